"""How model classes compare: evidences and frequencies."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots import figure_style as look
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
        _draw_class(ax, data, posterior, configuration, offset, colour, marker)
    if any(line.get_marker() == "x" for line in ax.lines):
        ax.plot([], [], "x", color="black", markersize=6, label="called spurious")
    ax.axhline(0.0, color="black", linewidth=0.8)
    ticks = [f"{mode.label}\n{mode.frequency_hz:.4g} Hz" for mode in data.modes]
    ax.set_xticks(range(len(ticks)), ticks)
    ax.set_xlim(-0.5, len(ticks) - 0.5)
    ax.set_xlabel("identified mode")
    ax.set_ylabel("model / identified - 1 (%)")
    look.without_math(*ax.get_xticklabels())
    look.title_of(ax, label_in(configuration, "Model frequencies, 90 % of the posterior"))
    ax.grid(axis="y", alpha=0.3)
    look.legend_below(ax, columns=4)
    return ax


def _draw_class(
    ax: Axes,
    data: ModalData,
    posterior: Posterior,
    configuration: str,
    offset: float,
    colour: str,
    marker: str,
) -> None:
    modes, frequencies_hz = posterior.configuration(configuration)
    updated = {each.label: each for each in modes.updated.modes}
    name: str | None = posterior.name  # for the legend, once
    for i, mode in enumerate(data.modes):
        number = modes.pairing.get(mode.label)
        if number is None:
            ax.plot(i + offset, 0.0, "x", color=colour, markersize=6)
            continue
        if modes.inferred_pairing is not None:
            # The number of the mode may change from draw to draw.
            hz = np.array(updated[mode.label].after_hz)
        else:
            hz = np.quantile(frequencies_hz[..., number - 1], LEVELS)
        low, median, high = 100.0 * (hz / mode.frequency_hz - 1.0)
        point = ax.errorbar(i + offset, median, yerr=[[median - low], [high - median]], fmt=marker,
                            color=colour, markersize=4, capsize=2, label=name)  # fmt: skip
        look.hover(point, f"{posterior.name}, mode {mode.label}: {hz[1]:.4g} Hz, "
              f"{median:+.2f} % ({low:+.2f} to {high:+.2f} %)")  # fmt: skip
        name = None
