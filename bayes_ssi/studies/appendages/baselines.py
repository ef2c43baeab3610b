"""The model classes on which appendages are hung: the baseline of a search is a question, too."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.structures.geometry import Geometry, SinglePlace, motion_of
from bayes_ssi.studies.appendages.candidates import (
    Candidate,
    are_observed,
    located,
    require_distinct,
    require_on_structure,
)
from bayes_ssi.studies.appendages.hypotheses import (
    MassScale,
    hypothesis,
    name_of,
    scale_of,
    tests_with_appendages,
    tests_with_places,
)
from bayes_ssi.studies.appendages.places import AppendagePlace, places_of
from bayes_ssi.studies.appendages.search_settings import SearchSettings
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.family import Family


@dataclass(frozen=True, eq=False)
class Baselines(Family[AppendagePlace]):
    """The classes that a search hangs appendages on, and what it compares them with."""

    options: SearchSettings  # what an appendage may be
    # Names of the configurations that have appendages; all if None.
    present_in: tuple[str, ...] | None
    rivals: tuple[ModelClass, ...]  # classes that are compared without appendages
    left_out: Mapping[str, str]  # other classes of the study → why nothing is hung on them

    def name_of(self, features: Sequence[AppendagePlace]) -> str:
        return name_of(features)

    def hypothesis(
        self, baseline: ModelClass, features: Sequence[AppendagePlace], name: str
    ) -> ModelClass:
        scale = self.scales[baseline.name] if features else None
        return hypothesis(
            baseline, features, self.options, name, present_in=self.present_in, scale=scale
        )

    def places(self, baseline: str) -> Iterator[SinglePlace]:
        for place in self.features[baseline]:
            for end in place.candidate.ends:
                yield from (single for single, _ in motion_of(end) if single != 0)

    @property
    def n_hypotheses_of_one(self) -> int:
        return sum(1 + len(places) for places in self.features.values())

    @cached_property
    def scales(self) -> Mapping[str, MassScale]:
        """Name of a baseline → the mass to which mass ratios refer."""
        return {each.name: scale_of(each, self.present_in) for each in self.classes}

    @cached_property
    def unobserved(self) -> frozenset[AppendagePlace]:
        """Places whose motion no sensor sees in a mode of the band, on any baseline."""
        observed: dict[AppendagePlace, bool] = {}
        for each in self.classes:
            places = self.features[each.name]
            for test in tests_with_appendages(each, self.present_in):
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

    Args:
        names: those to hang appendages on. If None, all on which that can be done, but for those
            that carry an appendage of their own where others do not: they are hypotheses of the
            kind that the search makes.
        candidates: where appendages may hang; those of the structure if None.
        present_in: names of the configurations that have appendages; if None, all whose structures
            have the candidates' places.
        options: what an appendage may be.
    """
    if candidates is not None:
        require_distinct(candidates)
    left_out: dict[str, str] = {}
    possible: list[ModelClass] = []
    chosen = study if names is None else study.only(names)
    if present_in is None:
        present_in = tests_with_places(chosen.model_classes[0], candidates)
    for each in chosen.model_classes:
        try:
            each.with_any_pairing(each.name)
            _places(each, candidates, present_in)
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
    return Baselines(
        chosen,
        {each.name: _places(each, candidates, present_in) for each in classes},
        options or SearchSettings(),
        None if present_in is None else tuple(present_in),
        tuple(study.only(rivals).with_any_pairing().model_classes) if rivals else (),
        left_out,
    )


def _places(
    baseline: ModelClass,
    candidates: Sequence[Candidate] | None,
    present_in: Sequence[str] | None,
) -> tuple[AppendagePlace, ...]:
    tests = tests_with_appendages(baseline, present_in)
    if candidates is None:
        sensors = dict.fromkeys(name for test in tests for name in test.data.sensors)
        candidates = tests[0].structure.candidates(list(sensors))
    for test in tests:
        try:
            require_on_structure(candidates, test.structure)
        except ValueError as error:
            where = f"model class {baseline.name!r}"
            raise ValueError(f"{where}: {error}") from None
    return places_of(located(each, tests[0].structure) for each in candidates)


def _appendages_of(model_class: ModelClass) -> list[str]:
    return [label for test in model_class.configurations for label in test.structure.appendages]
