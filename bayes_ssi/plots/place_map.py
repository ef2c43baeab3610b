"""The places of a search drawn in space, on the structure where its geometry is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_ssi.plots.figure_style import GREY, hover, legend_of_figure
from bayes_ssi.plots.probability_colours import colour_bar, colour_scale
from bayes_ssi.plots.space_axes import (
    MOST_VECTORS,
    colour_bar_axes,
    draw_structure,
    space_axes,
)
from bayes_ssi.structures.geometry import Geometry, Point
from bayes_ssi.studies.appendages.search_result import PlaceRecord
from bayes_ssi.studies.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The length of an arrow, of the longest side of the structure.
ARROW = 0.13
# Less than this share of the highest probability cannot be told from zero by its colour: such
# places are dots without directions.
LEAST_SHARE = 0.01


class _Located(NamedTuple):
    """A place with coordinates, and the end of the arrow that shows its direction, if any."""

    record: PlaceRecord
    at: Point
    end: Point | None


def plot_place_map(
    places: Sequence[PlaceRecord], geometry: Geometry | None = None, ax: Axes | None = None
) -> Axes:
    """Places in space, the probability of an appendage in colour, and directions as arrows.

    Args:
        ax: axes in three dimensions; those of a new figure if None.
    """
    located = _located(places, geometry)
    best = located[-1].record
    shown = [one for one in located if one.record.probability >= LEAST_SHARE * best.probability]
    points = [
        *(one.at for one in located),
        *(one.end for one in shown if one.end is not None),
        *(geometry.nodes.values() if geometry else ()),
    ]
    unit = geometry.unit if geometry else ""
    title = f"Most probable: {best.place.name}, {probability_text(best.probability)}"
    drawn = space_axes(np.array(points), unit, title, ax)
    if geometry is not None:
        draw_structure(drawn, geometry)
    scale = colour_scale(best.probability)
    dots = sorted({one.at for one in located} - {one.at for one in shown})
    if dots:
        drawn.scatter(*np.transpose(dots), s=4.0, color=[scale.to_rgba(0.0)], edgecolors=GREY,
                      linewidths=0.4, depthshade=False, label="improbable place",
                      rasterized=len(dots) > MOST_VECTORS)  # fmt: skip
    for one in shown:
        artist = _draw(drawn, one, scale.to_rgba(one.record.probability))
        if len(shown) <= MOST_VECTORS:
            text = probability_text(one.record.probability)
            hover(artist, f"{one.record.place.name}: probability {text}")
        else:
            artist.set_rasterized(True)
    colour_bar(drawn, scale, colour_bar_axes(drawn) if ax is None else None)
    legend_of_figure(drawn.figure, [drawn])
    return drawn


def _located(places: Sequence[PlaceRecord], geometry: Geometry | None) -> list[_Located]:
    """The places with coordinates, the most probable last, so that it is drawn above the others."""
    known = [(each, each.place.coordinates) for each in places if each.place.coordinates]
    if not known:
        raise ValueError("a map needs places with coordinates")
    nodes = geometry.nodes.values() if geometry else ()
    length = ARROW * float(np.ptp([*(at for _, at in known), *nodes], axis=0).max() or 1.0)
    located = []
    for record, at in sorted(known, key=lambda pair: pair[0].probability):
        direction = record.place.direction
        x, y, z = np.add(at, np.multiply(length, direction or (0.0, 0.0, 0.0)))
        located.append(_Located(record, at, (x, y, z) if direction else None))
    return located


def _draw(ax: Any, place: _Located, colour: Any) -> Any:
    """An arrow along the direction, or the marker of the kind where it has none."""
    if place.end is None:
        kind = place.record.place
        return ax.scatter(*place.at, s=36.0, marker=kind.marker, color=[colour],
                          edgecolors="black", linewidths=0.4, depthshade=False,
                          label=kind.title)  # fmt: skip
    along = np.subtract(place.end, place.at)
    return ax.quiver(*place.at, *along, color=[colour], linewidth=1.6, arrow_length_ratio=0.4,
                     label="place and direction")  # fmt: skip
