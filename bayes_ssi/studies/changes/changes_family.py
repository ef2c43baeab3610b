"""Hypotheses of change: a structure some of whose parameters are less after than before."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.refinement import (
    RefinementSettings,
    is_approximate,
    requirements,
)
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.priors import LogUniform, NearOne, Prior, TruncatedNormal, Uniform
from bayes_ssi.structures.changed_structure import ChangedStructure, Loss
from bayes_ssi.structures.structure import Requirement, Structure
from bayes_ssi.studies.appendages.baselines import MassScale, scale_of
from bayes_ssi.studies.changes.kinds_of_change import (
    COMMON_PLACE,
    AppearedAppendage,
    ChangePlace,
    ElementPlace,
    KindOfChange,
    SomethingElse,
    element_places,
    places_of,
)
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.ranking.variations import with_priors
from bayes_ssi.studies.search.family import (
    BASIS_DRAWS,
    Draws,
    Family,
    Hypothesis,
    SearchLimits,
    compact,
    prior_draws,
)

SHARED = "shared error"
# Of a share in common where all frequencies moved alike and none was asked for; moisture and
# temperature change stiffnesses by a few per cent.
COMMON_SD = 0.05


@dataclass(frozen=True)
class ChangeSettings(SearchLimits):
    """What a change may be, and in how many places there may be one.

    Attributes:
        loss: prior of the share of a parameter that a change takes away; a gain where negative.
        common_sd: standard deviation of a share that all groups lose or gain in common, as by
            temperature or moisture, which is no change of the structure; not considered if None.
        covariate: name of a test → what the common share is proportional to, such as degrees; then
            ``common_sd`` is that of the share at the test that differs most from those before.
        losses_only: whether no mass, appendage or anything else that came or went is considered.
        shared: prior of the share of prediction errors that the tests have in common, where the
            class gives none; errors of different tests are independent if None.
        number_weights, branches, most_unsampled, most_sampled: how many changes, and how far the
            search goes, as in :class:`~bayes_ssi.studies.search.family.SearchLimits`.

    Raises:
        ValueError: as :class:`~bayes_ssi.studies.search.family.SearchLimits`; a loss could leave a
            negative stiffness; or the common share's standard deviation is not usable.
        TypeError: a prior is not a prior distribution.
    """

    loss: Prior = field(default_factory=lambda: Uniform(0.0, 1.0))
    common_sd: float | None = None
    covariate: Mapping[str, float] | None = None
    losses_only: bool = False
    # Where nothing changed, each of many places has some hundredths: sampling one takes as long as
    # screening forty, and corrects its share by a tenth.
    most_unsampled: float = 0.1
    # What is not shared has any order of size, down to a hundredth of an error.
    shared: Prior | None = field(default_factory=lambda: NearOne(1e-4))

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_priors("loss", "shared", optional=("shared",))
        if (highest := self.loss.support[1]) > 1.0:
            raise ValueError(
                f"ChangeSettings: a loss of {highest:g} would leave a negative stiffness; it must "
                f"be at most 1, got {self.loss!r}"
            )
        if self.common_sd is not None and not 0.0 < self.common_sd < 1.0:
            raise ValueError(
                f"ChangeSettings: common_sd must be between 0 and 1, got {self.common_sd!r}"
            )
        if self.covariate is not None and self.common_sd is None:
            raise ValueError("ChangeSettings: a covariate needs common_sd, which is not given")


@dataclass(frozen=True, eq=False)
class Changes(Family[KindOfChange]):
    """Classes of a study, and the places where their parameters may have changed."""

    nothing = "nothing changed"

    options: ChangeSettings
    before: tuple[str, ...]  # names of tests
    after: tuple[str, ...]
    amounts: Mapping[str, float]  # name of a test → how much of the common loss it has

    @property
    def title(self) -> str:
        return f"Changes from {', '.join(self.before)} to {', '.join(self.after)}"

    def hypothesis(
        self, baseline: ModelClass, features: Sequence[KindOfChange], name: str
    ) -> ModelClass:
        tests = tuple(self._changed(baseline, test, features) for test in baseline.configurations)
        return replace(baseline, name=name, configurations=tests)

    def _changed(
        self, baseline: ModelClass, test: Configuration, features: Sequence[KindOfChange]
    ) -> Configuration:
        """A test with what changed, and its pairing where an appendage has a mode of its own."""
        structure, pairing, falls = test.structure, test.pairing, dict[int, Parameter]()
        is_after = test.name in self.after
        side = [each for each in baseline.configurations if (each.name in self.after) == is_after]
        for each in features:
            if isinstance(each, ElementPlace) and each.has_gone != is_after:
                lowest = min(mode.frequency_hz for of in side for mode in of.data.modes)
                highest = max(of.data.band_hz[1] for of in side)
                hz = LogUniform(0.5 * lowest, highest)
                for element in each.elements(self.scales[baseline.name].mass, hz):
                    structure = structure.with_element(element)
                if isinstance(each, AppearedAppendage) and pairing != "any":
                    pairing = each.pairing_in(test, pairing, side)
        for each in features:
            if isinstance(each, SomethingElse) and is_after and pairing != "any":
                falls = {pairing[label]: e for label, e in each.falls.items() if label in pairing}
        losses = tuple(self._losses(features, test))
        if losses or falls:
            structure = ChangedStructure(structure, losses, falls)
        return replace(test, structure=structure, pairing=pairing)

    def _losses(self, features: Sequence[KindOfChange], test: Configuration) -> Iterator[Loss]:
        for place in features:
            if not isinstance(place, ChangePlace):
                continue
            prior: Prior = self.options.loss
            amounts: Mapping[str, float] = dict.fromkeys(self.after, 1.0)
            if place.is_common:
                assert self.options.common_sd is not None
                prior = TruncatedNormal(0.0, self.options.common_sd, -1.0, 1.0)
                amounts = self.amounts
            if amount := amounts.get(test.name, 0.0):
                for loss, names in place.losses.items():
                    yield from (Loss(name, Parameter(loss, prior), amount) for name in names)

    @cached_property
    def scales(self) -> Mapping[str, MassScale]:
        """Name of a baseline → the mass of which masses and appendages are shares."""
        return {each.name: scale_of(each, self.after) for each in self.classes}

    def quantities(
        self,
        baseline: str,  # noqa: ARG002 - of all families
        feature: KindOfChange,
        column: Callable[[str], FloatArray],
    ) -> dict[str, FloatArray]:
        """The shares that are lost of parameters, or added of the mass scale."""
        return {name: column(name) for name in feature.amount_names}

    # Reduced structures: all tests of one structure share a basis, which reaches as far as losses.

    @cached_property
    def reaching(self) -> dict[str, ModelClass]:
        """Name of a baseline → the same, accurate over the prior, also of losses.

        All that is computed later begins from its bases: none of their full solutions is lost.
        """
        settings = RefinementSettings(error_share=1.0)
        return {
            each.name: _sharing_a_basis(each, self._with_losses(each.name, prior_draws), settings)
            for each in self.classes
        }

    def _with_losses(self, baseline: str, draws: Draws) -> list[tuple[ModelClass, FloatArray]]:
        """A change at every place, and draws of it: of the baseline's parameters as given."""
        chosen = self[baseline]
        own = draws(chosen.parameter_names, BASIS_DRAWS)
        rng, at = np.random.default_rng(0), []
        for place in self.features[baseline]:
            made = self.hypothesis(chosen, (place,), place.name)
            # Losses between 2 and 98 % if they are uniform.
            z = np.clip(rng.standard_normal((len(own), len(made.parameters))), -2.0, 2.0)
            z[:, [made.parameter_names.index(name) for name in chosen.parameter_names]] = own
            at.append((made, z))
        return at

    def projected(self, baseline: str, draws: Draws) -> ModelClass:
        return _sharing_a_basis(self.reaching[baseline], self._with_losses(baseline, draws), None)

    def accurate(self, best: Hypothesis[KindOfChange]) -> ModelClass:
        chosen = self.reaching[best.key.baseline]
        z = best.screened.posterior_draws(best.model_class.parameter_names, BASIS_DRAWS)
        made = self.hypothesis(chosen, best.key.features, best.model_class.name)
        return _sharing_a_basis(chosen, [(made, z)], RefinementSettings())

    def to_sample(self, accurate: ModelClass, hypothesis: Hypothesis[KindOfChange]) -> ModelClass:
        name = hypothesis.model_class.name
        made = self.hypothesis(accurate, hypothesis.key.features, name)
        # With its losses, which the baseline does not have.
        return compact(made, hypothesis.screened.draws)


