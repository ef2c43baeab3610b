"""The updated mode shapes of a model class, from stored records."""

from __future__ import annotations

import re
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    COLOURS,
    GREY,
    LINES,
    MARKERS,
    VERMILION,
    figure_of,
    hover,
    legend_of_figure,
    without_math,
)
from bayes_ssi.plots.identified_modes import PANELS_ACROSS
from bayes_ssi.plots.shape_plots import Reference, plot_building_shape, plot_shape_components
from bayes_ssi.posterior.updated_modes import UpdatedMode, UpdatedModes
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot_mode_shapes"]

# A label that ends in a direction: "floor 3 x".
DIRECTED = re.compile(r"^(.*\S)\s+(x|y|z|torsion|rx|ry|rz)$")
# Rows of a panel whose labels have room; of more, panels grow no taller and labels become smaller.
MOST_ROWS = 16


def plot_mode_shapes(
    modes: UpdatedModes, data: ModalData, figure: Figure | None = None, title: str = ""
) -> Figure:
    """The paired modes' shapes, with 95 % bands and the identified components.

    A structure of floors that move sideways is drawn deformed, with the shape before updating
    dashed; of one with floors that move in several directions, each direction is a line; of any
    other, components are bars. Shapes have their largest component on the main structure at 1.
    """
    heights = _heights(modes)
    n = max(1, len(modes.modes))
    across, down = min(n, PANELS_ACROSS), -(-n // PANELS_ACROSS)
    tall = 0.9 + 0.28 * min(MOST_ROWS, len(set(heights.values())) + 2)
    figure = figure_of(figure, (1.0 + 1.45 * across, 0.5 + down * max(2.3, tall)))
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for i, (mode, ax) in enumerate(zip(modes.modes, axes, strict=False)):
        _draw(ax, modes, mode, data)
        rows = len(ax.get_yticks())
        ax.tick_params(labelsize=7)
        ax.tick_params("y", labelsize=7.0 * min(1.0, 2.5 * MOST_ROWS / max(rows, 1)))
        if i % across:
            ax.set_yticklabels([""] * rows)
    for ax in axes[len(modes.modes) :]:
        ax.axis("off")
    if modes.modes:
        legend_of_figure(figure, axes[0], columns=4)
    if title:
        without_math(figure.suptitle(title, fontsize=10, x=0.02, ha="left"))
    return figure


def _draw(ax: Axes, modes: UpdatedModes, mode: UpdatedMode, data: ModalData) -> None:
    title = f"mode {mode.label}\n{mode.after_hz[1]:.4g} Hz"
    shape = Band(*(np.array(part) for part in mode.shape_after))
    reference = _identified(modes, mode, data)
    if _directions(modes):
        _plot_directions(ax, modes, shape, reference, title)
    elif modes.has_floors:
        plot_building_shape(
            modes, modes.places, shape, ax, reference=reference, before=mode.shape_before,
            name="model, 95 % band", title=title,
        )  # fmt: skip
        ax.xaxis.label.set_fontsize(6)
    else:
        plot_shape_components(modes, modes.places, shape, ax, reference=reference, title=title)
    ax.title.set_fontsize(8)


def _plot_directions(
    ax: Axes, modes: UpdatedModes, shape: Band, reference: Reference | None, title: str
) -> None:
    """Components over the floors, a line for each direction."""
    heights = _heights(modes)
    ax.axvline(0.0, color=GREY, linewidth=0.8)
    looks = cycle(zip(COLOURS, LINES, MARKERS, strict=False))
    for (direction, rows), (colour, line, marker) in zip(
        _directions(modes).items(), looks, strict=False
    ):
        y = [heights[modes.places[row]] for row in rows]
        low, median, high = (part[rows] for part in shape)
        ax.fill_betweenx(y, low, high, color=colour, alpha=0.3, linewidth=0)
        ax.plot(median, y, linestyle=line, marker=marker, markersize=3.5, color=colour,
                linewidth=1.2, label=direction)  # fmt: skip
    for k, place in enumerate(modes.appendages):
        component = float(shape.median[modes.places.index(place)])
        _appendage(ax, place, heights[place], component, "appendage" if k == 0 else None)
    if reference is not None:
        name, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=6,
                label=name)  # fmt: skip
    ax.set_xlim(-1.35, 1.35)
    ax.set_xticks([-1, 0, 1])
    floors = {heights[place]: _floor(place) for place in modes.places
              if place not in modes.appendages}  # fmt: skip
    ax.set_yticks(list(floors), list(floors.values()))
    ax.set_ylim(0.0, max(heights.values()) + 0.6)
    without_math(*ax.get_yticklabels(), ax.set_title(title))


def _appendage(ax: Axes, place: str, height: float, component: float, label: str | None) -> None:
    """An appendage at its component, or an arrow at the edge of the axes."""
    edge = 1.25
    inside = abs(component) < edge
    marker = "s" if inside else "<" if component < 0 else ">"
    (point,) = ax.plot(np.clip(component, -edge, edge), height, marker, color=VERMILION,
                       markeredgecolor="black", markersize=5, linestyle="none", clip_on=False,
                       label=label)  # fmt: skip
    hover(point, f"{place}: {component:.3g}")


def _identified(modes: UpdatedModes, mode: UpdatedMode, data: ModalData) -> Reference | None:
    """The identified shape at the places, scaled to lie upon the model's median."""
    shape = data.mode(mode.label).unit_shape
    if shape is None:
        return None
    at = [
        (place, modes.places.index(place), float(component))
        for place, component in zip(data.sensors, np.asarray(shape), strict=True)
        if place in modes.places and np.isfinite(component)
    ]
    components = np.array([component for *_, component in at])
    if not components.any():
        return None
    model = np.array([mode.shape_after[1][row] for _, row, _ in at])
    scale = float(model @ components / (components @ components))
    return "identified", [place for place, *_ in at], scale * components


def _directions(modes: UpdatedModes) -> dict[str, list[int]]:
    """Direction → rows of its places, where all places of the main structure have one."""
    rows: dict[str, list[int]] = {}
    for i, place in enumerate(modes.places):
        if place in modes.appendages:
            continue
        match = DIRECTED.match(place)
        if match is None:
            return {}
        direction = match[2] if match[2] in "xyz" else f"{match[2]} (rad)"
        rows.setdefault(direction, []).append(i)
    return rows


def _floor(place: str) -> str:
    match = DIRECTED.match(place)
    return place if match is None else match[1]


def _heights(modes: UpdatedModes) -> dict[str, float]:
    """Place → height; floors that move in several directions are counted from 1."""
    if not _directions(modes):
        return modes.heights()
    main = [place for place in modes.places if place not in modes.appendages]
    number = {name: i for i, name in enumerate(dict.fromkeys(map(_floor, main)), 1)}
    heights = {place: float(number[_floor(place)]) for place in main}
    per_floor = len(main) / len(number)
    own = modes.heights()
    for k, place in enumerate(modes.appendages):  # near the floor that it hangs on
        near = round(own[place] / per_floor + 0.49) + 0.25 + 0.2 * (k % 2)
        heights[place] = min(near, len(number) + 0.45)
    return heights
