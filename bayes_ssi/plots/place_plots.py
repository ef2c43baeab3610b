"""Places on a structure: where a search finds appendages or changes, and where a plan puts sensors.

Places are drawn as it suits what is known of the structure.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from bayes_ssi.plots import figure_style as look
from bayes_ssi.plots.space import axes_in_space, longest_side
from bayes_ssi.structures.geometry import Point, direction_name
from bayes_ssi.studies.appendages.candidates import AppendagePlace
from bayes_ssi.studies.changes.change_search import ChangeRecord
from bayes_ssi.studies.planning.plan_record import Plan
from bayes_ssi.studies.ranking.comparison import probability_text
from bayes_ssi.studies.search.findings import FamilyRecord

MOST_FLOORS = 40  # of a building; taller figures would not fit a page
# Places with a bar of their own, as many as fit on the first screen of a report.
MOST_BARS = 12
# Of the highest probability; less cannot be told from zero by its colour.
LEAST_SHARE = 0.01


def plot_place_map(search: FamilyRecord, ax: Axes | None = None) -> Axes:
    """Places in space, their probabilities in colour, and directions as arrows.

    Places that are improbable by comparison are dots without directions.
    """
    geometry = search.geometry
    # The most probable is the last, and so drawn above the others.
    located: list[Any] = [each for each in search.places if each.place.coordinates]
    located.sort(key=lambda each: each.probability)
    best = located[-1]
    least = LEAST_SHARE * best.probability
    shown = [each for each in located if each.probability >= least]
    nodes = geometry.nodes.values() if geometry else ()
    at = [each.place.coordinates for each in located]
    # Of an arrow, of the longest side of the structure.
    length = 0.13 * longest_side([*at, *nodes])
    arrows = [length * np.array(each.place.direction or (0.0, 0.0, 0.0)) for each in shown]
    ends = (each.place.coordinates + arrow for each, arrow in zip(shown, arrows, strict=True))
    points = np.array([*at, *ends, *nodes])
    unit = f" ({geometry.unit})" if geometry and geometry.unit else ""
    low, high = points.min(axis=0), points.max(axis=0)
    spans = ", ".join(f"{x} {a:.4g} to {b:.4g}" for x, a, b in zip("xyz", low, high, strict=True))
    title = f"Most probable: {best.place.name}, {probability_text(best.probability)}\n{spans}{unit}"
    # A line or a plane needs some depth for its axes.
    reach = 0.05 * longest_side(points)
    drawn = axes_in_space(ax, "" if ax is None else title, points, reach, geometry, below=1.15)
    bar = None
    if ax is None:
        figure, title = drawn.figure, look.wrapped(title, look.FIGURE_WIDTH)
        figure.suptitle(title, x=0.02, ha="left", fontsize=look.TEXT_SIZE, parse_math=False)
        height = figure.get_figheight()
        bar = figure.add_axes((0.2, 0.75 / height, 0.6, 0.12 / height))
    scale = _colour_scale(best.probability)
    dots = sorted({*at} - {each.place.coordinates for each in shown})
    if dots:
        drawn.scatter(*np.transpose(dots), s=4.0, color=[scale.to_rgba(0.0)], edgecolors=look.GREY,
                      linewidths=0.4, depthshade=False, label="improbable place",
                      rasterized=len(dots) > look.MOST_VECTORS)  # fmt: skip
    for each, arrow in zip(shown, arrows, strict=True):
        place, colours = each.place, [scale.to_rgba(each.probability)]
        if place.direction:
            artist = drawn.quiver(*place.coordinates, *arrow, color=colours, linewidth=1.6,
                                  arrow_length_ratio=0.4, label="place and direction")  # fmt: skip
        else:
            artist = drawn.scatter(*place.coordinates, s=36.0, marker=place.marker, color=colours,
                                   edgecolors="black", linewidths=0.4, depthshade=False,
                                   label=place.title)  # fmt: skip
        if len(shown) <= look.MOST_VECTORS:
            look.hover(artist, f"{place.name}: probability {probability_text(each.probability)}")
        else:
            artist.set_rasterized(True)
    _colour_bar(drawn, scale, search.a_feature, bar)
    look.legend_of_figure(drawn.figure, [drawn])
    return drawn


# A kind of appendage in one direction has a column of its own.
Kind = tuple[type[AppendagePlace], Point | None]


def plot_places_on_building(search: FamilyRecord, ax: Axes | None = None) -> Axes:
    """The building, and in colour the probability of each place of a search.

    Each kind of place has its own marker, next to its floor or in its storey, and the
    probability is written next to it.
    """
    places = _places(search)
    heights = [each.place.height or 0.0 for each in places]
    n_floors = math.ceil(max(heights))
    columns, width = _columns(each.place for each in places)
    # In the least height of a floor, probabilities of floors still keep apart.
    tall = n_floors * min(0.7, max(0.2, 4.0 / n_floors))
    ax = look.axes_of(ax, (max(look.FIGURE_WIDTH, 1.0 + 0.75 * len(columns)), 1.6 + tall))
    ax.plot([-0.5, width + 0.5], [0, 0], color="black", linewidth=2.0)
    for side in (0.0, width):
        ax.plot([side, side], [0, n_floors], color=look.GREY, linewidth=1.5)
    for floor in range(1, n_floors + 1):
        ax.plot([0.0, width], [floor, floor], color="black", linewidth=1.5)
        ax.text(-0.15, floor, f"floor {floor}", ha="right", va="center", fontsize=look.SMALL_TEXT)
    # A change is there or not; an appendage that is there may be anywhere.
    is_change = isinstance(search, ChangeRecord)
    scale = _colour_scale(1.0 if is_change else max(each.probability for each in places))
    for each, y in zip(places, heights, strict=True):
        place, text = each.place, probability_text(each.probability)
        x = columns[_kind(place)]
        if place.is_outside:
            ax.plot([width, x], [y, y], color=look.GREY, linewidth=0.8, linestyle=":")
        point = ax.scatter(
            x, y, s=55.0, marker=place.marker, zorder=3, color=[scale.to_rgba(each.probability)],
            edgecolors="black", linewidths=0.6,
        )  # fmt: skip
        look.hover(point, f"{place.name}: probability {text}")
        # Above the line that joins a column further out to its floor.
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
        ax.text(x + 0.17, y, text, va="center", fontsize=look.SMALL_TEXT, bbox=box)
    ax.set_xlim(-1.1, max(width, *columns.values()) + 0.7)
    ax.set_ylim(-0.3, n_floors + 0.6)
    ax.axis("off")
    for (_, direction), x in columns.items():
        if direction:
            ax.text(
                x, n_floors + 0.35, direction_name(direction), ha="center", fontsize=look.SMALL_TEXT
            )
    for kind in dict.fromkeys(kind for kind, _ in columns):
        ax.plot([], [], linestyle="none", marker=kind.marker, color="black",
                markerfacecolor="none", label=kind.title)  # fmt: skip
    look.legend_below(ax, 2)
    _colour_bar(ax, scale, search.a_feature)
    return ax


def _kind(place: AppendagePlace) -> Kind:
    return type(place), place.direction


def _columns(places: Iterable[AppendagePlace]) -> tuple[dict[Kind, float], float]:
    """Where each kind of appendage is drawn in the building or next to it, and the width of it."""
    kinds = dict.fromkeys(_kind(place) for place in places)
    inside = [kind for kind in kinds if not kind[0].is_outside]
    outside = [kind for kind in kinds if kind[0].is_outside]
    apart = 1.1  # in half of which probabilities are written
    width = apart * max(1, len(inside))
    columns = {kind: apart * (i + 0.15) for i, kind in enumerate(inside)}
    columns |= {kind: width + apart * (i + 0.5) for i, kind in enumerate(outside)}
    return columns, width


def plot_place_bars(search: FamilyRecord, ax: Axes | None = None) -> Axes:
    """The probabilities of the most probable places, and of all others together."""
    places = search.places_by_probability
    first, others = places[:MOST_BARS], places[MOST_BARS:]
    bars = [(each.place.name, each.probability, look.BLUE) for each in first]
    if others:
        together = sum(each.probability for each in others)
        bars.append((f"{len(others)} others together", together, look.GREY))
    names = [name for name, _, _ in bars]
    ax = look.rows_of(ax, names, extra=0.7)
    for row, (name, probability, colour) in enumerate(bars):
        text = probability_text(probability)
        (bar,) = ax.barh(row, probability, height=0.6, color=colour)
        look.hover(bar, f"{name}: probability {text}")
        ax.annotate(text, (probability, row), xytext=(3, 0), textcoords="offset points",
                    va="center", fontsize=look.SMALL_TEXT)  # fmt: skip
    highest = max(probability for _, probability, _ in bars)
    ax.set_xlim(0.0, 1.25 * highest or 1.0)  # with room for the numbers
    ax.set_xlabel(f"probability of {search.a_feature}")
    return ax


def _places(search: FamilyRecord) -> list[Any]:
    """The places of a search, without what all places have in common."""
    return [one for one in search.places if not getattr(one.place, "is_common", False)]


def plot_places(search: FamilyRecord, ax: Axes | None = None) -> Axes:
    """The probability of an appendage, or of a change, at each place of a search.

    Places on floors are drawn on the building, places with coordinates in space, and others as
    bars. Axes that are given must have three dimensions for a drawing in space.
    """
    places = _places(search)
    heights = [one.place.height for one in places]
    drawn = {(_kind(each.place), each.place.height) for each in places}
    if len(drawn) == len(places) and all(
        height is not None and height <= MOST_FLOORS for height in heights
    ):
        return plot_places_on_building(search, ax)
    if any(each.place.coordinates is not None for each in search.places):
        return plot_place_map(search, ax)
    return plot_place_bars(search, ax)


def _colour_scale(highest: float) -> Any:
    """Colours of probabilities from zero to the highest that is drawn, a ``ScalarMappable``."""

    # ColorBrewer's map from pale yellow to dark red: its lightness falls evenly, so that
    # colour-blind readers, and greyscale, keep the order.
    return ScalarMappable(Normalize(0.0, highest or 1.0), "YlOrRd")


def _colour_bar(ax: Axes, scale: Any, what: str, cax: Axes | None = None) -> None:
    """A colour bar, below ``ax`` or in axes of its own."""

    room: Any = {"cax": cax, "orientation": "horizontal"}
    if cax is None:
        room = {"ax": ax, "location": "bottom", "shrink": 0.7, "aspect": 30, "pad": 0.02}
    bar = ax.figure.colorbar(scale, ticks=MaxNLocator(4), **room)
    bar.set_label(f"probability of {what}", fontsize=look.SMALL_TEXT)
    bar.ax.tick_params(labelsize=look.SMALL_TEXT)


CHOSEN, OTHER = "sensor of the best layout", "other candidate"


def plot_layout(plan: Plan, ax: Axes | None = None) -> Axes:
    """The structure with the places of the best layout, and the other candidates.

    In space where candidates have coordinates, with arrows for directions; else by their heights.
    Axes that are given must have three dimensions for a drawing in space.
    """
    if any(each.coordinates for each in plan.candidates):
        return _layout_in_space(plan, ax)
    # Without heights one above the other.
    heights = [i if c.height is None else c.height for i, c in enumerate(plan.candidates, 1)]
    ax = look.axes_of(ax, (look.FIGURE_WIDTH, 1.2 + 0.35 * len({*heights})))
    ax.plot([0.0, 0.0], [0.0, max(heights)], color=look.GREY, linewidth=1.5)
    ax.plot([-0.5, 0.5], [0.0, 0.0], color="black", linewidth=2.0)
    beside: dict[float, int] = {}
    for candidate, height in zip(plan.candidates, heights, strict=True):
        place = beside[height] = beside.get(height, -1) + 1
        chosen = candidate.name in plan.best.sensors
        ax.plot(0.9 * place, height, linestyle="none", marker="o", markersize=8.0,
                color=look.VERMILION if chosen else "white", markeredgecolor="black",
                label=CHOSEN if chosen else OTHER)  # fmt: skip
        ax.text(0.9 * place + 0.1, height, candidate.name, va="center", fontsize=look.SMALL_TEXT)
    ax.set_xlim(-0.6, 0.9 * max(beside.values()) + 1.2)
    ax.margins(y=0.1)
    ax.axis("off")
    look.legend_below(ax, 2)
    return ax


def _layout_in_space(plan: Plan, ax: Any) -> Any:
    located = [(each, each.coordinates) for each in plan.candidates if each.coordinates]
    nodes = plan.geometry.nodes.values() if plan.geometry else ()
    points = np.array([*(at for _, at in located), *nodes])
    length = 0.13 * longest_side(points)
    title = f"{len(plan.best.sensors)} of {len(plan.candidates)} candidates"
    ax = axes_in_space(ax, title, points, length, plan.geometry, below=0.6)
    for each, at in located:
        chosen = each.name in plan.best.sensors
        colour, label = (look.VERMILION, CHOSEN) if chosen else (look.GREY, OTHER)
        if each.direction and chosen:
            along = np.multiply(length, each.direction)
            ax.quiver(*at, *along, color=colour, linewidth=1.6,
                      arrow_length_ratio=0.4)  # fmt: skip
        ax.scatter(*at, s=30.0 if chosen else 8.0, color=[colour], label=label,
                   depthshade=False)  # fmt: skip
    look.legend_of_figure(ax.figure, [ax])
    return ax


def plot_gains(plan: Plan, ax: Axes | None = None) -> Axes:
    """The gain of the best layout against its number of sensors, with 90 % intervals."""
    ax = look.axes_of(ax, (look.FIGURE_WIDTH, 2.6))
    numbers = [len(layout.sensors) for layout in plan.by_number]
    gains = [layout.gain for layout in plan.by_number]
    errors = [look.SDS_OF_90_PERCENT * layout.error for layout in plan.by_number]
    ax.errorbar(numbers, gains, yerr=errors, color=look.BLUE, marker="o", label="best layout")
    if plan.greatest is not None:
        ax.axhline(plan.greatest, color=look.GREY, linestyle="--", label="settles it")
    ax.axvline(plan.knee, color=look.ORANGE, linestyle=":", label="knee")
    ax.set_xticks(numbers)
    ax.set_xlabel("number of sensors")
    ax.set_ylabel(f"information about {plan.aim} (nats)")
    look.legend_below(ax, 3)
    return ax
