"""Hypotheses of change: a structure some of whose parameters are less after than before."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.refinement import (
    RefinementSettings,
    is_approximate,
    requirements,
)
from bayes_ssi.parameters.families import NearOne, TruncatedNormal, Uniform
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.structures.changed_structure import ChangedStructure, Loss
from bayes_ssi.structures.structure import Requirement, Structure
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.family import (
    BASIS_DRAWS,
    Draws,
    Family,
    FeaturePlace,
    Hypothesis,
    SearchLimits,
    compact,
    prior_draws,
)

SHARED = "shared error"
# Names that no study uses as that of a place.
COMMON_PLACE = "all in common"


@dataclass(frozen=True)
class ChangeSettings(SearchLimits):
    """What a change may be, and in how many places there may be one.

    Attributes:
        loss: prior of the share of a parameter that a change takes away; a gain where negative.
        common_sd: standard deviation of a share that all groups lose or gain in common, as by
            temperature or moisture, which is no change of the structure; not considered if None.
        covariate: name of a test → what the common share is proportional to, such as degrees; then
            ``common_sd`` is that of the share at the test that differs most from those before.
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


@dataclass(frozen=True)
class ChangePlace(FeaturePlace):
    """Parameters of a class of which a change at one place takes a share."""

    name: str  # unique among the places
    parameters: tuple[str, ...]
    is_joined: bool = True  # whether all of them lose one share; else each loses one of its own
    is_common: bool = False  # whether this is a common factor of all places, which is no change
    height: float | None = None  # in storeys above the ground; None where it is not known

    title = "change"  # drawn in its storey

    @property
    def description(self) -> str:
        return "a loss in common" if self.is_common else f"a loss in {self.name}"

    @property
    def losses(self) -> dict[str, tuple[str, ...]]:
        """Name of every loss → the parameters of which it takes a share."""
        if self.is_common:
            return {"common loss": self.parameters}
        if self.is_joined:
            return {f"loss, {self.name}": self.parameters}
        return {f"loss, {name}": (name,) for name in self.parameters}


def places_of(
    parameters: Sequence[str],
    joined: Mapping[str, Sequence[str]],
    places: Mapping[str, Sequence[str]],
    left_out: Sequence[str],
    structure: Structure,
    where: str,
) -> tuple[ChangePlace, ...]:
    """Those that are given, then every other parameter alone; ``where`` begins messages."""
    groups = [(name, tuple(names), True) for name, names in joined.items()]
    groups += [(name, tuple(names), False) for name, names in places.items()]
    named = [*left_out, *(one for _, names, _ in groups for one in names)]
    require_known(f"{where}: no parameter", named, parameters)
    groups += [(name, (name,), True) for name in parameters if name not in named]
    groups = [group for group in groups if group[1]]
    for all_of, what in ((named, "parameter"), ([name for name, *_ in groups], "place")):
        for name in all_of:
            if all_of.count(name) > 1:
                raise ValueError(f"{where}: {what} {name!r} is named twice")
    if not groups:
        raise ValueError(f"{where}: every parameter is left out; leave one in")
    made = []
    for name, names, is_joined in groups:
        heights = [at for each in names if (at := structure.height_of(each)) is not None]
        height = sum(heights) / len(heights) if heights else None
        made.append(ChangePlace(name, names, is_joined, height=height))
    return tuple(made)


@dataclass(frozen=True, eq=False)
class Changes(Family[ChangePlace]):
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
        self, baseline: ModelClass, features: Sequence[ChangePlace], name: str
    ) -> ModelClass:
        def changed(structure: Structure, i: int) -> Structure:
            losses = tuple(self._losses(features, baseline.configurations[i]))
            return ChangedStructure(structure, losses) if losses else structure

        return replace(baseline.with_structures(changed), name=name)

    def _losses(self, features: Sequence[ChangePlace], test: Configuration) -> Iterator[Loss]:
        for place in features:
            prior: Prior = self.options.loss
            amounts: Mapping[str, float] = dict.fromkeys(self.after, 1.0)
            if place.is_common:
                assert self.options.common_sd is not None
                prior = TruncatedNormal(0.0, self.options.common_sd, -1.0, 1.0)
                amounts = self.amounts
            if amount := amounts.get(test.name, 0.0):
                for loss, names in place.losses.items():
                    yield from (Loss(name, Parameter(loss, prior), amount) for name in names)

    def quantities(
        self,
        baseline: str,  # noqa: ARG002 - of all families
        feature: ChangePlace,
        column: Callable[[str], FloatArray],
    ) -> dict[str, FloatArray]:
        """The shares of parameters that are lost."""
        return {loss: column(loss) for loss in feature.losses}

    # Reduced structures: all tests of one structure share a basis, which reaches as far as losses.

    @property
    def most_sampled(self) -> int | None:
        most = super().most_sampled
        if self.options.most_sampled is None and any(map(is_approximate, self.classes)):
            return (most or 0) // 2  # each takes full solutions of two tests
        return most

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

    def accurate(self, best: Hypothesis[ChangePlace]) -> ModelClass:
        chosen = self.reaching[best.key.baseline]
        z = best.screened.posterior_draws(best.model_class.parameter_names, BASIS_DRAWS)
        made = self.hypothesis(chosen, best.key.features, best.model_class.name)
        return _sharing_a_basis(chosen, [(made, z)], RefinementSettings())

    def to_sample(self, accurate: ModelClass, hypothesis: Hypothesis[ChangePlace]) -> ModelClass:
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
            if isinstance(test.structure, ChangedStructure):
                required = required._replace(values=test.structure.left(required.values))
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
    features = {}
    for each in classes:
        changed = [test.structure for test in each.configurations if test.name in after]
        own = [{p.name for p in structure.parameters} for structure in changed]
        able = [p.name for p in each.structural_parameters if all(p.name in n for n in own)]
        where = f"model class {each.name!r}"
        found = places_of(able, joined or {}, places or {}, left_out, changed[0], where)
        if options.common_sd is not None:
            of_all = tuple(dict.fromkeys(name for place in found for name in place.parameters))
            found += (ChangePlace(COMMON_PLACE, of_all, is_common=True),)
        features[each.name] = found
    return Changes(chosen, features, options, before, after, _amounts(options, before, after))


def _amounts(
    options: ChangeSettings, before: Sequence[str], after: Sequence[str]
) -> dict[str, float]:
    covariate = options.covariate
    if covariate is None:
        return dict.fromkeys(after, 1.0)
    for name in (*before, *after):
        if name not in covariate:
            raise ValueError(f"covariate: no value of test {name!r}")
    reference = sum(covariate[name] for name in before) / len(before)
    apart = {name: covariate[name] - reference for name in (*before, *after)}
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
        for test in tests:
            if test.pairing == "any":
                raise ValueError(
                    f"{where}: configuration {test.name!r} has pairing 'any', for which tests "
                    "cannot share prediction errors; give its pairing, or make errors independent"
                )
        paired = [
            {label for name in names for label in model_class.configuration(name).pairing}
            for names in (before, after)
        ]
        if not paired[0] & paired[1]:
            labels = ("; ".join(sorted(one)) or "none" for one in paired)
            raise ValueError(
                f"{where}: no paired mode has the same label before and after, so nothing can be "
                f"compared; got {' and '.join(labels)}"
            )
        error = replace(error, between_tests=Parameter(SHARED, options.shared))
    restricted = replace(model_class, configurations=tests, error=error, priors={})
    names = restricted.parameter_names
    own = {name: prior for name, prior in model_class.priors.items() if name in names}
    return replace(restricted, priors=own)