def _sharing_a_basis(
    baseline: ModelClass,
    hypotheses: Sequence[tuple[ModelClass, FloatArray]],
    settings: RefinementSettings | None,
) -> ModelClass:
    """The baseline, its structures accurate where hypotheses lie: one for all its tests.

    Args:
        hypotheses: classes on it, and where each lies (n, d), in standard-normal coordinates.
        settings: how accurate; as far as a small basis is, of what there is, if None.
    """
    if not is_approximate(baseline):
        return baseline
    needed: dict[int, list[Requirement]] = {}
    for made, z in hypotheses:
        of_tests = requirements(made, made.values(z), settings or RefinementSettings())
        tests = zip(baseline.configurations, made.configurations, of_tests, strict=True)
        for own, test, required in tests:
            at = required.values
            if isinstance(test.structure, ChangedStructure):
                at = test.structure.left(at)
            # Elements come after what the structure has of its own.
            required = required._replace(
                values=at[:, : len(own.structure.parameters)],
                n_modes=min(required.n_modes, own.structure.n_modes),
            )
            needed.setdefault(id(own.structure), []).append(required)
    better: dict[int, Structure] = {}
    for structure in (test.structure for test in baseline.configurations):
        values, frequency, shape, n_modes = zip(*needed[id(structure)], strict=True)
        if id(structure) in better:
            continue
        at = np.concatenate(values)
        required = Requirement(at, min(frequency), min(shape), max(n_modes))
        better[id(structure)] = (
            structure.compact(at) if settings is None else structure.accurate_at(required)
        )
    return baseline.with_structures(lambda structure, _: better[id(structure)])


