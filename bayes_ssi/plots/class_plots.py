"""One model class: joint densities of its parameters, and matrices of its modes.

And its parameters in many tests.
"""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import arviz
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.plots import figure_style as look
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy

MOST_NAMED_TESTS = 12  # whose names fit next to one another


def plot_mac(
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    ax: Axes | None = None,
    *,
    of: tuple[str, str] = ("", ""),
) -> Axes:
    """A matrix of modal assurance criteria, with the values written in its cells.

    Args:
        matrix: (n_rows, n_columns), as of :func:`~bayes_ssi.structures.modal.mac`; NaN is left
            blank.
    """
    ax = look.axes_of(ax, (2.0 + 0.55 * len(columns), 1.1 + 0.45 * len(rows)))
    image = ax.imshow(matrix, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:.2f}", ha="center", va="center", fontsize=look.SMALL_TEXT,
                    color="white" if value > 0.6 else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    look.without_math(*ax.get_xticklabels(), *ax.get_yticklabels())
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax


def plot_corner(
    posterior: Posterior,
    figure: Figure | None = None,
    parameters: Sequence[str] | None = None,
    truths: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
) -> Figure:
    """Marginal and joint posterior densities of all or some of the parameters.

    Dashed lines are the 5 %, 50 % and 95 % quantiles; contours hold 39 % and 86 % of the draws, as
    one and two standard deviations of a normal density do. Panels leave out the outermost 0.3 % of
    the draws, and reach to true values.

    Args:
        parameters: names of the parameters; all if None.
        truths: true values of some of them, which lines mark.
        units: parameter → its unit, which is written beside the name.
    """
    names = posterior.parameter_names if parameters is None else tuple(parameters)
    truths = truths or {}
    require_known("plot_corner: no parameter", truths, posterior.parameter_names)
    require_known("plot_corner: no parameter", names, posterior.parameter_names)
    values = posterior.values[:, [posterior.parameter_names.index(name) for name in names]]
    n = len(names)
    # Of the draws: those within three standard deviations of a normal density, so that a single
    # draw far away does not shrink all others to a point; and within one and two of a density of
    # two variables.
    shown, contours = 0.9973, 1.0 - np.exp(-0.5 * np.array([1.0, 2.0]) ** 2)
    spans = np.quantile(values, (0.5 - 0.5 * shown, 0.5 + 0.5 * shown), axis=0)
    for k in (names.index(name) for name in truths if name in names):  # where lines are to be seen
        width = 0.05 * np.ptp(spans[:, k])
        spans[0, k] = min(spans[0, k], truths[names[k]] - width)
        spans[1, k] = max(spans[1, k], truths[names[k]] + width)
    figure = look.figure_of(figure, (0.8 + 1.5 * n, 1.4 + 1.5 * n))
    arviz()  # corner imports it, and would show its warnings
    import corner

    with warnings.catch_warnings():
        # Constrained layout replaces corner's own.
        warnings.filterwarnings("ignore", "This figure was using a layout engine", UserWarning)
        corner.corner(
            values, bins=30, range=spans.T, fig=figure, color=look.BLUE, quantiles=LEVELS,
            smooth=1.0, levels=contours, plot_datapoints=False, plot_density=False,
            fill_contours=True, no_fill_contours=True, max_n_ticks=3,
            truths=[truths.get(name) for name in names], truth_color=look.VERMILION,
        )  # fmt: skip
    panels = np.array(figure.axes, dtype=object).reshape(n, n)
    # Panels above the diagonal are empty; the layout need not look for what they hold.
    for empty in panels[np.triu_indices(n, 1)]:
        empty.set(visible=False, in_layout=False)
    for i, (name, draws) in enumerate(zip(names, values.T, strict=True)):
        low, median, high = np.quantile(draws, LEVELS)
        # In a panel of 1.5 in, a name may take 1.3 in.
        label = look.wrapped(_with_unit(name, units), 1.3, look.SMALL_TEXT)
        title = f"{label}\n{median:.4g}\n({low:.4g} to {high:.4g})"
        panels[i, i].set_title(title, fontsize=look.SMALL_TEXT, loc="center", parse_math=False)
        panels[-1, i].set_xlabel(label, fontsize=look.SMALL_TEXT, parse_math=False)
        if i:
            panels[i, 0].set_ylabel(label, fontsize=look.SMALL_TEXT, parse_math=False)
    for ax in panels.flat:
        # Three numbers at most, none of them at a corner, where those of two panels would meet.
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_locator(), MaxNLocator):
                axis.set_major_locator(MaxNLocator(3, prune="both", min_n_ticks=1))
        ax.tick_params(labelsize=look.SMALL_TEXT, labelrotation=0)
    note = "median, 90 % interval" + ("; 1 and 2 sigma" if n > 1 else "")
    figure.suptitle(f"{posterior.name}\n{note}", fontsize=10, parse_math=False)
    return figure


