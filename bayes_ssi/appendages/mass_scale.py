"""The mass to which a search relates the mass of an appendage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.motion import SinglePlace
from bayes_ssi.structures.rigid_floors import RigidFloors
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True)
class MassScale:
    """A mass in the structure's unit, and what it is."""

    mass: float
    name: str


def mass_scale(structure: Structure, sensors: Sequence[str], n_identified: int) -> MassScale:
    """The mean mass of a floor; of a structure without floors, the median modal mass.

    That is the median of the modal masses of as many modes as were identified, the lowest,
    whose shapes have a largest component of 1 at the sensors: the mass at the place of largest
    motion that would have the mode's inertia. The median is not moved by a local mode that the
    sensors hardly see. Both masses are at the prior medians.

    Args:
        structure: the structure without appendages.
        sensors: names of the sensors.
        n_identified: number of identified modes.

    Raises:
        ValueError: none of these modes moves a sensor.
    """
    if isinstance(structure, LumpedStructure):
        return MassScale(_mean_floor_mass(structure), "mean floor mass")
    shapes = structure.modes(structure.prior_medians()).shapes
    at_sensors = structure.sensor_matrix(sensors).apply(shapes)[0, :, : max(n_identified, 1)]
    largest = np.abs(at_sensors).max(axis=0, initial=0.0)  # at unit modal mass
    if not largest.any():
        raise ValueError("no mode of the structure moves a sensor, so masses have no scale")
    return MassScale(float(np.median(largest[largest > 0.0] ** -2.0)), "median modal mass")


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