def choose_changes(
    study: Study,
    before: Sequence[str],
    after: Sequence[str],
    options: ChangeSettings | None = None,
    *,
    joined: Mapping[str, Sequence[str]] | None = None,
    places: Mapping[str, Sequence[str]] | None = None,
    left_out: Sequence[str] = (),
) -> Changes:
    """The hypotheses of change between two tests of a study, or two groups of them.

    Arguments are those of :func:`~bayes_ssi.studies.questions.changes`.
    """
    options = options or ChangeSettings()
    before, after = tuple(dict.fromkeys(before)), tuple(dict.fromkeys(after))
    if not (before and after):
        raise ValueError("changes: give one configuration or more before, and one or more after")
    if both := [name for name in before if name in after]:
        raise ValueError(f"changes: configuration {both[0]!r} cannot be both before and after")
    classes = [_of_tests(each, before, after, options) for each in study.model_classes]
    chosen = replace(study, model_classes=classes, stands_for={})
    chosen.require_same_data()
    if options.common_sd is None and moved_alike(risen(classes[0], before, after)):
        options = replace(options, common_sd=COMMON_SD)
    features = {}
    for each in classes:
        changed = [test.structure for test in each.configurations if test.name in after]
        own = [{p.name for p in structure.parameters} for structure in changed]
        able = [p.name for p in each.structural_parameters if all(p.name in n for n in own)]
        where = f"model class {each.name!r}"
        losses = places_of(able, joined or {}, places or {}, left_out, where)
        if options.common_sd is not None:
            of_all = tuple(dict.fromkeys(name for place in losses for name in place.parameters))
            losses += (ChangePlace(COMMON_PLACE, of_all, is_common=True),)
        others = () if options.losses_only else _besides_losses(each, before, after)
        features[each.name] = (*losses, *others)
    return Changes(chosen, features, options, before, after, _amounts(options, before, after))


