"""Where a search finds appendages: a drawing that suits what is known of the structure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayes_ssi.plots.place_bars import plot_place_bars
from bayes_ssi.plots.place_map import plot_place_map
from bayes_ssi.plots.places_on_building import MOST_FLOORS, plot_places_on_building
from bayes_ssi.studies.appendages.search_result import SearchRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
