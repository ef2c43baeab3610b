"""The most probable places of a search as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bayes_ssi.plots.figure_style import BLUE, GREY, SMALL, hover, name_rows, rows_of
from bayes_ssi.studies.appendages.search_result import PlaceRecord
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
