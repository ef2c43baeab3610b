"""The updated mode shapes of a model class, from stored records."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bayes_ssi.inference.posterior.configuration_modes import UpdatedMode, UpdatedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.plots.shape_plots import DrawnShape, Reference, plot_shapes
from bayes_ssi.results.predictions.bands import Band

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
