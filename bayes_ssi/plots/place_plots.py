"""Places on a structure: where a search finds appendages or changes, and where a plan puts sensors.

Places are drawn as it suits what is known of the structure.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator

from bayes_ssi.plots import figure_style as look
from bayes_ssi.plots.moving_shapes import axes_in_space, longest_side
from bayes_ssi.studies.appendages.hidden_cases import BlindSpots
from bayes_ssi.studies.planning.plan_record import Plan
from bayes_ssi.studies.ranking.comparison import probability_text
from bayes_ssi.studies.search.findings import FamilyRecord

# Places with a bar of their own, as many as fit on the first screen of a report.
MOST_BARS = 12
# Of the highest probability; less cannot be told from zero by its colour.
LEAST_SHARE = 0.01


def plot_place_map(search: FamilyRecord) -> Axes:
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
    drawn = axes_in_space("", points, reach, geometry, below=1.15)
    figure, title = drawn.figure, look.wrapped(title, look.FIGURE_WIDTH)
    figure.suptitle(title, x=0.02, ha="left", fontsize=look.TEXT_SIZE, parse_math=False)
    height = figure.get_figheight()
    # ColorBrewer's map from pale yellow to dark red: its lightness falls evenly, so that
    # colour-blind readers, and greyscale, keep the order.
    scale: Any = ScalarMappable(Normalize(0.0, best.probability or 1.0), "YlOrRd")
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
    below = figure.add_axes((0.2, 0.75 / height, 0.6, 0.12 / height))
    bar = figure.colorbar(scale, ticks=MaxNLocator(4), cax=below, orientation="horizontal")
    bar.set_label(f"probability of {search.a_feature}", fontsize=look.SMALL_TEXT)
    bar.ax.tick_params(labelsize=look.SMALL_TEXT)
    look.legend_of_figure(figure, [drawn])
    return drawn


def plot_place_bars(search: FamilyRecord) -> Axes:
    """The probabilities of the most probable places, and of all others together."""
    places = [one for one in search.places_by_probability if not one.place.is_common]
    first, others = places[:MOST_BARS], places[MOST_BARS:]
    bars = [(each.place.name, each.probability, look.BLUE) for each in first]
    if others:
        together = sum(each.probability for each in others)
        bars.append((f"{len(others)} others together", together, look.GREY))
    names = [name for name, _, _ in bars]
    ax = look.rows_of(None, names, extra=0.7)
    for row, (name, probability, colour) in enumerate(bars):
        text = probability_text(probability)
        (bar,) = ax.barh(row, probability, height=0.6, color=colour)
        look.hover(bar, f"{name}: probability {text}")
        ax.annotate(text, (probability, row), xytext=(3, 0), textcoords="offset points",
                    va="center", fontsize=look.SMALL_TEXT)  # fmt: skip
    highest = max(probability for _, probability, _ in bars)
    limit = 1.25 * highest or 1.0  # with room for the numbers
    ticks = np.asarray(MaxNLocator(5).tick_values(0.0, limit))
    ax.set_xticks(ticks[ticks <= min(limit, 1.0)])
    ax.set(xlim=(0.0, limit), xlabel=f"probability of {search.a_feature}")
    return ax


def plot_places(search: FamilyRecord) -> Axes:
    """The probability of an appendage, or of a change, at each place of a search.

    Places with coordinates are drawn in space, others as bars.
    """
    in_space = any(each.place.coordinates is not None for each in search.places)
    return plot_place_map(search) if in_space else plot_place_bars(search)


CHOSEN, OTHER = "sensor of the best layout", "other candidate"


def plot_layout(plan: Plan) -> Any:
    """The structure in space with the places of the best layout, and the other candidates.

    Arrows are directions of measurement.
    """
    located = [(each, each.coordinates) for each in plan.candidates if each.coordinates]
    points = np.array([*(at for _, at in located), *plan.geometry.nodes.values()])
    length = 0.13 * longest_side(points)
    title = f"{len(plan.best.sensors)} of {len(plan.candidates)} candidates"
    ax = axes_in_space(title, points, length, plan.geometry, below=0.6)
    for each, at in located:
        chosen = each.name in plan.best.sensors
        colour, label = (look.VERMILION, CHOSEN) if chosen else (look.GREY, OTHER)
        if each.direction and chosen:
            along = np.multiply(length, each.direction)
            ax.quiver(*at, *along, color=colour, linewidth=1.6, arrow_length_ratio=0.4)
        ax.scatter(*at, s=30.0 if chosen else 8.0, color=[colour], label=label, depthshade=False)
        if len(located) <= MOST_BARS:
            ax.text(*at, f"  {each.name}", va="bottom", fontsize=look.SMALL_TEXT)
    look.legend_of_figure(ax.figure, [ax])
    return ax


# What becomes of an appendage, by the colour of its cell.
OUTCOMES = {
    "no stiffness wrong": "#EEEEEE",
    "wrong, said": look.BLUE,
    "blind if one mode is missed": look.ORANGE,
    "blind with all modes": look.VERMILION,
}


def plot_blind_spots(spots: BlindSpots) -> Figure:
    """Maps of hidden appendages, a panel for each place: mass over frequency, outcomes in colour.

    Dotted lines are frequencies of the structure without them.
    """
    places = list(dict.fromkeys(case.place for case in spots.cases))
    figure, axes = look.panels_of(len(places), 1.1, 1.3, sharex=True, sharey=True)
    for ax, place in zip(axes, places, strict=True):
        cells: dict[tuple[float, float], int] = {}
        for case in (each for each in spots.cases if each.place == place):
            outcome = (2 if case.missed else 3) if case.is_blind else int(bool(case.warning))
            key = (case.mass, case.frequency_hz)
            cells[key] = max(outcome, cells.get(key, 0))
        masses, hz = (sorted({key[i] for key in cells}) for i in (0, 1))
        grid = [[cells[mass, each] for each in hz] for mass in masses]
        colours = ListedColormap(list(OUTCOMES.values()))
        edges = np.sqrt(hz[1] / hz[0]) * np.array([hz[0] ** 2 / hz[1], *hz])
        ax.pcolormesh(edges, np.arange(len(masses) + 1) - 0.5, grid, cmap=colours, vmin=-0.5,
                      vmax=3.5, edgecolors="white", linewidth=0.5)  # fmt: skip
        ax.set_yticks(range(len(masses)), [f"{mass:.3g}" for mass in masses])
        for each in spots.frequencies_hz:
            if edges[0] < each < edges[-1]:
                ax.axvline(each, color="black", linestyle=":", linewidth=0.8)
        ax.set_xscale("log")
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter("{x:g}")
        ax.xaxis.set_minor_formatter("")
        look.title_of(ax, place)
        if ax.get_subplotspec().is_last_row():
            ax.set_xlabel("frequency (Hz)")
        if ax.get_subplotspec().is_first_col():
            ax.set_ylabel("vibrating mass")
    handles = [Patch(color=colour, label=name) for name, colour in OUTCOMES.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=look.SMALL_TEXT)
    return figure
