"""Hypotheses of a search: a structure with appendages at some places, in all tests or in some."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.families import LogUniform
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import (
    Candidate,
    require_on_structure,
)
from bayes_ssi.studies.appendages.places import AppendagePlace


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


NO_APPENDAGE = "no appendage"
# Of the prior of an appendage's frequency, at least one draw in a hundred lies in the band.
LEAST_IN_BAND = 0.01


@dataclass(frozen=True)
class SearchSettings:
    """What an appendage may be, and how many there may be.

    What modes determine is not a mass but its effective mass, the mass times the square of the
    motion of its place in the mode beside which it vibrates. The default prior is uniform in the
    logarithm of both, so that within its range it prefers no place to any other.

    Attributes:
        mass_ratio: prior of the vibrating mass over the mean floor mass, or the median modal
            mass where there are no floors
            (:func:`~bayes_ssi.studies.appendages.hypotheses.mass_scale`).
        mass: instead of ``mass_ratio``, the lightest and the heaviest vibrating mass, in the
            structure's unit; log-uniform between them.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights: prior weights of no appendage, of one, of two, ...; the weight of a
            number is shared evenly by all ways to place that many. Its length limits the search.
        branches: number of best hypotheses that are extended by one more appendage.
        most_unsampled: as many hypotheses are sampled as it takes until sampling the others, whose
            evidences are approximations, would change no probability by more than this. All are
            where it is zero.
        most_sampled: largest number of hypotheses that are sampled, the most probable ones, each
            with a probability above ``most_unsampled``; if None, twelve, or all where
            ``most_unsampled`` is zero; but six of finite-element models in a reduced basis, each of
            which takes some 20 full solutions.

    Raises:
        ValueError: there are fewer than two weights, one is not positive, there is no branch, none
            is to be sampled, or ``most_unsampled`` is not a probability.
        TypeError: a prior is not a prior distribution.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogUniform(0.001, 0.5))
    mass: tuple[float, float] | None = None
    frequency: Prior | None = None
    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2
    most_unsampled: float = 0.01
    most_sampled: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "number_weights", tuple(self.number_weights))
        if len(self.number_weights) < 2 or not all(
            0.0 < weight < math.inf for weight in self.number_weights
        ):
            raise ValueError(
                "SearchSettings: number_weights must be two or more positive numbers, got "
                f"{self.number_weights!r}"
            )
        if self.mass is not None:
            lightest, heaviest = self.mass
            LogUniform(lightest, heaviest)  # which refuses what is no range
            object.__setattr__(self, "mass", (lightest, heaviest))
        if self.branches < 1:
            raise ValueError(f"SearchSettings: branches must be at least 1, got {self.branches!r}")
        if not 0.0 <= self.most_unsampled < 1.0:
            raise ValueError(
                "SearchSettings: most_unsampled must be at least 0 and below 1, got "
                f"{self.most_unsampled!r}"
            )
        if self.most_sampled is not None and self.most_sampled < 1:
            raise ValueError(
                f"SearchSettings: most_sampled must be at least 1, got {self.most_sampled!r}"
            )
        for name in ("mass_ratio", "frequency"):
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name == "frequency" and prior is None):
                raise TypeError(f"SearchSettings: {name} must be a prior, got {prior!r}")

    def prior_of_mass_ratio(self, scale: float) -> Prior:
        """The prior of the vibrating mass over ``scale``, a mass in the structure's unit."""
        if self.mass is None:
            return self.mass_ratio
        return LogUniform(self.mass[0] / scale, self.mass[1] / scale)


