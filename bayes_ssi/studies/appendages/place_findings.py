"""What all hypotheses of a search together say about each place."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.appendages.hypotheses import frequency_name, mass_name
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.screened_hypothesis import ScreenedHypothesis
from bayes_ssi.studies.appendages.search_result import AppendageSummary, PlaceRecord


class AppendageDraws(NamedTuple):
    """Posterior draws of one appendage, (n,) each.

    Attributes:
        mass: vibrating mass, in the structure's unit.
    """

    mass_ratio: FloatArray
    mass: FloatArray
    frequency_hz: FloatArray
    weights: FloatArray

    def summary(self, place: AppendagePlace) -> AppendageSummary:
        """The quantiles at 5, 50 and 95 %."""

        def quantiles(values: FloatArray) -> tuple[float, float, float]:
            low, middle, high = np.quantile(
                values, [0.05, 0.5, 0.95], weights=self.weights, method="inverted_cdf"
            )
            return float(low), float(middle), float(high)

        numbers = (self.mass, self.mass_ratio, self.frequency_hz)
        return AppendageSummary(place, *map(quantiles, numbers))


def appendage_draws(
    hypothesis: ScreenedHypothesis,
    posterior: Posterior | None,
    place: AppendagePlace,
    mass_scale: float,
) -> AppendageDraws:
    """The draws of one appendage of a hypothesis, those of screening where it was not sampled."""
    if posterior is None:
        names = hypothesis.model_class.parameter_names
        values = hypothesis.model_class.values(hypothesis.screened.z)
        weights = hypothesis.screened.weights
    else:
        names, values = posterior.parameter_names, posterior.values
        weights = np.full(len(values), 1.0 / len(values))
    ratio = values[:, names.index(mass_name(place))]
    frequency = values[:, names.index(frequency_name(place))]
    return AppendageDraws(ratio, mass_scale * ratio, frequency, weights)


def place_records(
    draws: Mapping[str, Mapping[AppendagePlace, AppendageDraws]],
    probabilities: Mapping[str, float],
    unobserved: Collection[AppendagePlace],
) -> tuple[PlaceRecord, ...]:
    """Every place: the probability of an appendage there, and its mass and frequency if so."""
    at_place: dict[AppendagePlace, list[tuple[float, AppendageDraws]]] = {}
    for name, appendages in draws.items():
        for place, of_one in appendages.items():
            at_place.setdefault(place, []).append((probabilities[name], of_one))
    return tuple(
        _place_record(place, with_one, place not in unobserved)
        for place, with_one in at_place.items()
    )


def _place_record(
    place: AppendagePlace, with_one: Sequence[tuple[float, AppendageDraws]], is_observed: bool
) -> PlaceRecord:
    """One place, given the probabilities and draws of the hypotheses with an appendage there."""
    probability = sum(own for own, _ in with_one)
    if probability == 0.0:  # too small for a floating-point number
        with_one = [(1.0, each) for _, each in with_one]
    total = sum(own for own, _ in with_one)
    weighted = [each._replace(weights=own / total * each.weights) for own, each in with_one]
    mixed = AppendageDraws(*map(np.concatenate, zip(*weighted, strict=True)))
    return PlaceRecord(mixed.summary(place), probability, is_observed)
