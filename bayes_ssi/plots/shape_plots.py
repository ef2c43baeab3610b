"""Mode shapes with their bands, and identified modes with their errors.

Shapes are drawn component by component; on the structure, they move
(:mod:`~bayes_ssi.plots.moving_shapes`).
"""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.model_at_draws import UpdatedMode, UpdatedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots import figure_style as look
from bayes_ssi.results.predictions.posterior_draws import Band
from bayes_ssi.structures.structure import Structure

# Of a panel, whose labels fit; with more, panels grow no taller and labels smaller.
MOST_ROWS = 40

APPENDAGES = "appendage"
BEYOND = "appendage beyond the scale, its component below"
# Name, places and components of a shape to compare with.
Reference = tuple[str, Sequence[str], FloatArray]


def plot_mode_shapes(modes: UpdatedModes, data: ModalData) -> Figure:
    """The paired modes' shapes, with 90 % bands and the identified components.

    Shapes are scaled by :func:`~bayes_ssi.structures.modal.scaled_shapes`, identified ones to the
    model's median; on the structure, they move
    (:func:`~bayes_ssi.plots.moving_shapes.plot_moving_shapes`).
    """
    if not (modes.modes and modes.places):
        raise ValueError("plot_mode_shapes: no mode is paired, or the model has no shapes")
    places = modes.places
    height = 1.0 + 0.18 * min(MOST_ROWS, len(places))
    figure, axes = look.panels_of(len(modes.modes), 0.6, height)
    for mode, ax in zip(modes.modes, axes, strict=True):
        title = f"mode {mode.label}\n{mode.after_hz[1]:.4g} Hz"
        shape, reference = Band(*map(np.array, mode.shape_after)), _identified(modes, mode, data)
        plot_shape_components(modes, places, shape, ax, reference=reference, title=title)
        ax.tick_params("y", labelsize=look.SMALL_TEXT * min(1.0, MOST_ROWS / len(places)),
                       labelleft=ax.get_subplotspec().is_first_col())  # fmt: skip
    look.legend_of_figure(figure, axes, columns=4)
    return figure


def _identified(modes: UpdatedModes, mode: UpdatedMode, data: ModalData) -> Reference | None:
    """The identified shape at the places, scaled to the model's median."""
    shape = data.mode(mode.label).unit_shape
    if shape is None:
        return None
    identified = {
        place: component
        for place, component in zip(data.sensors, np.asarray(shape), strict=True)
        if place in modes.places and np.isfinite(component)
    }
    components = np.array(list(identified.values()))
    if not components.any():
        return None
    model = np.array([mode.shape_after[1][modes.places.index(place)] for place in identified])
    scale = float(model @ components / (components @ components))
    return "identified", list(identified), scale * components


