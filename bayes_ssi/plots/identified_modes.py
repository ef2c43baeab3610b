"""Identified modes: their frequencies in the band, and their shapes with errors.

Shapes are drawn at the sensors, or on the structure where sensors have places on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.model_at_draws import moves_sideways
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.figure_style import (
    STYLE,
    figure_of,
    hover,
    legend_of_figure,
    letters_across,
    panels_across,
    title_of,
    whole_figure,
    width_of_modes,
    width_of_panels,
    without_math,
)
from bayes_ssi.plots.shape_plots import DrawnShape, plot_shape_components, plot_shapes
from bayes_ssi.plots.space import draw_structure, panels_in_space
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.structure import Structure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INTERVAL = "90 % interval"
NAME = "identified"


def plot_identified_modes(
    data: ModalData, figure: Figure | None = None, configuration: str = ""
) -> Figure:
    """The band with every identified frequency in it, and the shapes at the sensors.

    Shapes are scaled to a largest component of ±1, with the identification's own 90 % intervals; a
    grey bar is the 95 % interval of a frequency.
    """
    shapes = _shapes(data)
    across = panels_across(len(shapes)) if shapes else 1
    n_rows = -(-len(shapes) // across)
    height = 1.5 + (0.85 + 0.22 * len(data.sensors)) * n_rows
    figure = figure_of(
        figure, (max(width_of_modes(len(data.modes)), width_of_panels(across)), height)
    )
    ratios = [1.0, *[1.0 + 0.25 * len(data.sensors)] * n_rows]
    grid = figure.add_gridspec(1 + n_rows, across, height_ratios=ratios)
    _band(figure.add_subplot(grid[0, :]), data, configuration)
    for i, each in enumerate(shapes):
        ax = figure.add_subplot(grid[1 + i // across, i % across])
        plot_shape_components(None, data.sensors, each.shape, ax, title=each.title, name=NAME)
        ax.tick_params("y", labelleft=i % across == 0)
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
            return plot_shapes(structure, data.sensors, shapes, figure, sideways=True, name=NAME)
    return plot_shapes(None, data.sensors, shapes, figure, sideways=False, name=NAME)


def has_errors_on(structure: Structure, data: ModalData) -> bool:
    """Whether there are shapes with errors, which can be drawn on a structure."""
    has_errors = any(mode.shape_sd is not None for mode in data.modes)
    is_placed = _locations(structure, data.sensors) is not None
    return has_errors and (is_placed or _are_floors(structure, data.sensors))


def _shapes(data: ModalData) -> list[DrawnShape]:
    """Shapes with largest component ±1, and 90 % intervals in their scale."""
    m, n = len(data.modes), len(data.sensors)
    shapes = []
    for i, mode in enumerate(data.modes):
        if mode.scaled_shape is None:
            continue
        sds = np.full(n, mode.shape_sd or np.nan)
        if data.covariance is not None:
            sds = np.sqrt(data.covariance.diagonal()[m + n * i : m + n * (i + 1)])
        scaled = np.asarray(mode.scaled_shape)
        scale = np.linalg.norm(scaled[np.isfinite(scaled)])  # over a unit shape
        half = STYLE.sds_of_90_percent * sds * scale
        title = f"mode {mode.label}\n{mode.frequency_hz:.4g} Hz"
        shapes.append(DrawnShape(title, Band(scaled - half, scaled, scaled + half)))
    return shapes


def _locations(structure: Structure, sensors: Sequence[str]) -> list[Location] | None:
    """Where all sensors are and in which directions they measure; None unless all are known."""
    motions = {sensor.label: sensor.motion for sensor in structure.sensors}
    located = [structure.location_of(motions.get(name, name)) for name in sensors]
    known = [each for each in located if each is not None and each.direction is not None]
    return known if len(known) == len(located) else None


def _are_floors(structure: Structure, sensors: Sequence[str]) -> bool:
    return set(sensors) <= set(structure.degrees_of_freedom) and moves_sideways(structure)


def _in_space(
    shapes: Sequence[DrawnShape], at: Sequence[Location], geometry: Geometry, figure: Figure | None
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
        for point, along, *band in zip(points, reach * directions, *shape.shape, strict=True):
            low, end, high = (point + component * along for component in band)
            if np.isfinite(end).all():
                ax.plot(*point[:, None], ".", color=STYLE.blue, markersize=3)
                ax.plot(*np.array([point, end]).T, color=STYLE.blue, linewidth=1.0,
                        label="identified component")  # fmt: skip
                ax.plot(*np.array([low, high]).T, color=STYLE.vermilion, linewidth=2.5,
                        solid_capstyle="butt", label=INTERVAL)  # fmt: skip
    legend_of_figure(figure, panels[:1])
    return figure
