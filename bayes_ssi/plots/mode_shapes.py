"""The updated modes of a model class drawn on its structure, from stored records."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.plots.shapes import plot_shape
from bayes_ssi.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    draw_as_they_are,
    figure_of,
    hover,
    legend_of_figure,
)
from bayes_ssi.posterior.updated_modes import UpdatedMode, UpdatedModes
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
from bayes_ssi.plots.identified_modes import PANELS_ACROSS

__all__ = ["plot_mode_shapes", "shapes_size"]

# A label that ends in a direction: "floor 3 x".
DIRECTED = re.compile(r"^(.*\S)\s+(x|y|z|torsion|rx|ry|rz)$")
# Rows of a panel whose labels stand apart; more of them are drawn closer, and smaller at last.
MOST_ROWS = 16
LINES = ((BLUE, "-", "o"), (ORANGE, "--", "s"), (GREEN, ":", "^"), (VERMILION, "-.", "D"))


def plot_mode_shapes(
    modes: UpdatedModes, data: ModalData, figure: Figure | None = None, title: str = ""
) -> Figure:
    """The paired modes' shapes on the structure, with 95 % bands and the identified components.

    A structure of floors that move sideways is drawn deformed, with the shape before updating
    dashed; of one with floors that move in several directions, each direction is a line; of any
    other, components are shown one below the other. Shapes have their largest component on the
    main structure at 1.
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
        rows = len(ax.get_yticks())
        ax.tick_params("y", labelsize=7.0 * min(1.0, 2.5 * MOST_ROWS / max(rows, 1)))
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
    tall = 0.9 + 0.28 * min(MOST_ROWS, len(set(_floors(modes).values())) + 2)
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
        before=mode.shape_before,
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
        if not _directions(modes):  # nothing says that neighbours in the list are neighbours
            ax.hlines(y, low[rows], high[rows], color=colour, alpha=0.4, linewidth=3)
            line = "none"
        else:
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
