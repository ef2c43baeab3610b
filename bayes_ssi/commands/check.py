"""``bayes-ssi check``: what a file of identified modes says."""

from __future__ import annotations

from pathlib import Path

import click

from bayes_ssi.terminal import console, say

__all__ = ["check"]


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
def check(data: Path) -> None:
    """Say what was read from the identified modes in DATA (CSV) and what is odd."""
    from bayes_ssi.modal_csv import read_modal_csv
    from bayes_ssi.tables import modes_table

    read = read_modal_csv(data)
    low, high = read.data.band_hz
    where = console()
    where.print(modes_table(read.data))
    sensors = ", ".join(read.data.sensors) or "none"
    remarks = [*read.remarks, *read.data.oddities()]
    say(
        where,
        f"Band: {low:g} to {high:g} Hz. Sensors: {sensors}. Digest: {read.data.digest}.",
        *(f"(!) {remark}" for remark in remarks),
        *([] if remarks else ["Nothing odd."]),
    )
