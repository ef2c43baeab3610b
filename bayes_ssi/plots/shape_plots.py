"""Mode shapes with their bands, on the building or component by component."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREY,
    PANELS_ACROSS,
    VERMILION,
    axes_of,
    figure_of,
    legend_of_figure,
    without_math,
)
from bayes_ssi.posterior.configuration_modes import UpdatedModes
from bayes_ssi.predictions.bands import Band
from bayes_ssi.structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Half the width of a building, in the unit of the shapes drawn on it, and the largest distance from
# its axis that is drawn: appendages may move many times as far as floors.
HALF_WIDTH, REACH = 0.7, 2.1
# Rows whose labels fit a panel; with more, panels grow no taller and labels become smaller.
MOST_ROWS = 40

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
) -> Figure:
    """Mode shapes of one structure next to one another, with one legend.

    Args:
        structure: gives heights and appendages.
        places: degrees of freedom of the shapes.
        shapes: one or more shapes.
        figure: to draw on; a new one if None.
        sideways: whether the places are floors that move sideways, to be drawn as a building; if
            not, shapes are drawn component by component.
    """
    across = min(len(shapes), PANELS_ACROSS)
    down = -(-len(shapes) // across)
    height = 2.8 if sideways else 1.0 + 0.2 * min(MOST_ROWS, len(places))
    figure = figure_of(figure, (1.4 + 1.45 * across, 0.5 + down * height))
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for i, (each, ax) in enumerate(zip(shapes, axes, strict=False)):
        if sideways:
            plot_building_shape(structure, places, each.shape, ax, reference=each.reference,
                                before=each.before, title=each.title)  # fmt: skip
        else:
            plot_shape_components(structure, places, each.shape, ax, reference=each.reference,
                                  title=each.title)  # fmt: skip
        ax.title.set_fontsize(8)
        ax.tick_params(labelsize=7)
        ax.tick_params("y", labelsize=7.0 * min(1.0, MOST_ROWS / len(places)),
                       labelleft=i % across == 0)  # fmt: skip
    for ax in axes[len(shapes) :]:
        ax.remove()
    legend_of_figure(figure, axes[0], columns=4)
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
) -> Axes:
    """A mode shape as the deformed building: floors and columns, appendages marked, with bands.

    An appendage that moves further than the axes reach is an arrow at their edge, its component
    and band written below.

    Args:
        structure: gives the height at which each degree of freedom is drawn.
        places: degrees of freedom of the shape.
        shape: median and band of the components (n_places,), in a scale in which floors move by
            about 1.
        ax: axes; new ones if None.
        reference: another shape, drawn as crosses.
        before: components (n_places,) before updating, drawn as dashed columns.
        title: above the building.
    """
    ax = axes_of(ax, (2.2, 3.0))
    heights = structure.heights()
    floors = [i for i, place in enumerate(places) if place not in structure.appendages]
    floors.sort(key=lambda i: heights[places[i]])
    y = np.array([0.0, *(heights[places[i]] for i in floors)])
    low, median, high = (np.r_[0.0, part[floors]] for part in shape)
    ax.axvline(0.0, color=GREY, linewidth=0.6, linestyle=":")
    ax.plot([-0.9 * REACH, 0.9 * REACH], [0, 0], color="black", linewidth=2.0)
    for side, labelled in ((-HALF_WIDTH, True), (HALF_WIDTH, False)):
        if before is not None:
            earlier = np.array([0.0, *(before[i] for i in floors)])
            ax.plot(earlier + side, y, color=GREY, linewidth=0.9, linestyle="--",
                    label="before updating" if labelled else None)  # fmt: skip
        ax.fill_betweenx(y, low + side, high + side, color=BLUE, alpha=0.35, linewidth=0)
        ax.plot(median + side, y, color=BLUE, linewidth=1.2,
                label="model, with its band" if labelled else None)  # fmt: skip
    for x, height in zip(median[1:], y[1:], strict=True):
        ax.plot([x - HALF_WIDTH, x + HALF_WIDTH], [height, height], color="black", linewidth=2.5)
    for i, place in enumerate(places):
        if place in structure.appendages:
            _draw_appendage(ax, heights[place], *(float(part[i]) for part in shape))
    _write_below(ax, structure, places, shape, REACH - 0.1)
    if reference is not None:
        name, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=7,
                markeredgewidth=1.5, label=name)  # fmt: skip
    ax.set_xlim(-REACH, REACH)
    ax.set_ylim(-0.15, max(heights.values()) + 0.4)
    ax.set_yticks(y, ["ground", *(places[i] for i in floors)])
    ax.set_xticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    without_math(*ax.get_yticklabels(), ax.set_title(title))
    return ax


def _draw_appendage(ax: Axes, height: float, low: float, median: float, high: float) -> None:
    inside = abs(median) < REACH - 0.1
    at = median if inside else np.copysign(REACH - 0.1, median)
    if inside:
        ax.errorbar(at, height, xerr=[[median - low], [high - median]], color=VERMILION, capsize=3)
    marker = "s" if inside else "<" if median < 0 else ">"
    ax.plot(at, height, marker, color=VERMILION, markeredgecolor="black", markersize=7,
            linestyle="none", label="appendage", zorder=3)  # fmt: skip


def _write_below(
    ax: Axes, structure: Building, places: Sequence[str], shape: Band, reach: float
) -> None:
    """Write below the axes the components of appendages that lie beyond their limits."""
    # Adding zero turns a negative zero into a plain one.
    rounded = np.round(np.array(shape).T, 1) + 0.0
    far = [
        f"{place}: {median:.1f}\n({low:.1f} to {high:.1f})"
        for i, (place, (low, median, high)) in enumerate(zip(places, rounded, strict=True))
        if place in structure.appendages and abs(shape.median[i]) >= reach
    ]
    ax.set_xlabel("\n".join(far), fontsize=6, parse_math=False)


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
    are written below. Arguments are as in :func:`plot_building_shape`; the first place is the
    lowest bar.
    """
    ax = axes_of(ax, (2.6, 0.8 + 0.22 * len(places)))
    y = np.arange(len(places))
    low, median, high = shape
    main = [i for i, place in enumerate(places) if place not in structure.appendages]
    largest = np.abs(np.array(shape)[:, main]).max(initial=0.0)
    reach = 1.15 * largest if largest > 0.0 else 1.0
    colours = [BLUE if i in main else VERMILION for i in y]
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.barh(y, median, height=0.6, color=colours, alpha=0.45, label="model")
    ax.errorbar(median, y, xerr=[median - low, high - median], fmt="none", ecolor="black",
                elinewidth=0.8, capsize=2)  # fmt: skip
    if reference is not None:
        name, at, components = reference
        ax.plot(components, [places.index(place) for place in at], "x", color="black",
                markersize=6, label=name)  # fmt: skip
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5, len(places) - 0.5)
    ax.set_yticks(y, places)
    without_math(*ax.get_yticklabels(), ax.set_title(title))
    _write_below(ax, structure, places, shape, reach)
    return ax
