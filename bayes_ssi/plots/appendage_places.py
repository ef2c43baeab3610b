"""Where a search finds appendages: a drawing that suits what is known of the structure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bayes_ssi.plots.figure_style import BLUE, GREY, SMALL, hover, name_rows, rows_of
from bayes_ssi.plots.place_map import plot_place_map
from bayes_ssi.plots.places_on_building import MOST_FLOORS, plot_places_on_building
from bayes_ssi.studies.appendages.search_result import PlaceRecord, SearchRecord
from bayes_ssi.studies.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Places with a bar of their own, as many as fit on the first screen of a report.
MOST_BARS = 12


def plot_place_bars(places: Sequence[PlaceRecord], ax: Axes | None = None) -> Axes:
    """The probability of an appendage at the most probable places, and at all others together.

    Args:
        ax: axes; those of a new figure if None.
    """
    first, others = places[:MOST_BARS], places[MOST_BARS:]
    bars = [(each.place.name, each.probability, BLUE) for each in first]
    if others:
        together = sum(each.probability for each in others)
        bars.append((f"{len(others)} others together", together, GREY))
    names = [name for name, _, _ in bars]
    ax = rows_of(ax, names, extra=0.7)
    name_rows(ax, names)
    for row, (name, probability, colour) in enumerate(bars):
        text = probability_text(probability)
        (bar,) = ax.barh(row, probability, height=0.6, color=colour)
        hover(bar, f"{name}: probability {text}")
        ax.annotate(text, (probability, row), xytext=(3, 0), textcoords="offset points",
                    va="center", fontsize=SMALL)  # fmt: skip
    highest = max(probability for _, probability, _ in bars)
    ax.set_xlim(0.0, 1.25 * highest or 1.0)  # with room for the numbers
    ax.set_xlabel("probability of an appendage")
    return ax


def plot_places(search: SearchRecord, ax: Axes | None = None) -> Axes:
    """The probability of an appendage at each place of a search.

    Places on floors are drawn on the building, places with coordinates in space, and others as
    bars. Axes that are given must have three dimensions for a drawing in space.
    """
    heights = [each.place.height for each in search.places]
    if all(height is not None and height <= MOST_FLOORS for height in heights):
        return plot_places_on_building(search.places, ax)
    if any(each.place.coordinates is not None for each in search.places):
        return plot_place_map(search.places, search.geometry, ax)
    return plot_place_bars(search.places_by_probability, ax)
