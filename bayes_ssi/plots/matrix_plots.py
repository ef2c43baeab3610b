"""Annotated matrices: MACs, pairing probabilities, sensitivities of modes to parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.calibration.modal_sensitivities import ModalSensitivities
from bayes_ssi.inference.likelihood.inferred_pairing import InferredPairing
from bayes_ssi.plots.figure_style import SMALL, axes_of, without_math

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage


def plot_mac(
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    ax: Axes | None = None,
    *,
    of: tuple[str, str] = ("", ""),
) -> Axes:
    """A matrix of modal assurance criteria, with the values written in its cells.

    Args:
        matrix: (n_rows, n_columns), as of :func:`~bayes_ssi.structures.modal.mac`; NaN is left
            blank.
        ax: axes; new ones if None.
    """
    ax = axes_of(ax, (2.0 + 0.55 * len(columns), 1.1 + 0.45 * len(rows)))
    image = _draw(ax, matrix, rows, columns, of, decimals=2)
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax


def plot_pairing(inferred: InferredPairing, n_modes: int, ax: Axes | None = None) -> Axes:
    """The probability that each identified mode is each model mode, or spurious."""
    labels = list(inferred.of_modes)
    columns = ["spurious", *(str(number) for number in range(1, n_modes + 1))]
    ax = axes_of(ax, (1.3 + 0.5 * len(columns), 1.1 + 0.34 * len(labels)))
    probabilities = np.array(
        [[inferred.of_modes[label].get(i, 0.0) for i in range(n_modes + 1)] for label in labels]
    )
    # Values that round to 0.000 are left blank.
    shown = np.where(probabilities < 0.0005, np.nan, probabilities)
    _draw(ax, shown, labels, columns, ("identified mode", "model mode"), decimals=3)
    return ax


def plot_modal_sensitivities(sensitivities: ModalSensitivities, ax: Axes | None = None) -> Axes:
    """How many percent each frequency rises where a parameter rises by one.

    Parameters proposed for updating are in bold.
    """
    modes, names = sensitivities.modes, sensitivities.parameters
    ax = axes_of(ax, (2.4 + 0.55 * len(names), 1.3 + 0.3 * len(modes)))
    matrix = sensitivities.of_frequencies
    largest = max(float(np.abs(matrix).max()), np.finfo(float).tiny)
    image = ax.imshow(matrix, cmap="RdBu_r", vmin=-largest, vmax=largest, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        ax.text(k, i, f"{value:+.2f}" if abs(value) >= 0.005 else "", ha="center", va="center",
                fontsize=SMALL,
                color="white" if abs(value) > 0.6 * largest else "black")  # fmt: skip
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(modes)), modes)
    for label in ax.get_xticklabels():
        if label.get_text() in sensitivities.proposed:
            label.set_fontweight("bold")
    without_math(*ax.get_xticklabels(), *ax.get_yticklabels())
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    ax.set_ylabel("mode")
    ax.set_xlabel("parameter; bold: proposed for updating")
    ax.figure.colorbar(image, ax=ax, label="% of frequency per % of parameter")
    return ax


def _draw(
    ax: Axes,
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    of: tuple[str, str],
    decimals: int,
) -> AxesImage:
    image = ax.imshow(matrix, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:.{decimals}f}", ha="center", va="center", fontsize=SMALL,
                    color="white" if value > 0.6 else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    without_math(*ax.get_xticklabels(), *ax.get_yticklabels())
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    return image
