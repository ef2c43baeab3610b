"""A study ranked: every class sampled, compared, and asked whether an appendage is missing."""

from __future__ import annotations

from dataclasses import replace

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.appendages.unmodelled_appendage import unmodelled_appendage
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.study import Ranking, Study, compare_and_diagnose


@checked
def rank(
    study: Study,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
) -> Ranking:
    """Sample every model class of a study and rank them by evidence.

    Args:
        study: the candidates.
        seed: a class's result follows from it and the class's name, regardless of other classes.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; the result does not depend on
            them.

    Raises:
        ValueError: the classes explain different data, a class's likelihood is zero everywhere,
            the model cannot be evaluated by the workers, or the checkpoint is of another run.
    """
    study.require_same_data()
    settings = settings or SamplingSettings()
    run = run or Run()
    with run.working():
        posteriors = sample_all(study.model_classes, seed, settings, run)
        ranking = compare_and_diagnose(study, posteriors, seed, settings, run)
        missing = unmodelled_appendage(study, ranking, seed, run)
    if not missing:
        return ranking
    comparison = ranking.comparison.with_common("appendage", [missing])
    return replace(ranking, comparison=comparison)
