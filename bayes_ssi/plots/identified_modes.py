"""The identified modes: frequencies in their band, and shapes at the sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREY,
    SMALL,
    figure_of,
    hover,
    letters_across,
    panels_across,
    title_of,
    whole_figure,
    width_of_modes,
    width_of_panels,
    without_math,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_identified_modes(
    data: ModalData, figure: Figure | None = None, configuration: str = ""
) -> Figure:
    """The band with every identified frequency in it, and the shapes at the sensors.

    Shapes are scaled to a largest component of ±1; a grey bar is the identification's own 95 %
    interval.
    """
    with_shape = [mode for mode in data.modes if mode.scaled_shape is not None]
    across = panels_across(len(with_shape)) if with_shape else 1
    n_rows = -(-len(with_shape) // across)
    height = 1.5 + (0.7 + 0.22 * len(data.sensors)) * n_rows
    figure = figure_of(
        figure, (max(width_of_modes(len(data.modes)), width_of_panels(across)), height)
    )
    ratios = [1.0, *[1.0 + 0.25 * len(data.sensors)] * n_rows]
    grid = figure.add_gridspec(1 + n_rows, across, height_ratios=ratios)
    _band(figure.add_subplot(grid[0, :]), data, configuration)
    for i, mode in enumerate(with_shape):
        ax = figure.add_subplot(grid[1 + i // across, i % across])
        shape = np.asarray(mode.scaled_shape)
        y = np.arange(len(data.sensors))
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        ax.hlines(y, 0.0, shape, color=BLUE, linewidth=1.5)
        for k, component in enumerate(shape):
            (point,) = ax.plot(component, y[k], "o", color=BLUE, markersize=4)
            hover(point, f"mode {mode.label}, {data.sensors[k]}: {component:.3f}")
        ax.set_xlim(-1.1, 1.1)
        ax.set_ylim(-0.6, len(y) - 0.4)
        ax.set_yticks(y, data.sensors if i % across == 0 else [""] * len(y))
        ax.set_xticks([-1, 0, 1])
        title = ax.set_title(f"mode {mode.label}", fontsize=SMALL)
        without_math(title, *ax.get_yticklabels())
    return figure


def _band(ax: Axes, data: ModalData, configuration: str) -> None:
    low, high = data.band_hz
    ax.axvspan(low, high, color=GREY, alpha=0.12, linewidth=0)
    # The label of a mode and the space next to it, on the scale of the axis.
    longest = max(len(mode.label) for mode in data.modes) + 1
    room = (high - low) * longest / letters_across(whole_figure(ax).get_figwidth(), SMALL)
    for height, mode in zip(_levels(data.frequencies_hz, room), data.modes, strict=True):
        if mode.frequency_cov is not None:
            half = 1.96 * mode.frequency_cov * mode.frequency_hz
            ax.axvspan(mode.frequency_hz - half, mode.frequency_hz + half, color=GREY, alpha=0.5,
                       linewidth=0)  # fmt: skip
        (line,) = ax.plot([mode.frequency_hz] * 2, [0.0, height], color=BLUE, linewidth=1.5)
        hover(line, f"mode {mode.label}: {mode.frequency_hz:.5g} Hz")
        label = ax.text(mode.frequency_hz, height + 0.04, mode.label, ha="center", va="bottom",
                        fontsize=SMALL, bbox={"facecolor": "white", "edgecolor": "none",
                                          "alpha": 0.8, "pad": 0.5})  # fmt: skip
        without_math(label)
    ax.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    ax.set_ylim(0.0, 1.3)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("identified frequency (Hz); grey: the band")
    title_of(ax, label_in(configuration, "identified modes"))


def _levels(frequencies_hz: FloatArray, room: float) -> list[float]:
    """Heights of the lines, chosen so that the labels of close modes do not overlap."""
    levels: list[float] = []
    for i, frequency in enumerate(frequencies_hz):
        close = i and frequency - frequencies_hz[i - 1] < room
        levels.append({0.9: 0.6, 0.6: 0.3, 0.3: 0.9}[levels[-1]] if close else 0.9)
    return levels
