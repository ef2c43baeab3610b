"""Figures of frequencies and MACs before and after updating."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.plots.style import (
    BLUE,
    GREY,
    VERMILION,
    axes_of,
    draw_as_they_are,
    hover,
    legend_below,
)
from bayes_ssi.posterior.updated_modes import LEVEL, UpdatedModes
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_frequency_change", "plot_mac_change", "plot_modes_before_and_after"]


def plot_frequency_change(
    labels: Sequence[str],
    identified_hz: FloatArray,
    before_hz: FloatArray,
    after: Band,
    ax: Axes | None = None,
    *,
    level: float = 0.95,
) -> Axes:
    """Model frequencies before and after updating, relative to the identified ones.

    Args:
        labels: of the identified modes.
        identified_hz: (n,).
        before_hz: (n,), of the model at the prior medians; NaN where it has no such mode.
        after: bands (n,) of the posterior.
        ax: axes; new ones if None.
        level: that the bands hold, for the legend.
    """
    ax = axes_of(ax, (6.4, 1.4 + 0.4 * len(labels)))
    before, low, median, high = (
        100.0 * (np.asarray(part) / identified_hz - 1.0) for part in (before_hz, *after)
    )
    ax.axvline(0.0, color="black", linewidth=0.8)
    told = [
        (
            f"mode {label} before: {before_hz[i]:.4g} Hz, {before[i]:+.2f} %",
            f"mode {label} after: {after.median[i]:.4g} Hz, {median[i]:+.2f} % "
            f"({low[i]:+.2f} to {high[i]:+.2f} %)",
        )
        for i, label in enumerate(labels)
    ]
    names = [f"{label}\n{f:.4g} Hz" for label, f in zip(labels, identified_hz, strict=True)]
    _changes(ax, names, before, Band(low, median, high), told, level)
    ax.set_xlabel("model / identified - 1 (%)")
    return ax


def plot_modes_before_and_after(
    modes: UpdatedModes, data: ModalData, ax: Axes | None = None
) -> Axes:
    """Frequencies of the paired modes before and after updating, as errors in per cent."""
    labels = [mode.label for mode in modes.modes]
    after = np.array([mode.after_hz for mode in modes.modes]).T
    identified = np.array([data.mode(label).frequency_hz for label in labels])
    before = np.array([mode.before_hz for mode in modes.modes])
    return plot_frequency_change(labels, identified, before, Band(*after), ax, level=LEVEL)


def plot_mac_change(modes: UpdatedModes, ax: Axes | None = None) -> Axes:
    """MACs of the paired modes with the identified shapes, before and after updating.

    Raises:
        ValueError: no mode has a shape that is scored.
    """
    scored = [mode for mode in modes.modes if mode.mac_after is not None]
    if not scored:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = axes_of(ax, (6.4, 1.4 + 0.35 * len(scored)))
    before = np.array(
        [np.nan if mode.mac_before is None else mode.mac_before for mode in scored], dtype=float
    )
    after = Band(*np.array([mode.mac_after for mode in scored], dtype=float).T)
    told = [
        (
            f"mode {mode.label} before: MAC {first:.4f}",
            f"mode {mode.label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})",
        )
        for mode, first, low, median, high in zip(scored, before, *after, strict=True)
    ]
    _changes(ax, [mode.label for mode in scored], before, after, told, LEVEL)
    ax.set_xlabel("MAC with the identified shape (1: the same shape)")
    return ax


def _changes(
    ax: Axes,
    names: Sequence[str],
    before: FloatArray,
    after: Band,
    told: Sequence[tuple[str, str]],
    level: float,
) -> None:
    """A row a mode: a circle before updating, a square with its band after it.

    Args:
        ax: axes.
        names: of the rows.
        before: (n,).
        after: bands (n,).
        told: what is told of the circle and of the square where they are pointed at.
        level: that the bands hold, for the legend.
    """
    rows = np.arange(len(names))
    ax.hlines(rows, before, after.median, color=GREY, linewidth=0.8)
    circle, square = "before: prior medians", f"after: posterior, {100 * level:g} %"
    for y, (low, median, high) in enumerate(zip(*after, strict=True)):
        (first,) = ax.plot(before[y], y, "o", color=VERMILION, markerfacecolor="white",
                           markersize=6, label=None if y else circle)  # fmt: skip
        then = ax.errorbar(median, y, xerr=[[median - low], [high - median]], fmt="s", color=BLUE,
                           markersize=5, capsize=3, label=None if y else square)  # fmt: skip
        hover(first, told[y][0])
        hover(then, told[y][1])
    ax.set_yticks(rows, names)
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_ylabel("identified mode")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
