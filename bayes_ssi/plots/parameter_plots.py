"""Parameters: before and after, posterior densities, and populations of many tests."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.packages import importing_without
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.plots.figure_style import (
    STYLE,
    figure_of,
    hover,
    interval_after,
    legend_below,
    legend_of_figure,
    rows_of,
    without_math,
    wrapped,
)
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_parameters(posterior: Posterior, ax: Axes | None = None) -> Axes:
    """The 90 % prior and posterior intervals of every parameter.

    Each row has a scale of its own: 0 is the prior median, -1 and 1 are the ends of the prior's
    90 % interval, and between them the scale is linear.
    """
    rows = posterior.summary
    ax = rows_of(ax, [row.name for row in rows], 1.3)
    ax.axvline(0.0, color=STYLE.grey, linewidth=0.8, linestyle=":")
    for y, row in enumerate(rows):
        low, median, high = posterior.prior_quantiles[y]
        after = (row.quantile_05, row.median, row.quantile_95)
        bar = ax.barh(y, 2.0, left=-1.0, height=0.62, color=STYLE.grey, alpha=0.25,
                      label=None if y else "prior, 90 %")  # fmt: skip
        hover(bar[0], f"{row.name} before: {median:.4g} ({low:.4g} to {high:.4g})")
        scaled = [
            (value - median) / (median - low if value < median else high - median)
            for value in after
        ]
        text = f"{row.name} after: {after[1]:.4g} ({after[0]:.4g} to {after[2]:.4g})"
        interval_after(ax, y, scaled, "posterior, 90 %", text)
    ax.set_xlabel("0: prior median\n-1 and 1: ends of the prior's 90 % interval")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax


def plot_corner(
    posterior: Posterior, figure: Figure | None = None, parameters: Sequence[str] | None = None
) -> Figure:
    """Marginal and joint posterior densities of all or some of the parameters.

    Dashed lines are the 5 %, 50 % and 95 % quantiles; contours hold 39 % and 86 % of the draws, as
    one and two standard deviations of a normal density do. Panels leave out the outermost 0.3 % of
    the draws.

    Args:
        figure: to draw on; a new one if None.
        parameters: names of the parameters; all if None.
    """
    names = posterior.parameter_names if parameters is None else tuple(parameters)
    require_known("plot_corner: no parameter", names, posterior.parameter_names)
    values = posterior.values[:, [posterior.parameter_names.index(name) for name in names]]
    n = len(names)
    # Of the draws: those within three standard deviations of a normal density, so that a single
    # draw far away does not shrink all others to a point; and within one and two of a density of
    # two variables.
    shown, contours = 0.9973, 1.0 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)
    figure = figure_of(figure, (0.8 + 1.5 * n, 1.4 + 1.5 * n))
    corner = import_corner()
    from matplotlib.ticker import MaxNLocator

    with warnings.catch_warnings():
        # Constrained layout replaces corner's own.
        warnings.filterwarnings("ignore", "This figure was using a layout engine", UserWarning)
        corner.corner(
            values, bins=30, range=[shown] * n, fig=figure, color=STYLE.blue, quantiles=LEVELS,
            smooth=1.0, levels=contours, plot_datapoints=False, plot_density=False,
            fill_contours=True, no_fill_contours=True, max_n_ticks=3,
        )  # fmt: skip
    panels = np.array(figure.axes, dtype=object).reshape(n, n)
    # Panels above the diagonal are empty; the layout need not look for what they hold.
    for empty in panels[np.triu_indices(n, 1)]:
        empty.set(visible=False, in_layout=False)
    for i, (name, draws) in enumerate(zip(names, values.T, strict=True)):
        low, median, high = np.quantile(draws, LEVELS)
        # In a panel of 1.5 in, a name may take 1.3 in.
        label = wrapped(name, 1.3, STYLE.small)
        title = f"{label}\n{median:.4g}\n({low:.4g} to {high:.4g})"
        panels[i, i].set_title(title, fontsize=STYLE.small, loc="center", parse_math=False)
        panels[-1, i].set_xlabel(label, fontsize=STYLE.small, parse_math=False)
        if i:
            panels[i, 0].set_ylabel(label, fontsize=STYLE.small, parse_math=False)
    for ax in panels.flat:
        # Three numbers at most, none of them at a corner, where those of two panels would meet.
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_locator(), MaxNLocator):
                axis.set_major_locator(MaxNLocator(3, prune="both", min_n_ticks=1))
        ax.tick_params(labelsize=STYLE.small, labelrotation=0)
    note = "median, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
    figure.suptitle(f"{posterior.name}\n{note}", fontsize=10, parse_math=False)
    return figure


@cache
def import_corner() -> Any:
    """The module corner, which takes arrays without arviz."""
    with importing_without("arviz", package="corner"):
        import corner
    return corner


def plot_population(hierarchy: Hierarchy, figure: Figure | None = None) -> Figure:
    """Each parameter's 90 % interval in every test by itself, and the most probable population's.

    Along the covariate, where there is one. Dark: the population's centre, median and 90 %
    interval. Light: the 90 % interval of the next test, averaged over all populations.
    """
    k = len(hierarchy.names)
    figure = figure_of(figure, (STYLE.width, 1.0 + 2.1 * k))
    panels = figure.subplots(k, 1, squeeze=False, sharex=True)[:, 0]
    tests, scale = hierarchy.tests, hierarchy.covariate
    at = np.arange(len(tests), dtype=float)
    grid = np.array([-0.5, len(tests) - 0.5])
    values: list[float | None] = [None, None]
    if scale is not None:
        at = np.array([test.covariate for test in tests], dtype=float)
        margin = 0.03 * np.ptp(at)
        grid = np.linspace(at.min() - margin, at.max() + margin, 25)
        values = grid.tolist()
    centres, nexts = (np.stack(each) for each in zip(*_bands(hierarchy, values), strict=True))
    for i, (ax, parameter) in enumerate(zip(panels, hierarchy.of_population, strict=True)):
        low, _, high = nexts[:, :, i].T
        ax.fill_between(grid, low, high, color=STYLE.blue, alpha=0.15, linewidth=0,
                        label="next test, 90 % interval")  # fmt: skip
        low, middle, high = centres[:, :, i].T
        ax.fill_between(grid, low, high, color=STYLE.blue, alpha=0.4, linewidth=0,
                        label="centre of the population, 90 % interval")  # fmt: skip
        ax.plot(grid, middle, color=STYLE.blue)
        _draw_tests(ax, hierarchy, at, i)
        ax.set_ylabel(f"{parameter.name} ({parameter.unit})" if parameter.unit else parameter.name)
        without_math(ax.yaxis.label)
    panels[-1].set_xlabel("test" if scale is None else scale.name)
    without_math(panels[-1].xaxis.label)
    if scale is None and len(tests) <= STYLE.most_named_tests:
        panels[-1].set_xticks(at, [test.name for test in tests], rotation=30, ha="right")
        without_math(*panels[-1].get_xticklabels())
    title = f"{hierarchy.model_class!r}: {hierarchy.best.name}"
    panels[0].set_title(title, parse_math=False)
    legend_of_figure(figure, panels)
    return figure


def _bands(
    hierarchy: Hierarchy, values: Sequence[float | None]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Quantiles (3, k) of the centre and of the next test, at each value of the covariate."""
    best, probabilities = hierarchy.best, [0.05, 0.5, 0.95]
    for value in values:
        drawn = hierarchy.next_test(4000, value)[:, hierarchy.population_columns]
        centre = np.quantile(hierarchy.centres(best, value), probabilities, axis=0)
        yield centre, np.quantile(drawn, probabilities, axis=0)


def _draw_tests(ax: Axes, hierarchy: Hierarchy, at: FloatArray, i: int) -> None:
    for x, test in zip(at, hierarchy.tests, strict=True):
        low, median, high = test.intervals[i]
        label = None if test is not hierarchy.tests[0] else "each test by itself, 90 % interval"
        point = ax.errorbar(
            x, median, [[median - low], [high - median]], fmt="o", color=STYLE.vermilion,
            markersize=3, linewidth=0.8, label=label,
        )  # fmt: skip
        hover(point, f"{test.name}: {median:.4g}, 90 % interval {low:.4g} to {high:.4g}")
