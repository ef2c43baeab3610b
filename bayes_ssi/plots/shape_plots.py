"""Mode shapes with their bands, on the building or component by component."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior.configuration_modes import UpdatedModes
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PANEL,
    SMALL,
    VERMILION,
    axes_of,
    figure_of,
    legend_of_figure,
    panels_across,
    title_of,
    width_of_panels,
    without_math,
    wrapped,
)
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Half the width of a building, in the unit of the shapes drawn on it, and the largest distance from
# its axis that is drawn, where appendages are marked that move further: they may move many times as
# far as floors. The rest is room for half of their mark.
HALF_WIDTH, REACH, MARGIN = 0.7, 1.8, 0.3
APPENDAGES = "appendage"
BEYOND = "appendage beyond the scale, its component below"
# Rows whose labels fit a panel; with more, panels grow no taller and labels become smaller.
MOST_ROWS = 40
# A point has three displacements and three rotations.
MOST_DIRECTIONS = 6
# Before the direction in the label of a group of places.
MODEL = "model, "

# Both give the heights of their places and name their appendages.
Building = Structure | UpdatedModes
# Name, places and components of a shape to compare with.
Reference = tuple[str, Sequence[str], FloatArray]


@dataclass(frozen=True, eq=False)
class DrawnShape:
    """A mode shape of a figure; its attributes are arguments of :func:`plot_building_shape`."""

    title: str
    shape: Band
    reference: Reference | None = None
    before: Sequence[float] | None = None


def plot_shapes(
    structure: Building,
    places: Sequence[str],
    shapes: Sequence[DrawnShape],
    figure: Figure | None = None,
    *,
    sideways: bool,
    name: str = "model, with its band",
) -> Figure:
    """Mode shapes of one structure next to one another, with one legend.

    Args:
        places: degrees of freedom of the shapes.
        figure: to draw on; a new one if None.
        sideways: whether the places are floors that move sideways, to be drawn as a building; if
            not, shapes are drawn component by component.
    """
    across = panels_across(len(shapes))
    down = -(-len(shapes) // across)
    height = 2.6 if sideways else 1.0 + 0.18 * min(MOST_ROWS, len(places))
    figure = figure_of(figure, (width_of_panels(across), 0.6 + down * height))
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for i, (each, ax) in enumerate(zip(shapes, axes, strict=False)):
        if sideways:
            plot_building_shape(structure, places, each.shape, ax, reference=each.reference,
                                before=each.before, title=each.title, name=name)  # fmt: skip
        else:
            plot_shape_components(structure, places, each.shape, ax, reference=each.reference,
                                  title=each.title)  # fmt: skip
        ax.tick_params("y", labelsize=SMALL * min(1.0, MOST_ROWS / len(places)),
                       labelleft=i % across == 0)  # fmt: skip
    for ax in axes[len(shapes) :]:
        ax.remove()
    legend_of_figure(figure, axes[: len(shapes)], columns=4)
    return figure


def plot_building_shape(
    structure: Building,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: Reference | None = None,
    before: Sequence[float] | None = None,
    title: str = "",
    name: str = "model, with its band",
) -> Axes:
    """A mode shape as the deformed building: floors and columns, appendages marked, with bands.

    An appendage that moves further than the axes reach is an arrow at their edge, its component
    and band written below.

    Args:
        places: degrees of freedom of the shape.
        shape: median and band of the components (n_places,), in a scale in which floors move by
            about 1.
        ax: axes; new ones if None.
        before: components (n_places,) before updating, drawn as dashed columns.
    """
    ax = axes_of(ax, (2.2, 3.0))
    heights = structure.heights()
    floors = [i for i, place in enumerate(places) if place not in structure.appendages]
    floors.sort(key=lambda i: heights[places[i]])
    y = np.array([0.0, *(heights[places[i]] for i in floors)])
    low, median, high = (np.r_[0.0, part[floors]] for part in shape)
    ax.axvline(0.0, color=GREY, linewidth=0.6, linestyle=":")
    ax.plot([-REACH, REACH], [0, 0], color="black", linewidth=2.0)
    for side, labelled in ((-HALF_WIDTH, True), (HALF_WIDTH, False)):
        if before is not None:
            earlier = np.array([0.0, *(before[i] for i in floors)])
            ax.plot(earlier + side, y, color=GREY, linewidth=0.9, linestyle="--",
                    label="before updating" if labelled else None)  # fmt: skip
        ax.fill_betweenx(y, low + side, high + side, color=BLUE, alpha=0.35, linewidth=0)
        ax.plot(median + side, y, color=BLUE, linewidth=1.2,
                label=name if labelled else None)  # fmt: skip
    for x, height in zip(median[1:], y[1:], strict=True):
        ax.plot([x - HALF_WIDTH, x + HALF_WIDTH], [height, height], color="black", linewidth=2.5)
    for i, place in enumerate(places):
        if place in structure.appendages:
            _draw_appendage(ax, heights[place], *(float(part[i]) for part in shape))
    _write_below(ax, structure, places, shape, REACH)
    if reference is not None:
        other, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=7,
                markeredgewidth=1.5, label=other)  # fmt: skip
    ax.set_xlim(-REACH - MARGIN, REACH + MARGIN)
    ax.set_ylim(-0.15, max(heights.values()) + 0.4)
    ax.set_yticks(y, ["ground", *(places[i] for i in floors)])
    ax.set_xticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    without_math(*ax.get_yticklabels())
    title_of(ax, title)
    return ax


def _draw_appendage(ax: Axes, height: float, low: float, median: float, high: float) -> None:
    if abs(median) >= REACH:
        _mark_beyond(ax, median, height, REACH)
        return
    ax.errorbar(median, height, xerr=[[median - low], [high - median]], color=VERMILION, capsize=3)
    ax.plot(median, height, "s", color=VERMILION, markeredgecolor="black", markersize=7,
            linestyle="none", label="appendage", zorder=3)  # fmt: skip


def _mark_beyond(ax: Axes, median: float, y: float, reach: float) -> None:
    """An arrow head within the axes, towards a component that lies beyond them."""
    ax.plot(np.copysign(reach, median), y, "<" if median < 0 else ">", color=VERMILION,
            markeredgecolor="black", markersize=7, linestyle="none", label=BEYOND,
            zorder=3)  # fmt: skip


def _write_below(
    ax: Axes, structure: Building, places: Sequence[str], shape: Band, reach: float
) -> None:
    """Write below the axes the components of appendages whose intervals reach beyond them."""
    # Adding zero turns a negative zero into a plain one.
    rounded = np.round(np.array(shape).T, 1) + 0.0
    far = [
        f"{wrapped(place, PANEL, SMALL)}:\n{median:.1f}\n({low:.1f} to {high:.1f})"
        for i, (place, (low, median, high)) in enumerate(zip(places, rounded, strict=True))
        if place in structure.appendages and max(-shape.low[i], shape.high[i]) >= reach
    ]
    ax.set_xlabel("\n".join(far), fontsize=SMALL, parse_math=False)


def plot_shape_components(
    structure: Building,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: Reference | None = None,
    title: str = "",
) -> Axes:
    """A mode shape component by component, for structures that move in several directions.

    The axes reach as far as the main structure moves; components of appendages that move further
    are written below. The components of each direction stand together in a colour of their own,
    those of appendages above them. Arguments are as in :func:`plot_building_shape`; the first place
    is the lowest bar.
    """
    ax = axes_of(ax, (2.6, 0.8 + 0.22 * len(places)))
    groups = by_direction(places, structure.appendages)
    order = [place for group in groups.values() for place in group]
    # Half a row between directions.
    gaps = np.repeat(0.5 * np.arange(len(groups)), [len(group) for group in groups.values()])
    y = dict(zip(order, np.arange(len(order)) + gaps, strict=True))
    bands = dict(zip(places, np.array(shape).T, strict=True))
    main = [bands[place] for place in places if place not in structure.appendages]
    largest = np.abs(main).max(initial=0.0)
    reach = 1.15 * largest if largest > 0.0 else 1.0
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    colours = cycle((BLUE, GREEN, ORANGE))
    for name, group in groups.items():
        colour = VERMILION if name == APPENDAGES else next(colours)
        rows = np.array([y[place] for place in group])
        low, median, high = np.array([bands[place] for place in group]).T
        ax.barh(rows, median, height=0.7, color=colour, alpha=0.6, label=name)
        # Of arrays of one element, matplotlib makes numbers in a way of which numpy 2.0 warns.
        below, above = (median - low).tolist(), (high - median).tolist()
        ax.errorbar(median, rows, xerr=[below, above], fmt="none", ecolor="black",
                    elinewidth=0.8, capsize=2)  # fmt: skip
        for row, component in zip(rows, median, strict=True):
            if abs(component) >= reach:
                _mark_beyond(ax, component, row, 0.9 * reach)
    if reference is not None:
        name, at, components = reference
        ax.plot(components, [y[place] for place in at], "x", color="black", markersize=6,
                label=name)  # fmt: skip
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5, max(y.values()) + 0.5)
    ax.set_yticks([*y.values()], order)
    ax.locator_params(axis="x", nbins=2)
    without_math(*ax.get_yticklabels())
    title_of(ax, title)
    _write_below(ax, structure, places, shape, reach)
    return ax


def by_direction(places: Sequence[str], appendages: Sequence[str]) -> dict[str, list[str]]:
    """Label of a group → its places: those of the main structure by direction, then appendages.

    Labels of places that move in several directions end with the direction: "floor 2 x". Where
    endings are numbers, or do not repeat, the places of the main structure are one group.
    """
    main = [place for place in places if place not in appendages]
    directions: dict[str, list[str]] = {}
    for place in main:
        directions.setdefault(place.split()[-1], []).append(place)
    few = 1 < len(directions) <= min(MOST_DIRECTIONS, len(main) - 1)
    if few and not any(ending.isdecimal() for ending in directions):
        groups = {f"{MODEL}{ending}": group for ending, group in directions.items()}
    else:
        groups = {"model": main}
    others = [place for place in places if place in appendages]
    return groups | ({APPENDAGES: others} if others else {})
