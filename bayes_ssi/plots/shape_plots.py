"""One mode shape with its band, on the building or component by component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.figure_style import BLUE, GREY, VERMILION, axes_of, without_math
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_building_shape", "plot_shape_components"]

# Half the width of a building, in the unit of the shapes that are drawn on it, and how far from its
# axis anything is drawn: appendages may move many times as far as floors.
HALF_WIDTH, REACH = 0.7, 2.1

# Name, places and components of a shape to compare with.
Reference = tuple[str, Sequence[str], FloatArray]


class Building(Protocol):
    """What a drawing needs of a structure; a stored record of its modes has it, too."""

    @property
    def appendages(self) -> tuple[str, ...]: ...

    def heights(self) -> dict[str, float]: ...


def plot_building_shape(
    structure: Building,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: Reference | None = None,
    before: Sequence[float] | None = None,
    name: str = "model",
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
        name: of the shape, for a legend.
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
        ax.plot(median + side, y, color=BLUE, linewidth=1.2, label=name if labelled else None)
    for x, height in zip(median[1:], y[1:], strict=True):
        ax.plot([x - HALF_WIDTH, x + HALF_WIDTH], [height, height], color="black", linewidth=2.5)
    for i, place in enumerate(places):
        if place in structure.appendages:
            _appendage(ax, heights[place], *(float(part[i]) for part in shape))
    _write_below(ax, structure, places, shape, REACH - 0.1)
    if reference is not None:
        other, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=7,
                markeredgewidth=1.5, label=other)  # fmt: skip
    ax.set_xlim(-REACH, REACH)
    ax.set_ylim(-0.15, max(heights.values()) + 0.4)
    ax.set_yticks(y, ["ground", *(places[i] for i in floors)])
    ax.set_xticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    without_math(*ax.get_yticklabels(), ax.set_title(title))
    return ax


def _appendage(ax: Axes, height: float, low: float, median: float, high: float) -> None:
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
    """Write below the axes the components of appendages that move further than these reach."""
    # Adding zero turns a negative zero into a plain one.
    rounded = np.round(np.array(shape).T, 1) + 0.0
    far = [
        f"{place}: {median:.1f}\n({low:.1f} to {high:.1f})"
        for i, (place, (low, median, high)) in enumerate(zip(places, rounded, strict=True))
        if place in structure.appendages and abs(shape.median[i]) >= reach
    ]
    without_math(ax.set_xlabel("\n".join(far), fontsize=7))


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
    are written below.

    Args:
        structure: names its appendages.
        places: degrees of freedom, from the lowest bar upwards.
        shape: median and band of the components (n_places,).
        ax: axes; new ones if None.
        reference: another shape, drawn as crosses.
        title: above the figure.
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
        other, at, components = reference
        ax.plot(components, [places.index(place) for place in at], "x", color="black",
                markersize=6, label=other)  # fmt: skip
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5, len(places) - 0.5)
    ax.set_yticks(y, places)
    without_math(*ax.get_yticklabels(), ax.set_title(title))
    _write_below(ax, structure, places, shape, reach)
    return ax
