"""Frequencies, MACs and parameters before and after updating, a row each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREY,
    VERMILION,
    WIDTH,
    axes_of,
    hover,
    legend_below,
    name_rows,
)
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.posterior.updated_modes import LEVEL, UpdatedMode

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_frequency_change", "plot_mac_change", "plot_parameters"]


class ModeBeforeAndAfter(Protocol):
    """What a row of :func:`plot_frequency_change` shows; records of stored and of predicted modes
    have it."""

    @property
    def label(self) -> str: ...

    @property
    def before_hz(self) -> float: ...

    @property
    def after_hz(self) -> Sequence[Any]: ...


def plot_frequency_change(
    modes: Sequence[ModeBeforeAndAfter],
    data: ModalData,
    ax: Axes | None = None,
    *,
    level: float = LEVEL,
) -> Axes:
    """Frequencies of modes before and after updating, relative to the identified ones.

    Args:
        modes: label of an identified mode, the model's frequency at the prior medians (NaN where
            it has no such mode), and low, median and high of the posterior.
        data: the identified modes.
        ax: axes; new ones if None.
        level: probability of the intervals, for the legend.
    """
    identified = np.array([data.mode(mode.label).frequency_hz for mode in modes])
    before = np.array([mode.before_hz for mode in modes])
    after = np.array([mode.after_hz for mode in modes]).reshape(-1, 3)
    names = [f"{mode.label}\n{hz:.4g} Hz" for mode, hz in zip(modes, identified, strict=True)]
    errors = 100.0 * (np.c_[before, after] / identified[:, None] - 1.0)
    texts = [
        (
            f"mode {mode.label} before: {hz:.4g} Hz, {error:+.2f} %",
            f"mode {mode.label} after: {mode.after_hz[1]:.4g} Hz, {median:+.2f} % "
            f"({low:+.2f} to {high:+.2f} %)",
        )
        for mode, hz, (error, low, median, high) in zip(modes, before, errors, strict=True)
    ]
    ax = axes_of(ax, (WIDTH, 1.4 + 0.4 * len(modes)))
    ax.axvline(0.0, color="black", linewidth=0.8)
    _draw(ax, names, errors[:, 0], errors[:, 1:], texts, level)
    ax.set_xlabel("model / identified - 1 (%)")
    return ax


def plot_mac_change(modes: Sequence[UpdatedMode], ax: Axes | None = None) -> Axes:
    """MACs of paired modes with the identified shapes, before and after updating.

    Modes without an identified shape are left out.

    Raises:
        ValueError: no mode has an identified shape.
    """
    shown = [(mode, mode.mac_after) for mode in modes if mode.mac_after is not None]
    if not shown:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = axes_of(ax, (WIDTH, 1.4 + 0.35 * len(shown)))
    before = np.array([mode.mac_before for mode, _ in shown], dtype=np.float64)
    texts = [
        (
            f"mode {mode.label} before: MAC {first:.4f}",
            f"mode {mode.label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})",
        )
        for (mode, (low, median, high)), first in zip(shown, before, strict=True)
    ]
    after = np.array([mac for _, mac in shown])
    _draw(ax, [mode.label for mode, _ in shown], before, after, texts, LEVEL)
    ax.set_xlabel("MAC with the identified shape (1: the same shape)")
    return ax


def _draw(
    ax: Axes,
    names: Sequence[str],
    before: FloatArray,
    after: FloatArray,
    texts: Sequence[tuple[str, str]],
    level: float,
) -> None:
    """A row a mode: a circle before updating, a square with its interval after.

    Args:
        ax: axes.
        names: of the rows.
        before: (n,).
        after: (n, 3), low, median and high.
        texts: that circle and square show under the pointer.
        level: probability of the intervals.
    """
    ax.hlines(range(len(names)), before, after[:, 1], color=GREY, linewidth=0.8)
    for y, (of_circle, of_square) in enumerate(texts):
        (circle,) = ax.plot(before[y], y, "o", color=VERMILION, markerfacecolor="white",
                            markersize=6, label=None if y else "before: prior medians")  # fmt: skip
        hover(circle, of_circle)
        _square(ax, y, after[y], f"after: posterior, {100 * level:g} %", of_square)
    name_rows(ax, names)
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


def plot_parameters(
    posterior: Posterior,
    prior_quantiles: Mapping[str, Sequence[float]],
    ax: Axes | None = None,
) -> Axes:
    """The 90 % interval of every parameter, of its prior and of its posterior.

    Each row has a scale of its own: 0 is the prior median, -1 and 1 are the ends of the prior's
    90 % interval, and between them the scale is linear.

    Args:
        posterior: the draws.
        prior_quantiles: name of a parameter → 5 %, 50 % and 95 % quantile of its prior.
        ax: axes; new ones if None.
    """
    rows = posterior.summary
    ax = axes_of(ax, (WIDTH, 1.3 + 0.3 * len(rows)))
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    for y, row in enumerate(rows):
        low, median, high = prior_quantiles[row.name]
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
    ax.set_xlabel("0: prior median; -1 and 1: ends of the prior's 90 % interval")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax
