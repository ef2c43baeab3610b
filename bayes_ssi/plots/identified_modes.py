"""Identified modes: their frequencies in the band, and their shapes with errors.

Shapes are drawn at the sensors, or on the structure where sensors have places on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.configuration_modes import moves_sideways
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    STYLE,
    figure_of,
    hover,
    legend_of_figure,
    letters_across,
    panels_across,
    panels_of,
    title_of,
    whole_figure,
    width_of_modes,
    width_of_panels,
    without_math,
)
from bayes_ssi.plots.shape_plots import MODEL, DrawnShape, by_direction, plot_shapes
from bayes_ssi.plots.space import draw_structure, panels_in_space
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INTERVAL = "90 % interval"


def plot_identified_modes(
    data: ModalData, figure: Figure | None = None, configuration: str = ""
) -> Figure:
    """The band with every identified frequency in it, and the shapes at the sensors.

    Shapes are scaled to a largest component of ±1; a grey bar is the identification's own 95 %
    interval.
    """
    with_shape = [mode for mode in data.modes if mode.scaled_shape is not None]
    across = panels_across(len(with_shape)) if with_shape else 1
    n_rows = -(-len(with_shape) // across)
    height = 1.5 + (0.7 + 0.22 * len(data.sensors)) * n_rows
    figure = figure_of(
        figure, (max(width_of_modes(len(data.modes)), width_of_panels(across)), height)
    )
    ratios = [1.0, *[1.0 + 0.25 * len(data.sensors)] * n_rows]
    grid = figure.add_gridspec(1 + n_rows, across, height_ratios=ratios)
    _band(figure.add_subplot(grid[0, :]), data, configuration)
    for i, mode in enumerate(with_shape):
        ax = figure.add_subplot(grid[1 + i // across, i % across])
        shape = np.asarray(mode.scaled_shape)
        y = np.arange(len(data.sensors))
        ax.axvline(0.0, color=STYLE.grey, linewidth=0.8)
        ax.hlines(y, 0.0, shape, color=STYLE.blue, linewidth=1.5)
        for k, component in enumerate(shape):
            (point,) = ax.plot(component, y[k], "o", color=STYLE.blue, markersize=4)
            hover(point, f"mode {mode.label}, {data.sensors[k]}: {component:.3f}")
        ax.set_xlim(-1.1, 1.1)
        ax.set_ylim(-0.6, len(y) - 0.4)
        ax.set_yticks(y, data.sensors if i % across == 0 else [""] * len(y))
        ax.set_xticks([-1, 0, 1])
        title = ax.set_title(f"mode {mode.label}", fontsize=STYLE.small)
        without_math(title, *ax.get_yticklabels())
    return figure


def _band(ax: Axes, data: ModalData, configuration: str) -> None:
    low, high = data.band_hz
    ax.axvspan(low, high, color=STYLE.grey, alpha=0.12, linewidth=0)
    # The label of a mode and the space next to it, on the scale of the axis.
    longest = max(len(mode.label) for mode in data.modes) + 1
    room = (high - low) * longest / letters_across(whole_figure(ax).get_figwidth(), STYLE.small)
    for height, mode in zip(_levels(data.frequencies_hz, room), data.modes, strict=True):
        if mode.frequency_cov is not None:
            half = 1.96 * mode.frequency_cov * mode.frequency_hz
            ax.axvspan(mode.frequency_hz - half, mode.frequency_hz + half, color=STYLE.grey,
                       alpha=0.5, linewidth=0)  # fmt: skip
        (line,) = ax.plot([mode.frequency_hz] * 2, [0.0, height], color=STYLE.blue, linewidth=1.5)
        hover(line, f"mode {mode.label}: {mode.frequency_hz:.5g} Hz")
        label = ax.text(mode.frequency_hz, height + 0.04, mode.label, ha="center", va="bottom",
                        fontsize=STYLE.small, bbox={"facecolor": "white", "edgecolor": "none",
                                          "alpha": 0.8, "pad": 0.5})  # fmt: skip
        without_math(label)
    ax.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    ax.set_ylim(0.0, 1.3)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.set_xlabel("identified frequency (Hz); grey: the band")
    title_of(ax, label_in(configuration, "identified modes"))


def _levels(frequencies_hz: FloatArray, room: float) -> list[float]:
    """Heights of the lines, chosen so that the labels of close modes do not overlap."""
    levels: list[float] = []
    for i, frequency in enumerate(frequencies_hz):
        close = i and frequency - frequencies_hz[i - 1] < room
        levels.append({0.9: 0.6, 0.6: 0.3, 0.3: 0.9}[levels[-1]] if close else 0.9)
    return levels


class _Shape(NamedTuple):
    """A shape with largest component ±1, and half the widths of 90 % intervals in its scale."""

    title: str
    components: FloatArray
    half_widths: FloatArray


def plot_identified_shapes(
    data: ModalData, structure: Structure | None = None, figure: Figure | None = None
) -> Figure:
    """Identified shapes with 90 % intervals of their components, the largest component being ±1.

    Intervals are those of the unit shapes, in the same scale; without a covariance, all components
    of a shape have its ``shape_sd``. Shapes are drawn on a structure that is given: as arrows in
    space where it knows where all sensors are, as the deformed building where all are floors that
    move sideways. Otherwise they are drawn over the names of the sensors.
    """
    shapes = _shapes(data)
    if not shapes:
        raise ValueError("plot_identified_shapes: no mode has a shape")
    if structure is not None:
        at = _locations(structure, data.sensors)
        if structure.geometry is not None and at is not None:
            return _in_space(shapes, at, structure.geometry, figure)
        if _are_floors(structure, data.sensors):
            return _on_building(shapes, data.sensors, structure, figure)
    return _over_sensors(shapes, data.sensors, figure)


def has_errors_on(structure: Structure, data: ModalData) -> bool:
    """Whether there are shapes with errors, which can be drawn on a structure."""
    has_errors = any(mode.shape_sd is not None for mode in data.modes)
    is_placed = _locations(structure, data.sensors) is not None
    return has_errors and (is_placed or _are_floors(structure, data.sensors))


def _shapes(data: ModalData) -> list[_Shape]:
    m, n = len(data.modes), len(data.sensors)
    shapes = []
    for i, mode in enumerate(data.modes):
        if mode.scaled_shape is None:
            continue
        sds = np.full(n, mode.shape_sd or 0.0)
        if data.covariance is not None:
            sds = np.sqrt(data.covariance.diagonal()[m + n * i : m + n * (i + 1)])
        scaled = np.asarray(mode.scaled_shape)
        scale = np.linalg.norm(scaled[np.isfinite(scaled)])  # over a unit shape
        title = f"mode {mode.label}\n{mode.frequency_hz:.4g} Hz"
        shapes.append(_Shape(title, scaled, STYLE.sds_of_90_percent * sds * scale))
    return shapes


def _over_sensors(
    shapes: Sequence[_Shape], sensors: Sequence[str], figure: Figure | None
) -> Figure:
    n = len(sensors)
    figure, axes = panels_of(figure, len(shapes), 0.3, 0.75 + 0.18 * n, sharex=True)
    # Lines join what moves in one direction.
    groups = by_direction(sensors, ())
    ordered = [name for group in groups.values() for name in group]
    for shape, ax in zip(shapes, axes, strict=True):
        ax.axvline(0.0, color=STYLE.grey, linewidth=0.8)
        for (name, group), colour in zip(
            groups.items(), cycle((STYLE.blue, STYLE.green, STYLE.orange))
        ):
            at = [list(sensors).index(sensor) for sensor in group]
            direction = "" if len(groups) == 1 else f"{name.removeprefix(MODEL)}, "
            bars = ax.errorbar(shape.components[at], [ordered.index(sensor) for sensor in group],
                               xerr=shape.half_widths[at], fmt=".-", color=colour,
                               linewidth=0.8, markersize=3, ecolor=STYLE.vermilion, elinewidth=1.5,
                               capsize=3, label=direction + INTERVAL)  # fmt: skip
            hover(bars, shape.title.replace("\n", ", "))
        ax.set_xlim(-1.2, 1.2)
        ax.set_xticks([-1, 0, 1])
        ax.set_ylim(-0.6, n - 0.4)
        is_first = ax.get_subplotspec().is_first_col()
        ax.set_yticks(range(n), ordered if is_first else [""] * n)
        title_of(ax, shape.title)
        without_math(*ax.get_yticklabels())
    legend_of_figure(figure, axes[:1])
    return figure


def _on_building(
    shapes: Sequence[_Shape], sensors: Sequence[str], structure: Structure, figure: Figure | None
) -> Figure:
    drawn = []
    for shape in shapes:
        low, high = shape.components - shape.half_widths, shape.components + shape.half_widths
        drawn.append(DrawnShape(shape.title, Band(low, shape.components, high)))
    name = f"identified, {INTERVAL}"
    return plot_shapes(structure, sensors, drawn, figure, sideways=True, name=name)


def _locations(structure: Structure, sensors: Sequence[str]) -> list[Location] | None:
    """Where all sensors are and in which directions they measure; None unless all are known."""
    motions = {sensor.label: sensor.motion for sensor in structure.sensors}
    located = [structure.location_of(motions.get(name, name)) for name in sensors]
    known = [each for each in located if each is not None and each.direction is not None]
    return known if len(known) == len(located) else None


def _are_floors(structure: Structure, sensors: Sequence[str]) -> bool:
    return set(sensors) <= set(structure.degrees_of_freedom) and moves_sideways(structure)


def _in_space(
    shapes: Sequence[_Shape], at: Sequence[Location], geometry: Geometry, figure: Figure | None
) -> Figure:
    nodes = np.array(list(geometry.nodes.values()))
    points = np.array([each.position for each in at])
    directions = np.array([each.direction for each in at])
    # The largest component drawn, of the structure's longest side.
    reach = 0.25 * (float(np.ptp(nodes, axis=0).max()) or 1.0)
    titles = [each.title for each in shapes]
    figure, panels = panels_in_space(titles, np.concatenate([nodes, points]), reach, figure)
    for shape, ax in zip(shapes, panels, strict=True):
        draw_structure(ax, geometry)
        for point, along, component, half in zip(
            points, reach * directions, shape.components, shape.half_widths, strict=True
        ):
            if np.isfinite(component):
                end = point + component * along
                interval = np.array([end - half * along, end + half * along])
                ax.plot(*point[:, None], ".", color=STYLE.blue, markersize=3)
                ax.plot(*np.array([point, end]).T, color=STYLE.blue, linewidth=1.0,
                        label="identified component")  # fmt: skip
                ax.plot(*interval.T, color=STYLE.vermilion, linewidth=2.5, solid_capstyle="butt",
                        label=INTERVAL)  # fmt: skip
    legend_of_figure(figure, panels[:1])
    return figure