def plot_shape_components(
    structure: Structure | UpdatedModes | None,
    places: Sequence[str],
    shape: Band,
    ax: Axes | None = None,
    *,
    reference: Reference | None = None,
    title: str = "",
    name: str = "model",
) -> Axes:
    """A mode shape component by component.

    The axes reach as far as the main structure moves; components of appendages that move further
    are written below. The components of each direction stand together in a colour of their own,
    those of appendages above them.

    Args:
        structure: names the appendages; None where places are sensors.
        places: degrees of freedom of the shape; the first place is the lowest bar.
        shape: median and band of the components (n_places,).
    """
    appendages = structure.appendages if structure is not None else ()
    ax = look.axes_of(ax, (2.6, 0.8 + 0.22 * len(places)))
    groups = by_direction(places, appendages, name)
    order = [place for group in groups.values() for place in group]
    # Half a row between directions.
    gaps = np.repeat(0.5 * np.arange(len(groups)), [len(group) for group in groups.values()])
    y = dict(zip(order, np.arange(len(order)) + gaps, strict=True))
    bands = dict(zip(places, np.array(shape).T, strict=True))
    main = [bands[place] for place in places if place not in appendages]
    largest = np.nanmax(np.abs(main), initial=0.0)
    reach = 1.15 * largest if largest > 0.0 else 1.0
    ax.axvline(0.0, color=look.GREY, linewidth=0.6)
    colours = cycle((look.BLUE, look.GREEN, look.ORANGE))
    for label, group in groups.items():
        colour = look.VERMILION if label == APPENDAGES else next(colours)
        rows = np.array([y[place] for place in group])
        low, median, high = np.array([bands[place] for place in group]).T
        bars = ax.barh(rows, median, height=0.7, color=colour, alpha=0.6, label=label)
        for place, bar, component in zip(group, bars, median, strict=True):
            look.hover(bar, f"{title}, {place}: {component:.3f}".replace("\n", ", "))
        # Of arrays of one element, matplotlib makes numbers in a way of which numpy 2.0 warns.
        below, above = (median - low).tolist(), (high - median).tolist()
        ax.errorbar(median, rows, xerr=[below, above], fmt="none", ecolor="black",
                    elinewidth=0.8, capsize=2)  # fmt: skip
        for row, component in zip(rows, median, strict=True):
            if abs(component) >= reach:  # an arrow head within the axes, towards it
                ax.plot(np.copysign(0.9 * reach, component), row, "<" if component < 0 else ">",
                        color=look.VERMILION, markeredgecolor="black", markersize=7,
                        linestyle="none", label=BEYOND, zorder=3)  # fmt: skip
    if reference is not None:
        other, at, components = reference
        ax.plot(components, [y[place] for place in at], "x", color="black", markersize=6,
                label=other)  # fmt: skip
    ax.set(xlim=(-reach, reach), ylim=(-0.5, max(y.values()) + 0.5))
    ax.set_yticks([*y.values()], order)
    ax.locator_params(axis="x", nbins=2)
    look.without_math(*ax.get_yticklabels())
    look.title_of(ax, title)
    far = []
    for place in groups.get(APPENDAGES, ()):
        low, median, high = bands[place]
        if max(-low, high) >= reach:
            shown = look.wrapped(place, look.PANEL_WIDTH, look.SMALL_TEXT)
            # Adding zero turns a negative zero into a plain one.
            low, median, high = np.round(bands[place], 1) + 0.0
            far.append(f"{shown}:\n{median:.1f}\n({low:.1f} to {high:.1f})")
    ax.set_xlabel("\n".join(far), fontsize=look.SMALL_TEXT, parse_math=False)
    return ax


def by_direction(
    places: Sequence[str], appendages: Sequence[str], name: str
) -> dict[str, list[str]]:
    """Label of a group → its places: those of the main structure by direction, then appendages.

    Labels of places that move in several directions end with the direction: "floor 2 x". Where
    endings are numbers, or do not repeat, the places of the main structure are one group.
    """
    main = [place for place in places if place not in appendages]
    directions: dict[str, list[str]] = {}
    for place in main:
        directions.setdefault(place.split()[-1], []).append(place)
    # A point has three displacements and three rotations.
    few = 1 < len(directions) <= min(6, len(main) - 1)
    if few and not any(ending.isdecimal() for ending in directions):
        groups = {f"{name}, {ending}": group for ending, group in directions.items()}
    else:
        groups = {name: main}
    others = [place for place in places if place in appendages]
    return groups | ({APPENDAGES: others} if others else {})


