"""Frequencies, MACs and parameters before and after updating, one row each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior.configuration_modes import KEPT, UpdatedMode
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREY,
    VERMILION,
    hover,
    legend_below,
    name_rows,
    rows_of,
)
from bayes_ssi.results.predictions.predictions import PredictedMode

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class _Row(NamedTuple):
    """One mode: where it is drawn before, and (low, median, high) after; texts are for hovering."""

    name: str
    before: float
    after: Sequence[float] | FloatArray
    text_before: str
    text_after: str


def plot_frequency_change(
    modes: Sequence[UpdatedMode] | Sequence[PredictedMode],
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
    rows = []
    for mode in modes:
        label, hz = mode.label, data.mode(mode.label).frequency_hz
        before, *after = 100.0 * (np.array([mode.before_hz, *mode.after_hz]) / hz - 1.0)
        low, median, high = after
        rows.append(
            _Row(
                f"{label}\n{hz:.4g} Hz",
                before,
                after,
                f"mode {label} before: {mode.before_hz:.4g} Hz, {before:+.2f} %",
                f"mode {label} after: {mode.after_hz[1]:.4g} Hz, {median:+.2f} % "
                f"({low:+.2f} to {high:+.2f} %)",
            )
        )
    ax = rows_of(ax, [row.name for row in rows], 1.1)
    ax.axvline(0.0, color="black", linewidth=0.8)
    _draw(ax, rows, level)
    ax.set_xlabel("model / identified - 1 (%)")
    return ax


def plot_mac_change(modes: Sequence[UpdatedMode], ax: Axes | None = None) -> Axes:
    """MACs of paired modes with the identified shapes, before and after updating.

    Modes without an identified shape are left out.
    """
    rows = []
    for mode in modes:
        if mode.mac_after is not None and mode.mac_before is not None:
            low, median, high = mode.mac_after
            rows.append(
                _Row(
                    mode.label,
                    mode.mac_before,
                    mode.mac_after,
                    f"mode {mode.label} before: MAC {mode.mac_before:.4f}",
                    f"mode {mode.label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})",
                )
            )
    if not rows:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = rows_of(ax, [row.name for row in rows], 1.1)
    _draw(ax, rows, KEPT.level)
    ax.set_xlabel("MAC with the identified shape\n(1: the same shape)")
    return ax


def _draw(ax: Axes, rows: Sequence[_Row], level: float) -> None:
    """Rows of a circle before updating, joined to a square with its interval after."""
    for y, row in enumerate(rows):
        ax.plot([row.before, row.after[1]], [y, y], color=GREY, linewidth=0.8)
        (circle,) = ax.plot(row.before, y, "o", color=VERMILION, markerfacecolor="white",
                            markersize=6, label=None if y else "before: prior medians")  # fmt: skip
        hover(circle, row.text_before)
        _square(ax, y, row.after, f"after: posterior, {100 * level:g} %", row.text_after)
    name_rows(ax, [row.name for row in rows])
    ax.set_ylabel("identified mode")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)


def _square(
    ax: Axes, y: int, interval: Sequence[float] | FloatArray, label: str, text: str
) -> None:
    low, median, high = interval
    square = ax.errorbar(median, y, xerr=[[median - low], [high - median]], fmt="s", color=BLUE,
                         markersize=5, capsize=3, label=None if y else label)  # fmt: skip
    hover(square, text)


def plot_parameters(posterior: Posterior, ax: Axes | None = None) -> Axes:
    """The 90 % prior and posterior intervals of every parameter.

    Each row has a scale of its own: 0 is the prior median, -1 and 1 are the ends of the prior's
    90 % interval, and between them the scale is linear.
    """
    rows = posterior.summary
    ax = rows_of(ax, [row.name for row in rows], 1.3)
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    for y, row in enumerate(rows):
        low, median, high = posterior.prior_quantiles[y]
        after = (row.quantile_05, row.median, row.quantile_95)
        bar = ax.barh(y, 2.0, left=-1.0, height=0.62, color=GREY, alpha=0.25,
                      label=None if y else "prior, 90 %")  # fmt: skip
        hover(bar[0], f"{row.name} before: {median:.4g} ({low:.4g} to {high:.4g})")
        scaled = [
            (value - median) / (median - low if value < median else high - median)
            for value in after
        ]
        text = f"{row.name} after: {after[1]:.4g} ({after[0]:.4g} to {after[2]:.4g})"
        _square(ax, y, scaled, "posterior, 90 %", text)
    name_rows(ax, [row.name for row in rows])
    ax.set_xlabel("0: prior median\n-1 and 1: ends of the prior's 90 % interval")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax
