"""Appendages matched across hypotheses by what they explain, which is their frequency.

Hypotheses with equally many appendages at different places share what these do to the modes. Draw
by draw, the appendage of the lowest frequency is the first: places may change hands, even between
the draws of one hypothesis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.studies.appendages.baselines import Baselines
from bayes_ssi.studies.appendages.candidates import VISIBLE
from bayes_ssi.studies.appendages.hypotheses import SearchSettings, tests_with_appendages
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.screening import ScreenedHypothesis
from bayes_ssi.studies.appendages.search_result import (
    AppendageSummary,
    HypothesisRecord,
    MatchedAppendage,
    PlaceOfAppendage,
)

# Frequencies with nothing between them over a tenth are two answers, if each has a twentieth of the
# probability.
APART, SHARE_OF_A_GROUP = 1.1, 0.05


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

        numbers = (self.mass, self.mass_ratio, self.frequency_hz)
        return AppendageSummary(
            place, *(weighted_quantiles(each, self.weights) for each in numbers)
        )


class _Motions(NamedTuple):
    """Motions in the modes of a baseline that the sensors see, at unit modal mass.

    Attributes:
        numbers: (m,), of the modes, from 1.
        frequencies_hz: (m,).
        of_places: place → (m,).
        of_sensors: (m,), that of the sensor that moves most.
    """

    numbers: np.ndarray
    frequencies_hz: FloatArray
    of_places: Mapping[AppendagePlace, FloatArray]
    of_sensors: FloatArray


class _One(NamedTuple):
    """Draws of one appendage in one hypothesis: (n,) each, and the places that it has in turn."""

    baseline: str
    places: Sequence[AppendagePlace]
    which: np.ndarray
    mass: FloatArray
    frequency_hz: FloatArray
    weights: FloatArray
    weights_by_data: FloatArray


def matched_appendages(
    draws: Mapping[str, Mapping[AppendagePlace, AppendageDraws]],
    rows: Sequence[HypothesisRecord],
    baselines: Baselines,
    hypotheses: Sequence[ScreenedHypothesis],
    options: SearchSettings,
) -> tuple[MatchedAppendage, ...]:
    """The appendages of the most probable number of them, the lowest frequency first."""
    shares: dict[int, float] = {}
    for row in rows:
        n = len(row.appendages)
        shares[n] = shares.get(n, 0.0) + (row.probability if n else 0.0)
    number = max(shares, key=lambda n: shares[n])
    if not shares[number] > 0.0:
        return ()
    chosen = [row for row in rows if len(row.appendages) == number and row.probability > 0.0]
    priors = {
        name: options.prior_of_mass_ratio(scale.mass) for name, scale in baselines.scales.items()
    }
    split = [
        _by_frequency(row, draws[row.name], row.probability / shares[number], priors[row.baseline])
        for row in chosen
    ]
    by_name = {each.model_class.name: each for each in hypotheses}
    best = {row.baseline: by_name[row.name] for row in reversed(chosen)}
    motions = {name: _motions(baselines, each) for name, each in best.items()}
    return tuple(_matched([each[i] for each in split], motions) for i in range(number))


def _by_frequency(
    row: HypothesisRecord,
    draws: Mapping[AppendagePlace, AppendageDraws],
    share: float,
    prior: Prior,
) -> list[_One]:
    """The draws of every appendage of a hypothesis, by rank of its frequency in each draw."""
    own = list(draws.values())
    ratios = np.stack([each.mass_ratio for each in own])
    # The prior density of the logarithm of a mass, which weighs draws in a uniform one's place.
    densities = ratios * np.exp(prior.log_density(ratios))
    frequencies = np.stack([each.frequency_hz for each in own])
    order = np.argsort(frequencies, axis=0)
    masses = np.take_along_axis(np.stack([each.mass for each in own]), order, axis=0)
    frequencies = np.take_along_axis(frequencies, order, axis=0)
    weights = share * own[0].weights
    return [
        _One(row.baseline, tuple(draws), which, mass, hz, weights, _divided(weights, density))
        for which, mass, hz, density in zip(
            order, masses, frequencies, np.take_along_axis(densities, order, axis=0), strict=True
        )
    ]


def _divided(weights: FloatArray, density: FloatArray) -> FloatArray:
    return np.divide(weights, density, out=np.zeros_like(weights), where=density > 0.0)


def _matched(
    of_hypotheses: Sequence[_One], motions: Mapping[str, _Motions | None]
) -> MatchedAppendage:
    groups = _of_one_frequency(of_hypotheses)
    weights = [np.concatenate([each.weights for each in group]) for group in groups]
    frequencies = [
        weighted_quantiles(np.concatenate([each.frequency_hz for each in group]), weight)
        for group, weight in zip(groups, weights, strict=True)
    ]
    shares = [float(weight.sum()) for weight in weights]
    first, *others = sorted(range(len(groups)), key=lambda number: -shares[number])
    group, weight, frequency = groups[first], weights[first], frequencies[first]
    moving = [motions[each.baseline] for each in group]
    nearest = 0
    if moving[0] is not None:
        nearest = int(np.abs(moving[0].frequencies_hz - frequency[1]).argmin())
    ratio, mass = [], []
    for each, motion in zip(group, moving, strict=True):
        if motion is None or nearest >= len(motion.of_sensors):
            break
        at_place = np.array([motion.of_places[place][nearest] for place in each.places])
        ratio.append(each.mass * at_place[each.which] ** 2)
        mass.append(ratio[-1] / motion.of_sensors[nearest] ** 2)
    known = len(ratio) == len(group)
    return MatchedAppendage(
        frequency,
        shares[first],
        tuple((shares[i], frequencies[i]) for i in others),
        weighted_quantiles(np.concatenate(mass), weight) if known else None,
        weighted_quantiles(np.concatenate(ratio), weight) if known else None,
        int(moving[0].numbers[nearest]) if moving[0] is not None else 0,
        _places(group),
    )


def _of_one_frequency(of_hypotheses: Sequence[_One]) -> list[list[_One]]:
    """The draws in groups of frequencies that are apart, each with a share of the probability."""
    hz = np.concatenate([each.frequency_hz for each in of_hypotheses])
    order = np.argsort(hz)
    hz, weights = hz[order], np.concatenate([each.weights for each in of_hypotheses])[order]
    ends, begin = [], 0
    for i in np.flatnonzero(hz[1:] > APART * hz[:-1]).tolist():
        left, right = weights[begin : i + 1].sum(), weights[i + 1 :].sum()
        if min(left, right) >= SHARE_OF_A_GROUP * weights.sum():
            ends.append(float(hz[i]))
            begin = i + 1
    edges = [-np.inf, *ends, np.inf]
    groups = []
    for low, high in pairwise(edges):
        group = []
        for each in of_hypotheses:
            inside = (each.frequency_hz > low) & (each.frequency_hz <= high)
            if inside.any():
                columns = (array[inside] for array in each[2:])
                group.append(_One(each.baseline, each.places, *columns))
        groups.append(group)
    return groups


def _places(of_hypotheses: Sequence[_One]) -> tuple[PlaceOfAppendage, ...]:
    """Where an appendage may be, the most probable place first."""
    parts: dict[AppendagePlace, list[FloatArray]] = {}
    for each in of_hypotheses:
        columns = np.stack([each.mass, each.weights, each.weights_by_data])
        for i, place in enumerate(each.places):
            parts.setdefault(place, []).append(columns[:, each.which == i])
    all_weights = sum(float(each.weights.sum()) for each in of_hypotheses)
    by_data = sum(float(each.weights_by_data.sum()) for each in of_hypotheses)
    places = []
    for place, part in parts.items():
        mass, weights, alone = np.concatenate(part, axis=1)
        if weights.sum() > 0.0:
            share, share_by_data = float(weights.sum()) / all_weights, float(alone.sum()) / by_data
            places.append(
                PlaceOfAppendage(place, share, weighted_quantiles(mass, weights), share_by_data)
            )
    return tuple(sorted(places, key=lambda place: -place.probability))


def _motions(baselines: Baselines, hypothesis: ScreenedHypothesis) -> _Motions | None:
    """Motions at the means of the parameters of the most probable hypothesis on a baseline."""
    key, screened = hypothesis.key, hypothesis.screened
    baseline: ModelClass = baselines[key.baseline]
    values = hypothesis.model_class.values(screened.z)
    means = dict(
        zip(hypothesis.model_class.parameter_names, screened.weights @ values, strict=True)
    )
    test = tests_with_appendages(baseline, baselines.present_in)[0]
    structure = test.structure
    at = np.array([[means[parameter.name] for parameter in structure.parameters]])
    places = baselines.places[key.baseline]
    moved = structure.place_shapes([end for place in places for end in place.candidate.ends], at)
    if moved is None:
        return None
    modes = structure.modes(at)
    at_sensors = structure.sensor_matrix(test.data.sensors).apply(modes.shapes)[0]
    largest = np.abs(at_sensors).max(axis=0, initial=0.0)
    seen = np.flatnonzero(largest >= VISIBLE * largest.max())
    if not len(seen) or not largest.any():
        return None
    of_places, begin = {}, 0
    for place in places:
        n = len(place.candidate.ends)
        # What hangs between two places is driven by the mean of their motions.
        of_places[place] = moved[begin : begin + n, seen].mean(axis=0)
        begin += n
    return _Motions(seen + 1, modes.frequencies_hz[0, seen], of_places, largest[seen])
