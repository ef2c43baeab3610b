"""The findings of a search: places, appendages and averaged parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from bayes_ssi.appendages.hypotheses import (
    NO_APPENDAGE,
    SearchSettings,
    frequency_name,
    mass_name,
    mean_mass,
    structure_with_floors,
)
from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.averages import AveragedParameter, averaged_parameters
from bayes_ssi.ranking.study import Ranking


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
    """One hypothesis of a search: its probability and its appendages."""

    name: str
    probability: float
    appendages: tuple[AppendageSummary, ...]


@dataclass(frozen=True)
class SearchRecord:
    """The findings of a search, stored in addition to its ranking.

    Attributes:
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
        mass_scale: the mean floor mass, in the structure's unit.
        probability_of_any: probability that there is at least one appendage.
        places: all places that were considered.
        hypotheses: the most probable first.
        averaged_parameters: averaged parameters of the baseline.
    """

    baseline: str
    search_settings: SearchSettings
    mass_scale: float
    probability_of_any: float
    places: tuple[PlaceProbability, ...]
    hypotheses: tuple[HypothesisRecord, ...]
    averaged_parameters: tuple[AveragedAndNaive, ...]

    @property
    def place_probabilities(self) -> dict[AppendagePlace, float]:
        """Every place → the probability that an appendage hangs there."""
        return {each.place: each.probability for each in self.places}

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
        ranking: ranking of all hypotheses that were sampled.
        record: where appendages are, and their properties.
    """

    ranking: Ranking
    record: SearchRecord

    def appendages(self, name: str) -> tuple[AppendageSummary, ...]:
        """The appendages of one hypothesis."""
        return self.record.hypothesis(name).appendages


def search_record(
    baseline: ModelClass,
    search_settings: SearchSettings,
    ranking: Ranking,
    places: Mapping[str, Sequence[AppendagePlace]],
    candidates: Sequence[AppendagePlace],
) -> SearchRecord:
    """The record of a search.

    Args:
        baseline: the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
        ranking: ranking of the hypotheses.
        places: hypothesis → the places of its appendages.
        candidates: all places that were considered.
    """
    mass_scale = mean_mass(structure_with_floors(baseline))
    posteriors = {posterior.name: posterior for posterior in ranking.posteriors}
    probabilities = dict.fromkeys(candidates, 0.0)
    hypotheses = []
    for row in ranking.comparison.classes:
        for place in places[row.name]:
            probabilities[place] += row.probability
        appendages = (_summary(posteriors[row.name], p, mass_scale) for p in places[row.name])
        hypotheses.append(HypothesisRecord(row.name, row.probability, tuple(appendages)))
    return SearchRecord(
        baseline=baseline.name,
        search_settings=search_settings,
        mass_scale=mass_scale,
        probability_of_any=sum(each.probability for each in hypotheses if each.appendages),
        places=tuple(PlaceProbability(*each) for each in probabilities.items()),
        hypotheses=tuple(hypotheses),
        averaged_parameters=_averaged(ranking, posteriors[NO_APPENDAGE]),
    )


def _summary(posterior: Posterior, place: AppendagePlace, mass_scale: float) -> AppendageSummary:
    def quantiles(parameter: str, scale: float) -> tuple[float, float, float]:
        values = scale * posterior.values[:, posterior.parameter_names.index(parameter)]
        low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
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
