"""What a search for appendages found: places, appendages and averaged parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from bayes_ssi.appendages.hypotheses import (
    Place,
    SearchSettings,
    frequency_name,
    mass_name,
)
from bayes_ssi.codec import to_record
from bayes_ssi.ranking.averages import AveragedParameter, averaged_parameters
from bayes_ssi.ranking.study import Ranking

__all__ = ["AppendageSearch", "AppendageSummary", "AveragedBesideNaive", "search_record"]


@dataclass(frozen=True)
class AppendageSummary:
    """One appendage of one hypothesis, with medians and 90 % intervals.

    Attributes:
        place: where it hangs.
        mass: of what vibrates, in the structure's unit.
        mass_ratio: the same over the mean floor mass.
        frequency_hz: natural frequency on fixed floors.
    """

    place: Place
    mass: tuple[float, float, float]
    mass_ratio: tuple[float, float, float]
    frequency_hz: tuple[float, float, float]


@dataclass(frozen=True)
class AveragedBesideNaive(AveragedParameter):
    """A parameter of the baseline, averaged over all hypotheses by their probability.

    Attributes:
        naive_mean, naive_sd: if no appendage is thought of.
    """

    naive_mean: float
    naive_sd: float


@dataclass(frozen=True, eq=False)
class AppendageSearch:
    """What a search found.

    Attributes:
        ranking: of all hypotheses that were sampled.
        places: hypothesis → the places of its appendages.
        candidates: all places that were considered.
        mass_scale: the mean floor mass, in the structure's unit.
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
    """

    ranking: Ranking
    places: Mapping[str, tuple[Place, ...]]
    candidates: tuple[Place, ...]
    mass_scale: float
    baseline: str
    search_settings: SearchSettings

    @property
    def probability_of_any(self) -> float:
        """That there is at least one appendage."""
        return sum(
            row.probability for row in self.ranking.comparison.classes if self.places[row.name]
        )

    @property
    def place_probabilities(self) -> dict[Place, float]:
        """Every candidate place → the probability that an appendage hangs there."""
        found = dict.fromkeys(self.candidates, 0.0)
        for row in self.ranking.comparison.classes:
            for place in set(self.places[row.name]):
                found[place] += row.probability
        return found

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
    def averaged_parameters(self) -> tuple[AveragedBesideNaive, ...]:
        """The baseline's parameters averaged over the hypotheses, beside the naive fit."""
        naive = next(p for p in self.ranking.posteriors if not self.places[p.name])
        averaged = averaged_parameters(self.ranking.posteriors, self.ranking.comparison)
        by_name = {row.name: row for row in averaged}
        return tuple(
            AveragedBesideNaive(
                **asdict(by_name[name]),
                naive_mean=float(naive.values[:, i].mean()),
                naive_sd=float(naive.values[:, i].std()),
            )
            for i, name in enumerate(naive.parameter_names)
        )


def search_record(found: AppendageSearch) -> dict[str, Any]:
    """What a search found, for a JSON record."""
    return {
        "baseline": found.baseline,
        "search_settings": to_record(found.search_settings),
        "mass_scale": found.mass_scale,
        "probability_of_any": found.probability_of_any,
        "places": [
            {"kind": place.kind, "floors": list(place.floors), "probability": probability}
            for place, probability in found.place_probabilities.items()
        ],
        "hypotheses": [
            {
                "name": row.name,
                "probability": row.probability,
                "appendages": [asdict(each) for each in found.appendages(row.name)],
            }
            for row in found.ranking.comparison.classes
        ],
        "averaged_parameters": [asdict(row) for row in found.averaged_parameters],
    }
