"""The places of a search drawn on a building."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from bayes_ssi.plots.figure_style import GREY, SMALL, WIDTH, axes_of, hover, legend_below
from bayes_ssi.plots.probability_colours import colour_bar, colour_scale
from bayes_ssi.structures.geometry import Point, direction_name
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.search_result import PlaceRecord
from bayes_ssi.studies.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Inches of a floor: at most, and at least, where the probabilities of floors still keep apart.
HIGHEST, LOWEST = 0.7, 0.2
# Inches: of a building with more than a few floors; and for what is above and below it.
BUILDING, AROUND = 4.0, 1.6
# Taller figures would not fit a page.
MOST_FLOORS = 40
# Distance of columns of places, in half of which their probabilities are written.
COLUMN = 1.1

# A kind of appendage in one direction has a column of its own.
Kind = tuple[type[AppendagePlace], Point | None]


def plot_places_on_building(places: Sequence[PlaceRecord], ax: Axes | None = None) -> Axes:
    """The building, and in colour the probability of an appendage at each place of a search.

    Each kind of appendage has its own marker, next to its floor or in its storey, and the
    probability is written next to it.

    Args:
        ax: axes; those of a new figure if None.
    """
    heights = [each.place.height or 0.0 for each in places]
    n_floors = math.ceil(max(heights))
    columns, width = _columns(each.place for each in places)
    tall = n_floors * min(HIGHEST, max(LOWEST, BUILDING / n_floors))
    ax = axes_of(ax, (max(WIDTH, 1.0 + 0.75 * len(columns)), AROUND + tall))
    ax.plot([-0.5, width + 0.5], [0, 0], color="black", linewidth=2.0)
    for side in (0.0, width):
        ax.plot([side, side], [0, n_floors], color=GREY, linewidth=1.5)
    for floor in range(1, n_floors + 1):
        ax.plot([0.0, width], [floor, floor], color="black", linewidth=1.5)
        ax.text(-0.15, floor, f"floor {floor}", ha="right", va="center", fontsize=SMALL)
    scale = colour_scale(max(each.probability for each in places))
    for each, y in zip(places, heights, strict=True):
        place, text = each.place, probability_text(each.probability)
        x = columns[_kind(place)]
        if place.is_outside:
            ax.plot([width, x], [y, y], color=GREY, linewidth=0.8, linestyle=":")
        point = ax.scatter(
            x, y, s=55.0, marker=place.marker, zorder=3, color=[scale.to_rgba(each.probability)],
            edgecolors="black", linewidths=0.6,
        )  # fmt: skip
        hover(point, f"{place.name}: probability {text}")
        # Above the line that joins a column further out to its floor.
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
        ax.text(x + 0.17, y, text, va="center", fontsize=SMALL, bbox=box)
    ax.set_xlim(-1.1, max(width, *columns.values()) + 0.7)
    ax.set_ylim(-0.3, n_floors + 0.6)
    ax.axis("off")
    for (_, direction), x in columns.items():
        if direction:
            ax.text(x, n_floors + 0.35, direction_name(direction), ha="center", fontsize=SMALL)
    for kind in dict.fromkeys(kind for kind, _ in columns):
        ax.plot([], [], linestyle="none", marker=kind.marker, color="black",
                markerfacecolor="none", label=kind.title)  # fmt: skip
    legend_below(ax, 2)
    colour_bar(ax, scale)
    return ax


def _kind(place: AppendagePlace) -> Kind:
    return type(place), place.direction


def _columns(places: Iterable[AppendagePlace]) -> tuple[dict[Kind, float], float]:
    """Where each kind of appendage is drawn in the building or next to it, and the width of it."""
    kinds = dict.fromkeys(_kind(place) for place in places)
    inside = [kind for kind in kinds if not kind[0].is_outside]
    outside = [kind for kind in kinds if kind[0].is_outside]
    width = COLUMN * max(1, len(inside))
    columns = {kind: COLUMN * (i + 0.15) for i, kind in enumerate(inside)}
    columns |= {kind: width + COLUMN * (i + 0.5) for i, kind in enumerate(outside)}
    return columns, width
