"""Hypotheses of a search: a structure with appendages at some places, in all tests or in some."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.families import LogUniform
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import Candidate, require_on_structure
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.search_settings import CRITERIA, SearchSettings


@dataclass(frozen=True)
class MassScale:
    """A mass in the structure's unit, and what it is."""

    mass: float
    name: str


def scale_of(baseline: ModelClass, present_in: Sequence[str] | None = None) -> MassScale:
    """The mean mass of a floor; of a structure without floors, the median modal mass.

    That is of the modes in the band, no more than were identified, the lowest. Their shapes have a
    largest component of 1 at the sensors: the mass at the place of largest motion that would have
    the mode's inertia. A local mode that hardly moves a sensor has a huge one, which does not
    change the median. All are at the prior medians.

    Args:
        present_in: names of the configurations that have appendages; all if None.
    """
    test = tests_with_appendages(baseline, present_in)[0]
    structure, data = test.structure, test.data
    of_floor = structure.mean_floor_mass()
    if of_floor is not None:
        return MassScale(of_floor, "mean floor mass")
    modes = structure.modes(structure.prior_medians())
    n_in_band = int((modes.frequencies_hz[0] <= data.band_hz[1]).sum())
    n = max(min(n_in_band, len(data.modes)), 1)
    at_sensors = seen_shapes(structure.sensor_matrix(data.sensors).apply(modes.shapes))
    largest = np.abs(at_sensors[0, :, :n]).max(axis=0, initial=0.0)  # at unit modal mass
    if not largest.any():
        raise ValueError(
            f"model class {baseline.name!r}: no mode of the structure moves a sensor, so masses "
            "have no scale"
        )
    return MassScale(float(np.median(largest[largest > 0.0] ** -2)), "median modal mass")


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
    return " + ".join(place.name for place in places) or "no appendage"


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


def _frequency_prior(
    baseline: ModelClass, tests: Sequence[Configuration], options: SearchSettings
) -> Prior:
    low = min(test.data.band_hz[0] for test in tests)
    high = max(test.data.band_hz[1] for test in tests)
    prior = options.frequency
    if prior is None:
        modes = [mode for test in tests for mode in test.data.modes]
        lowest = min((mode.frequency_hz for mode in modes), default=high)
        return LogUniform(0.5 * lowest, high)
    if prior.probability_below(high) - prior.probability_below(low) < CRITERIA.least_in_band:
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
