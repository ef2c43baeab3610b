"""``bayes-ssi identify``: modes with uncertainties from vibration records."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands import options, terminal
from bayes_ssi.foundations.displayed import columns
from bayes_ssi.measurements.modes.identification_summary import BAYESIAN_FFT, METHOD_NAMES

if TYPE_CHECKING:
    from bayes_ssi.measurements.records.modal_identification import ModalIdentification

MODE_FIELDS = (
    "label", "frequency_hz", "frequency_cov", "damping", "damping_sd", "shape_sd", "shape",
)  # fmt: skip
WHAT_HELPS = (
    "Understand why before you use the modes. The pictures of --figures show where the spectra "
    "are not explained; what helps is another --band, --mode for a mode that was missed, a longer "
    "record, or one without strong motion."
)


@click.command()
@options.files_argument
@options.range_option("--band", "Frequencies of the search in Hz.", required=True)
@click.option("--mode", "at", type=float, metavar="HZ", multiple=True,
    help="Frequency of a mode, in place of those that are looked for; may be repeated."
)  # fmt: skip
@click.option("--ground", metavar="SENSOR",
    help="The sensor that measures the motion of the base, which drives the structure; by default "
    "one that is named ground or base, if the others follow it. '' for none.")  # fmt: skip
@options.record_options
@options.default_option("--method", BAYESIAN_FFT,
    "Whose modes are written; the others look near those of the Bayesian FFT.",
    click.Choice(list(METHOD_NAMES)))  # fmt: skip
@options.flag("--compare", text="Print the modes by every method in one table.")
@options.flag("--verbose", text="Print what the record says of every peak and of the loads, too.")
@options.modes_option
@options.path_option(
    "--figures", text="Directory for figures of spectra, poles, residuals and shapes, a new one."
)
@options.renamed("--at", "--mode")
@terminal.json_option
def identify(
    files: tuple[Path, ...], band: tuple[float, float], at: tuple[float, ...], ground: str | None,
    stated: dict[str, Any], method: str, compare: bool, verbose: bool, out: Path | None,
    figures: Path | None,
) -> None:  # fmt: skip
    """Identify the modes of the record in FILES, all of one setup and the same instants.

    Writes them with their uncertainties to a CSV file, the data of model classes; --json gives
    their whole covariance.
    """
    from bayes_ssi.measurements.modes.modal_files import modal_files, write_modal_data
    from bayes_ssi.measurements.records import modal_identification, other_methods
    from bayes_ssi.measurements.records.record_files import read_record
    from bayes_ssi.report.tables.mode_tables import estimates_table
    from bayes_ssi.results.identification_answer import identification_answer
    from bayes_ssi.results.result_files import require_new_files
    from bayes_ssi.results.wording import listed

    written = () if out is None else modal_files(out)
    require_new_files(*written, *(() if figures is None else (figures,)))
    record = read_record(files, **stated)
    identified = modal_identification.identify(record, band, at=at, ground=ground)
    # Floors lag behind the ground that shakes them.
    warnings = [*identified.said_of_sensors, *record.selected(identified.quoted.sensors).warnings()]
    by_others = other_methods.compared(record, identified.quoted) if compare else {}
    chosen = other_methods.modes_by(method, record, identified.quoted)
    drawn: list[Path] = []
    said: list[str] = []  # after all is written, however the output ends
    if figures is not None:
        from bayes_ssi.plots.record_plots import MOVING, save_record_figures

        drawn = save_record_figures(figures, identified)
        page = f"; shapes move in {MOVING}" if (figures / MOVING).is_file() else ""
        said.append(f"Wrote {len(drawn)} figures in {figures}{page}.")
    if out is not None:
        data = identified.modal_data(f"identified from {record.source}")
        (own,) = data.identifications
        own = replace(own, remarks=(*warnings, *own.remarks), figures=tuple(map(str, drawn)))
        if method != BAYESIAN_FFT:
            data = replace(chosen, source=data.source)
            own = replace(own, method=METHOD_NAMES[method])
        data = replace(data, identifications=(own,))
        said.append(f"Wrote {listed(write_modal_data(data, out))}.")
    if failed := identified.failed_checks:
        checks = "1 check failed" if len(failed) == 1 else f"{len(failed)} checks failed"
        terminal.say_warnings([(f"{checks}. {WHAT_HELPS}", failed)])
    terminal.say_in_paragraphs(identification_answer(identified), "")
    terminal.show(estimates_table(identified.quoted, identified.method, identified.modes))
    if compare:
        from bayes_ssi.report.tables.mode_tables import methods_table

        terminal.show(methods_table(by_others, METHOD_NAMES))
        failures = {name: why for name, why in by_others.items() if isinstance(why, str)}
        terminal.say(*(f"{METHOD_NAMES[name]}: {why}" for name, why in failures.items()))
    remarks = [*warnings, *identified.remarks]
    if verbose:
        remarks += [
            f"the record shows {identified.loads}; chi-square of its spectra over degrees of "
            f"freedom is up to {identified.whiteness:.2f}, allowed "
            f"{identified.allowed_whiteness:.2f}",
            *map(str, identified.peaks),
        ]
    if remarks:
        terminal.say_in_paragraphs("\n".join(f"{each[0].upper()}{each[1:]}." for each in remarks))
    if out is None:
        said.append("Nothing is written; --out NAME.csv writes the modes for model classes.")
    terminal.say("", *said, "Every peak, loads and fit: --verbose. Pictures: --figures DIRECTORY.")
    terminal.conclude(_record(identified, warnings), identified.failed_checks)


def _record(identified: ModalIdentification, warnings: list[str]) -> dict[str, Any]:
    return {
        "method": identified.method,
        "band_hz": identified.band_hz,
        "sensors": identified.quoted.sensors,
        "sensors_left_out": dict(identified.left_out),
        "modes": [
            columns(mode, MODE_FIELDS) | columns(estimated, ("mpc", "mean_phase_deg"))
            for mode, estimated in zip(identified.quoted.modes, identified.modes, strict=True)
        ],
        "covariance_of_log_frequencies_and_unit_shapes": identified.quoted.covariance,
        "loads": identified.loads,
        "bands": [
            {"band_hz": band.band_hz, **columns(band.fit, ("whiteness", "allowed_whiteness"))}
            for band in identified.bands
            if band.is_wanted
        ],
        "peaks": identified.peaks,
        "modes_too_short_for_damping_and_shape": [i + 1 for i in identified.too_short],
        "not_identified": [
            {"frequency_hz": hz, "reason": why} for hz, why in identified.not_identified
        ],
        "remarks": [*warnings, *identified.remarks],
        "failed_checks": identified.failed_checks,
    }
