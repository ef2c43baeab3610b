"""Identified shapes with their errors: on the structure where sensors have places on it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior.configuration_modes import (
    UpdatedMode,
    UpdatedModes,
    moves_sideways,
)
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    figure_of,
    hover,
    legend_of_figure,
    panels_across,
    title_of,
    width_of_panels,
    without_math,
)
from bayes_ssi.plots.modes_in_space import panels_in_space
from bayes_ssi.plots.shape_plots import MODEL, DrawnShape, Reference, by_direction, plot_shapes
from bayes_ssi.plots.space_axes import draw_structure
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_mode_shapes(modes: UpdatedModes, data: ModalData, figure: Figure | None = None) -> Figure:
    """The paired modes' shapes, with 95 % bands and the identified components.

    A structure of floors that move sideways is drawn deformed, with the shape before updating
    dashed; of any other, components are bars. Shapes are scaled by
    :func:`~bayes_ssi.structures.modal.scaled_shapes`, identified ones to the model's median.
    """
    if not modes.modes:
        raise ValueError("plot_mode_shapes: no mode is paired")
    shapes = [
        DrawnShape(
            f"mode {mode.label}\n{mode.after_hz[1]:.4g} Hz",
            Band(*map(np.array, mode.shape_after)),
            _identified(modes, mode, data),
            mode.shape_before,
        )
        for mode in modes.modes
    ]
    return plot_shapes(modes, modes.places, shapes, figure, sideways=modes.has_floors)


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


# Standard deviations to either side that hold 90 %.
WITHIN_90 = 1.645
INTERVAL = "90 % interval"
# The largest component drawn in space, of the structure's longest side.
LARGEST = 0.25


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

    Args:
        figure: an empty figure; a new one if None.
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
        shapes.append(_Shape(title, scaled, WITHIN_90 * sds * scale))
    return shapes


def _over_sensors(
    shapes: Sequence[_Shape], sensors: Sequence[str], figure: Figure | None
) -> Figure:
    across = panels_across(len(shapes))
    rows, n = -(-len(shapes) // across), len(sensors)
    figure = figure_of(figure, (width_of_panels(across), 0.3 + (0.75 + 0.18 * n) * rows))
    axes = figure.subplots(rows, across, squeeze=False, sharex=True).ravel()
    # Lines join what moves in one direction.
    groups = by_direction(sensors, ())
    ordered = [name for group in groups.values() for name in group]
    for i, (shape, ax) in enumerate(zip(shapes, axes, strict=False)):
        y = np.arange(n)
        ax.axvline(0.0, color=GREY, linewidth=0.8)
        for (name, group), colour in zip(groups.items(), cycle((BLUE, GREEN, ORANGE))):
            at = [list(sensors).index(sensor) for sensor in group]
            direction = "" if len(groups) == 1 else f"{name.removeprefix(MODEL)}, "
            bars = ax.errorbar(shape.components[at], [ordered.index(sensor) for sensor in group],
                               xerr=shape.half_widths[at], fmt=".-", color=colour,
                               linewidth=0.8, markersize=3, ecolor=VERMILION, elinewidth=1.5,
                               capsize=3, label=direction + INTERVAL)  # fmt: skip
            hover(bars, shape.title.replace("\n", ", "))
        ax.set_xlim(-1.2, 1.2)
        ax.set_xticks([-1, 0, 1])
        ax.set_ylim(-0.6, n - 0.4)
        ax.set_yticks(y, ordered if i % across == 0 else [""] * n)
        title_of(ax, shape.title)
        without_math(*ax.get_yticklabels())
    for ax in axes[len(shapes) :]:
        ax.remove()
    legend_of_figure(figure, axes[:1])
    return figure


def _on_building(
    shapes: Sequence[_Shape], sensors: Sequence[str], structure: Structure, figure: Figure | None
) -> Figure:
    drawn = [
        DrawnShape(
            each.title,
            Band(
                each.components - each.half_widths,
                each.components,
                each.components + each.half_widths,
            ),
        )
        for each in shapes
    ]
    return plot_shapes(
        structure, sensors, drawn, figure, sideways=True, name="identified, 90 % interval"
    )


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
    reach = LARGEST * (float(np.ptp(nodes, axis=0).max()) or 1.0)
    titles = [each.title for each in shapes]
    figure, panels = panels_in_space(titles, np.concatenate([nodes, points]), reach, figure)
    for shape, ax in zip(shapes, panels, strict=True):
        draw_structure(ax, geometry)
        for point, along, component, half in zip(
            points, reach * directions, shape.components, shape.half_widths, strict=True
        ):
            if np.isfinite(component):
                _draw_component(ax, point, along, component, half)
    legend_of_figure(figure, panels[:1])
    return figure


def _draw_component(
    ax: Any, point: FloatArray, along: FloatArray, component: float, half: float
) -> None:
    """A component from its sensor on, and its interval."""
    end = point + component * along
    interval = np.array([end - half * along, end + half * along])
    ax.plot(*point[:, None], ".", color=BLUE, markersize=3)
    ax.plot(*np.array([point, end]).T, color=BLUE, linewidth=1.0, label="identified component")
    ax.plot(*interval.T, color=VERMILION, linewidth=2.5, solid_capstyle="butt", label=INTERVAL)
