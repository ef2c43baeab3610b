"""Marginal and joint posterior densities of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.figure_style import BLUE, SMALL, figure_of, wrapped
from bayes_ssi.posterior.posterior import Posterior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

QUANTILES = (0.05, 0.5, 0.95)
# Probability within two and within one standard deviations of a normal density of two variables.
CONTOURS = 1.0 - np.exp(-0.5 * np.array([2.0, 1.0]) ** 2)
# Opacity of the two areas: the contour of the outer one remains visible on it.
AREAS = (0.35, 1.0)
# Shares of the draws between which a panel extends: three standard deviations of a normal density,
# so that a single draw far away does not shrink all others to a point.
RANGE = (0.00135, 0.99865)
BINS = 30
# Weights of neighbouring bins, whose counts are smoothed: a normal density of one bin's width.
KERNEL = np.exp(-0.5 * np.arange(-3.0, 4.0) ** 2)
PANEL = 1.5  # inches


def plot_corner(
    posterior: Posterior, figure: Figure | None = None, parameters: Sequence[str] | None = None
) -> Figure:
    """Marginal and joint posterior densities of all or some of the parameters.

    Dashed lines are the 5 %, 50 % and 95 % quantiles; contours hold 39 % and 86 % of the draws, as
    one and two standard deviations of a normal density do. Panels leave out the outermost 0.1 % of
    the draws at either end. The axes of the figure are those of the panels on and below the
    diagonal, row by row.

    Args:
        posterior: the draws.
        figure: to draw on; a new one if None.
        parameters: names of the parameters; all if None.

    Raises:
        ValueError: there is no parameter with one of these names.
    """
    names = posterior.parameter_names if parameters is None else tuple(parameters)
    unknown = [name for name in names if name not in posterior.parameter_names]
    if unknown:
        raise ValueError(
            f"plot_corner: no parameter {unknown[0]!r}; choose from "
            f"{', '.join(map(repr, posterior.parameter_names))}"
        )
    values = posterior.values[:, [posterior.parameter_names.index(name) for name in names]]
    n = len(names)
    figure = figure_of(figure, (0.8 + PANEL * n, 1.4 + PANEL * n))
    grid = figure.add_gridspec(n, n)
    edges = [_edges(draws) for draws in values.T]
    # In a panel, a name may take all but 0.2 in.
    labels = [wrapped(name, PANEL - 0.2, SMALL) for name in names]
    for row in range(n):
        for column in range(row + 1):
            ax = figure.add_subplot(grid[row, column])
            ax.set_xlim(edges[column][0], edges[column][-1])
            if row == column:
                _draw_marginal(ax, values[:, row], edges[row], labels[row])
            else:
                ax.set_ylim(edges[row][0], edges[row][-1])
                _draw_joint(ax, values[:, [column, row]], edges[column], edges[row])
            # Only panels at the left and at the bottom have numbers.
            _number(ax.xaxis, labels[column] if row == n - 1 else None)
            _number(ax.yaxis, labels[row] if column == 0 < row else None)
    note = "median, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
    figure.suptitle(f"{posterior.name}\n{note}", fontsize=10, parse_math=False)
    return figure


def _edges(draws: FloatArray) -> FloatArray:
    """Edges of the bins of a parameter, (BINS + 1,)."""
    low, high = np.quantile(draws, RANGE)
    edges: FloatArray = np.histogram_bin_edges([], BINS, (low, high))  # also of a constant
    return edges


def _draw_marginal(ax: Axes, draws: FloatArray, edges: FloatArray, label: str) -> None:
    counts, _ = np.histogram(draws, edges)
    ax.stairs(counts, edges, color=BLUE)
    ax.set_ylim(0.0, 1.1 * max(counts.max(), 1))
    low, median, high = np.quantile(draws, QUANTILES)
    for quantile in (low, median, high):
        ax.axvline(quantile, color=BLUE, linestyle="--")
    title = f"{label}\n{median:.4g}\n({low:.4g} to {high:.4g})"
    ax.set_title(title, fontsize=SMALL, loc="center", parse_math=False)


def _draw_joint(ax: Axes, draws: FloatArray, x_edges: FloatArray, y_edges: FloatArray) -> None:
    counts, _, _ = np.histogram2d(draws[:, 0], draws[:, 1], bins=(x_edges, y_edges))
    density = _smoothed(_smoothed(counts).T)
    levels = [_level(density, share) for share in CONTOURS]
    if not levels[0] < levels[1] < density.max():  # of a constant
        return
    # To the edges of the panel, not only to the centres of its outermost bins.
    x, y = (
        np.pad(0.5 * (at[1:] + at[:-1]), 1, constant_values=(at[0], at[-1]))
        for at in (x_edges, y_edges)
    )
    density = np.pad(density, 1, mode="edge")
    ax.contourf(x, y, density, [*levels, np.inf], colors=[(BLUE, each) for each in AREAS])
    ax.contour(x, y, density, levels, colors=BLUE)


def _smoothed(counts: FloatArray) -> FloatArray:
    """Counts (n, m) smoothed along their first axis; what is beyond the edge mirrors it."""
    half = len(KERNEL) // 2
    mirrored = np.pad(counts, ((half, half), (0, 0)), mode="symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(mirrored, len(KERNEL), axis=0)
    return windows @ (KERNEL / KERNEL.sum())


def _level(density: FloatArray, share: float) -> float:
    """The density above which there is a share of the draws."""
    sorted_density = np.sort(density, axis=None)[::-1]
    within = np.cumsum(sorted_density) <= share * sorted_density.sum()
    return float(sorted_density[max(0, within.sum() - 1)])


def _number(axis: Any, label: str | None) -> None:
    """Number and name an axis; without ``label`` it remains empty."""
    if label is None:
        axis.set_ticks([])
        return
    from matplotlib.ticker import MaxNLocator

    # Three numbers at most, none of them at a corner, where those of two panels would meet.
    axis.set_major_locator(MaxNLocator(3, prune="both", min_n_ticks=1))
    axis.set_tick_params(labelsize=SMALL)
    axis.set_label_text(label, fontsize=SMALL, parse_math=False)
