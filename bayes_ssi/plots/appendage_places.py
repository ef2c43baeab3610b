"""Where a search finds appendages, drawn on the building."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.plots.figure_style import GREY, SMALL, VERMILION, WIDTH, axes_of, hover
from bayes_ssi.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_places(probabilities: Mapping[AppendagePlace, float], ax: Axes | None = None) -> Axes:
    """The building, and the probability of an appendage at each place of a search.

    Each kind of appendage has its own marker, next to its floor or in its storey; its area and
    darkness grow with the probability, which is written next to it.
    """
    heights = {p: p.height for p in probabilities if p.height is not None}
    n_floors = math.ceil(max(heights.values(), default=0.0))
    ax = axes_of(ax, (WIDTH, 1.4 + 0.7 * n_floors))
    ax.plot([-1.6, 1.6], [0, 0], color="black", linewidth=2.0)
    for side in (-1.0, 1.0):
        ax.plot([side, side], [0, n_floors], color=GREY, linewidth=1.5)
    for floor in range(1, n_floors + 1):
        ax.plot([-1.0, 1.0], [floor, floor], color="black", linewidth=2.5)
        ax.text(-1.15, floor, f"floor {floor}", ha="right", va="center")
    columns = _columns(probabilities)
    for place, y in heights.items():
        x, probability = columns[type(place)], probabilities[place]
        if place.is_outside:
            ax.plot([1.0, x], [y, y], color=GREY, linewidth=0.8, linestyle=":")
        point = ax.scatter(
            x, y, s=40.0 + 260.0 * probability, marker=place.marker, zorder=3,
            facecolor=VERMILION, edgecolor="black", alpha=0.12 + 0.88 * probability, linewidth=0.8,
        )  # fmt: skip
        hover(point, f"{place.name}: probability {probability_text(probability)}")
        ax.text(x + 0.2, y, probability_text(probability), va="center", fontsize=SMALL)
    ax.set_xlim(-2.2, max(columns.values()) + 1.2)
    ax.set_ylim(-0.3, n_floors + 0.5)
    ax.axis("off")
    ax.set_title("Appendages: probability by place")
    for kind in columns:
        ax.plot([], [], kind.marker, color="black", markerfacecolor="none", label=kind.title)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=len(columns), frameon=False)
    return ax


def _columns(places: Iterable[AppendagePlace]) -> dict[type[AppendagePlace], float]:
    """Where each kind of appendage is drawn across the building, or next to it."""
    columns: dict[type[AppendagePlace], float] = {}
    for kind in dict.fromkeys(type(place) for place in places):
        n_alike = sum(other.is_outside == kind.is_outside for other in columns)
        columns[kind] = 1.6 + 1.1 * n_alike if kind.is_outside else 0.45 * n_alike
    return columns
