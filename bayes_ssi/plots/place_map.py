"""Where a search found appendages, drawn on the building."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from bayes_ssi.appendages.hypotheses import Place
from bayes_ssi.appendages.search_result import AppendageSearch
from bayes_ssi.plots.style import (
    GREY,
    VERMILION,
    axes_of,
    hover,
    style,
)
from bayes_ssi.ranking.comparison import probability_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_places", "save_places"]


def plot_places(found: AppendageSearch | Mapping[Place, float], ax: Axes | None = None) -> Axes:
    """The building, and the probability that an appendage hangs at each place.

    A pendulum's circle stands beside its floor, an infill's in its storey; the circle's area and
    darkness grow with the probability, which is written beside it.

    Args:
        found: a search, or the probability of every place that it considered.
        ax: axes; new ones if None.
    """
    probabilities = found if isinstance(found, Mapping) else found.place_probabilities
    n_floors = max(max(place.floors) for place in probabilities)
    ax = axes_of(ax, _places_size(n_floors))
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
    ax.set_aspect("auto")
    ax.axis("off")
    ax.set_title(
        "Appendages: probability by place\n"
        "(square: infill in a storey; circle: pendulum on a floor)"
    )
    return ax


def save_places(found: AppendageSearch, path: Path) -> Path:
    """Write :func:`plot_places` as a PNG file."""
    from matplotlib.figure import Figure

    with style():
        n_floors = max(max(place.floors) for place in found.candidates)
        figure = Figure(figsize=_places_size(n_floors))
        plot_places(found, figure.subplots())
        figure.savefig(path)
    return path


def _places_size(n_floors: int) -> tuple[float, float]:
    return 4.6, 1.2 + 0.7 * n_floors
