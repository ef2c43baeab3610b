"""Where a search finds appendages, drawn on the building."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from bayes_ssi.appendages.hypotheses import Place
from bayes_ssi.plots.figure_style import GREY, VERMILION, axes_of, hover
from bayes_ssi.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_places"]


def plot_places(probabilities: Mapping[Place, float], ax: Axes | None = None) -> Axes:
    """The building, and the probability of an appendage at each place of a search.

    A pendulum's circle is drawn next to its floor, an infill's square in its storey; its area and
    darkness grow with the probability, which is written next to it.
    """
    n_floors = max(max(place.floors) for place in probabilities)
    ax = axes_of(ax, (4.6, 1.2 + 0.7 * n_floors))
    ax.plot([-1.6, 1.6], [0, 0], color="black", linewidth=2.0)
    for side in (-1.0, 1.0):
        ax.plot([side, side], [0, n_floors], color=GREY, linewidth=1.5)
    for floor in range(1, n_floors + 1):
        ax.plot([-1.0, 1.0], [floor, floor], color="black", linewidth=2.5)
        ax.text(-1.15, floor, f"floor {floor}", ha="right", va="center")
    for place, probability in probabilities.items():
        infill = len(place.floors) == 2
        x, y = 0.0 if infill else 1.6, sum(place.floors) / len(place.floors)
        if not infill:
            ax.plot([1.0, x], [y, y], color=GREY, linewidth=0.8, linestyle=":")
        point = ax.scatter(
            x, y, s=40.0 + 260.0 * probability, marker="s" if infill else "o", zorder=3,
            facecolor=VERMILION, edgecolor="black", alpha=0.12 + 0.88 * probability, linewidth=0.8,
        )  # fmt: skip
        hover(point, f"{place.name}: probability {probability_text(probability)}")
        ax.text(x + 0.2, y, probability_text(probability), va="center", fontsize=8)
    ax.set_xlim(-2.2, 2.8)
    ax.set_ylim(-0.3, n_floors + 0.5)
    ax.axis("off")
    ax.set_title(
        "Appendages: probability by place\n"
        "(square: infill in a storey; circle: pendulum on a floor)"
    )
    return ax
