"""Parameters in many tests of one structure, and the population that they come from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.plots.figure_style import (
    BLUE,
    STYLE,
    VERMILION,
    WIDTH,
    figure_of,
    hover,
    legend_of_figure,
    without_math,
)
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_population(hierarchy: Hierarchy, figure: Figure | None = None) -> Figure:
    """Each parameter's 90 % interval in every test by itself, and the most probable population's.

    Along the covariate, where there is one. Dark: the population's centre, median and 90 %
    interval. Light: the 90 % interval of the next test, averaged over all populations.
    """
    k = len(hierarchy.names)
    figure = figure_of(figure, (WIDTH, 1.0 + 2.1 * k))
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
        ax.fill_between(grid, low, high, color=BLUE, alpha=0.15, linewidth=0,
                        label="next test, 90 % interval")  # fmt: skip
        low, middle, high = centres[:, :, i].T
        ax.fill_between(grid, low, high, color=BLUE, alpha=0.4, linewidth=0,
                        label="centre of the population, 90 % interval")  # fmt: skip
        ax.plot(grid, middle, color=BLUE)
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
            x, median, [[median - low], [high - median]], fmt="o", color=VERMILION, markersize=3,
            linewidth=0.8, label=label,
        )  # fmt: skip
        hover(point, f"{test.name}: {median:.4g}, 90 % interval {low:.4g} to {high:.4g}")
