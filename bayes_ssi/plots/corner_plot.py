"""Marginal and joint posterior densities of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.figure_style import BLUE, figure_of, letters_across, without_math
from bayes_ssi.posterior.posterior import Posterior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot_corner"]

# Probability within one and within two standard deviations of a normal density of two variables.
CONTOURS = 1.0 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)


def plot_corner(
    posterior: Posterior,
    figure: Figure | None = None,
    parameters: Sequence[str] | None = None,
    bins: int = 30,
) -> Figure:
    """Marginal and joint posterior densities of the parameters, or of those that are named.

    Dashed lines are the 5 %, 50 % and 95 % quantiles; contours hold 39 % and 86 % of the draws, as
    one and two standard deviations of a normal density do.

    Args:
        posterior: the draws.
        figure: to draw on; a new one if None.
        parameters: names; all if None.
        bins: of the histograms, across the range of a parameter's draws.

    Raises:
        ValueError: there is no parameter of such a name.
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
    # Of a panel of 1.5 in, 1.2 in hold its title.
    points = 9.0 * min(1.0, letters_across(1.2) / max(map(len, names)))
    figure = figure_of(figure, (0.6 + 1.5 * n, 1.4 + 1.5 * n))
    axes: Any = figure.subplots(n, n, squeeze=False, sharex="col")
    for row, column in np.ndindex(n, n):
        ax = axes[row, column]
        if column > row:
            ax.remove()
        elif column == row:
            _marginal(ax, values[:, row], bins, names[row], min(7.5, points))
        else:
            _joint(ax, values[:, column], values[:, row], bins)
        ax.tick_params("both", labelsize=7, labelleft=column == 0 < row)
        ax.tick_params("x", rotation=45)
        ax.locator_params(nbins=4)
    for i, name in enumerate(names):
        without_math(axes[-1, i].set_xlabel(name, fontsize=points))
        if i:
            without_math(axes[i, 0].set_ylabel(name, fontsize=points))
    note = "median, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
    without_math(figure.suptitle(f"{posterior.name}\n{note}", fontsize=10))
    return figure


def _marginal(ax: Axes, values: FloatArray, bins: int, name: str, points: float) -> None:
    low, median, high = quantiles = np.quantile(values, [0.05, 0.5, 0.95])
    ax.hist(values, bins=bins, histtype="step", color=BLUE)
    for value in quantiles:
        ax.axvline(value, color=BLUE, linestyle="--", linewidth=0.9)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    title = f"{name}\n{median:.4g}\n({low:.4g} to {high:.4g})"
    without_math(ax.set_title(title, fontsize=points, loc="center"))


def _joint(ax: Axes, x: FloatArray, y: FloatArray, bins: int) -> None:
    """Contours of a histogram, smoothed by a Gaussian of one bin."""
    from scipy.ndimage import gaussian_filter

    counts, *edges = np.histogram2d(x, y, bins=bins)
    centres = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    density = gaussian_filter(counts, 1.0).T
    falling = np.sort(density, axis=None)[::-1]
    held = np.cumsum(falling) / falling.sum()
    outer, inner = falling[np.searchsorted(held, CONTOURS[::-1])]
    ax.contourf(*centres, density, [outer, inner, np.inf], colors=[(BLUE, 0.2), (BLUE, 0.5)])
    ax.contour(*centres, density, np.unique([outer, inner]), colors=[BLUE], linewidths=0.9)
    ax.set_ylim(edges[1][0], edges[1][-1])
