"""``bayes-ssi merge``: one file of modes from those of several setups or records."""

from pathlib import Path

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns

MODE_FIELDS = ("frequency_hz", "frequency_cov", "shape_sd", "damping", "damping_sd")


@click.command()
@options.files_argument
@options.modes_option
@terminal.json_option
def merge(files: tuple[Path, ...], out: Path | None) -> None:
    """Merge the modes in FILES: of setups that share reference sensors, of several records, or of
    bands that touch or overlap.

    Modes that are nearest to each other are the same; frequencies and shapes have the weights of
    their errors. The scatter between files is compared with these. The exit code is 3 where it is
    larger, and where an identification failed a check.
    """
    from bayes_ssi.measurements.modes import modal_files
    from bayes_ssi.measurements.modes.merging import merge_modal_data
    from bayes_ssi.report.tables.mode_tables import merged_table
    from bayes_ssi.results.result_files import require_new_files
    from bayes_ssi.results.wording import listed

    require_new_files(*(() if out is None else modal_files.modal_files(out)))
    named = options.named_paths(files)
    merged = merge_modal_data({name: modal_files.read_modal_data(named[name]) for name in named})
    failed = merged.data.all_failed_checks
    files_written = () if out is None else modal_files.write_modal_data(merged.data, out)
    terminal.show(merged_table(merged))
    terminal.say(
        "Band: {:g} to {:g} Hz.".format(*merged.data.band_hz),
        *(f"(!) {remark}" for remark in merged.remarks),
        *(f"(!) Failed check: {check}" for check in failed),
    )
    if files_written:
        terminal.say(f"Wrote {listed(files_written)}.")
    modes = [
        {
            "label": mode.label,
            "labels": dict(row.labels),
            **columns(mode, MODE_FIELDS),
            "frequency_scatter": row.frequency,
            "shape_scatter": row.shape,
        }
        for row, mode in zip(merged.modes, merged.data.modes, strict=True)
    ]
    record = columns(merged.data, ("source", "band_hz", "sensors"))
    record |= {"modes": modes, "remarks": merged.remarks, "failed_checks": failed}
    terminal.conclude(record, failed)
