"""The model classes on which appendages are hung: the baseline of a search is a question, too."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    is_approximate,
    more_accurate,
)
from bayes_ssi.structures.geometry import Geometry, motion_of
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.appendages.candidates import (
    Candidate,
    are_observed,
    located,
    require_distinct,
    require_on_structure,
)
from bayes_ssi.studies.appendages.hypotheses import (
    MassScale,
    SearchSettings,
    hypothesis,
    scale_of,
    tests_with_appendages,
    tests_with_places,
)
from bayes_ssi.studies.appendages.places import AppendagePlace, places_of
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.study import Study

# Draws whose modes make the bases in which hypotheses on a reduced structure are computed.
N_DRAWS = 200
# Names of parameters and n → draws (n, d) of these, in standard-normal coordinates.
Draws = Callable[[Sequence[str], int], FloatArray]
# Hypotheses, baselines included, that are sampled where each takes some 20 full solutions of a
# finite-element model: in total fewer than 200.
MOST_WITH_FULL_SOLUTIONS = 6
# Sampling one takes as long as screening five: those that are sampled, most of an answer that rests
# on few, take no longer than the screening of a hundred. Where it rests on more, each has a few per
# cent, and errors of a tenth of a nat, which are independent, change their sums little.
MOST_SAMPLED = 12


def prior_draws(names: Sequence[str], n: int) -> FloatArray:
    """Draws (n, d) of the prior, in standard-normal coordinates."""
    return np.random.default_rng(0).standard_normal((n, len(names)))


@dataclass(frozen=True, eq=False)
class Baselines:
    """What a search hangs appendages on, and what it compares that with.

    Attributes:
        present_in: names of the configurations that have appendages; all if None.
    """

    study: Study
    places: Mapping[str, tuple[AppendagePlace, ...]]
    present_in: tuple[str, ...] | None
    rivals: tuple[ModelClass, ...]
    left_out: Mapping[str, str]

    @property
    def classes(self) -> tuple[ModelClass, ...]:
        return tuple(self.study.model_classes)

    @property
    def n_hypotheses_of_one(self) -> int:
        """The number of hypotheses with at most one appendage."""
        return sum(1 + len(places) for places in self.places.values())

    @cached_property
    def scales(self) -> Mapping[str, MassScale]:
        """Name of a baseline → the mass to which mass ratios refer."""
        return {each.name: scale_of(each, self.present_in) for each in self.classes}

    @cached_property
    def unobserved(self) -> frozenset[AppendagePlace]:
        """Places whose motion no sensor sees in a mode of the band, on any baseline."""
        observed: dict[AppendagePlace, bool] = {}
        for each in self.classes:
            places = self.places[each.name]
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

    def __getitem__(self, name: str) -> ModelClass:
        """The baseline of that name."""
        return next(each for each in self.classes if each.name == name)

    def hypothesis(
        self,
        baseline: ModelClass,
        places: Sequence[AppendagePlace],
        options: SearchSettings,
        name: str,
    ) -> ModelClass:
        """A baseline, or a projected one, with appendages at ``places``."""
        scale = self.scales[baseline.name] if places else None
        return hypothesis(baseline, places, options, name, present_in=self.present_in, scale=scale)

    def projected(self, name: str, draws: Draws) -> ModelClass:
        """A baseline with its reduced structures in a basis for draws.

        Others, and those that carry elements already, are as they are.
        """
        ends = (end for place in self.places[name] for end in place.candidate.ends)
        singles = dict.fromkeys(
            single for end in ends for single, _ in motion_of(end) if single != 0
        )
        return _with_reduced(self[name], draws, lambda s, values: s.projected(values, singles))

    def accurate(self, name: str, draws: Draws) -> ModelClass:
        """A baseline with reduced structures as accurate at draws as sampling requires.

        All hypotheses on it share this basis, to which an element adds what its force needs.
        """
        baseline = self[name]
        if not is_approximate(baseline):
            return baseline
        values = baseline.values(draws(baseline.parameter_names, N_DRAWS))
        return more_accurate(baseline, values, RefinementSettings())

    def most_sampled(self, options: SearchSettings) -> int | None:
        """How many hypotheses are sampled at most; None if there is no limit."""
        if options.most_sampled is not None:
            return options.most_sampled
        if any(map(is_approximate, self.classes)):
            return MOST_WITH_FULL_SOLUTIONS
        return None if options.most_unsampled == 0.0 else MOST_SAMPLED

    def prior_probability(self, baseline: str) -> float:
        """That of one baseline among all, without regard to appendages."""
        weights = self.study.prior_weights or dict.fromkeys(self.study.names, 1.0)
        return weights[baseline] / sum(weights.values())

    def original_names(self, baseline: str) -> tuple[str, ...]:
        """The classes of the study that a baseline represents."""
        return self.study.stands_for[baseline]


def compact(baseline: ModelClass, draws: Draws) -> ModelClass:
    """As :meth:`Baselines.projected`, but with reduced structures whose error is certified."""
    return _with_reduced(baseline, draws, lambda s, values: s.compact(values))


def _with_reduced(
    baseline: ModelClass,
    draws: Draws,
    change: Callable[[Structure, FloatArray], Structure],
) -> ModelClass:
    structures = [test.structure for test in baseline.configurations]
    if not any(structure.is_approximate for structure in structures):
        return baseline
    z = draws(baseline.parameter_names, N_DRAWS)
    columns = [own for _, _, own in baseline.parts(baseline.values(z))]

    return baseline.with_structures(
        lambda structure, i: change(structure, columns[i][:, : len(structure.parameters)])
    )


def choose_baselines(
    study: Study,
    names: Sequence[str] | None = None,
    candidates: Sequence[Candidate] | None = None,
    present_in: Sequence[str] | None = None,
) -> Baselines:
    """The baselines of a search, and the appendages that are tried on them.

    Args:
        names: those to hang appendages on. If None, all on which that can be done, but for those
            that carry an appendage of their own where others do not: they are hypotheses of the
            kind that the search makes.
        candidates: where appendages may hang; those of the structure if None.
        present_in: names of the configurations that have appendages; if None, all whose structures
            have the candidates' places.
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
    with_own = _with_appendages(possible) if names is None else {}
    left_out |= with_own
    chosen = chosen.only([name for name in chosen.names if name not in left_out])
    chosen.require_same_data()
    chosen = chosen.with_any_pairing()
    known = {name for own in chosen.stands_for.values() for name in own}
    if not any(map(_appendages_of, chosen.model_classes)):
        # To have an appendage is what the search asks: such a class is no rival without any.
        known |= {each.name for each in study.model_classes if _appendages_of(each)}
    return Baselines(
        chosen,
        {each.name: _places(each, candidates, present_in) for each in chosen.model_classes},
        None if present_in is None else tuple(present_in),
        _rivals(study, {*known, *with_own}, chosen.model_classes[0].data_digest),
        left_out,
    )


def _places(
    baseline: ModelClass,
    candidates: Sequence[Candidate] | None,
    present_in: Sequence[str] | None,
) -> tuple[AppendagePlace, ...]:
    """The appendages that are tried on a class."""
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
    """Labels of the appendages that a class carries."""
    return [label for test in model_class.configurations for label in test.structure.appendages]


def _with_appendages(classes: Sequence[ModelClass]) -> dict[str, str]:
    """Classes that carry appendages of their own, where others do not → why they are left out."""
    own = {each.name: _appendages_of(each) for each in classes}
    if all(own.values()):
        return {}
    return {
        name: f"model class {name!r} carries an appendage of its own, {labels[0]!r}"
        for name, labels in own.items()
        if labels
    }


def _rivals(study: Study, known: set[str], data_digest: str) -> tuple[ModelClass, ...]:
    """The other classes of the same data, where an evidence over all pairings takes seconds."""
    others = [
        each.name
        for each in study.model_classes
        if each.name not in known
        and each.data_digest == data_digest
        and is_cheap(each)
        and not each.error.is_correlated
    ]
    if not others:
        return ()
    return tuple(study.only(others).with_any_pairing().model_classes)