def _besides_losses(
    model_class: ModelClass, before: Sequence[str], after: Sequence[str]
) -> Iterator[KindOfChange]:
    """Masses and appendages that came or went, and something else."""
    tests = {name: model_class.configuration(name) for name in (*before, *after)}
    is_any = any(test.pairing == "any" for test in tests.values())
    modes: dict[bool, Sequence[str]] = {}
    for has_gone, own, others in ((False, after, before), (True, before, after)):
        known = {label for name in others for label in tests[name].data.labels}
        known |= {label for name in own for label in tests[name].pairing}
        labels = dict.fromkeys(label for name in own for label in tests[name].data.labels)
        modes[has_gone] = ("",) if is_any else [each for each in labels if each not in known]
    sensors = dict.fromkeys(name for test in tests.values() for name in test.data.sensors)
    yield from element_places(tests[after[0]].structure, list(sensors), modes)
    if (moved := risen(model_class, before, after)) and not is_any:
        yield SomethingElse(tuple(moved))


def risen(model_class: ModelClass, before: Sequence[str], after: Sequence[str]) -> dict[str, float]:
    """Label of a mode that is paired on both sides → the share by which its frequency rose."""

    def means(names: Sequence[str]) -> dict[str, float]:
        of_modes: dict[str, list[float]] = {}
        for test in map(model_class.configuration, names):
            for label in () if test.pairing == "any" else test.pairing:
                of_modes.setdefault(label, []).append(test.data.mode(label).frequency_hz)
        return {label: float(np.mean(hz)) for label, hz in of_modes.items()}

    first, second = means(before), means(after)
    return {label: second[label] / hz - 1.0 for label, hz in first.items() if label in second}


def moved_alike(risen: Mapping[str, float]) -> bool:
    """Whether all rose or fell by a thousandth or more on average, each within half of that."""
    moved = np.array(list(risen.values()))
    mean = moved.mean() if len(moved) else 0.0
    is_near = np.abs(moved - mean) < 0.5 * abs(mean)
    return bool(len(moved) > 1 and abs(mean) > 1e-3 and is_near.all())


def _amounts(
    options: ChangeSettings, before: Sequence[str], after: Sequence[str]
) -> dict[str, float]:
    covariate = options.covariate
    if covariate is None:
        return dict.fromkeys(after, 1.0)
    tests = (*before, *after)
    if missing := [name for name in tests if name not in covariate]:
        raise ValueError(f"covariate: no value of test {missing[0]!r}")
    reference = sum(covariate[name] for name in before) / len(before)
    apart = {name: covariate[name] - reference for name in tests}
    largest = max(map(abs, apart.values()))
    if largest == 0.0:
        raise ValueError("covariate: it is the same in all tests, so it explains no change")
    return {name: each / largest for name, each in apart.items()}


def _of_tests(
    model_class: ModelClass, before: Sequence[str], after: Sequence[str], options: ChangeSettings
) -> ModelClass:
    """The class with these tests alone, which share prediction errors."""
    where = f"model class {model_class.name!r}"
    tests = tuple(model_class.configuration(name) for name in (*before, *after))
    error = model_class.error
    if options.shared is not None and not error.repeats_between_tests:
        if inferred := [test.name for test in tests if test.pairing == "any"]:
            raise ValueError(
                f"{where}: configuration {inferred[0]!r} has pairing 'any', for which tests cannot "
                "share prediction errors; give its pairing, or make errors independent"
            )
        sides = tests[: len(before)], tests[len(before) :]
        paired = [{label for test in side for label in test.pairing} for side in sides]
        if not paired[0] & paired[1]:
            labels = ("; ".join(sorted(one)) or "none" for one in paired)
            raise ValueError(
                f"{where}: no paired mode has the same label before and after, so nothing can be "
                f"compared; got {' and '.join(labels)}"
            )
        error = replace(error, between_tests=Parameter(SHARED, options.shared))
    restricted = replace(model_class, configurations=tests, error=error, priors={})
    return with_priors(model_class.priors, restricted)
