"""Hypotheses of a search: a structure with appendages hung on its floors and in its storeys."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.parameters import Parameter
from bayes_ssi.priors.families import LogNormal, LogUniform
from bayes_ssi.priors.prior import Prior
from bayes_ssi.structures.elements import Element, OutOfPlaneInfill, Pendulum
from bayes_ssi.structures.lumped import LumpedStructure

__all__ = [
    "AND",
    "NO_APPENDAGE",
    "Place",
    "SearchSettings",
    "frequency_name",
    "hypothesis",
    "mass_name",
    "mean_mass",
    "places_of",
    "structure_with_floors",
]

NO_APPENDAGE = "no appendage"
AND = " + "


@dataclass(frozen=True)
class Place:
    """Where an appendage may hang.

    Attributes:
        kind: "pendulum" on one floor, or "infill" between two.
        floors: the floor, or the two, 0 being the ground.
    """

    kind: str
    floors: tuple[int, ...]

    @property
    def name(self) -> str:
        return f"{self.kind} {'-'.join(map(str, self.floors))}"


@dataclass(frozen=True)
class SearchSettings:
    """What an appendage may be, and how many there may be.

    The defaults suit buildings: parapets, chimneys, tanks and infills that move out of their
    plane weigh mostly between 1 and 20 % of a floor, and are tuned to anything in the band.

    Attributes:
        mass_ratio: prior of the mass that vibrates, over the mean floor mass.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights: prior weights of no appendage, of one, of two, ...; the weight of a
            number is shared evenly by all ways to place so many. Its length bounds the search.
        branches: how many of the best hypotheses are extended by one more appendage.

    Raises:
        ValueError: fewer than two weights, one that is not positive, or no branch.
        TypeError: a prior is none.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogNormal(0.05, 1.0))
    frequency: Prior | None = None
    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "number_weights", tuple(self.number_weights))
        if len(self.number_weights) < 2 or not all(
            0.0 < weight < math.inf for weight in self.number_weights
        ):
            raise ValueError(
                "SearchSettings: number_weights must be two or more positive numbers, got "
                f"{self.number_weights!r}"
            )
        if self.branches < 1:
            raise ValueError(f"SearchSettings: branches must be at least 1, got {self.branches!r}")
        for name in ("mass_ratio", "frequency"):
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name == "frequency" and prior is None):
                raise TypeError(f"SearchSettings: {name} must be a prior, got {prior!r}")


def places_of(structure: LumpedStructure) -> tuple[Place, ...]:
    """Every floor for a pendulum, and every storey for an infill."""
    floors = range(1, len(structure.main_degrees_of_freedom()) + 1)
    return (
        *(Place("pendulum", (floor,)) for floor in floors),
        *(Place("infill", (floor - 1, floor)) for floor in floors),
    )


def hypothesis(
    baseline: ModelClass,
    places: Sequence[Place],
    search_settings: SearchSettings | None = None,
) -> ModelClass:
    """The baseline with an appendage at each of ``places``, scored over all pairings.

    Raises:
        ValueError: its structure has no floors to hang an appendage on.
    """
    options = search_settings or SearchSettings()
    structure = structure_with_floors(baseline)
    scale = mean_mass(structure)
    frequency = options.frequency or _default_frequency(baseline)
    for place in places:
        ratio = Parameter(mass_name(place), options.mass_ratio)
        tuned = Parameter(frequency_name(place), frequency, unit="Hz")
        structure = structure.with_element(_element(place, ratio, tuned, scale))
    name = AND.join(place.name for place in places) or NO_APPENDAGE
    return baseline.with_any_pairing(baseline.name).with_structure(structure, name)


def structure_with_floors(baseline: ModelClass) -> LumpedStructure:
    if len(baseline.configurations) > 1:
        raise ValueError(
            f"model class {baseline.name!r}: a search needs a class with one configuration, got "
            f"{len(baseline.configurations)}: {', '.join(map(repr, baseline.configuration_names))}"
        )
    structure = baseline.structure
    if not isinstance(structure, LumpedStructure):
        raise ValueError(
            f"model class {baseline.name!r}: a search needs a structure with floors, such as a "
            f"ShearBuilding, got {type(structure).__name__}"
        )
    return structure


def _element(place: Place, ratio: Parameter, tuned: Parameter, mass_scale: float) -> Element:
    label = f"appendage {place.name}"
    if place.kind == "pendulum":
        return Pendulum(on=place.floors[0], mass=mass_scale * ratio, frequency=tuned, label=label)
    low, high = place.floors
    # Half of an infill vibrates.
    return OutOfPlaneInfill(
        between=(low, high), mass=2.0 * mass_scale * ratio, frequency=tuned, label=label
    )


def _default_frequency(baseline: ModelClass) -> Prior:
    lowest = min(mode.frequency_hz for mode in baseline.data.modes)
    return LogUniform(0.5 * lowest, baseline.data.band_hz[1])


def mean_mass(structure: LumpedStructure) -> float:
    """The mean mass of a floor, at the prior medians, in the structure's unit."""
    masses = [mass.mass.median for mass in structure.main_masses()]
    return sum(masses) / len(structure.main_degrees_of_freedom())


def mass_name(place: Place) -> str:
    return f"mass ratio, {place.name}"


def frequency_name(place: Place) -> str:
    return f"frequency, {place.name}"
