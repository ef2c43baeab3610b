"""``bayes-ssi rank``: the model classes of a study, ranked by evidence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands import options
from bayes_ssi.commands.saved_run import RunOptions, run_options

if TYPE_CHECKING:
    from bayes_ssi.inference.workers.run import Run
    from bayes_ssi.studies.ranking.study import Ranking


@click.command()
@options.study_argument
@options.classes_option("Rank only these model classes.")
@options.flag("--any-pairing", text="Infer which identified mode is which model mode; classes "
              "that differ in nothing else become one.")  # fmt: skip
@run_options
def rank(study: Path, names: tuple[str, ...], any_pairing: bool, sampling: RunOptions) -> None:
    """Sample every model class of STUDY, rank them by evidence, and save the result.

    A run that was interrupted is resumed when the same command is given again. Workers take whole
    classes where there are at least as many classes as workers, or where models are small; else
    they share the evaluations of one class.
    """
    from bayes_ssi.report.tables.ranking_tables import further_tables, ranked
    from bayes_ssi.studies.questions import rank as rank_study
    from bayes_ssi.studies.ranking.study import averaged_parameters

    loaded = options.load(study, names)
    if any_pairing:
        loaded = loaded.with_any_pairing()
    loaded.require_same_data()

    def sample(run: Run) -> tuple[Ranking, Mapping[str, Any]]:
        ranking = rank_study(loaded, sampling.seed, sampling.settings, run)
        averages = averaged_parameters(ranking.posteriors, ranking.comparison)
        return ranking, {"averaged_parameters.json": averages}

    sampling.answer(loaded, study, study.stem, sample, ranked, further_tables)
