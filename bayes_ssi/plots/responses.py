"""Figures of responses and predictions, on given axes or new ones; they never sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    axes_of,
    draw_as_they_are,
    legend_below,
)
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_mac", "plot_time_history", "plot_transfer_functions"]

WIDE = (6.4, 3.2)  # inches
# A band is told from the next one by colour, by lightness and by the line of its median.
BANDS = ((BLUE, "-"), (ORANGE, "--"), (GREEN, "-."), (VERMILION, ":"))
# A logarithmic axis begins no lower than this share of its highest value.
LOWEST = 1e-4


def plot_transfer_functions(
    frequencies_hz: FloatArray,
    bands: Mapping[str, Band],
    ax: Axes | None = None,
    *,
    reference: tuple[str, FloatArray] | None = None,
    quantity: str = "amplitude",
    legend: bool = True,
) -> Axes:
    """Amplitudes of transfer functions with their bands, on a logarithmic axis.

    Args:
        frequencies_hz: (F,).
        bands: name → band of arrays (F,), at most four.
        ax: axes; new ones if None.
        reference: name and amplitude (F,) of what the bands are held against, a black line.
        quantity: what the amplitude is, with its unit.
        legend: whether to draw one.
    """
    ax = axes_of(ax, WIDE)
    _bands(ax, frequencies_hz, bands)
    if reference is not None:
        ax.plot(frequencies_hz, reference[1], color="black", linewidth=1.1, label=reference[0])
    ax.set_yscale("log")
    # At rest, and where it is annulled, a response is as low as rounding lets it.
    highest = max((float(np.max(band.high)) for band in bands.values()), default=1.0)
    ax.set_ylim(bottom=max(ax.get_ylim()[0], LOWEST * highest))
    ax.set_xlim(float(frequencies_hz[0]), float(frequencies_hz[-1]))
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel(quantity)
    ax.grid(alpha=0.3)
    if legend:
        legend_below(ax, columns=2)
    return ax


def plot_time_history(
    times: FloatArray,
    bands: Mapping[str, Band],
    ax: Axes | None = None,
    *,
    reference: tuple[str, FloatArray] | None = None,
    quantity: str = "response",
    legend: bool = True,
) -> Axes:
    """Time histories with the envelope of their draws.

    Arguments as those of :func:`plot_transfer_functions`, over ``times`` (s).
    """
    ax = axes_of(ax, WIDE)
    _bands(ax, times, bands)
    if reference is not None:
        ax.plot(times, reference[1], color="black", linewidth=0.7, label=reference[0])
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    ax.set_xlim(float(times[0]), float(times[-1]))
    ax.set_xlabel("time (s)")
    ax.set_ylabel(quantity)
    ax.grid(alpha=0.3)
    if legend:
        legend_below(ax, columns=2)
    return ax


def _bands(ax: Axes, x: FloatArray, bands: Mapping[str, Band]) -> None:
    if len(bands) > len(BANDS):
        raise ValueError(f"a figure holds at most {len(BANDS)} bands, got {len(bands)}")
    for (name, band), (colour, line) in zip(bands.items(), BANDS, strict=False):
        ax.fill_between(x, band.low, band.high, color=colour, alpha=0.35, linewidth=0)
        ax.plot(x, band.median, color=colour, linestyle=line, linewidth=1.2, label=name)


def plot_mac(
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    ax: Axes | None = None,
    *,
    of: tuple[str, str] = ("", ""),
) -> Axes:
    """A matrix of modal assurance criteria, values written in.

    Args:
        matrix: (n_rows, n_columns), as of :func:`~bayes_ssi.modal.mac`.
        rows, columns: names of the modes.
        ax: axes; new ones if None.
        of: what the rows and what the columns are.
    """
    ax = axes_of(ax, (1.2 + 0.55 * len(columns), 0.9 + 0.5 * len(rows)))
    image = ax.imshow(matrix, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:.2f}", ha="center", va="center", fontsize=8,
                    color="white" if value > 0.6 else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    draw_as_they_are([*ax.get_xticklabels(), *ax.get_yticklabels()])
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax
