"""Figures of one mode shape, on the structure or component by component."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.plots.style import (
    BLUE,
    GREY,
    VERMILION,
    axes_of,
    draw_as_they_are,
)
from bayes_ssi.predictions.bands import Band

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_components", "plot_shape"]

# Half the width of a building, in the unit of the shapes that are drawn on it, and how far from its
# axis anything is drawn: appendages may move many times as far as floors.
HALF_WIDTH, REACH = 0.7, 2.1


class Drawn(Protocol):
    """What a drawing asks of a structure; a stored record of its modes answers it too."""

    @property
    def appendages(self) -> tuple[str, ...]: ...

    def heights(self) -> dict[str, float]: ...


def plot_shape(
    structure: Drawn,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: tuple[str, Sequence[str], FloatArray] | None = None,
    before: Sequence[float] | None = None,
    name: str = "model",
    title: str = "",
) -> Axes:
    """A mode shape as the deformed building: floors and columns, appendages marked, with bands.

    An appendage that moves further than the axes reach is an arrow at their edge, its component
    and band written below.

    Args:
        structure: says at which height each degree of freedom is drawn.
        places: degrees of freedom of the shape.
        shape: median and band of the components (n_places,), in a scale in which floors move by
            about 1.
        ax: axes; new ones if None.
        reference: name, places and components of another shape, drawn as crosses.
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
    for k, side in enumerate((-HALF_WIDTH, HALF_WIDTH)):
        if before is not None:
            earlier = np.array([0.0, *(before[i] for i in floors)])
            ax.plot(earlier + side, y, color=GREY, linewidth=0.9, linestyle="--",
                    label="before updating" if k == 0 else None)  # fmt: skip
        ax.fill_betweenx(y, low + side, high + side, color=BLUE, alpha=0.35, linewidth=0)
        label = name if k == 0 else None
        ax.plot(median + side, y, color=BLUE, linewidth=1.2, label=label)
    for x, height in zip(median[1:], y[1:], strict=True):
        ax.plot([x - HALF_WIDTH, x + HALF_WIDTH], [height, height], color="black", linewidth=2.5)
    for i, place in enumerate(places):
        if place in structure.appendages:
            _appendage(ax, heights[place], *(float(part[i]) for part in shape))
    _numbers_below(ax, structure, places, shape, REACH - 0.1)
    if reference is not None:
        other, at, components = reference
        ax.plot(components, [heights[place] for place in at], "x", color="black", markersize=7,
                markeredgewidth=1.5, label=other)  # fmt: skip
    ax.set_xlim(-REACH, REACH)
    ax.set_ylim(-0.15, max(heights.values()) + 0.4)
    ax.set_yticks(y, ["ground", *(places[i] for i in floors)])
    draw_as_they_are(ax.get_yticklabels())
    ax.set_xticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="y", length=0)
    draw_as_they_are([ax.set_title(title)])
    return ax


def _appendage(ax: Axes, height: float, low: float, median: float, high: float) -> None:
    inside = abs(median) < REACH - 0.1
    at = median if inside else np.copysign(REACH - 0.1, median)
    if inside:
        ax.errorbar(at, height, xerr=[[median - low], [high - median]], color=VERMILION, capsize=3)
    marker = "s" if inside else "<" if median < 0 else ">"
    ax.plot(at, height, marker, color=VERMILION, markeredgecolor="black", markersize=7,
            linestyle="none", label="appendage", zorder=3)  # fmt: skip


def _numbers_below(
    ax: Axes, structure: Drawn, places: Sequence[str], shape: Band, reach: float
) -> None:
    """Write below the axes the components of appendages that these do not hold."""
    far = [
        # Adding zero makes a negative zero a plain one.
        f"{place}: {median + 0.0:.1f}\n({low + 0.0:.1f} to {high + 0.0:.1f})"
        for i, (place, low, median, high) in enumerate(
            zip(places, *np.round(shape, 1), strict=True)
        )
        if place in structure.appendages and abs(shape.median[i]) >= reach
    ]
    draw_as_they_are([ax.set_xlabel("\n".join(far), fontsize=7)])


def plot_components(
    structure: Drawn,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    title: str = "",
) -> Axes:
    """A mode shape component by component, for structures that move in several directions.

    The axes reach as far as the main structure moves; components of appendages that move further
    are written below.

    Args:
        structure: which says what is an appendage.
        places: degrees of freedom, from the lowest bar upwards.
        shape: median and band of the components (n_places,).
        ax: axes; new ones if None.
        title: above the figure.
    """
    ax = axes_of(ax, (2.6, 0.8 + 0.22 * len(places)))
    y = np.arange(len(places))
    low, median, high = shape
    main = [i for i, place in enumerate(places) if place not in structure.appendages]
    reach = 1.15 * max(1e-300, *(float(np.abs(part[main]).max()) for part in shape))
    colours = [BLUE if i in main else VERMILION for i in y]
    ax.axvline(0.0, color=GREY, linewidth=0.6)
    ax.barh(y, median, height=0.6, color=colours, alpha=0.45)
    ax.errorbar(median, y, xerr=[median - low, high - median], fmt="none", ecolor="black",
                elinewidth=0.8, capsize=2)  # fmt: skip
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5, len(places) - 0.5)
    ax.set_yticks(y, places)
    draw_as_they_are([*ax.get_yticklabels(), ax.set_title(title)])
    _numbers_below(ax, structure, places, shape, reach)
    return ax
