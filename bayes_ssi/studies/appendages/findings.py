"""What the screened and the sampled hypotheses of a search say together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict

from scipy.special import expit, logsumexp

from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.studies.appendages.baselines import Baselines
from bayes_ssi.studies.appendages.hypotheses import SearchSettings
from bayes_ssi.studies.appendages.next_level import NextLevel
from bayes_ssi.studies.appendages.place_findings import (
    AppendageDraws,
    appendage_draws,
    place_records,
)
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.sampling_choice import most_probability_unsampled
from bayes_ssi.studies.appendages.screened_hypothesis import ScreenedHypothesis
from bayes_ssi.studies.appendages.screening import Screened
from bayes_ssi.studies.appendages.search_result import (
    AveragedAndNaive,
    BaselineRecord,
    HypothesisRecord,
    SearchRecord,
)
from bayes_ssi.studies.ranking.averages import averaged_parameter
from bayes_ssi.studies.ranking.study import Ranking


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
