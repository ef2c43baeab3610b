"""The hypotheses of a search: the baselines, which are a question, too, and what hangs on them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.priors import LogUniform, Prior, Uniform
from bayes_ssi.structures.changed_structure import FurtherMode
from bayes_ssi.structures.geometry import Candidate, Geometry, SinglePlace, motion_of
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import (
    AppendagePlace,
    FurtherMotion,
    SearchSettings,
    appendages_among,
    are_observed,
    located,
    places_of,
    require_distinct,
    require_on_structure,
    with_given_masses,
    with_masses_in_model,
)
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.family import Family

Feature = AppendagePlace | FurtherMotion
# A place has mass enough for an appendage to have been in it: no less than this share of the prior
# of its mass. The prior then ends at what the place has.
HEAVIEST = 0.9
LEAST_IN_BAND = 0.01  # share of the prior of an appendage's frequency


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
            "of appendages have no scale; a search needs sensors, or a structure with floors"
        )
    return MassScale(float(np.median(largest[largest > 0.0] ** -2)), "median modal mass")


def hypothesis(
    baseline: ModelClass,
    places: Sequence[Feature],
    search_settings: SearchSettings | None = None,
    name: str | None = None,
    *,
    present_in: Sequence[str] | None = None,
    scale: MassScale | None = None,
) -> ModelClass:
    """The baseline with an appendage at each of ``places``, scored over all pairings."""
    options = search_settings or SearchSettings()
    tests = tests_with_appendages(baseline, present_in)
    prior = frequency_prior(baseline, tests, options)
    own_name = " + ".join(place.name for place in places)
    changed = baseline.with_any_pairing(name or own_name or Baselines.nothing)
    if not places:
        return changed
    mass = (scale or scale_of(baseline, present_in)).mass
    elements = []
    motions = [each for each in places if isinstance(each, FurtherMotion)]
    for place in appendages_among(places):
        mass_prior = options.prior_of_mass_ratio(mass, place.available)
        vibrating = mass * Parameter(mass_name(place), mass_prior)
        element: Any = place.element(vibrating, Parameter(frequency_name(place), prior, unit="Hz"))
        if (share := place.in_model) != 0.0:
            inferred = Parameter(in_model_name(place), Uniform(0.0, 1.0))
            element = replace(element, in_model=inferred if share is None else share)
        elements.append(element)

    def carrying(structure: Structure, i: int) -> Structure:
        if baseline.configurations[i] not in tests:
            return structure
        for element in elements:
            structure = structure.with_element(element)
        for motion in motions:
            frequency = Parameter(frequency_name(motion), prior, unit="Hz")
            structure = FurtherMode(structure, frequency, motion.mode - 1)
        return structure

    return changed.with_structures(carrying)


def tests_with_appendages(
    baseline: ModelClass, present_in: Sequence[str] | None
) -> tuple[Configuration, ...]:
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
    names = []
    for test in model_class.configurations:
        with suppress(ValueError):
            require_on_structure(candidates, test.structure)
            names.append(test.name)
    return tuple(names) if 0 < len(names) < len(model_class.configurations) else None


def frequency_prior(
    baseline: ModelClass, tests: Sequence[Configuration], options: SearchSettings
) -> Prior:
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


def frequency_name(place: Feature) -> str:
    return f"frequency, {place.name}"


def in_model_name(place: AppendagePlace) -> str:
    """Name of the parameter for the share of an appendage's mass that the model has already."""
    return f"share in the model, {place.name}"


@dataclass(frozen=True, eq=False)
class Baselines(Family[Feature]):
    """The classes that a search hangs appendages on, and what it compares them with."""

    nothing = "no appendage"

    options: SearchSettings  # what an appendage may be
    # Names of the configurations that have appendages; all if None.
    present_in: tuple[str, ...] | None
    rivals: tuple[ModelClass, ...]  # classes that are compared without appendages
    left_out: Mapping[str, str]  # other classes of the study → why nothing is hung on them
    name: str  # of the study, or of the only class

    @property
    def title(self) -> str:
        return f"Appendages hidden in {self.name!r}"

    def hypothesis(
        self, baseline: ModelClass, features: Sequence[Feature], name: str
    ) -> ModelClass:
        scale = self.scales[baseline.name] if features else None
        return hypothesis(
            baseline, features, self.options, name, present_in=self.present_in, scale=scale
        )

    def quantities(
        self, baseline: str, feature: Feature, column: Callable[[str], FloatArray]
    ) -> dict[str, FloatArray]:
        """The vibrating mass in the structure's unit and over the mass scale, the frequency, and
        the share of the mass that the model has already.
        """
        if isinstance(feature, FurtherMotion):
            return {"frequency_hz": column(frequency_name(feature))}
        ratio, hz = column(mass_name(feature)), column(frequency_name(feature))
        share = feature.in_model
        in_model = column(in_model_name(feature)) if share is None else np.full(len(ratio), share)
        mass = self.scales[baseline].mass * ratio
        return {"mass": mass, "mass_ratio": ratio, "frequency_hz": hz, "in_model": in_model}

    def n_ways(self, baseline: str, number: int, n_common: int) -> float:
        """Every feature is as probably a motion, like any of the modes, as an appendage, anywhere.

        So neither the number of places nor that of modes takes from what has no feature.
        """
        n_all, n_places = len(self.features[baseline]), len(self.appendages(baseline))

        def n_choices(n: int) -> int:
            return math.comb(n_all - n_places, n) * math.comb(n_places, number - n)

        splits = sum(math.comb(number, n) for n in range(number + 1) if n_choices(n))
        return max(n_choices(n_common), 1) * splits / math.comb(number, n_common)

    def appendages(self, baseline: str) -> list[AppendagePlace]:
        """Where appendages may be on a baseline."""
        return appendages_among(self.features[baseline])

    def places(self, baseline: str) -> Iterator[SinglePlace]:
        for place in self.appendages(baseline):
            for end in place.candidate.ends:
                yield from (single for single, _ in motion_of(end) if single != 0)

    def tests(self, baseline: ModelClass) -> tuple[Configuration, ...]:
        """The tests of a baseline that have appendages."""
        return tests_with_appendages(baseline, self.present_in)

    @cached_property
    def scales(self) -> Mapping[str, MassScale]:
        """Name of a baseline → the mass to which mass ratios refer."""
        return {each.name: scale_of(each, self.present_in) for each in self.classes}

    @cached_property
    def unobserved(self) -> frozenset[AppendagePlace]:
        """Places whose motion no sensor sees in a mode of the band, on any baseline."""
        observed: dict[AppendagePlace, bool] = {}
        for each in self.classes:
            places = self.appendages(each.name)
            for test in self.tests(each):
                seen = are_observed(test.structure, [p.candidate for p in places], test.data)
                for place, one in zip(places, seen, strict=True):
                    observed[place] = observed.get(place, False) or bool(one)
        return frozenset(place for place, one in observed.items() if not one)

    @property
    def geometry(self) -> Geometry | None:
        """Where the nodes are of the first structure that knows it."""
        tests = (test for each in self.classes for test in each.configurations)
        known = (test.structure.geometry for test in tests)
        return next((geometry for geometry in known if geometry), None)


