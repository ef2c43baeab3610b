"""Modes of a model: before and after updating, and matrices of MACs, pairings and sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.calibration.modal_sensitivities import ModalSensitivities
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.posterior.model_at_draws import KEPT, UpdatedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    STYLE,
    axes_of,
    hover,
    interval_after,
    legend_below,
    rows_of,
    without_math,
)
from bayes_ssi.results.predictions.predictions import PredictedMode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage


def plot_frequency_change(
    modes: Sequence[UpdatedMode | PredictedMode],
    data: ModalData,
    ax: Axes | None = None,
    *,
    level: float = KEPT.level,
) -> Axes:
    """Frequencies of modes before and after updating, relative to the identified ones.

    Args:
        ax: axes; new ones if None.
        level: probability of the intervals.
    """
    identified = [data.mode(mode.label).frequency_hz for mode in modes]
    names = [f"{mode.label}\n{hz:.4g} Hz" for mode, hz in zip(modes, identified, strict=True)]
    ax = rows_of(ax, names, 1.1)
    ax.axvline(0.0, color="black", linewidth=0.8)
    for y, (mode, hz) in enumerate(zip(modes, identified, strict=True)):
        before, *after = 100.0 * (np.array([mode.before_hz, *mode.after_hz]) / hz - 1.0)
        low, median, high = after
        _draw_change(
            ax, y, before, after, level,
            f"mode {mode.label} before: {mode.before_hz:.4g} Hz, {before:+.2f} %",
            f"mode {mode.label} after: {mode.after_hz[1]:.4g} Hz, {median:+.2f} % "
            f"({low:+.2f} to {high:+.2f} %)",
        )  # fmt: skip
    return _finished(ax, "model / identified - 1 (%)")


def plot_mac_change(modes: Sequence[UpdatedMode], ax: Axes | None = None) -> Axes:
    """MACs of paired modes with the identified shapes, before and after updating.

    Modes without an identified shape are left out.
    """
    macs = {
        mode.label: (mode.mac_before, mode.mac_after)
        for mode in modes
        if mode.mac_before is not None and mode.mac_after is not None
    }
    if not macs:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = rows_of(ax, list(macs), 1.1)
    for y, (label, (before, after)) in enumerate(macs.items()):
        low, median, high = after
        _draw_change(
            ax, y, before, after, KEPT.level, f"mode {label} before: MAC {before:.4f}",
            f"mode {label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})",
        )  # fmt: skip
    return _finished(ax, "MAC with the identified shape\n(1: the same shape)")


def _draw_change(
    ax: Axes, y: int, before: float, after: Sequence[float], level: float, *texts: str
) -> None:
    """A circle before updating, joined to a square with its interval (low, median, high) after."""
    ax.plot([before, after[1]], [y, y], color=STYLE.grey, linewidth=0.8)
    (circle,) = ax.plot(before, y, "o", color=STYLE.vermilion, markerfacecolor="white",
                        markersize=6, label=None if y else "before: prior medians")  # fmt: skip
    hover(circle, texts[0])
    interval_after(ax, y, after, f"after: posterior, {100 * level:g} %", texts[1])


def _finished(ax: Axes, label: str) -> Axes:
    ax.set_xlabel(label)
    ax.set_ylabel("identified mode")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax


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
    image = _annotate(ax, matrix, rows, columns, of, ".2f")
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
    _annotate(ax, shown, labels, columns, ("identified mode", "model mode"), ".3f")
    return ax


def plot_modal_sensitivities(sensitivities: ModalSensitivities, ax: Axes | None = None) -> Axes:
    """How many percent each frequency rises where a parameter rises by one.

    Parameters proposed for updating are in bold.
    """
    modes, names = sensitivities.modes, sensitivities.parameters
    ax = axes_of(ax, (2.4 + 0.55 * len(names), 1.3 + 0.3 * len(modes)))
    matrix = sensitivities.of_frequencies
    largest = max(float(np.abs(matrix).max()), np.finfo(float).tiny)
    # Values that round to 0.00 are left blank.
    shown = np.where(np.abs(matrix) < 0.005, np.nan, matrix)
    of = ("mode", "parameter; bold: proposed for updating")
    image = _annotate(ax, shown, modes, names, of, "+.2f", -largest, largest, "RdBu_r")
    for label in ax.get_xticklabels():
        if label.get_text() in sensitivities.proposed:
            label.set_fontweight("bold")
    ax.figure.colorbar(image, ax=ax, label="% of frequency per % of parameter")
    return ax


def _annotate(
    ax: Axes,
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    of: tuple[str, str],
    form: str,
    least: float = 0.0,
    most: float = 1.0,
    colours: str = "Blues",
) -> AxesImage:
    """A matrix in colours from ``least`` to ``most``, with its values where they are finite."""
    image = ax.imshow(matrix, cmap=colours, vmin=least, vmax=most, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:{form}}", ha="center", va="center", fontsize=STYLE.small,
                    color="white" if abs(value) > 0.6 * most else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    without_math(*ax.get_xticklabels(), *ax.get_yticklabels())
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    return image
