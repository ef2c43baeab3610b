"""Transfer functions and time histories with their bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots.figure_style import COLOURS, GREY, LINES, WIDTH, axes_of, legend_below
from bayes_ssi.results.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
        frequencies_hz: (F,), frequencies of the amplitudes.
        bands: name → band of arrays (F,), at most four.
        ax: axes; new ones if None.
        reference: name and amplitude (F,) of a black line to compare the bands with.
        quantity: name and unit of the amplitude.
    """
    ax = _draw(ax, frequencies_hz, bands, reference, 1.1)
    ax.set_yscale("log")
    highest = max((float(np.max(band.high)) for band in bands.values()), default=1.0)
    # Where a response vanishes or cancels out, only rounding errors are left: show 4 decades.
    ax.set_ylim(bottom=max(ax.get_ylim()[0], 1e-4 * highest))
    _label(ax, "frequency (Hz)", quantity, legend)
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

    Arguments are as in :func:`plot_transfer_functions`, over ``times`` (s).
    """
    ax = _draw(ax, times, bands, reference, 0.7)
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    _label(ax, "time (s)", quantity, legend)
    return ax


def _draw(
    ax: Axes | None,
    x: FloatArray,
    bands: Mapping[str, Band],
    reference: tuple[str, FloatArray] | None,
    linewidth: float,
) -> Axes:
    if len(bands) > len(LINES):
        raise ValueError(f"a figure holds at most {len(LINES)} bands, got {len(bands)}")
    ax = axes_of(ax, (WIDTH, 3.2))
    for (name, band), colour, line in zip(bands.items(), COLOURS, LINES, strict=False):
        ax.fill_between(x, band.low, band.high, color=colour, alpha=0.35, linewidth=0)
        ax.plot(x, band.median, color=colour, linestyle=line, linewidth=1.2, label=name)
    if reference is not None:
        name, curve = reference
        ax.plot(x, curve, color="black", linewidth=linewidth, label=name)
    ax.set_xlim(float(x[0]), float(x[-1]))
    ax.grid(alpha=0.3)
    return ax


def _label(ax: Axes, x: str, y: str, legend: bool) -> None:
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    if legend:
        legend_below(ax, columns=2)