def plot_identified_modes(data: ModalData, configuration: str = "") -> Figure:
    """The band with every identified frequency in it, and the shapes at the sensors.

    Shapes are scaled to a largest component of ±1, with the identification's own 90 % intervals,
    those of unit shapes in the same scale; without a covariance, all components of a shape have its
    ``shape_sd``. A grey bar is the 90 % interval of a frequency.
    """
    shapes = _shapes(data)
    across = look.panels_across(len(shapes)) if shapes else 1
    n_rows = -(-len(shapes) // across)
    height = 1.5 + (0.85 + 0.22 * len(data.sensors)) * n_rows
    width = max(look.width_of_modes(len(data.modes)), look.width_of_panels(across))
    figure = look.new_figure((width, height))
    ratios = [1.0, *[1.0 + 0.25 * len(data.sensors)] * n_rows]
    grid = figure.add_gridspec(1 + n_rows, across, height_ratios=ratios)
    _band(figure.add_subplot(grid[0, :]), data, configuration)
    for i, (title, shape) in enumerate(shapes):
        ax = figure.add_subplot(grid[1 + i // across, i % across])
        plot_shape_components(None, data.sensors, shape, ax, title=title, name="identified")
        ax.tick_params("y", labelleft=i % across == 0)
    return figure


def _band(ax: Axes, data: ModalData, configuration: str) -> None:
    low, high = data.band_hz
    ax.axvspan(low, high, color=look.GREY, alpha=0.12, linewidth=0)
    # The label of a mode and the space next to it, on the scale of the axis.
    longest = max(len(mode.label) for mode in data.modes) + 1
    across = look.letters_across(look.whole_figure(ax).get_figwidth(), look.SMALL_TEXT)
    room = (high - low) * longest / across
    for height, mode in zip(_levels(data.frequencies_hz, room), data.modes, strict=True):
        if mode.frequency_cov is not None:
            half = look.SDS_OF_90_PERCENT * mode.frequency_cov * mode.frequency_hz
            ax.axvspan(mode.frequency_hz - half, mode.frequency_hz + half, color=look.GREY,
                       alpha=0.5, linewidth=0)  # fmt: skip
        (line,) = ax.plot([mode.frequency_hz] * 2, [0.0, height], color=look.BLUE, linewidth=1.5)
        look.hover(line, f"mode {mode.label}: {mode.frequency_hz:.5g} Hz")
        label = ax.text(mode.frequency_hz, height + 0.04, mode.label, ha="center", va="bottom",
                        fontsize=look.SMALL_TEXT, bbox={"facecolor": "white", "edgecolor": "none",
                                          "alpha": 0.8, "pad": 0.5})  # fmt: skip
        look.without_math(label)
    margin = 0.02 * (high - low)
    ax.set(xlim=(low - margin, high + margin), ylim=(0.0, 1.3), yticks=[])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("identified frequency (Hz); grey: the band")
    look.title_of(ax, label_in(configuration, "identified modes"))


def _levels(frequencies_hz: FloatArray, room: float) -> list[float]:
    """Heights of the lines, chosen so that the labels of close modes do not overlap."""
    levels: list[float] = []
    for i, frequency in enumerate(frequencies_hz):
        close = i and frequency - frequencies_hz[i - 1] < room
        levels.append({0.9: 0.6, 0.6: 0.3, 0.3: 0.9}[levels[-1]] if close else 0.9)
    return levels


def half_widths(data: ModalData) -> FloatArray:
    """Of the 90 % intervals of unit shapes (n_modes, n_sensors); NaN where errors are not known."""
    m, n = len(data.modes), len(data.sensors)
    sds = np.array([np.full(n, mode.shape_sd or np.nan) for mode in data.modes])
    if data.covariance is not None:
        sds = np.sqrt(data.covariance.diagonal()[m:].reshape(m, n))
    return look.SDS_OF_90_PERCENT * sds


def _shapes(data: ModalData) -> list[tuple[str, Band]]:
    """Titles, and shapes with largest component ±1 and 90 % intervals in their scale."""
    shapes = []
    for mode, of_unit_shape in zip(data.modes, half_widths(data), strict=True):
        if mode.scaled_shape is None:
            continue
        scaled = np.asarray(mode.scaled_shape)
        half = of_unit_shape * np.linalg.norm(scaled[np.isfinite(scaled)])
        title = f"mode {mode.label}\n{mode.frequency_hz:.4g} Hz"
        shapes.append((title, Band(scaled - half, scaled, scaled + half)))
    return shapes
