"""What commands that sample have in common: the study, and options of sampling."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.saved_run import RunOptions
from bayes_ssi.commands.terminal import json_option

if TYPE_CHECKING:
    from bayes_ssi.studies.ranking.study import Study


study_argument = click.argument("study", type=click.Path(path_type=Path))


def load(path: Path, only: str | None = None) -> Study:
    """The study from a file, with all its model classes or only the listed ones."""
    from bayes_ssi.studies.ranking.study_file import load_study

    study = load_study(path)
    if only is None:
        return study
    if only in study.names:  # a name may itself hold commas
        return study.only([only])
    return study.only([name.strip() for name in only.split(",") if name.strip()])


def run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of :class:`RunOptions` to a command, as one argument ``options``."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        own = {item.name: options.pop(item.name) for item in fields(RunOptions)}
        command(options=RunOptions(**own), **options)

    for option in (
        click.option("--accept-failed-checks", is_flag=True,
                     help="Exit with code 0 where checks failed; they are shown and saved all "
                     "the same."),
        click.option("--dask", metavar="ADDRESS",
                     help="Sample on a Dask cluster, by its scheduler's address."),
        click.option("--workers", type=click.IntRange(min=1), metavar="N",
                     help="Sample in N processes on this machine, at most one for each core. If "
                     "not given: one for each core that has a class to sample, but only this "
                     "process where a model is a user's own function or class of structure, or a "
                     "single small one."),
        click.option("--sensitivity", is_flag=True,
                     help="Rank again with every setting halved and doubled: missed and spurious "
                     "modes, error sizes, widths of priors."),
        click.option("--overwrite", is_flag=True,
                     help="Replace a result, or an unfinished run, that exists."),
        click.option("--out", type=click.Path(path_type=Path),
                     help="Result directory; in runs/results if not given."),
        click.option("--economical", is_flag=True,
                     help="Emulate the modes of slow models from some hundred solutions, "
                     "hundreds of times fewer."),
        click.option("--error", "log_evidence_error", type=float, default=0.01,
                     show_default=True,
                     help="Wanted standard error of each log evidence, in nats."),
        click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
                     help="The result follows from it."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return json_option(wrapped)