def choose_baselines(
    study: Study,
    names: Sequence[str] | None = None,
    candidates: Sequence[Candidate] | None = None,
    present_in: Sequence[str] | None = None,
    options: SearchSettings | None = None,
) -> Baselines:
    """The baselines of a search, and the appendages that are tried on them.

    Arguments are those of :func:`~bayes_ssi.studies.questions.search`. Classes
    that carry an appendage of their own where others do not are hypotheses of the kind that the
    search makes: on these, none is hung unless they are named.
    """
    if candidates is not None:
        require_distinct(candidates)
    options = options or SearchSettings()
    left_out: dict[str, str] = {}
    possible: list[ModelClass] = []
    chosen = study if names is None else study.only(names)
    if present_in is None:
        present_in = tests_with_places(chosen.model_classes[0], candidates)
    for each in chosen.model_classes:
        try:
            each.with_any_pairing(each.name)
            _places(each, candidates, present_in, options)
            possible.append(each)
        except ValueError as error:
            if names is not None or len(study.model_classes) == 1:
                raise
            left_out[each.name] = str(error)
    if not possible:
        raise ValueError(next(iter(left_out.values())))
    carried = {each.name: _appendages_of(each) for each in possible}
    if names is None and not all(carried.values()):
        left_out |= {
            name: f"model class {name!r} carries an appendage of its own, {labels[0]!r}"
            for name, labels in carried.items()
            if labels
        }
    chosen = chosen.only([name for name in chosen.names if name not in left_out])
    chosen.require_same_data()
    chosen = chosen.with_any_pairing()
    classes = chosen.model_classes
    tried = {name for originals in chosen.stands_for.values() for name in originals}
    # To have an appendage is what the search asks: such a class is no rival without any.
    are_bare = not any(map(_appendages_of, classes))
    rivals = [
        each.name
        for each in study.model_classes
        if each.name not in tried
        and not (are_bare and _appendages_of(each))
        and each.data_digest == classes[0].data_digest
        # An evidence over all pairings takes seconds.
        and is_cheap(each)
        and not each.error.is_correlated
    ]
    features: dict[str, tuple[Feature, ...]] = {
        each.name: (*_places(each, candidates, present_in, options), *_motions_of(each))
        for each in classes
    }
    present = None if present_in is None else tuple(present_in)
    compared = tuple(study.only(rivals).with_any_pairing().model_classes) if rivals else ()
    name = classes[0].name if len(classes) == 1 else study.name
    return Baselines(chosen, features, options, present, compared, left_out, name)


def _places(
    baseline: ModelClass,
    candidates: Sequence[Candidate] | None,
    present_in: Sequence[str] | None,
    options: SearchSettings,
) -> tuple[AppendagePlace, ...]:
    tests = tests_with_appendages(baseline, present_in)
    scale = scale_of(baseline, present_in)  # refuses masses that have none, before any sampling
    if candidates is None:
        sensors = dict.fromkeys(name for test in tests for name in test.data.sensors)
        candidates = tests[0].structure.candidates(list(sensors))
        candidates = with_given_masses(candidates, tests[0].structure)
    for test in tests:
        try:
            require_on_structure(candidates, test.structure)
        except ValueError as error:
            where = f"model class {baseline.name!r}"
            raise ValueError(f"{where}: {error}") from None
    places = places_of(located(each, tests[0].structure) for each in candidates)
    heaviest = scale.mass * options.prior_of_mass_ratio(scale.mass).quantile(HEAVIEST)
    return with_masses_in_model(places, tests[0].structure, heaviest)


def _motions_of(baseline: ModelClass) -> tuple[FurtherMotion, ...]:
    """One like each mode in the band, no more than were identified, of a single test's shapes."""
    test = baseline.configurations[0]
    if len(baseline.configurations) > 1 or not baseline.has_shapes:
        return ()
    modes = test.structure.modes(test.structure.prior_medians())
    n = int((modes.frequencies_hz[0] <= test.data.band_hz[1]).sum())
    return tuple(FurtherMotion(i) for i in range(1, min(n, len(test.data.modes)) + 1))


def _appendages_of(model_class: ModelClass) -> list[str]:
    return [label for test in model_class.configurations for label in test.structure.appendages]
