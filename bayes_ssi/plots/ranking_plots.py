"""Figures of results. Every function draws on given axes or on new ones, and never samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.model_class.configuration import label_in
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
    style,
)
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes

from bayes_ssi.plots.corner_plot import corner_size, plot_corner

__all__ = ["plot_evidence", "plot_frequencies", "save_figures", "style"]

MOST_DRAWN = 12
FREQUENCIES_SIZE = (6.4, 3.4)  # inches
WIDTH_OF_A_MODE = 0.72  # inches, for its frequency written below the axis


def plot_evidence(comparison: Comparison, ax: Axes | None = None) -> Axes:
    """Log evidence of every class, split into fit and information gained.

    Each class has three marks on one axis in nats: how well it fits on average (mean
    log-likelihood), the log evidence with its error bar, and between them, as a bar, the
    information gained, by which the evidence falls short of the fit.
    """
    rows = comparison.classes
    ax = axes_of(ax, _evidence_size(comparison))
    y = np.arange(len(rows))
    evidence = np.array([row.log_evidence for row in rows])
    fit = np.array([row.mean_log_likelihood for row in rows])
    ax.barh(y, fit - evidence, left=evidence, height=0.35, color=BLUE, alpha=0.25,
            label="information gained")  # fmt: skip
    ax.plot(fit, y, "|", color=BLUE, markersize=11, label="fit: mean log-likelihood")
    for i, row in enumerate(rows):
        point = ax.errorbar(row.log_evidence, i, xerr=row.error, fmt="o", color=VERMILION,
                            capsize=3,
                            label=None if i else "log evidence ± 1 standard error")  # fmt: skip
        hover(point, f"{row.name}: log evidence {row.log_evidence:.3f} ± {row.error:.3f}, fit "
              f"{row.mean_log_likelihood:.2f}, probability {row.probability_text}")  # fmt: skip
    ax.set_yticks(y, [f"{row.name}\n({row.probability_text})" for row in rows])
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.use_sticky_edges = False
    ax.margins(x=0.04)
    ax.set_xlabel("nats")
    ax.set_title("Model classes by evidence (probability)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=3)
    return ax


def plot_frequencies(
    data: ModalData,
    posteriors: Sequence[Posterior],
    ax: Axes | None = None,
    configuration: str = "",
) -> Axes:
    """Posterior model frequencies relative to the identified ones, class by class.

    A bar is the central 95 % of a paired model mode, a dot its median, and the grey band behind
    an identified mode's own 95 % interval, where the data give one. Identified modes that a
    class calls spurious are marked with a cross. ``configuration`` is the one in which ``data``
    were identified, where the classes have several.
    """
    labels = data.labels
    ax = axes_of(ax, _frequencies_size(data))
    offsets = np.linspace(-0.3, 0.3, len(posteriors)) if len(posteriors) > 1 else [0.0]
    colours = [BLUE, ORANGE, GREEN, VERMILION, GREY]
    for i, mode in enumerate(data.modes):
        if mode.frequency_cov is not None:
            half = 196.0 * mode.frequency_cov
            ax.fill_between([i - 0.42, i + 0.42], -half, half, color=GREY, alpha=0.3, linewidth=0)
    for k, (posterior, offset) in enumerate(zip(posteriors, offsets, strict=True)):
        colour = colours[k % len(colours)]
        marker = "osD^v"[(k // len(colours)) % 5]
        named = False
        modes, frequencies_hz = posterior.configuration(configuration)
        for i, mode in enumerate(data.modes):
            number = modes.pairing.get(mode.label)
            if number is None:
                ax.plot(i + offset, 0.0, "x", color=colour, markersize=6)
                continue
            frequencies = frequencies_hz[..., number - 1].ravel()
            low, mid, high = 100.0 * (
                np.quantile(frequencies, [0.025, 0.5, 0.975]) / mode.frequency_hz - 1.0
            )
            point = ax.errorbar(i + offset, mid, yerr=[[mid - low], [high - mid]], fmt=marker,
                                color=colour, markersize=4, capsize=2,
                                label=None if named else posterior.name)  # fmt: skip
            hover(point, f"{posterior.name}, mode {mode.label}: {np.median(frequencies):.4g} Hz, "
                  f"{mid:+.2f} % ({low:+.2f} to {high:+.2f} %)")  # fmt: skip
            named = True
    ax.axhline(0.0, color="black", linewidth=0.8)
    ticks = [f"{m.label}\n{m.frequency_hz:.4g} Hz" for m in data.modes]
    ax.set_xticks(range(len(labels)), ticks)
    draw_as_they_are(ax.get_xticklabels())
    ax.set_xlim(-0.5, len(labels) - 0.5)
    ax.set_xlabel("identified mode")
    ax.set_ylabel("model / identified - 1 (%)")
    what = "Model frequencies, 95 % of the posterior  (x: called spurious)"
    draw_as_they_are([ax.set_title(label_in(configuration, what))])
    ax.grid(axis="y", alpha=0.3)
    longest = max(len(posterior.name) for posterior in posteriors)
    legend_below(ax, columns=max(1, min(4, 72 // (longest + 6))))
    return ax


def save_figures(
    directory: Path,
    data: ModalData | Mapping[str, ModalData],
    ranked: Sequence[Posterior],
    comparison: Comparison,
) -> list[Path]:
    """Write the figures of a result as PNG files into ``directory``, which is created.

    ``data`` are the identified modes, or those of each configuration by its name. ``ranked`` are
    the posteriors, the best first; the corner plot is the best one's. Where there are more than
    ``MOST_DRAWN``, only the best are drawn.
    """
    from matplotlib.figure import Figure

    tests = {"": data} if isinstance(data, ModalData) else data
    ranked = ranked[:MOST_DRAWN]
    comparison = replace(comparison, classes=comparison.classes[:MOST_DRAWN])
    # Figures of their own, not pyplot's: nothing is shown, and no backend is switched.
    directory.mkdir()
    corner = Figure(
        figsize=corner_size(len(ranked[0].parameter_names))
    )  # outside the style: corner has its own layout
    with style():
        evidence = Figure(figsize=_evidence_size(comparison))
        sizes = [_frequencies_size(modes) for modes in tests.values()]
        width, height = max(width for width, _ in sizes), sum(height for _, height in sizes)
        frequencies = Figure(figsize=(width, height))
        plot_evidence(comparison, evidence.subplots())
        panels = frequencies.subfigures(len(tests), squeeze=False)[:, 0]
        for panel, (configuration, modes) in zip(panels, tests.items(), strict=True):
            plot_frequencies(modes, ranked, panel.subplots(), configuration)
        plot_corner(ranked[0], corner)
        paths = []
        for name, figure in (
            ("evidence", evidence),
            ("frequencies", frequencies),
            ("corner", corner),
        ):
            paths.append(directory / f"{name}.png")
            figure.savefig(paths[-1])
    return paths


def _frequencies_size(data: ModalData) -> tuple[float, float]:
    width, height = FREQUENCIES_SIZE
    return max(width, 0.7 + WIDTH_OF_A_MODE * len(data.modes)), height


def _evidence_size(comparison: Comparison) -> tuple[float, float]:
    return 6.4, 1.3 + 0.42 * len(comparison.classes)