def hypothesis(
    baseline: ModelClass,
    places: Sequence[AppendagePlace],
    search_settings: SearchSettings | None = None,
    name: str | None = None,
    *,
    present_in: Sequence[str] | None = None,
    scale: MassScale | None = None,
) -> ModelClass:
    """The baseline with an appendage at each of ``places``, scored over all pairings.

    Args:
        name: of the hypothesis; that of the places if None.
        present_in: names of the configurations that have the appendages; all if None.
    """
    options = search_settings or SearchSettings()
    tests = tests_with_appendages(baseline, present_in)
    prior = _frequency_prior(baseline, tests, options)
    changed = baseline.with_any_pairing(name or name_of(places))
    if not places:
        return changed
    mass = (scale or scale_of(baseline, present_in)).mass
    mass_prior = options.prior_of_mass_ratio(mass)
    elements = [
        place.element(
            mass * Parameter(mass_name(place), mass_prior),
            Parameter(frequency_name(place), prior, unit="Hz"),
        )
        for place in places
    ]

    def carrying(structure: Structure, i: int) -> Structure:
        if baseline.configurations[i] not in tests:
            return structure
        for element in elements:
            structure = structure.with_element(element)
        return structure

    return changed.with_structures(carrying)


def name_of(places: Sequence[AppendagePlace]) -> str:
    """What a hypothesis with these appendages is called, where there is one baseline."""
    return " + ".join(place.name for place in places) or NO_APPENDAGE


def tests_with_appendages(
    baseline: ModelClass, present_in: Sequence[str] | None
) -> tuple[Configuration, ...]:
    """The configurations of a class that have the appendages of a search."""
    names = baseline.configuration_names if present_in is None else tuple(present_in)
    if not names:
        raise ValueError("present_in: names no test; give one or more, or None for all")
    tests = tuple(baseline.configuration(name) for name in dict.fromkeys(names))
    for test in tests:
        if not test.structure.carries_elements:
            raise ValueError(
                f"model class {baseline.name!r}: a search needs a structure that carries elements, "
                "such as a ShearBuilding or MatrixStructure, got "
                f"{type(test.structure).__name__}"
            )
    return tests


def tests_with_places(
    model_class: ModelClass, candidates: Sequence[Candidate] | None
) -> tuple[str, ...] | None:
    """Names of the tests whose structures have the candidates' places; None if all do, or none.

    A structure may describe a part of the motion alone, such as torsion.
    """
    first = model_class.configurations[0]
    if candidates is None:
        candidates = first.structure.candidates(first.data.sensors)

    def has_places(structure: Structure) -> bool:
        try:
            require_on_structure(candidates, structure)
        except ValueError:
            return False
        return True

    names = tuple(test.name for test in model_class.configurations if has_places(test.structure))
    return names if 0 < len(names) < len(model_class.configurations) else None


def scale_of(baseline: ModelClass, present_in: Sequence[str] | None = None) -> MassScale:
    """The mass to which a search on this class relates the mass of an appendage."""
    first = tests_with_appendages(baseline, present_in)[0]
    try:
        return mass_scale(first.structure, first.data)
    except ValueError as error:
        raise ValueError(f"model class {baseline.name!r}: {error}") from None


def _frequency_prior(
    baseline: ModelClass, tests: Sequence[Configuration], options: SearchSettings
) -> Prior:
    """The prior of an appendage's frequency."""
    low = min(test.data.band_hz[0] for test in tests)
    high = max(test.data.band_hz[1] for test in tests)
    prior = options.frequency
    if prior is None:
        modes = [mode for test in tests for mode in test.data.modes]
        lowest = min((mode.frequency_hz for mode in modes), default=high)
        return LogUniform(0.5 * lowest, high)
    if prior.probability_below(high) - prior.probability_below(low) < LEAST_IN_BAND:
        raise ValueError(
            f"model class {baseline.name!r}: an appendage's frequency, {prior!r} Hz, lies outside "
            f"the band {low:g} to {high:g} Hz in which modes were identified"
        )
    return prior


def mass_name(place: AppendagePlace) -> str:
    """Name of the parameter for the vibrating mass over the mass scale."""
    return f"mass ratio, {place.name}"


def frequency_name(place: AppendagePlace) -> str:
    """Name of the parameter for the appendage's frequency."""
    return f"frequency, {place.name}"
