"""``bayes-ssi rank``: the model classes of a study, ranked by evidence."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click

from bayes_ssi.commands.saved_run import SavedRun, notes_of, run_options
from bayes_ssi.commands.study_argument import load, study_argument
from bayes_ssi.commands.terminal import console, say

__all__ = ["rank"]


@click.command()
@study_argument
@click.option("--only", metavar="NAME,…", help="Rank only these model classes.")
@click.option("--any-pairing", is_flag=True,
              help="Infer which identified mode is which model mode; classes that differ in "
              "nothing else become one.")  # fmt: skip
@run_options
def rank(study: Path, only: str | None, any_pairing: bool, run: SavedRun) -> None:
    """Sample every model class of STUDY, rank them by evidence, and save the result.

    A run that was stopped goes on when the same command is given again. Workers take whole
    classes where models are fast, and share the evaluations of one class where one evaluation
    takes milliseconds or more, or where there is but one class.
    """
    from bayes_ssi.ranking.averages import averaged_parameters
    from bayes_ssi.ranking.study import Ranking
    from bayes_ssi.ranking.study import rank as rank_study

    def averages(found: Ranking) -> dict[str, Any]:
        rows = averaged_parameters(found.posteriors, found.comparison)
        return {"averaged_parameters.json": [asdict(row) for row in rows]}

    loaded = load(study, only)
    if any_pairing:
        loaded = loaded.with_any_pairing()
    loaded.require_same_data()
    saved = run.sample_and_save(
        partial(rank_study, loaded),
        loaded,
        study,
        name=study.stem,
        options=("rank",),
        ranking=lambda found: found,
        extra=averages,
    )

    result = saved.result
    from bayes_ssi.tables import averages_table, evidence_table, parameter_table, ranking_table

    where = console()
    where.print(ranking_table(result.comparison, loaded.name))
    where.print(evidence_table(result.ranked_posteriors))
    where.print(parameter_table(result.ranked_posteriors[0]))
    shared = averaged_parameters(result.posteriors, result.comparison)
    if shared:
        where.print(averages_table(shared))
    say(where, *notes_of(result))
    run.end(saved)
