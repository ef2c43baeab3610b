"""The mass to which a search relates the mass of an appendage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True)
class MassScale:
    """A mass in the structure's unit, and what it is."""

    mass: float
    name: str


def mass_scale(structure: Structure, data: ModalData) -> MassScale:
    """The mean mass of a floor; of a structure without floors, the median modal mass.

    That is of the modes in the band, no more than were identified, the lowest. Their shapes have a
    largest component of 1 at the sensors: the mass at the place of largest motion that would have
    the mode's inertia. A local mode that hardly moves a sensor has a huge one, which does not
    change the median. All are at the prior medians.
    """
    of_floor = structure.mean_floor_mass()
    if of_floor is not None:
        return MassScale(of_floor, "mean floor mass")
    modes = structure.modes(structure.prior_medians())
    n_in_band = int((modes.frequencies_hz[0] <= data.band_hz[1]).sum())
    n = max(min(n_in_band, len(data.modes)), 1)
    at_sensors = seen_shapes(structure.sensor_matrix(data.sensors).apply(modes.shapes))
    largest = np.abs(at_sensors[0, :, :n]).max(axis=0, initial=0.0)  # at unit modal mass
    if not largest.any():
        raise ValueError("no mode of the structure moves a sensor, so masses have no scale")
    return MassScale(float(np.median(largest[largest > 0.0] ** -2)), "median modal mass")
