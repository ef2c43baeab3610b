"""``bayes-ssi check``: show a file of identified modes as it is read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.terminal import console, json_option, print_record, say

if TYPE_CHECKING:
    from bayes_ssi.data.modal_data import ModalData

# Far more modes, sensors or warnings than a test has are a mistake, which the first ones show.
MOST = 100
MODE_FIELDS = (
    "label", "frequency_hz", "frequency_cov", "shape_sd", "damping", "damping_sd", "n_measured",
)  # fmt: skip


@click.command()
@click.argument("data", type=click.Path(path_type=Path))
@json_option
def check(data: Path) -> None:
    """Show the identified modes read from DATA (CSV), with warnings about them."""
    from bayes_ssi.data.modal_files import read_modal_data
    from bayes_ssi.tables import modes_table

    modes = read_modal_data(data)
    low, high = modes.band_hz
    where = console()
    where.print(modes_table(modes, MOST))
    if len(modes.modes) > MOST:
        say(where, _not_shown(len(modes.modes), "modes"))
    print_record(lambda: _record(modes))
    sensors = ", ".join(modes.sensors[:MOST]) or "none"
    if len(modes.sensors) > MOST:
        sensors += "; " + _not_shown(len(modes.sensors), "sensors").removesuffix(".")
    remarks = modes.warnings()
    say(
        where,
        f"Band: {low:g} to {high:g} Hz. Sensors: {sensors}. Digest: {modes.digest}.",
        "Errors of frequencies and shapes: "
        + ("independent." if modes.covariance is None else "joint, by their covariance."),
        *(f"(!) {remark}" for remark in remarks[:MOST]),
        *([_not_shown(len(remarks), "warnings")] if len(remarks) > MOST else []),
        *([] if remarks else ["No warnings."]),
    )


def _not_shown(n: int, what: str) -> str:
    return f"{n - MOST:,} of {n:,} {what} are not shown here; --json gives all."


def _record(data: ModalData) -> dict[str, Any]:
    return {
        "source": data.source,
        "band_hz": data.band_hz,
        "sensors": data.sensors,
        "digest": data.digest,
        "covariance_digest": data.covariance_digest,
        "modes": [{key: getattr(mode, key) for key in MODE_FIELDS} for mode in data.modes],
        "remarks": data.warnings(),
    }
