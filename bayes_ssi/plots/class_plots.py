"""One model class: its modes and parameters before and after updating, and matrices of its modes.

And its parameters in many tests.
"""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import arviz
from bayes_ssi.foundations.summaries import LEVEL, LEVELS
from bayes_ssi.inference.calibration.modal_sensitivities import ModalSensitivities
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.posterior.model_at_draws import UpdatedMode
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots import figure_style as look
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy
from bayes_ssi.results.predictions.predictions import PredictedMode

MOST_NAMED_TESTS = 12  # whose names fit next to one another


def plot_frequency_change(
    modes: Sequence[UpdatedMode | PredictedMode],
    data: ModalData,
    ax: Axes | None = None,
    *,
    level: float = LEVEL,
) -> Axes:
    """Frequencies of modes before and after updating, relative to the identified ones.

    Args:
        level: probability of the intervals.
    """
    identified = [data.mode(mode.label).frequency_hz for mode in modes]
    names = [f"{mode.label}\n{hz:.4g} Hz" for mode, hz in zip(modes, identified, strict=True)]
    ax = look.rows_of(ax, names, 1.1)
    ax.axvline(0.0, color="black", linewidth=0.8)
    for y, (mode, hz) in enumerate(zip(modes, identified, strict=True)):
        before, *after = 100.0 * (np.array([mode.before_hz, *mode.after_hz]) / hz - 1.0)
        low, median, high = after
        _draw_change(
            ax, y, before, after, level,
            f"mode {mode.label} before: {mode.before_hz:.4g} Hz, {before:+.2f} %",
            f"mode {mode.label} after: {mode.after_hz[1]:.4g} Hz, {median:+.2f} % "
            f"({low:+.2f} to {high:+.2f} %)",
        )  # fmt: skip
    return _finished(ax, "model / identified - 1 (%)")


def plot_mac_change(modes: Sequence[UpdatedMode], ax: Axes | None = None) -> Axes:
    """MACs of paired modes with the identified shapes, before and after updating.

    Modes without an identified shape are left out.
    """
    macs = {
        mode.label: (mode.mac_before, mode.mac_after)
        for mode in modes
        if mode.mac_before is not None and mode.mac_after is not None
    }
    if not macs:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = look.rows_of(ax, list(macs), 1.1)
    for y, (label, (before, after)) in enumerate(macs.items()):
        low, median, high = after
        _draw_change(
            ax, y, before, after, LEVEL, f"mode {label} before: MAC {before:.4f}",
            f"mode {label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})",
        )  # fmt: skip
    return _finished(ax, "MAC with the identified shape\n(1: the same shape)")


def _draw_change(
    ax: Axes, y: int, before: float, after: Sequence[float], level: float, *texts: str
) -> None:
    """A circle before updating, joined to a square with its interval (low, median, high) after."""
    ax.plot([before, after[1]], [y, y], color=look.GREY, linewidth=0.8)
    (circle,) = ax.plot(before, y, "o", color=look.VERMILION, markerfacecolor="white",
                        markersize=6, label=None if y else "before: prior medians")  # fmt: skip
    look.hover(circle, texts[0])
    look.interval_after(ax, y, after, f"after: posterior, {100 * level:g} %", texts[1])


def _finished(ax: Axes, label: str) -> Axes:
    ax.set_xlabel(label)
    ax.set_ylabel("identified mode")
    ax.grid(axis="x", alpha=0.3)
    look.legend_below(ax, columns=2)
    return ax


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
    image = _annotate(ax, matrix, rows, columns, of, ".2f")
    ax.figure.colorbar(image, ax=ax, label="MAC")
    return ax


def plot_pairing(inferred: InferredPairing, n_modes: int, ax: Axes | None = None) -> Axes:
    """The probability that each identified mode is each model mode, or spurious."""
    labels = list(inferred.of_modes)
    columns = ["spurious", *(str(number) for number in range(1, n_modes + 1))]
    ax = look.axes_of(ax, (1.3 + 0.5 * len(columns), 1.1 + 0.34 * len(labels)))
    probabilities = np.array(
        [[inferred.of_modes[label].get(i, 0.0) for i in range(n_modes + 1)] for label in labels]
    )
    # Values that round to 0.000 are left blank.
    shown = np.where(probabilities < 0.0005, np.nan, probabilities)
    _annotate(ax, shown, labels, columns, ("identified mode", "model mode"), ".3f")
    return ax


