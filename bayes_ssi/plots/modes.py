"""Figures of identified modes, and of model modes before and after updating, from stored records.

Every function draws on given axes or figures, or on new ones, and never samples.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.identification.inferred_pairing import InferredPairing
from bayes_ssi.model_class.configuration import label_in
from bayes_ssi.plots.responses import plot_frequency_change, plot_shape
from bayes_ssi.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    axes_of,
    draw_as_they_are,
    figure_of,
    hover,
    legend_below,
    legend_of_figure,
)
from bayes_ssi.predictions.predictions import Band
from bayes_ssi.priors import FloatArray
from bayes_ssi.updating.updated_modes import LEVEL, UpdatedMode, UpdatedModes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "data_size",
    "plot_identified_modes",
    "plot_mac_change",
    "plot_mode_shapes",
    "plot_modes_before_and_after",
    "plot_pairing",
    "shapes_size",
]

PANELS_ACROSS = 4
# A label that ends in a direction: "floor 3 x".
DIRECTED = re.compile(r"^(.*\S)\s+(x|y|z|torsion|rx|ry|rz)$")
LINES = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, ":", "^"), (VERMILION, "-.", "D"))


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


def plot_modes_before_and_after(
    modes: UpdatedModes, data: ModalData, ax: Axes | None = None
) -> Axes:
    """Frequencies of the paired modes before and after updating, as errors in per cent."""
    labels = [mode.label for mode in modes.modes]
    after = np.array([mode.after_hz for mode in modes.modes]).T
    identified = np.array([data.mode(label).frequency_hz for label in labels])
    before = np.array([mode.before_hz for mode in modes.modes])
    return plot_frequency_change(labels, identified, before, Band(*after), ax, level=LEVEL)


def plot_mac_change(modes: UpdatedModes, ax: Axes | None = None) -> Axes:
    """MACs of the paired modes with the identified shapes, before and after updating.

    Raises:
        ValueError: no mode has a shape that is scored.
    """
    scored = [mode for mode in modes.modes if mode.mac_after is not None]
    if not scored:
        raise ValueError("plot_mac_change: no paired mode has an identified shape")
    ax = axes_of(ax, (6.4, 1.4 + 0.35 * len(scored)))
    before_label, after_label = "before: prior medians", f"after: posterior, {100 * LEVEL:g} %"
    for y, mode in enumerate(scored):
        assert mode.mac_after is not None
        low, median, high = mode.mac_after
        before = float("nan") if mode.mac_before is None else mode.mac_before
        ax.hlines(y, before, median, color=GREY, linewidth=0.8)
        (first,) = ax.plot(before, y, "o", color=VERMILION, markerfacecolor="white", markersize=6,
                           label=None if y else before_label)  # fmt: skip
        after = ax.errorbar(median, y, xerr=[[median - low], [high - median]], fmt="s", color=BLUE,
                            markersize=5, capsize=3,
                            label=None if y else after_label)  # fmt: skip
        hover(first, f"mode {mode.label} before: MAC {before:.4f}")
        hover(after, f"mode {mode.label} after: MAC {median:.4f} ({low:.4f} to {high:.4f})")
    ax.set_yticks(range(len(scored)), [mode.label for mode in scored])
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(len(scored) - 0.5, -0.5)
    ax.set_ylabel("identified mode")
    ax.set_xlabel("MAC with the identified shape (1: the same shape)")
    ax.grid(axis="x", alpha=0.3)
    legend_below(ax, columns=2)
    return ax


def plot_mode_shapes(
    modes: UpdatedModes, data: ModalData, figure: Figure | None = None, title: str = ""
) -> Figure:
    """The paired modes' shapes on the structure, with 95 % bands and the identified components.

    A structure of floors that move sideways is drawn deformed; of one with floors that move in
    several directions, each direction is a line; of any other, components are shown one below the
    other. Shapes have their largest component on the main structure at 1.
    """
    n = max(1, len(modes.modes))
    across = min(n, PANELS_ACROSS)
    n_rows = -(-n // PANELS_ACROSS)
    figure = figure_of(figure, shapes_size(modes))
    axes = np.atleast_1d(figure.subplots(n_rows, across, squeeze=False)).ravel()
    for i, mode in enumerate(modes.modes):
        ax = axes[i]
        heading = f"mode {mode.label}\n{mode.after_hz[1]:.4g} Hz"
        if modes.has_floors and not _directions(modes):
            _deformed(ax, modes, mode, data, heading)
        else:
            _as_lines(ax, modes, mode, data, heading)
        ax.title.set_fontsize(8)
        ax.tick_params(labelsize=7)
        if i % across:
            ax.set_yticklabels([""] * len(ax.get_yticks()))
    for ax in axes[len(modes.modes) :]:
        ax.axis("off")
    if modes.modes:
        legend_of_figure(figure, axes[0], columns=4)
    if title:
        draw_as_they_are([figure.suptitle(title, fontsize=10, x=0.02, ha="left")])
    return figure


def shapes_size(modes: UpdatedModes) -> tuple[float, float]:
    """Width and height, in inches, of :func:`plot_mode_shapes`."""
    n = max(1, len(modes.modes))
    tall = 0.9 + 0.28 * min(12, len(set(_floors(modes).values())) + 2)
    return 1.0 + 1.45 * min(n, PANELS_ACROSS), 0.5 + -(-n // PANELS_ACROSS) * max(2.3, tall)


def _deformed(
    ax: Axes, modes: UpdatedModes, mode: UpdatedMode, data: ModalData, title: str
) -> None:
    shape = Band(*(np.array(part) for part in mode.shape_after))
    reference = _identified_at(modes, mode, data)
    plot_shape(
        modes,
        modes.places,
        shape,
        ax,
        reference=None if reference is None else ("identified", *reference),
        name="model, 95 % band",
        title=title,
    )
    ax.xaxis.label.set_fontsize(6)  # what moves far is told below the panel


def _as_lines(
    ax: Axes, modes: UpdatedModes, mode: UpdatedMode, data: ModalData, title: str
) -> None:
    heights = _floors(modes)
    groups = _directions(modes) or {"model, 95 % band": list(range(len(modes.places)))}
    low, median, high = (np.array(part) for part in mode.shape_after)
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    own = [i for i, place in enumerate(modes.places) if place not in modes.appendages]
    for (name, members), (colour, line, marker) in zip(groups.items(), LINES * 3, strict=False):
        rows = [i for i in members if i in own]
        y = np.array([heights[modes.places[i]] for i in rows])
        ax.fill_betweenx(y, low[rows], high[rows], color=colour, alpha=0.3, linewidth=0)
        ax.plot(median[rows], y, linestyle=line, marker=marker, markersize=3.5, color=colour,
                linewidth=1.2, label=name)  # fmt: skip
    for i, place in enumerate(modes.places):
        if place in modes.appendages:
            _moving_appendage(ax, place, heights[place], float(median[i]))
    reference = _identified_at(modes, mode, data)
    if reference is not None:
        at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=6,
                label="identified")  # fmt: skip
    ax.set_xlim(-1.35, 1.35)
    ax.set_xticks([-1, 0, 1])
    labels = {heights[place]: _floor_of(place) for place in modes.places
              if place not in modes.appendages}  # fmt: skip
    ax.set_yticks(list(labels), list(labels.values()))
    draw_as_they_are(ax.get_yticklabels())
    ax.set_ylim(0.0 if _directions(modes) else 0.4, max(heights.values()) + 0.6)
    draw_as_they_are([ax.set_title(title)])


def _moving_appendage(ax: Axes, place: str, height: float, component: float) -> None:
    """An appendage at its component, or at the edge with the component beside it."""
    inside = abs(component) < 1.25
    at = component if inside else float(np.copysign(1.25, component))
    marker = "s" if inside else "<" if component < 0 else ">"
    (point,) = ax.plot(at, height, marker, color=VERMILION, markeredgecolor="black", markersize=5,
                       linestyle="none", clip_on=False,
                       label="" if ax.get_label() else "appendage")  # fmt: skip
    ax.set_label("named")  # the next one needs no other place in the legend
    hover(point, f"{place}: {component:.3g}")


def _identified_at(
    modes: UpdatedModes, mode: UpdatedMode, data: ModalData
) -> tuple[Sequence[str], FloatArray] | None:
    """Places and components of the identified shape, scaled to lie upon the model's median."""
    shape = data.mode(mode.label).unit_shape
    if shape is None:
        return None
    column = {place: i for i, place in enumerate(modes.places)}
    at = [
        (place, column[place], float(component))
        for place, component in zip(data.sensors, np.asarray(shape), strict=True)
        if place in column and np.isfinite(component)
    ]
    model = np.array([mode.shape_after[1][i] for _, i, _ in at])
    components = np.array([component for _, _, component in at])
    if not len(at) or not components.any():
        return None
    scale = float(model @ components / (components @ components))
    return [place for place, _, _ in at], scale * components


