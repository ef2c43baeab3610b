"""``bayes-ssi check``: what a file of identified modes says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.terminal import console, json_option, say, tell_record

if TYPE_CHECKING:
    from bayes_ssi.data.modal_csv import ModalCsv

__all__ = ["check"]


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
@json_option
def check(data: Path) -> None:
    """Say what was read from the identified modes in DATA (CSV) and what is odd."""
    from bayes_ssi.data.modal_csv import read_modal_csv
    from bayes_ssi.tables import modes_table

    read = read_modal_csv(data)
    low, high = read.data.band_hz
    where = console()
    where.print(modes_table(read.data))
    tell_record(lambda: _record(read))
    sensors = ", ".join(read.data.sensors) or "none"
    remarks = [*read.remarks, *read.data.warnings()]
    say(
        where,
        f"Band: {low:g} to {high:g} Hz. Sensors: {sensors}. Digest: {read.data.digest}.",
        *(f"(!) {remark}" for remark in remarks),
        *([] if remarks else ["Nothing odd."]),
    )


def _record(read: ModalCsv) -> dict[str, Any]:
    data = read.data
    return {
        "source": data.source,
        "band_hz": data.band_hz,
        "sensors": data.sensors,
        "digest": data.digest,
        "modes": [
            {
                "label": mode.label,
                "frequency_hz": mode.frequency_hz,
                "frequency_cov": mode.frequency_cov,
                "damping": mode.damping,
                "n_measured": mode.n_measured,
            }
            for mode in data.modes
        ],
        "remarks": [*read.remarks, *data.warnings()],
    }
