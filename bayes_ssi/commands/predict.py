"""``bayes-ssi predict``: modes and responses from a stored result, with credible bands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands import options, terminal

if TYPE_CHECKING:
    from bayes_ssi.results.predictions.predictions import Predictions, StoredPredictions
    from bayes_ssi.results.predictions.requested_predictions import ResponseRequest
    from bayes_ssi.structures.response import Output, Quantity


@click.command()
@options.result_argument
@options.study_option
@options.repeated_option("--class", "classes", "NAME",
    "Model class, or hypothesis of a search; may be repeated.  [default: average, over all by "
    "their probabilities]")  # fmt: skip
@options.configuration_option
@options.default_option("--quantity", "acceleration",
    "Displacement relative to the ground, absolute acceleration, or drift.",
    click.Choice(["displacement", "acceleration", "drift"]))  # fmt: skip
@options.repeated_option("--at", "places", "PLACE",
    "Degree of freedom or sensor of the structure; for drift LOWER:UPPER, where LOWER may be "
    "'ground'; may be repeated.  [default: the top]")  # fmt: skip
@click.option("--damping", metavar="RATIO,…",
    help="Fraction of critical damping, one for all modes or one for each.  [default: median "
    "of the identified ones, or 0.02]")  # fmt: skip
@click.option("--transfer", metavar="SOURCE",
    help="Input of transfer functions: acceleration of the 'ground', a force at a degree of "
    "freedom, or 'none'.  [default: ground, if the influence of ground motion is known]"
)  # fmt: skip
@options.range_option("--frequencies", "Of transfer functions in Hz.  [default: band of the data]")
@options.path_option("--record", "records", metavar="FILE", multiple=True,
    text="Ground motion (AT2, text or CSV) for time histories; may be repeated.")  # fmt: skip
@click.option("--unit", help="Unit of the records (g, m/s2, cm/s2, …), in place of the file's.")
@click.option("--dt", type=float, help="Time step of the records in s, if not in the file.")
@options.default_option("--draws", 1000, "Number of posterior draws.", click.IntRange(min=1))
@options.path_option(
    "--out", text="Directory for tables and figures.  [default: RESULT/predictions]")  # fmt: skip
@options.flag("--overwrite", text="Replace existing predictions.")
@options.renamed("--band", "--frequencies")
@terminal.json_option
def predict(
    result: Path, study: Path | None, classes: tuple[str, ...], out: Path | None, overwrite: bool,
    configuration: str | None, draws: int, **options: Any,
) -> None:  # fmt: skip
    """Predict modes and responses from RESULT, a directory that rank or search saved.

    Frequencies and mode shapes, transfer functions, and time histories and peaks under ground
    motions, all with credible bands. Nothing is sampled: draws are those stored, structures those
    of the study file. The exit code is 3 where a failed check of RESULT was not accepted.
    """
    from bayes_ssi.foundations.displayed import counted
    from bayes_ssi.plots.prediction_plots import save_prediction_figures
    from bayes_ssi.results.answer import answer
    from bayes_ssi.results.predictions import requested_predictions as requested
    from bayes_ssi.results.predictions.posterior_draws import ARRAY_SIZE
    from bayes_ssi.results.predictions.predictions import AVERAGE, load_predictions
    from bayes_ssi.results.result_files import new_directory, require_new, write_json

    predicted = load_predictions(result, study, draws, configuration)
    of_one = len(predicted.model_classes) == 1
    names = dict.fromkeys(classes or (list(predicted.model_classes) if of_one else [AVERAGE]))
    request, remarks = _requested(predicted, predicted.of(next(iter(names))), **options)
    directory = out or result / "predictions"
    require_new(directory, marker=requested.MARKER, overwrite=overwrite)
    record = requested.predictions_record(predicted, tuple(names), request)
    longest = max(map(len, request.motions), default=0)
    if predicted.n_draws * longest > ARRAY_SIZE and not terminal.is_quiet():
        click.echo(
            f"{predicted.n_draws} time histories of {longest} samples take a while; fewer --draws "
            "take less.",
            err=True,
        )
    responses = []
    with terminal.progress_bars() as report:
        for name in names:
            report(name, "predictions", 0.0)
            responses.append(requested.predict_responses(predicted, name, request))
            report(name, "predictions", 1.0)
    with new_directory(directory, marker=requested.MARKER, overwrite=overwrite) as partial:
        write_json(partial / requested.MARKER, record)
        requested.save_predictions(partial, responses)
        save_prediction_figures(partial / "figures", responses)

    from bayes_ssi.report.tables.prediction_tables import frequency_table, peak_table

    title = predicted.stored.record.study
    test = f", configuration {predicted.configuration!r}" if predicted.configuration else ""
    terminal.say(f"{title}{test}: {predicted.n_draws} stored draws; nothing was sampled.")
    if predicted.n_draws < draws:
        terminal.say(f"(!) --draws {draws}: no more than {predicted.n_draws} draws are stored.")
    terminal.say(*(response.predictions.composition for response in responses), *remarks)
    terminal.show(frequency_table(responses))
    if request.frequencies_hz is not None or request.motions:
        terminal.show(peak_table(responses))
    tables = counted(len(list(directory.glob("**/*.csv"))), "table")
    figures = counted(len(list(directory.glob("**/*.png"))), "figure")
    terminal.say(f"Saved in {directory}: {tables} and {figures}.")
    terminal.say_warnings(answer(predicted.stored).warnings)
    failed = predicted.stored.comparison.failed_checks
    modes = {
        each.name: {mode.label: list(mode.after_hz) for mode in each.modes} for each in responses
    }
    accepted = predicted.stored.record.failed_checks_accepted
    said = {"directory": str(directory), **record, "modes": modes, "failed_checks": failed}
    terminal.conclude(said, () if accepted else failed)


def _requested(
    predicted: StoredPredictions, first: Predictions, quantity: Quantity, places: tuple[str, ...],
    damping: str | None, transfer: str | None, frequencies: tuple[float, float] | None,
    records: tuple[Path, ...], unit: str | None, dt: float | None,
) -> tuple[ResponseRequest, list[str]]:  # fmt: skip
    from bayes_ssi.measurements.records.record_files import read_ground_motion
    from bayes_ssi.results.predictions.requested_predictions import completed_request

    for name, value in (("--unit", unit), ("--dt", dt)):
        if value is not None and not records:
            raise ValueError(f"{name}: applies to records, but no --record is given")
    try:
        ratios = [float(part) for part in damping.split(",")] if damping is not None else []
    except ValueError:
        raise ValueError(
            f"--damping: must be a fraction, or one for each mode separated by commas, got "
            f"{damping!r}"
        ) from None
    request, remarks = completed_request(
        predicted,
        first,
        _output(quantity, places) if places else quantity,
        damping=ratios[0] if len(ratios) == 1 else tuple(ratios) or None,
        source=transfer,
        band_hz=frequencies,
        motions=tuple(read_ground_motion(file, unit=unit, dt=dt) for file in records),
    )
    if frequencies is not None and request.frequencies_hz is None:
        raise ValueError("--frequencies: applies to transfer functions, but --transfer is none")
    return request, remarks


def _output(quantity: Quantity, places: tuple[str, ...]) -> Output:
    from bayes_ssi.structures.response import Output

    if quantity != "drift":
        return Output(quantity, places)
    for place in places:
        if place.count(":") != 1:
            raise ValueError(f"--at: a drift is given as LOWER:UPPER, got {place!r}")
    pairs = [place.partition(":") for place in places]
    return Output(quantity, tuple((lower, upper) for lower, _, upper in pairs))