def _with_unit(name: str, units: Mapping[str, str] | None) -> str:
    return f"{name} ({units[name]})" if units and name in units else name


def plot_population(hierarchy: Hierarchy, figure: Figure | None = None) -> Figure:
    """Each parameter's 90 % interval in every test by itself, and the most probable population's.

    Along the covariate, where there is one. Dark: the population's centre, median and 90 %
    interval. Light: the 90 % interval of the next test, averaged over all populations.
    """
    k = len(hierarchy.names)
    figure = look.figure_of(figure, (look.FIGURE_WIDTH, 1.0 + 2.1 * k))
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
    columns = hierarchy.population_columns
    draws = [(hierarchy.centres(hierarchy.best, x), hierarchy.next_test(4000, x)) for x in values]
    centres = np.stack([np.quantile(centre, LEVELS, axis=0) for centre, _ in draws])
    nexts = np.stack([np.quantile(drawn[:, columns], LEVELS, axis=0) for _, drawn in draws])
    for i, (ax, parameter) in enumerate(zip(panels, hierarchy.of_population, strict=True)):
        low, _, high = nexts[:, :, i].T
        ax.fill_between(grid, low, high, color=look.BLUE, alpha=0.15, linewidth=0,
                        label="next test, 90 % interval")  # fmt: skip
        low, middle, high = centres[:, :, i].T
        ax.fill_between(grid, low, high, color=look.BLUE, alpha=0.4, linewidth=0,
                        label="centre of the population, 90 % interval")  # fmt: skip
        ax.plot(grid, middle, color=look.BLUE)
        _draw_tests(ax, hierarchy, at, i)
        ax.set_ylabel(f"{parameter.name} ({parameter.unit})" if parameter.unit else parameter.name)
        look.without_math(ax.yaxis.label)
    panels[-1].set_xlabel("test" if scale is None else scale.name)
    look.without_math(panels[-1].xaxis.label)
    if scale is None and len(tests) <= MOST_NAMED_TESTS:
        panels[-1].set_xticks(at, [test.name for test in tests], rotation=30, ha="right")
        look.without_math(*panels[-1].get_xticklabels())
    title = f"{hierarchy.model_class!r}: {hierarchy.best.name}"
    panels[0].set_title(title, parse_math=False)
    look.legend_of_figure(figure, panels)
    return figure


def _draw_tests(ax: Axes, hierarchy: Hierarchy, at: FloatArray, i: int) -> None:
    for x, test in zip(at, hierarchy.tests, strict=True):
        low, median, high = test.intervals[i]
        label = None if test is not hierarchy.tests[0] else "each test by itself, 90 % interval"
        point = ax.errorbar(
            x, median, [[median - low], [high - median]], fmt="o", color=look.VERMILION,
            markersize=3, linewidth=0.8, label=label,
        )  # fmt: skip
        look.hover(point, f"{test.name}: {median:.4g}, 90 % interval {low:.4g} to {high:.4g}")
