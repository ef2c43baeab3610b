"""The study that is passed to a command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

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
