"""``bayes-ssi new``: a small study to start from."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from bayes_ssi.commands.scaffold import KINDS, write_study
from bayes_ssi.commands.terminal import console, say


@click.command()
@click.argument("name", type=click.Path(path_type=Path))
@click.option("--kind", type=click.Choice(KINDS), default="shear-building", show_default=True,
              help="Kind of structure: storeys and floors, matrices of a finite-element program, "
              "or a Python function (around OpenSees, for instance).")  # fmt: skip
def new(name: Path, kind: str) -> None:
    """Write an example study NAME.py and its identified modes NAME.csv, to adapt to your own.

    The example runs unchanged: bayes-ssi rank NAME.py. Existing files are not overwritten.
    """
    study, data = write_study(name, kind)
    say(
        console(),
        f"Wrote {study} and {data}. Next:",
        f"  {shlex.join(['bayes-ssi', 'check', str(data)])}",
        f"  {shlex.join(['bayes-ssi', 'rank', str(study)])}",
    )
