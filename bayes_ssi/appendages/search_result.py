"""The result of a search for appendages: places, appendages and averaged parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from bayes_ssi.appendages.hypotheses import SearchSettings, frequency_name, mass_name
from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.ranking.averages import AveragedParameter, averaged_parameters
from bayes_ssi.ranking.study import Ranking

__all__ = [
    "AppendageSearch",
    "AppendageSummary",
    "AveragedAndNaive",
    "HypothesisRecord",
    "PlaceProbability",
    "SearchRecord",
    "search_record",
]


@dataclass(frozen=True)
class AppendageSummary:
    """One appendage of one hypothesis: 5, 50 and 95 % quantiles.

    Attributes:
        place: where it hangs.
        mass: the vibrating mass, in the structure's unit.
        mass_ratio: the same over the mean floor mass.
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
    """What is stored of a search in addition to its ranking.

    Attributes:
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
        mass_scale: the mean floor mass, in the structure's unit.
        probability_of_any: probability that there is at least one appendage.
        places: all that were considered.
        hypotheses: the most probable first.
        averaged_parameters: of the baseline.
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


@dataclass(frozen=True, eq=False)
class AppendageSearch:
    """The result of a search.

    Attributes:
        ranking: of all hypotheses that were sampled.
        places: hypothesis → the places of its appendages.
        candidates: all places that were considered.
        mass_scale: the mean floor mass, in the structure's unit.
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
    """

    ranking: Ranking
    places: Mapping[str, tuple[AppendagePlace, ...]]
    candidates: tuple[AppendagePlace, ...]
    mass_scale: float
    baseline: str
    search_settings: SearchSettings

    @property
    def probability_of_any(self) -> float:
        """Probability that there is at least one appendage."""
        return sum(
            row.probability for row in self.ranking.comparison.classes if self.places[row.name]
        )

    @property
    def place_probabilities(self) -> dict[AppendagePlace, float]:
        """Every candidate place → the probability that an appendage hangs there."""
        probabilities = dict.fromkeys(self.candidates, 0.0)
        for row in self.ranking.comparison.classes:
            for place in set(self.places[row.name]):
                probabilities[place] += row.probability
        return probabilities

    def appendages(self, name: str) -> tuple[AppendageSummary, ...]:
        """The appendages of one hypothesis."""
        posterior = next(p for p in self.ranking.posteriors if p.name == name)
        column = {parameter: i for i, parameter in enumerate(posterior.parameter_names)}

        def quantiles(parameter: str, scale: float) -> tuple[float, float, float]:
            values = scale * posterior.values[:, column[parameter]]
            low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
            return float(low), float(middle), float(high)

        return tuple(
            AppendageSummary(
                place,
                quantiles(mass_name(place), self.mass_scale),
                quantiles(mass_name(place), 1.0),
                quantiles(frequency_name(place), 1.0),
            )
            for place in self.places[name]
        )

    @property
    def averaged_parameters(self) -> tuple[AveragedAndNaive, ...]:
        """The baseline's parameters averaged over the hypotheses, and without appendages."""
        naive = next(p for p in self.ranking.posteriors if not self.places[p.name])
        averaged = averaged_parameters(self.ranking.posteriors, self.ranking.comparison)
        by_name = {row.name: row for row in averaged}
        return tuple(
            AveragedAndNaive(
                **asdict(by_name[name]),
                naive_mean=float(naive.values[:, i].mean()),
                naive_sd=float(naive.values[:, i].std()),
            )
            for i, name in enumerate(naive.parameter_names)
        )


def search_record(result: AppendageSearch) -> SearchRecord:
    """What is stored of a search in addition to its ranking."""
    return SearchRecord(
        result.baseline,
        result.search_settings,
        result.mass_scale,
        result.probability_of_any,
        tuple(PlaceProbability(*each) for each in result.place_probabilities.items()),
        tuple(
            HypothesisRecord(row.name, row.probability, result.appendages(row.name))
            for row in result.ranking.comparison.classes
        ),
        result.averaged_parameters,
    )
