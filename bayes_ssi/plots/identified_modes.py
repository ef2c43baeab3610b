"""Figures of identified modes, and of model modes before and after updating, from stored records.

Every function draws on given axes or figures, or on new ones, and never samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.identification.inferred_pairing import InferredPairing
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.plots.style import (
    BLUE,
    GREY,
    axes_of,
    draw_as_they_are,
    figure_of,
    hover,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["data_size", "plot_identified_modes", "plot_pairing"]

PANELS_ACROSS = 4


def plot_identified_modes(
    data: ModalData, figure: Figure | None = None, configuration: str = ""
) -> Figure:
    """The data: the band with every identified frequency in it, and the shapes at the sensors.

    Components are those of unit shapes; a grey bar is the identification's own 95 % interval.
    """
    with_shape = [mode for mode in data.modes if mode.unit_shape is not None]
    n_rows = -(-len(with_shape) // PANELS_ACROSS)
    figure = figure_of(figure, data_size(data))
    ratios = [1.0, *[1.0 + 0.25 * len(data.sensors)] * n_rows]
    grid = figure.add_gridspec(1 + n_rows, PANELS_ACROSS, height_ratios=ratios)
    _band(figure.add_subplot(grid[0, :]), data, configuration)
    for i, mode in enumerate(with_shape):
        ax = figure.add_subplot(grid[1 + i // PANELS_ACROSS, i % PANELS_ACROSS])
        shape = np.asarray(mode.unit_shape)
        y = np.arange(len(data.sensors))
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        ax.hlines(y, 0.0, shape, color=BLUE, linewidth=1.5)
        for k, component in enumerate(shape):
            (point,) = ax.plot(component, y[k], "o", color=BLUE, markersize=4)
            hover(point, f"mode {mode.label}, {data.sensors[k]}: {component:.3f}")
        ax.set_xlim(-1.1, 1.1)
        ax.set_ylim(-0.6, len(y) - 0.4)
        ax.set_yticks(y, data.sensors if i % PANELS_ACROSS == 0 else [""] * len(y))
        draw_as_they_are(ax.get_yticklabels())
        ax.set_xticks([-1, 0, 1])
        ax.tick_params(labelsize=7)
        draw_as_they_are([ax.set_title(f"mode {mode.label}", fontsize=8)])
    return figure


def data_size(data: ModalData) -> tuple[float, float]:
    """Width and height, in inches, of :func:`plot_identified_modes`."""
    n_rows = -(-sum(mode.unit_shape is not None for mode in data.modes) // PANELS_ACROSS)
    return 6.8, 1.5 + (0.7 + 0.22 * len(data.sensors)) * n_rows


def _band(ax: Axes, data: ModalData, configuration: str) -> None:
    low, high = data.band_hz
    ax.axvspan(low, high, color=GREY, alpha=0.12, linewidth=0)
    for height, mode in zip(_levels(data.frequencies_hz, high - low), data.modes, strict=True):
        if mode.frequency_cov is not None:
            half = 1.96 * mode.frequency_cov * mode.frequency_hz
            ax.axvspan(mode.frequency_hz - half, mode.frequency_hz + half, color=GREY, alpha=0.5,
                       linewidth=0)  # fmt: skip
        (line,) = ax.plot([mode.frequency_hz] * 2, [0.0, height], color=BLUE, linewidth=1.5)
        hover(line, f"mode {mode.label}: {mode.frequency_hz:.5g} Hz")
        label = ax.text(mode.frequency_hz, height + 0.04, mode.label, ha="center", va="bottom",
                        fontsize=8, bbox={"facecolor": "white", "edgecolor": "none",
                                          "alpha": 0.8, "pad": 0.5})  # fmt: skip
        draw_as_they_are([label])
    ax.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    ax.set_ylim(0.0, 1.3)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("identified frequency (Hz); grey: the band")
    draw_as_they_are([ax.set_title(label_in(configuration, "identified modes"))])


def _levels(frequencies_hz: FloatArray, width: float) -> list[float]:
    """Heights of the lines such that labels of close modes stand above one another."""
    levels: list[float] = []
    for i, frequency in enumerate(frequencies_hz):
        close = i and frequency - frequencies_hz[i - 1] < 0.05 * width
        levels.append({0.9: 0.6, 0.6: 0.3, 0.3: 0.9}[levels[-1]] if close else 0.9)
    return levels


def plot_pairing(inferred: InferredPairing, n_modes: int, ax: Axes | None = None) -> Axes:
    """How probable it is that each identified mode is each model mode, or spurious."""
    labels = list(inferred.of_modes)
    columns = ["spurious", *(str(number) for number in range(1, n_modes + 1))]
    ax = axes_of(ax, (1.6 + 0.62 * len(columns), 1.1 + 0.34 * len(labels)))
    shares = np.array(
        [[inferred.of_modes[label].get(i, 0.0) for i in range(n_modes + 1)] for label in labels]
    )
    ax.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, k), share in np.ndenumerate(shares):
        if share >= 0.0005:
            ax.text(k, i, f"{share:.3f}", ha="center", va="center", fontsize=7,
                    color="white" if share > 0.6 else "black")  # fmt: skip
    ax.set_xticks(range(len(columns)), columns)
    ax.set_yticks(range(len(labels)), labels)
    draw_as_they_are(ax.get_yticklabels())
    ax.set_xlabel("model mode")
    ax.set_ylabel("identified mode")
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    return ax
