"""``bayes-ssi rank``: the model classes of a study, ranked by evidence."""

from pathlib import Path

import click

from bayes_ssi.commands.options import flag, load, only_option, study_argument
from bayes_ssi.commands.saved_run import RunOptions, notes_of, run_options, say_misfit
from bayes_ssi.commands.terminal import say, show


@click.command()
@study_argument
@only_option("Rank only these model classes.")
@flag("--any-pairing", text="Infer which identified mode is which model mode; classes that differ "
      "in nothing else become one.")  # fmt: skip
@run_options
def rank(study: Path, only: str | None, any_pairing: bool, options: RunOptions) -> None:
    """Sample every model class of STUDY, rank them by evidence, and save the result.

    A run that was interrupted is resumed when the same command is given again. Workers take whole
    classes where there are at least as many classes as workers, or where models are small; else
    they share the evaluations of one class.
    """
    from bayes_ssi.studies.appendages.ranked_study import rank as rank_study
    from bayes_ssi.studies.ranking.study import averaged_parameters

    loaded = load(study, only)
    if any_pairing:
        loaded = loaded.with_any_pairing()
    loaded.require_same_data()
    place = options.place(loaded, study, study.stem, "rank")
    with options.running(loaded, place) as run:
        ranking = rank_study(loaded, options.seed, options.settings, run)
        averages = averaged_parameters(ranking.posteriors, ranking.comparison)
        records = {"averaged_parameters.json": averages}
        result = options.save(ranking, records, place, run)

    from bayes_ssi.report.tables.ranking_tables import (
        averages_table,
        evidence_table,
        parameter_table,
        ranking_table,
    )

    say_misfit(result)
    show(ranking_table(result.comparison, loaded.name), evidence_table(result.ranked_posteriors))
    show(parameter_table(result.ranked_posteriors[0]))
    if averages:
        show(averages_table(averages))
    say(*notes_of(result))
    options.end(result, records)
