"""Model frequencies of several classes relative to the identified ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    COLOURS,
    GREY,
    MARKERS,
    axes_of,
    hover,
    legend_below,
    title_of,
    width_of_modes,
    without_math,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_frequencies(
    data: ModalData,
    posteriors: Sequence[Posterior],
    ax: Axes | None = None,
    configuration: str = "",
) -> Axes:
    """Posterior model frequencies relative to the identified ones, class by class.

    A bar is the central 95 % of a paired model mode, its mark the median, and the grey band an
    identified mode's own 95 % interval, where the data give one. Identified modes that a class
    calls spurious are marked with a cross.

    Args:
        ax: axes; new ones if None.
        configuration: the one in which ``data`` were identified, where there are several.
    """
    ax = axes_of(ax, (width_of_modes(len(data.modes)), 3.4))
    for i, mode in enumerate(data.modes):
        if mode.frequency_cov is not None:
            half = 196.0 * mode.frequency_cov  # 1.96 standard deviations, in per cent
            ax.fill_between([i - 0.42, i + 0.42], -half, half, color=GREY, alpha=0.3, linewidth=0)
    offsets = np.linspace(-0.3, 0.3, len(posteriors)) if len(posteriors) > 1 else [0.0]
    for k, (posterior, offset) in enumerate(zip(posteriors, offsets, strict=True)):
        colour = COLOURS[k % len(COLOURS)]
        # Another shift after each round of the colours: pairs of both repeat late.
        marker = MARKERS[(k + k // len(COLOURS)) % len(MARKERS)]
        _draw_class(ax, data, posterior, configuration, offset, colour, marker)
    if any(line.get_marker() == "x" for line in ax.lines):
        ax.plot([], [], "x", color="black", markersize=6, label="called spurious")
    ax.axhline(0.0, color="black", linewidth=0.8)
    ticks = [f"{mode.label}\n{mode.frequency_hz:.4g} Hz" for mode in data.modes]
    ax.set_xticks(range(len(ticks)), ticks)
    ax.set_xlim(-0.5, len(ticks) - 0.5)
    ax.set_xlabel("identified mode")
    ax.set_ylabel("model / identified - 1 (%)")
    without_math(*ax.get_xticklabels())
    title_of(ax, label_in(configuration, "Model frequencies, 95 % of the posterior"))
    ax.grid(axis="y", alpha=0.3)
    legend_below(ax, columns=4)
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
            hz = np.quantile(frequencies_hz[..., number - 1], [0.025, 0.5, 0.975])
        low, median, high = 100.0 * (hz / mode.frequency_hz - 1.0)
        point = ax.errorbar(i + offset, median, yerr=[[median - low], [high - median]], fmt=marker,
                            color=colour, markersize=4, capsize=2, label=name)  # fmt: skip
        hover(point, f"{posterior.name}, mode {mode.label}: {hz[1]:.4g} Hz, "
              f"{median:+.2f} % ({low:+.2f} to {high:+.2f} %)")  # fmt: skip
        name = None