def plot_modal_sensitivities(sensitivities: ModalSensitivities, ax: Axes | None = None) -> Axes:
    """How many percent each frequency rises where a parameter rises by one.

    Parameters proposed for updating are in bold.
    """
    modes, names = sensitivities.modes, sensitivities.parameters
    ax = look.axes_of(ax, (2.4 + 0.55 * len(names), 1.3 + 0.3 * len(modes)))
    matrix = sensitivities.of_frequencies
    largest = max(float(np.abs(matrix).max()), np.finfo(float).tiny)
    # Values that round to 0.00 are left blank.
    shown = np.where(np.abs(matrix) < 0.005, np.nan, matrix)
    of = ("mode", "parameter; bold: proposed for updating")
    image = _annotate(ax, shown, modes, names, of, "+.2f", -largest, largest, "RdBu_r")
    for label in ax.get_xticklabels():
        if label.get_text() in sensitivities.proposed:
            label.set_fontweight("bold")
    ax.figure.colorbar(image, ax=ax, label="% of frequency per % of parameter")
    return ax


def _annotate(
    ax: Axes,
    matrix: FloatArray,
    rows: Sequence[str],
    columns: Sequence[str],
    of: tuple[str, str],
    form: str,
    least: float = 0.0,
    most: float = 1.0,
    colours: str = "Blues",
) -> AxesImage:
    """A matrix in colours from ``least`` to ``most``, with its values where they are finite."""
    image = ax.imshow(matrix, cmap=colours, vmin=least, vmax=most, aspect="auto")
    for (i, k), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            ax.text(k, i, f"{value:{form}}", ha="center", va="center", fontsize=look.SMALL_TEXT,
                    color="white" if abs(value) > 0.6 * most else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(rows)), rows)
    look.without_math(*ax.get_xticklabels(), *ax.get_yticklabels())
    ax.set_ylabel(of[0])
    ax.set_xlabel(of[1])
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    return image


def plot_parameters(
    posterior: Posterior, ax: Axes | None = None, units: Mapping[str, str] | None = None
) -> Axes:
    """The 90 % prior and posterior intervals of every parameter.

    Each row has a scale of its own: 0 is the prior median, -1 and 1 are the ends of the prior's
    90 % interval, and between them the scale is linear.

    Args:
        units: parameter → its unit, which is written beside the name.
    """
    rows = posterior.summary
    ax = look.rows_of(ax, [_with_unit(row.name, units) for row in rows], 1.3)
    ax.axvline(0.0, color=look.GREY, linewidth=0.8, linestyle=":")
    for y, row in enumerate(rows):
        low, median, high = posterior.prior_quantiles[y]
        after = (row.quantile_05, row.median, row.quantile_95)
        bar = ax.barh(y, 2.0, left=-1.0, height=0.62, color=look.GREY, alpha=0.25,
                      label=None if y else "prior, 90 %")  # fmt: skip
        unit = f" {units[row.name]}" if units and row.name in units else ""
        look.hover(bar[0], f"{row.name} before: {median:.4g} ({low:.4g} to {high:.4g}){unit}")
        scaled = [
            (value - median) / (median - low if value < median else high - median)
            for value in after
        ]
        text = f"{row.name} after: {after[1]:.4g} ({after[0]:.4g} to {after[2]:.4g}){unit}"
        look.interval_after(ax, y, scaled, "posterior, 90 %", text)
    ax.set_xlabel("0: prior median\n-1 and 1: ends of the prior's 90 % interval")
    ax.grid(axis="x", alpha=0.3)
    look.legend_below(ax, columns=2)
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
    the draws.

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
    figure = look.figure_of(figure, (0.8 + 1.5 * n, 1.4 + 1.5 * n))
    arviz()  # corner imports it, and would show its warnings
    import corner

    with warnings.catch_warnings():
        # Constrained layout replaces corner's own.
        warnings.filterwarnings("ignore", "This figure was using a layout engine", UserWarning)
        corner.corner(
            values, bins=30, range=[shown] * n, fig=figure, color=look.BLUE, quantiles=LEVELS,
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
