"""The findings of a search: places, appendages and averaged parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.appendages.hypotheses import (
    NO_APPENDAGE,
    SearchSettings,
    frequency_name,
    mass_name,
    mean_mass,
    structure_with_floors,
)
from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.appendages.sampling_choice import most_probability_unsampled
from bayes_ssi.appendages.screening import Screened
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.averages import AveragedParameter, averaged_parameters
from bayes_ssi.ranking.study import Ranking
from bayes_ssi.sampling.estimates import Estimate


@dataclass(frozen=True)
class AppendageSummary:
    """One appendage of one hypothesis: 5, 50 and 95 % quantiles.

    Attributes:
        place: where it hangs.
        mass: the vibrating mass, in the structure's unit.
        mass_ratio: the vibrating mass over the mean floor mass.
        frequency_hz: natural frequency on fixed floors.
    """

    place: AppendagePlace
    mass: tuple[float, float, float]
    mass_ratio: tuple[float, float, float]
    frequency_hz: tuple[float, float, float]


@dataclass(frozen=True)
class AveragedAndNaive(AveragedParameter):
    """A parameter of the baseline, averaged over all hypotheses by their probability.

    Attributes:
        naive_mean, naive_sd: under the hypothesis of no appendage.
    """

    naive_mean: float
    naive_sd: float


@dataclass(frozen=True)
class PlaceProbability:
    """A place, and the probability that an appendage hangs there."""

    place: AppendagePlace
    probability: float


@dataclass(frozen=True)
class HypothesisRecord:
    """One hypothesis of a search.

    Attributes:
        name: name of its model class.
        prior_probability: among all hypotheses, and ``probability`` likewise.
        log_evidence: in nats, with its standard ``error``; approximate where it is not sampled.
        is_sampled: whether it was sampled, and has draws.
        laplace: Laplace's approximation of the log evidence.
        appendages: its appendages.
    """

    name: str
    prior_probability: float
    probability: float
    log_evidence: float
    error: float
    is_sampled: bool
    laplace: float
    appendages: tuple[AppendageSummary, ...]


@dataclass(frozen=True)
class SearchRecord:
    """The findings of a search, stored in addition to its ranking.

    Attributes:
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
        mass_scale: the mean floor mass, in the structure's unit.
        probability_of_any: probability that there is at least one appendage.
        most_probability_unsampled: an upper bound on the probability of all hypotheses together
            whose evidences are approximate.
        places: all places that were considered.
        hypotheses: the most probable first.
        averaged_parameters: averaged parameters of the baseline.
    """

    baseline: str
    search_settings: SearchSettings
    mass_scale: float
    probability_of_any: float
    most_probability_unsampled: float
    places: tuple[PlaceProbability, ...]
    hypotheses: tuple[HypothesisRecord, ...]
    averaged_parameters: tuple[AveragedAndNaive, ...]

    @property
    def place_probabilities(self) -> dict[AppendagePlace, float]:
        """Every place → the probability that an appendage hangs there."""
        return {each.place: each.probability for each in self.places}

    @property
    def n_unsampled(self) -> int:
        """The number of hypotheses whose evidences are approximate."""
        return sum(not each.is_sampled for each in self.hypotheses)

    def hypothesis(self, name: str) -> HypothesisRecord:
        """The hypothesis of that name; KeyError if there is none."""
        return {each.name: each for each in self.hypotheses}[name]

    @property
    def most_probable_with_appendages(self) -> HypothesisRecord:
        """The most probable hypothesis that has an appendage."""
        return next(each for each in self.hypotheses if each.appendages)


@dataclass(frozen=True, eq=False)
class AppendageSearch:
    """The result of a search.

    Attributes:
        ranking: ranking of the hypotheses that were sampled; probabilities are among these.
        record: where appendages are, and their properties.
    """

    ranking: Ranking
    record: SearchRecord

    def appendages(self, name: str) -> tuple[AppendageSummary, ...]:
        """The appendages of one hypothesis."""
        return self.record.hypothesis(name).appendages


class Hypothesis(NamedTuple):
    """A screened hypothesis: the places of its appendages, its class and its prior weight."""

    places: tuple[AppendagePlace, ...]
    model_class: ModelClass
    prior_weight: float
    screened: Screened

    @property
    def approximate_log_mass(self) -> Estimate:
        """Log of prior weight times approximate evidence."""
        weight = math.log(self.prior_weight)
        return Estimate(weight + self.screened.log_evidence, self.screened.error)

    def log_mass(self, posterior: Posterior) -> float:
        """Log of prior weight times the evidence that sampling gave."""
        return math.log(self.prior_weight) + posterior.evidence.log_evidence


def search_record(
    baseline: ModelClass,
    search_settings: SearchSettings,
    ranking: Ranking,
    hypotheses: Sequence[Hypothesis],
    candidates: Sequence[AppendagePlace],
) -> SearchRecord:
    """The record of a search.

    Args:
        baseline: the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
        ranking: ranking of those hypotheses that were sampled.
        hypotheses: all of them.
        candidates: all places that were considered.
    """
    mass_scale = mean_mass(structure_with_floors(baseline))
    posteriors = {posterior.name: posterior for posterior in ranking.posteriors}
    rows = _hypothesis_records(hypotheses, posteriors, mass_scale)
    approximate = {each.model_class.name: each.approximate_log_mass for each in hypotheses}
    sampled = {
        each.model_class.name: each.log_mass(posteriors[each.model_class.name])
        for each in hypotheses
        if each.model_class.name in posteriors
    }
    probabilities = dict.fromkeys(candidates, 0.0)
    for row in rows:
        for appendage in row.appendages:
            probabilities[appendage.place] += row.probability
    return SearchRecord(
        baseline=baseline.name,
        search_settings=search_settings,
        mass_scale=mass_scale,
        probability_of_any=sum(each.probability for each in rows if each.appendages),
        most_probability_unsampled=most_probability_unsampled(approximate, sampled),
        places=tuple(PlaceProbability(*each) for each in probabilities.items()),
        hypotheses=rows,
        averaged_parameters=_averaged(ranking, posteriors[NO_APPENDAGE]),
    )


def _hypothesis_records(
    hypotheses: Sequence[Hypothesis], posteriors: Mapping[str, Posterior], mass_scale: float
) -> tuple[HypothesisRecord, ...]:
    """The most probable first."""
    total_weight = sum(each.prior_weight for each in hypotheses)
    log_masses = [
        each.log_mass(posteriors[each.model_class.name])
        if each.model_class.name in posteriors
        else each.approximate_log_mass.log_evidence
        for each in hypotheses
    ]
    log_total = float(logsumexp(log_masses))
    rows = []
    # By the logarithm, which also ranks hypotheses whose probabilities are rounded to zero.
    for log_mass, each in sorted(
        zip(log_masses, hypotheses, strict=True), key=lambda item: -item[0]
    ):
        name, screened = each.model_class.name, each.screened
        posterior = posteriors.get(name)
        evidence = screened if posterior is None else posterior.evidence
        rows.append(
            HypothesisRecord(
                name=name,
                prior_probability=each.prior_weight / total_weight,
                probability=math.exp(log_mass - log_total),
                log_evidence=evidence.log_evidence,
                error=evidence.error,
                is_sampled=posterior is not None,
                laplace=screened.laplace,
                appendages=tuple(
                    _summary(each, posterior, place, mass_scale) for place in each.places
                ),
            )
        )
    return tuple(rows)


def _summary(
    hypothesis: Hypothesis, posterior: Posterior | None, place: AppendagePlace, mass_scale: float
) -> AppendageSummary:
    if posterior is None:
        values = hypothesis.model_class.values(hypothesis.screened.z)
        weights = hypothesis.screened.weights
    else:
        values = posterior.values
        weights = np.full(len(values), 1.0 / len(values))

    def quantiles(parameter: str, scale: float) -> tuple[float, float, float]:
        column = scale * values[:, hypothesis.model_class.parameter_names.index(parameter)]
        low, middle, high = np.quantile(
            column, [0.05, 0.5, 0.95], weights=weights, method="inverted_cdf"
        )
        return float(low), float(middle), float(high)

    return AppendageSummary(
        place,
        quantiles(mass_name(place), mass_scale),
        quantiles(mass_name(place), 1.0),
        quantiles(frequency_name(place), 1.0),
    )


def _averaged(ranking: Ranking, naive: Posterior) -> tuple[AveragedAndNaive, ...]:
    """The baseline's parameters averaged over the hypotheses, and without appendages."""
    averaged = averaged_parameters(ranking.posteriors, ranking.comparison)
    by_name = {row.name: row for row in averaged}
    return tuple(
        AveragedAndNaive(
            **asdict(by_name[name]),
            naive_mean=float(naive.values[:, i].mean()),
            naive_sd=float(naive.values[:, i].std()),
        )
        for i, name in enumerate(naive.parameter_names)
    )
