"""``bayes-ssi check``: show a file of identified modes, or a vibration record, as it is read."""

from pathlib import Path
from typing import Any

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns

MODE_FIELDS = (
    "label", "frequency_hz", "frequency_cov", "shape_sd", "damping", "damping_sd", "n_measured",
)  # fmt: skip
DATA_FIELDS = ("source", "band_hz", "sensors", "digest", "full_digest", "covariance_digest")
RECORD_FIELDS = ("source", "quantity", "unit", "rate_hz", "n_samples", "sensors")


@click.command()
@click.argument("data", type=options.PATH, nargs=-1, required=True)
@options.range_option(
    "--band", "Band (Hz) in which the modes were sought, if the file does not state it."
)
@options.record_options
@terminal.json_option
def check(data: tuple[Path, ...], band: tuple[float, float] | None, stated: dict[str, Any]) -> None:
    """Show the identified modes read from DATA (CSV), with warnings about them.

    Where DATA is a vibration record, in one file or in several of the same instants, warns of
    sensors that are dead, clipped or alike, of gaps and of machines. The exit code
    is 3 where the modes are of an identification that failed a check.
    """
    from bayes_ssi.measurements.records.record_files import is_record, read_record

    if data[0].suffix == ".py":
        raise ValueError(
            f"{data[0]}: a study; check reads files of modes or records. If it is one, run: "
            f"bayes-ssi rank {data[0]}"
        )
    if data[0].is_dir():
        raise ValueError(
            f"{data[0]}: a directory; check reads files of modes or records. If it is a result, "
            f"run: bayes-ssi report {data[0]}"
        )
    if len(data) > 1 or is_record(data[0]):
        if band:
            raise ValueError(f"--band: applies to modes, but {data[0]} holds a record")
        record = read_record(data, **stated)
        remarks = record.warnings()
        terminal.say(
            f"{record.source}: {record.quantity} in {record.unit}, {record.n_samples:,} samples at "
            f"{record.rate_hz:g} Hz ({record.duration_s:g} s), up to {record.nyquist_hz:g} Hz. "
            f"Sensors: {', '.join(record.sensors)}.",
            *([f"(!) {remark}" for remark in remarks] or ["No warnings."]),
        )
        terminal.conclude(columns(record, RECORD_FIELDS) | {"remarks": remarks})
        return
    for option in click.get_current_context().command.params:
        if stated.get(str(option.name)):
            raise ValueError(
                f"{option.opts[0]}: applies to vibration records, but {data[0]} holds modes"
            )
    _check_modes(data[0], band)


def _check_modes(path: Path, band: tuple[float, float] | None) -> None:
    from bayes_ssi.measurements.modes.modal_files import read_modal_data
    from bayes_ssi.report.tables.mode_tables import modes_table
    from bayes_ssi.results.wording import data_warnings

    modes = read_modal_data(path, band_hz=band)
    failed = modes.all_failed_checks
    low, high = modes.band_hz
    terminal.show(modes_table(modes))
    remarks = modes.warnings()[len(failed) :]
    terminal.say(
        f"Band: {low:g} to {high:g} Hz. Sensors: {', '.join(modes.sensors) or 'none'}. "
        f"Digest: {modes.full_digest}.",
        *([] if modes.covariance is None else ["Errors have a joint covariance."]),
        *([f"(!) {remark}" for remark in remarks] or ([] if failed else ["No warnings."])),
    )
    terminal.say_warnings(data_warnings(failed))
    shown = [columns(mode, MODE_FIELDS) for mode in modes.modes]
    further = {"modes": shown, "remarks": remarks, "failed_checks": failed}
    terminal.conclude(columns(modes, DATA_FIELDS) | further, failed)
