"""What a stored result says under changed settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.posterior.known_modes import known_at_draws
from bayes_ssi.results.load import StoredResult, load_result
from bayes_ssi.results.recorded_classes import recorded_class
from bayes_ssi.studies.ranking.changed_settings import (
    ChangedSettings,
    WhatIf,
    with_changed_settings,
)
from bayes_ssi.studies.ranking.study import Ranking


@checked
def what_if(result: Ranking | StoredResult | str | Path, settings: ChangedSettings) -> WhatIf:
    """The ranking and the parameters of a result under changed settings, in seconds.

    The posterior draws are reweighted: nothing is sampled, no mode is solved for, and a stored
    result needs no study file. Each class has a Pareto k, which says whether its draws cover the
    change; beyond 0.7 nothing is said of the class, which must be sampled again.

    Args:
        result: a ranking, a stored result, or the path of its directory.
        settings: what is changed.

    Raises:
        ValueError: the result is damaged, or a setting is of none of its classes or not usable.
    """
    if isinstance(result, Ranking):
        classes = {each.name: each for each in result.study.model_classes}
        known = {p.name: known_at_draws(classes[p.name], p) for p in result.posteriors}
        weights = result.study.prior_weights
    else:
        result = result if isinstance(result, StoredResult) else load_result(result)
        known = {p.name: recorded_class(result, p.name) for p in result.posteriors}
        weights = result.record.prior_weights
    answer = with_changed_settings(result.posteriors, known, weights, settings)
    return replace(answer, failed_data_checks=result.comparison.failed_data_checks)
