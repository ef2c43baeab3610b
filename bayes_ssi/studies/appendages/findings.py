"""What the screened and the sampled hypotheses of a search say together."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict

import numpy as np
from scipy.special import expit, logsumexp

from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.appendages.baselines import Baselines
from bayes_ssi.studies.appendages.hypotheses import SearchSettings, frequency_name, mass_name
from bayes_ssi.studies.appendages.matched_appendages import AppendageDraws, matched_appendages
from bayes_ssi.studies.appendages.next_level import NextLevel
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.sampling_choice import most_probability_unsampled
from bayes_ssi.studies.appendages.screening import Screened, ScreenedHypothesis
from bayes_ssi.studies.appendages.search_result import (
    AveragedAndNaive,
    BaselineRecord,
    HypothesisRecord,
    PlaceRecord,
    SearchRecord,
)
from bayes_ssi.studies.ranking.averages import averaged_parameter
from bayes_ssi.studies.ranking.study import Ranking


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


def search_record(
    baselines: Baselines,
    rivals: Sequence[Screened],
    search_settings: SearchSettings,
    ranking: Ranking,
    hypotheses: Sequence[ScreenedHypothesis],
    levels: Sequence[NextLevel],
) -> SearchRecord:
    """The record of a search."""
    posteriors = {posterior.name: posterior for posterior in ranking.posteriors}
    draws = {
        each.model_class.name: {
            place: appendage_draws(
                each,
                posteriors.get(each.model_class.name),
                place,
                baselines.scales[each.key.baseline].mass,
            )
            for place in each.key.places
        }
        for each in hypotheses
    }
    rows = _hypothesis_records(hypotheses, posteriors, draws)
    approximate = {each.key: each.approximate_log_mass for each in hypotheses}
    sampled = {
        each.key: each.log_mass(posteriors[each.model_class.name])
        for each in hypotheses
        if each.model_class.name in posteriors
    }
    not_tried = float(logsumexp([level.log_mass_not_tried for level in levels]))
    known = {key: each.log_evidence for key, each in approximate.items()} | sampled
    tried = float(logsumexp(list(known.values())))
    return SearchRecord(
        baselines=(*_searched(baselines, rows), *_compared(baselines, rivals)),
        left_out=dict(baselines.left_out),
        present_in=baselines.present_in,
        search_settings=search_settings,
        probability_of_any=sum(each.probability for each in rows if each.appendages),
        most_probability_unsampled=most_probability_unsampled(approximate, sampled),
        places=place_records(
            draws, {row.name: row.probability for row in rows}, baselines.unobserved
        ),
        geometry=baselines.geometry,
        hypotheses=rows,
        averaged_parameters=tuple(_averaged(ranking, hypotheses)),
        matched=matched_appendages(draws, rows, baselines, hypotheses, search_settings),
        n_not_tried=sum(level.n_not_tried for level in levels),
        expected_not_tried=float(expit(not_tried - tried)),
    )


def _hypothesis_records(
    hypotheses: Sequence[ScreenedHypothesis],
    posteriors: Mapping[str, Posterior],
    draws: Mapping[str, Mapping[AppendagePlace, AppendageDraws]],
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
                baseline=each.key.baseline,
                prior_probability=each.prior_weight / total_weight,
                probability=math.exp(log_mass - log_total),
                log_evidence=evidence.log_evidence,
                error=evidence.error,
                is_sampled=posterior is not None,
                screened=screened.log_evidence,
                laplace=screened.laplace,
                appendages=tuple(own.summary(place) for place, own in draws[name].items()),
            )
        )
    return tuple(rows)


def _searched(baselines: Baselines, rows: Sequence[HypothesisRecord]) -> list[BaselineRecord]:
    """The baselines that appendages were hung on, the most probable first."""
    records = []
    for each in baselines.classes:
        own = [row for row in rows if row.baseline == each.name]
        (without,) = [row for row in own if not row.appendages]
        records.append(
            BaselineRecord(
                name=each.name,
                classes=baselines.original_names(each.name),
                log_evidence=without.log_evidence,
                prior_probability=sum(row.prior_probability for row in own),
                probability=sum(row.probability for row in own),
                mass_scale=baselines.scales[each.name],
            )
        )
    return sorted(records, key=lambda record: -record.probability)


def _compared(baselines: Baselines, screened: Sequence[Screened]) -> Iterator[BaselineRecord]:
    """The classes on which no appendage was tried."""
    for each, result in zip(baselines.rivals, screened, strict=True):
        yield BaselineRecord(each.name, (), result.log_evidence, 0.0, 0.0, None)


def _averaged(
    ranking: Ranking, hypotheses: Sequence[ScreenedHypothesis]
) -> Iterator[AveragedAndNaive]:
    """The baselines' parameters averaged over the hypotheses, and without appendages."""
    without = {each.model_class.name for each in hypotheses if not each.key.places}
    by_name = {posterior.name: posterior for posterior in ranking.posteriors}
    ranked = [(by_name[row.name], row.probability) for row in ranking.comparison.classes]
    naive = [posterior for posterior, _ in ranked if posterior.name in without]
    for name in dict.fromkeys(name for each in naive for name in each.parameter_names):
        own = [each for each in ranked if name in each[0].parameter_names]
        if not any(probability > 0.0 for _, probability in own):
            continue
        averaged = averaged_parameter(name, *map(list, zip(*own, strict=True)))
        first = next(each for each in naive if name in each.parameter_names)
        values = first.values[:, first.parameter_names.index(name)]
        yield AveragedAndNaive(
            **asdict(averaged),
            naive_mean=float(values.mean()),
            naive_sd=float(values.std()),
        )