def _directions(modes: UpdatedModes) -> dict[str, list[int]]:
    """Direction → its places, where all places of the main structure have one; else empty."""
    found: dict[str, list[int]] = {}
    for i, place in enumerate(modes.places):
        if place in modes.appendages:
            continue
        match = DIRECTED.match(place)
        if match is None:
            return {}
        found.setdefault(match[2], []).append(i)
    return {
        f"{direction} (rad)" if direction in ("torsion", "rx", "ry", "rz") else direction: members
        for direction, members in found.items()
    }


def _floor_of(place: str) -> str:
    match = DIRECTED.match(place)
    return place if match is None else match[1]


def _floors(modes: UpdatedModes) -> dict[str, float]:
    """Place → height; floors that move in several directions are counted from 1."""
    if not _directions(modes):
        return modes.heights()
    main = [place for place in modes.places if place not in modes.appendages]
    number = {name: i for i, name in enumerate(dict.fromkeys(map(_floor_of, main)), 1)}
    heights = {place: float(number[_floor_of(place)]) for place in main}
    per_floor = len(main) / len(number)
    own = modes.heights()
    for k, place in enumerate(modes.appendages):  # near the floor that it hangs on
        heights[place] = round(own[place] / per_floor + 0.49) + 0.25 + 0.2 * (k % 2)
    top = len(number) + 0.45
    return {place: min(height, top) for place, height in heights.items()}


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
