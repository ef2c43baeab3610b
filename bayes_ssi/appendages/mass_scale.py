"""The mass to which a search relates the mass of an appendage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_ssi.data.modal_data import ModalData
from bayes_ssi.modal import seen_shapes
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.motion import SinglePlace
from bayes_ssi.structures.rigid_floors import RigidFloors
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
    if isinstance(structure, LumpedStructure):
        return MassScale(_mean_floor_mass(structure), "mean floor mass")
    modes = structure.modes(structure.prior_medians())
    n_in_band = int((modes.frequencies_hz[0] <= data.band_hz[1]).sum())
    n = max(min(n_in_band, len(data.modes)), 1)
    at_sensors = seen_shapes(structure.sensor_matrix(data.sensors).apply(modes.shapes))
    largest = np.abs(at_sensors[0, :, :n]).max(axis=0, initial=0.0)  # at unit modal mass
    if not largest.any():
        raise ValueError("no mode of the structure moves a sensor, so masses have no scale")
    return MassScale(float(np.median(largest[largest > 0.0] ** -2)), "median modal mass")


def _mean_floor_mass(structure: LumpedStructure) -> float:
    """The main structure's mass that moves with the ground, over the number of floors."""
    main = structure.main_degrees_of_freedom()
    moved: dict[SinglePlace, float] = {}
    for i, (label, motion) in enumerate(zip(main, structure.main_influence(), strict=True), 1):
        moved[i] = moved[label] = motion
    total = 0.0
    for mass in structure.main_masses():
        moves = sum(share * moved[place] for place, share in mass.direction)
        total += mass.mass.median * moves**2
    return total / (structure.n_floors if isinstance(structure, RigidFloors) else len(main))
