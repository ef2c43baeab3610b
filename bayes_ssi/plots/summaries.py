"""Figures of what was learnt about parameters, and of how a ranking moves with settings.

Every function draws on given axes or on new ones, and never samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    axes_of,
    draw_as_they_are,
    hover,
    legend_below,
)
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.comparison import probability_text
from bayes_ssi.ranking.sensitivity import Sensitivity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_parameters", "plot_sensitivity"]

CLASSES_DRAWN = 5
MARKERS = "osD^v"
# Nats from which on an axis is logarithmic beyond 1.
FAR = 30.0


def plot_parameters(
    posterior: Posterior,
    prior_quantiles: Mapping[str, Sequence[float]],
    ax: Axes | None = None,
) -> Axes:
    """Every parameter before and after: its prior's and its posterior's 90 % interval.

    Each row has a scale of its own: 0 is the prior median, -1 and 1 are the ends of the prior's
    90 % interval, and between them the scale is linear.

    Args:
        posterior: the draws.
        prior_quantiles: name of a parameter → 5 %, 50 % and 95 % quantile of its prior.
        ax: axes; new ones if None.
    """
    rows = posterior.summary
    ax = axes_of(ax, (6.4, 1.3 + 0.3 * len(rows)))
    ax.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    for y, row in enumerate(rows):
        prior = np.asarray(prior_quantiles[row.name])
        own = np.array([row.quantile_05, row.median, row.quantile_95])
        low, median, high = _relative(own, prior)
        band = ax.barh(y, 2.0, left=-1.0, height=0.62, color=GREY, alpha=0.25,
                       label="prior, 90 %" if y == 0 else None)  # fmt: skip
        hover(band[0], f"{row.name} before: {prior[1]:.4g} ({prior[0]:.4g} to {prior[2]:.4g})")
        bar = ax.errorbar(median, y, xerr=[[median - low], [high - median]], fmt="s", color=BLUE,
                          markersize=5, capsize=3,
                          label="posterior, 90 %" if y == 0 else None)  # fmt: skip
        hover(bar, f"{row.name} after: {own[1]:.4g} ({own[0]:.4g} to {own[2]:.4g})")
    ax.set_yticks(range(len(rows)), [row.name for row in rows])
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_xlabel("0: prior median; -1 and 1: ends of the prior's 90 % interval")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax


def _relative(values: np.ndarray, prior: np.ndarray) -> np.ndarray:
    low, median, high = prior
    return np.where(
        values < median, (values - median) / (median - low), (values - median) / (high - median)
    )


def plot_sensitivity(found: Sensitivity, ax: Axes | None = None) -> Axes:
    """How a ranking moves: of each class, log of its probability over that of the first class.

    A row is a setting, the first one the ranking as it is. A class right of the line is more
    probable than the class that comes first as it is. At most the five best classes are drawn.
    """
    first, *others = found.rows[0].ranked[:CLASSES_DRAWN]
    ax = axes_of(ax, (6.4, 1.4 + 0.3 * len(found.rows)))
    ax.axvline(0.0, color="black", linewidth=0.8, label=f"{first}: first as it is")
    for y, row in enumerate(found.rows):
        if row.best != first:
            ax.axhspan(y - 0.5, y + 0.5, color=VERMILION, alpha=0.12, linewidth=0)
        for name, colour, marker in zip(others, (BLUE, ORANGE, GREEN, VERMILION), MARKERS,
                                        strict=False):  # fmt: skip
            share, best = row.probabilities[name], row.probabilities[first]
            if share <= 0.0 or best <= 0.0:
                continue
            (point,) = ax.plot(np.log(share / best), y, marker, color=colour, markersize=5,
                               linestyle="none", label=name if y == 0 else None)  # fmt: skip
            hover(point, f"{name}, {row.name}: probability {probability_text(share)}")
    if max(map(abs, ax.get_xlim())) > FAR:
        # Classes far behind would press together those that matter.
        ax.set_xscale("symlog", linthresh=1.0)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.margins(x=0.06)
    ax.set_yticks(range(len(found.rows)), [row.name for row in found.rows])
    ax.set_ylim(len(found.rows) - 0.5, -0.5)
    ax.set_xlabel("log of the probability over that of the first class (nats)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=3)
    return ax
