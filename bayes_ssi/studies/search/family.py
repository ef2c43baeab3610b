"""A family of hypotheses: features that a search adds to the model classes it begins from."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import (
    RefinementSettings,
    is_approximate,
    more_accurate,
)
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.structures.geometry import Point, SinglePlace
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import Screened


class FeaturePlace:
    """Where a hypothesis puts a feature, and what it is there; its kinds are frozen dataclasses."""

    record_tag = "kind"  # where a stored record names the kind
    # How drawings show it: a legend and a marker.
    title: ClassVar[str]
    marker: ClassVar[str] = "s"

    if TYPE_CHECKING:  # a property or a field, which must not hide one another

        @property
        def name(self) -> str:
            """Unique among the places."""

    @property
    def description(self) -> str:
        """The feature and its place in words."""
        return f"{self.title} {self.name}"

    @property
    def is_common(self) -> bool:
        """Whether it counts as no feature: what all places have in common, or is beside them."""
        return False

    @property
    def coordinates(self) -> Point | None:
        return None

    @property
    def direction(self) -> Point | None:
        """(x, y, z) of its motion, where it is known."""
        return None


Feature = TypeVar("Feature", bound=FeaturePlace)
# Names of parameters and n → draws (n, d) of these, in standard-normal coordinates.
Draws = Callable[[Sequence[str], int], FloatArray]


BASIS_DRAWS = 200  # draws whose modes make the bases of reduced structures
# Sampling takes as long as screening five hypotheses; with more, errors of a tenth of a nat, which
# are independent, change sums little.
MOST_SAMPLED = 12
# Baselines included, where each takes some 20 full solutions of a finite-element model.
MOST_WITH_FULL_SOLUTIONS = 6


class Key(NamedTuple, Generic[Feature]):
    """What a hypothesis claims: the name of its baseline, and the features added to it."""

    baseline: str
    features: tuple[Feature, ...]


class Hypothesis(NamedTuple, Generic[Feature]):
    key: Key[Feature]
    model_class: ModelClass
    prior_weight: float
    screened: Screened

    @property
    def approximate_log_mass(self) -> Estimate:
        """Log of prior weight times approximate evidence."""
        weight = math.log(self.prior_weight)
        return Estimate(weight + self.screened.log_evidence, self.screened.error)

    def log_mass(self, posterior: Posterior | None) -> float:
        """Log of prior weight times evidence, that of sampling if there is a posterior."""
        evidence = self.screened if posterior is None else posterior.evidence
        return math.log(self.prior_weight) + evidence.log_evidence


@dataclass(frozen=True, kw_only=True)
class SearchLimits:
    """How far a search goes.

    Attributes:
        number_weights: prior weights of no feature, such as an appendage, of one, of two, ...; the
            weight of a number is shared evenly by all ways to choose that many (half of it by
            motions that the model lacks, beside appendages). Its length limits the search.
        branches: number of best hypotheses that are extended by one more feature.
        most_unsampled: as many hypotheses are sampled as it takes until sampling the others, whose
            evidences are approximations, would change no probability by more than this. All are
            where it is zero.
        most_sampled: largest number of hypotheses that are sampled, the most probable ones, each
            with a probability above ``most_unsampled``; if None, twelve, or all where
            ``most_unsampled`` is zero; but six of finite-element models in a reduced basis, each of
            which takes some 20 full solutions of every test.

    Raises:
        ValueError: there are fewer than two weights, one is not positive, there is no branch, none
            is to be sampled, or ``most_unsampled`` is not a probability.
    """

    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2
    most_unsampled: float = 0.01
    most_sampled: int | None = None

    def __post_init__(self) -> None:
        name = type(self).__name__
        weights = tuple(self.number_weights)
        object.__setattr__(self, "number_weights", weights)
        if len(weights) < 2 or not all(0.0 < weight < math.inf for weight in weights):
            raise ValueError(
                f"{name}: number_weights must be two or more positive numbers, got {weights!r}"
            )
        if self.branches < 1:
            raise ValueError(f"{name}: branches must be at least 1, got {self.branches!r}")
        if not 0.0 <= self.most_unsampled < 1.0:
            raise ValueError(
                f"{name}: most_unsampled must be at least 0 and below 1, got "
                f"{self.most_unsampled!r}"
            )
        if self.most_sampled is not None and self.most_sampled < 1:
            raise ValueError(f"{name}: most_sampled must be at least 1, got {self.most_sampled!r}")

    def _require_priors(self, *names: str, optional: Sequence[str] = ()) -> None:
        for name in names:
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name in optional and prior is None):
                raise TypeError(f"{type(self).__name__}: {name} must be a prior, got {prior!r}")


@dataclass(frozen=True, eq=False)
class Family(ABC, Generic[Feature]):
    """Hypotheses that add some of several features to one of several baselines."""

    nothing: ClassVar[str]  # name of a hypothesis without any feature

    study: Study  # the baselines, with their prior weights
    features: Mapping[str, tuple[Feature, ...]]  # name of a baseline → what may be added to it
    options: SearchLimits

    @property
    def most_sampled(self) -> int | None:
        most = self.options.most_sampled
        if most is None and any(map(is_approximate, self.classes)):
            return MOST_WITH_FULL_SOLUTIONS
        if most is None and self.options.most_unsampled > 0.0:
            return MOST_SAMPLED
        return most

    @property
    @abstractmethod
    def title(self) -> str:
        """Of the search."""

    def name_of(self, features: Sequence[Any]) -> str:
        """What a hypothesis with these features is called, where there is one baseline."""
        return " + ".join(feature.name for feature in features) or self.nothing

    @abstractmethod
    def hypothesis(
        self, baseline: ModelClass, features: Sequence[Feature], name: str
    ) -> ModelClass:
        """A baseline, or an approximation of it, with features added."""

    @abstractmethod
    def quantities(
        self, baseline: str, feature: Feature, column: Callable[[str], FloatArray]
    ) -> Mapping[str, FloatArray]:
        """How much there is of a feature, (n,) of each quantity, from draws of parameters."""

    def places(self, baseline: str) -> Iterable[SinglePlace]:  # noqa: ARG002 - for subclasses
        """Where on the structures of a baseline features put elements."""
        return ()

    @property
    def classes(self) -> tuple[ModelClass, ...]:
        return tuple(self.study.model_classes)

    def __getitem__(self, name: str) -> ModelClass:
        return next(each for each in self.classes if each.name == name)

    def full_name(self, key: Key[Feature]) -> str:
        name = self.name_of(key.features)
        return name if len(self.classes) == 1 else f"{key.baseline}: {name}"

    def in_reduced_bases(self) -> Self:
        """The same hypotheses, on structures that are quickly solved as often as they take."""
        quick = [each.with_structures(lambda s, _: s.for_many_hypotheses) for each in self.classes]
        return replace(self, study=replace(self.study, model_classes=quick))

    def prior_weight(self, baseline: str, number: int, n_common: int) -> float:
        """That of a hypothesis with a number of features, some of which are common ones."""
        weights = self.study.prior_weights or dict.fromkeys(self.study.names, 1.0)
        share = self.options.number_weights[number] / self.n_ways(baseline, number, n_common)
        return weights[baseline] / sum(weights.values()) * share

    def n_ways(self, baseline: str, number: int, n_common: int) -> float:  # noqa: ARG002
        """Equally probable ones to choose that many features, which share a weight."""
        return math.comb(len(self.features[baseline]), number)

    def projected(self, baseline: str, draws: Draws) -> ModelClass:
        """A baseline with its reduced structures in a small basis for draws, not certified."""
        places = dict.fromkeys(self.places(baseline))
        return _with_reduced(self[baseline], draws, lambda s, values: s.projected(values, places))

    def accurate(self, best: Hypothesis[Feature]) -> ModelClass:
        """A baseline with reduced structures accurate where its best hypothesis lies.

        All hypotheses on it share this basis, to which an element adds what its force needs.
        """
        chosen = self[best.key.baseline]
        if not is_approximate(chosen):
            return chosen
        draws = best.screened.posterior_draws(chosen.parameter_names, BASIS_DRAWS)
        return more_accurate(chosen, chosen.values(draws), RefinementSettings())

    def to_sample(self, accurate: ModelClass, hypothesis: Hypothesis[Feature]) -> ModelClass:
        """A hypothesis on an accurate baseline, in a basis compact where its posterior lies."""
        compact_one = compact(accurate, hypothesis.screened.draws)
        name = hypothesis.model_class.name
        return self.hypothesis(compact_one, hypothesis.key.features, name)


def prior_draws(names: Sequence[str], n: int) -> FloatArray:
    """Draws (n, d) of the prior, in standard-normal coordinates."""
    return np.random.default_rng(0).standard_normal((n, len(names)))


def compact(baseline: ModelClass, draws: Draws) -> ModelClass:
    """A baseline with its reduced structures in a small basis for draws, their error certified."""
    return _with_reduced(baseline, draws, lambda s, values: s.compact(values))


def _with_reduced(
    baseline: ModelClass, draws: Draws, change: Callable[[Structure, FloatArray], Structure]
) -> ModelClass:
    if not is_approximate(baseline):
        return baseline
    z = draws(baseline.parameter_names, BASIS_DRAWS)
    columns = [own for _, _, own in baseline.parts(baseline.values(z))]
    return baseline.with_structures(
        lambda structure, i: change(structure, columns[i][:, : len(structure.parameters)])
    )
