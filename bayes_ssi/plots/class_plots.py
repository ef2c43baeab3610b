"""Model classes: how they compare, densities of their parameters, and matrices of their modes.

And a class's parameters in many tests.
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
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots import figure_style as look
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy
from bayes_ssi.studies.ranking.comparison import Comparison


def plot_evidence(
    comparison: Comparison, ax: Axes | None = None, *, most: int | None = None
) -> Axes:
    """Log evidence of every class, split into fit and information gained.

    Each class has three marks on one axis in nats: how well it fits on average (mean
    log-likelihood), the log evidence with its error bar, and between them, as a bar, the
    information gained, by which the evidence falls short of the fit.

    Args:
        most: largest number of classes drawn, the best first; all if None.
    """
    rows = comparison.classes[:most]
    names = [f"{row.name}\n({row.probability_text})" for row in rows]
    ax = look.rows_of(ax, names, 1.3)
    y = np.arange(len(rows))
    evidence = np.array([row.log_evidence for row in rows])
    fit = np.array([row.mean_log_likelihood for row in rows])
    ax.barh(y, fit - evidence, left=evidence, height=0.35, color=look.BLUE, alpha=0.25,
            label="information gained")  # fmt: skip
    ax.plot(fit, y, "|", color=look.BLUE, markersize=11, label="fit: mean log-likelihood")
    for i, row in enumerate(rows):
        point = ax.errorbar(row.log_evidence, i, xerr=row.error, fmt="o", color=look.VERMILION,
                            capsize=3,
                            label=None if i else "log evidence ± 1 standard error")  # fmt: skip
        look.hover(point, f"{row.name}: log evidence {row.log_evidence:.3f} ± {row.error:.3f}, fit "
              f"{row.mean_log_likelihood:.2f}, probability {row.probability_text}")  # fmt: skip
    ax.use_sticky_edges = False
    ax.margins(x=0.04)
    ax.set_xlabel("nats")
    look.title_of(ax, "Model classes (probability)")
    ax.grid(axis="x", alpha=0.3)
    look.legend_below(ax, columns=2)
    return ax


def plot_frequencies(
    data: ModalData,
    posteriors: Sequence[Posterior],
    ax: Axes | None = None,
    configuration: str = "",
) -> Axes:
    """Posterior model frequencies relative to the identified ones, class by class.

    A bar is the central 90 % of a paired model mode, its mark the median, and the grey band an
    identified mode's own 90 % interval, where the data give one. Identified modes that a class
    calls spurious are marked with a cross.

    Args:
        configuration: the one in which ``data`` were identified, where there are several.
    """
    ax = look.axes_of(ax, (look.width_of_modes(len(data.modes)), 3.4))
    for i, mode in enumerate(data.modes):
        if mode.frequency_cov is not None:
            half = 100.0 * look.SDS_OF_90_PERCENT * mode.frequency_cov
            band = [i - 0.42, i + 0.42]
            ax.fill_between(band, -half, half, color=look.GREY, alpha=0.3, linewidth=0)
    offsets = np.linspace(-0.3, 0.3, len(posteriors)) if len(posteriors) > 1 else [0.0]
    for k, (posterior, offset) in enumerate(zip(posteriors, offsets, strict=True)):
        colour = look.COLOURS[k % len(look.COLOURS)]
        # Another shift after each round of the colours: pairs of both repeat late.
        marker = look.MARKERS[(k + k // len(look.COLOURS)) % len(look.MARKERS)]
        modes, frequencies_hz = posterior.configuration(configuration)
        updated = {each.label: each for each in modes.updated.modes}
        name: str | None = posterior.name  # for the legend, once
        for i, mode in enumerate(data.modes):
            if mode.label not in modes.pairing:
                ax.plot(i + offset, 0.0, "x", color=colour, markersize=6)
                continue
            if modes.inferred_pairing is not None:
                # The number of the mode may change from draw to draw.
                hz = np.array(updated[mode.label].after_hz)
            else:
                hz = np.quantile(frequencies_hz[..., modes.pairing[mode.label] - 1], LEVELS)
            low, median, high = 100.0 * (hz / mode.frequency_hz - 1.0)
            errors = [[median - low], [high - median]]
            point = ax.errorbar(i + offset, median, yerr=errors, fmt=marker, color=colour,
                                markersize=4, capsize=2, label=name)  # fmt: skip
            look.hover(point, f"{posterior.name}, mode {mode.label}: {hz[1]:.4g} Hz, "
                  f"{median:+.2f} % ({low:+.2f} to {high:+.2f} %)")  # fmt: skip
            name = None
    if any(line.get_marker() == "x" for line in ax.lines):
        ax.plot([], [], "x", color="black", markersize=6, label="called spurious")
    ax.axhline(0.0, color="black", linewidth=0.8)
    ticks = [f"{mode.label}\n{mode.frequency_hz:.4g} Hz" for mode in data.modes]
    ax.set_xticks(range(len(ticks)), ticks)
    ax.set(xlim=(-0.5, len(ticks) - 0.5), xlabel="identified mode")
    ax.set_ylabel("model / identified - 1 (%)")
    look.without_math(*ax.get_xticklabels())
    look.title_of(ax, label_in(configuration, "Model frequencies, 90 % of the posterior"))
    ax.grid(axis="y", alpha=0.3)
    look.legend_below(ax, columns=4)
    return ax


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
        matrix: (n_rows, n_columns), as of :func:`~bayes_ssi.structures.modal.mac`; NaN is blank.
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
    ax.set(ylabel=of[0], xlabel=of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax


def plot_corner(
    posterior: Posterior,
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
    figure = look.new_figure((0.8 + 1.5 * n, 1.4 + 1.5 * n))
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
        unit = f" ({units[name]})" if units and name in units else ""
        label = look.wrapped(f"{name}{unit}", 1.3, look.SMALL_TEXT)
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


def plot_population(hierarchy: Hierarchy) -> Figure:
    """Each parameter's 90 % interval in every test by itself, and the most probable population's.

    Along the covariate, where there is one. Dark: the population's centre, median and 90 %
    interval. Light: the 90 % interval of the next test, averaged over all populations.
    """
    k = len(hierarchy.names)
    figure = look.new_figure((look.FIGURE_WIDTH, 1.0 + 2.1 * k))
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
        for x, test in zip(at, tests, strict=True):
            low, median, high = test.intervals[i]
            label = None if test is not tests[0] else "each test by itself, 90 % interval"
            point = ax.errorbar(
                x, median, [[median - low], [high - median]], fmt="o", color=look.VERMILION,
                markersize=3, linewidth=0.8, label=label,
            )  # fmt: skip
            look.hover(point, f"{test.name}: {median:.4g}, 90 % interval {low:.4g} to {high:.4g}")
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
