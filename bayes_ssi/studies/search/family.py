"""A family of hypotheses: features that a search adds to the model classes it begins from."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.required_accuracy import (
    RefinementSettings,
    is_approximate,
    more_accurate,
)
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.structures.geometry import SinglePlace
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import Screened
from bayes_ssi.studies.search.efforts import EFFORTS

Feature = TypeVar("Feature", bound=Hashable)
# Names of parameters and n → draws (n, d) of these, in standard-normal coordinates.
Draws = Callable[[Sequence[str], int], FloatArray]


class Key(NamedTuple, Generic[Feature]):
    """What a hypothesis claims: the name of its baseline, and the features added to it."""

    baseline: str
    features: tuple[Feature, ...]


class Hypothesis(NamedTuple, Generic[Feature]):
    """A hypothesis: its claim, its model class, its prior weight, and its approximate evidence."""

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


class Limits(NamedTuple):
    """How far a search goes."""

    # Prior weights of no feature, of one, of two, ...; the weight of a number is shared by all ways
    # to choose that many.
    number_weights: Sequence[float]
    branches: int  # number of best hypotheses that are extended by one more feature
    most_unsampled: float  # most that sampling the others might change of any probability
    most_sampled: int | None  # number of hypotheses; None if there is no limit


@dataclass(frozen=True, eq=False)
class Family(ABC, Generic[Feature]):
    """Hypotheses that add some of several features to one of several baselines."""

    study: Study  # the baselines, with their prior weights
    features: Mapping[str, tuple[Feature, ...]]  # name of a baseline → what may be added to it

    @property
    @abstractmethod
    def limits(self) -> Limits:
        """How far its search goes."""

    @abstractmethod
    def name_of(self, features: Sequence[Feature]) -> str:
        """What a hypothesis with these features is called, where there is one baseline."""

    @abstractmethod
    def hypothesis(
        self, baseline: ModelClass, features: Sequence[Feature], name: str
    ) -> ModelClass:
        """A baseline, or an approximation of it, with features added."""

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

    def prior_weight(self, baseline: str, number: int) -> float:
        """That of a hypothesis with a number of features."""
        weights = self.study.prior_weights or dict.fromkeys(self.study.names, 1.0)
        share = self.limits.number_weights[number]
        share /= math.comb(len(self.features[baseline]), number)
        return weights[baseline] / sum(weights.values()) * share

    def projected(self, baseline: str, draws: Draws) -> ModelClass:
        """A baseline with its reduced structures in a small basis for draws, not certified.

        Others, and those that carry elements already, are as they are.
        """
        places = dict.fromkeys(self.places(baseline))
        return _with_reduced(self[baseline], draws, lambda s, values: s.projected(values, places))

    def accurate(self, baseline: str, draws: Draws) -> ModelClass:
        """A baseline with reduced structures as accurate at draws as sampling requires.

        All hypotheses on it share this basis, to which an element adds what its force needs.
        """
        chosen = self[baseline]
        if not is_approximate(chosen):
            return chosen
        values = chosen.values(draws(chosen.parameter_names, EFFORTS.basis_draws))
        return more_accurate(chosen, values, RefinementSettings())


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
    z = draws(baseline.parameter_names, EFFORTS.basis_draws)
    columns = [own for _, _, own in baseline.parts(baseline.values(z))]
    return baseline.with_structures(
        lambda structure, i: change(structure, columns[i][:, : len(structure.parameters)])
    )
