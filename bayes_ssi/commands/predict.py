"""``bayes-ssi predict``: modes and responses from a stored result, with credible bands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.options import (
    configuration_option,
    default_option,
    flag,
    path_option,
    range_option,
    repeated_option,
    result_argument,
    study_option,
)
from bayes_ssi.commands.terminal import (
    exit_if_failed,
    is_quiet,
    json_option,
    print_record,
    progress_bars,
    say,
    say_warnings,
    show,
)

if TYPE_CHECKING:
    from bayes_ssi.results.predictions.predictions import Predictions, StoredPredictions
    from bayes_ssi.results.predictions.requested_predictions import (
        PredictionsRecord,
        ResponseRequest,
    )
    from bayes_ssi.structures.response.modal_response import Damping, Output, Quantity


@click.command()
@result_argument
@study_option
@repeated_option(
    "--class",
    "classes",
    "NAME",
    "Model class, or hypothesis of a search; may be repeated.  [default: average, over all by "
    "their probabilities]",
)
@configuration_option
@default_option(
    "--quantity",
    "acceleration",
    "Displacement relative to the ground, absolute acceleration, or drift.",
    click.Choice(["displacement", "acceleration", "drift"]),
)
@repeated_option(
    "--at",
    "places",
    "PLACE",
    "Degree of freedom or sensor of the structure; for drift LOWER:UPPER, where LOWER may be "
    "'ground'; may be repeated.  [default: the top]",
)
@click.option(
    "--damping",
    metavar="RATIO,…",
    help="Fraction of critical damping, one for all modes or one for each.  [default: median "
    "of the identified ones, or 0.02]",
)
@click.option(
    "--transfer",
    metavar="SOURCE",
    help="Input of transfer functions: acceleration of the 'ground', a force at a degree of "
    "freedom, or 'none'.  [default: ground, if the influence of ground motion is known]",
)
@range_option("--band", "Frequencies of transfer functions in Hz.  [default: band of the data]")
@path_option(
    "--record",
    "records",
    metavar="FILE",
    multiple=True,
    text="Ground motion (AT2, text or CSV) for time histories; may be repeated.",
)
@click.option("--unit", help="Unit of the records (g, m/s2, cm/s2, …), in place of the file's.")
@click.option("--dt", type=float, help="Time step of the records in s, if not in the file.")
@default_option("--level", 0.95, "Probability of the credible bands.")
@default_option("--draws", 1000, "Number of posterior draws.", click.IntRange(min=1))
@path_option("--out", text="Directory for tables and figures.  [default: RESULT/predictions]")
@flag("--overwrite", text="Replace existing predictions.")
@json_option
def predict(
    result: Path, study: Path | None, classes: tuple[str, ...], out: Path | None, overwrite: bool,
    configuration: str | None, draws: int, **options: Any,
) -> None:  # fmt: skip
    """Predict modes and responses from RESULT, a directory that rank or search saved.

    Frequencies and mode shapes, transfer functions, and time histories and peaks under ground
    motions, all with credible bands. Nothing is sampled: draws are those stored, structures those
    of the study file. The exit code is 3 where a failed check of RESULT was not accepted.
    """
    from bayes_ssi.foundations.codec import to_record
    from bayes_ssi.plots.prediction_plots import save_prediction_figures
    from bayes_ssi.results.answer import answer
    from bayes_ssi.results.predictions.posterior_draws import PREDICTION_SETTINGS
    from bayes_ssi.results.predictions.predictions import AVERAGE, load_predictions
    from bayes_ssi.results.predictions.requested_predictions import (
        MARKER,
        predict_responses,
        save_predictions,
    )
    from bayes_ssi.results.result_files import new_directory, require_new, write_json

    predicted = load_predictions(result, study, draws, configuration)
    of_one = len(predicted.model_classes) == 1
    names = dict.fromkeys(classes or (list(predicted.model_classes) if of_one else [AVERAGE]))
    request, remarks = _request(predicted, predicted.of(next(iter(names))), **options)
    directory = out or result / "predictions"
    require_new(directory, marker=MARKER, overwrite=overwrite)
    record = _record(predicted, list(names), request)
    longest = max(map(len, request.motions), default=0)
    if predicted.n_draws * longest > PREDICTION_SETTINGS.array_size and not is_quiet():
        click.echo(
            f"{predicted.n_draws} time histories of {longest} samples take a while; fewer --draws "
            "take less.",
            err=True,
        )
    responses = []
    with progress_bars() as report:
        for name in names:
            report(name, "predictions", 0.0)
            responses.append(predict_responses(predicted, name, request))
            report(name, "predictions", 1.0)
    with new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        write_json(partial / MARKER, record)
        save_predictions(partial, responses)
        save_prediction_figures(partial / "figures", predicted.data, responses)

    from bayes_ssi.report.tables.prediction_tables import frequency_table, peak_table, shape_table

    title = predicted.stored.record.study
    test = f", configuration {predicted.configuration!r}" if predicted.configuration else ""
    say(f"{title}{test}: {predicted.n_draws} stored draws; nothing was sampled.")
    if predicted.n_draws < draws:
        say(f"(!) --draws {draws}: no more than {predicted.n_draws} draws are stored.")
    say(*(_composition(each.predictions) for each in responses), *remarks)
    show(frequency_table(responses))
    shapes = shape_table(responses[0])
    if shapes is not None:
        show(shapes)
    if request.frequencies_hz is not None or request.motions:
        show(peak_table(responses))
    n_tables, n_figures = (len(list(directory.glob(f"**/*.{kind}"))) for kind in ("csv", "png"))
    say(f"Saved in {directory}: {n_tables} tables and {n_figures} figures.")
    say_warnings(answer(predicted.stored).warnings)
    failed = predicted.stored.comparison.failed_checks
    print_record(
        lambda: {
            "directory": str(directory),
            **to_record(record),
            "modes": {
                each.name: {mode.label: list(mode.after_hz) for mode in each.modes}
                for each in responses
            },
            "failed_checks": failed,
        }
    )
    if not predicted.stored.record.failed_checks_accepted:
        exit_if_failed(failed)


def _request(
    predicted: StoredPredictions,
    first: Predictions,
    *,
    quantity: Quantity,
    places: tuple[str, ...],
    damping: str | None,
    transfer: str | None,
    band: tuple[float, float] | None,
    records: tuple[Path, ...],
    unit: str | None,
    dt: float | None,
    level: float,
) -> tuple[ResponseRequest, list[str]]:
    """The request from the options, and remarks on it."""
    import numpy as np

    from bayes_ssi.measurements.records.record_files import read_ground_motion
    from bayes_ssi.results.predictions.posterior_draws import PREDICTION_SETTINGS
    from bayes_ssi.results.predictions.requested_predictions import (
        ResponseRequest,
        default_frequencies,
        default_output,
    )
    from bayes_ssi.structures.response.ground_motion import UNITS
    from bayes_ssi.structures.response.modal_response import (
        GROUND,
        HEAVY_DAMPING,
        damping_ratios,
        ground_influence,
        heavy_damping_warning,
    )

    for name, value in (("--unit", unit), ("--dt", dt)):
        if value is not None and not records:
            raise ValueError(f"{name}: applies to records, but no --record is given")
    ratios, remark = _damping(predicted, damping)
    lowest = damping_ratios(ratios, np.size(ratios)).min()
    output = _output(quantity, places) if places else default_output(first, quantity)
    remarks = [remark]
    heaviest = float(np.max(ratios))
    if heaviest > HEAVY_DAMPING:
        remarks.append(f"(!) {heavy_damping_warning(heaviest)}")
    frequencies = None
    if transfer is None:
        structures = [each.structure for each in first.classes]
        unknown = [one for one in structures if ground_influence(one) is None]
        transfer = "none" if unknown else GROUND
        if unknown:
            remarks.append(
                "No transfer functions: how ground motion acts on the degrees of freedom of the "
                f"{type(unknown[0]).__name__} is not known."
            )
    if transfer != "none":
        frequencies = default_frequencies(predicted.data, lowest, band)
        source = "the ground's acceleration" if transfer == GROUND else f"a force at {transfer!r}"
        remarks.append(
            f"Transfer functions: from {source}, {len(frequencies)} frequencies from "
            f"{frequencies[0]:g} to {frequencies[-1]:g} Hz."
        )
        if len(frequencies) == PREDICTION_SETTINGS.most_frequencies:
            remarks.append(
                "(!) The frequencies may miss the top of a narrow peak; give a narrower --band."
            )
    elif band is not None:
        raise ValueError("--band: applies to transfer functions, but --transfer is none")
    motions = tuple(read_ground_motion(file, unit=unit, dt=dt) for file in records)
    remarks += [
        f"Record {motion.name}: {len(motion)} samples, {motion.dt:g} s apart; peak "
        f"{motion.peak_acceleration / UNITS['g']:.3g} g."
        for motion in motions
    ]
    frequencies_of_modes = np.median(first.classes[0].frequencies_hz, axis=0)
    remarks += [
        f"(!) {warning}." for motion in motions for warning in motion.warnings(frequencies_of_modes)
    ]
    force_at = None if transfer in (GROUND, "none") else transfer
    return ResponseRequest(output, ratios, frequencies, force_at, motions, level), remarks


def _damping(predicted: StoredPredictions, text: str | None) -> tuple[Damping, str]:
    """The damping from the option or from the data, and a sentence about it."""
    from bayes_ssi.results.predictions.requested_predictions import default_damping

    if text is None:
        default, source = default_damping(predicted.data)
        return default, f"Damping: {100 * default:.3g} % in all modes, {source}."
    try:
        ratios = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ValueError(
            f"--damping: must be a fraction, or one for each mode separated by commas, got {text!r}"
        ) from None
    each = ", ".join(f"{100 * ratio:.3g}" for ratio in ratios)
    if len(ratios) == 1:
        return ratios[0], f"Damping: {each} % in all modes, as given."
    return ratios, f"Damping: {each} % mode by mode, as given."


def _output(quantity: Quantity, places: tuple[str, ...]) -> Output:
    from bayes_ssi.structures.response.modal_response import Output

    if quantity != "drift":
        return Output(quantity, places)
    for place in places:
        if place.count(":") != 1:
            raise ValueError(f"--at: a drift is given as LOWER:UPPER, got {place!r}")
    pairs = [place.partition(":") for place in places]
    return Output(quantity, tuple((lower, upper) for lower, _, upper in pairs))


def _composition(predictions: Predictions) -> str:
    """Sentence on the model classes whose draws make a prediction."""
    from bayes_ssi.results.predictions.predictions import AVERAGE

    if predictions.name != AVERAGE:
        return f"{predictions.name}: one model class."
    by_share = sorted(predictions.classes, key=lambda each: -len(each.values))
    shares = [f"{len(each.values)} of {each.name!r}" for each in by_share[:4]]
    if len(by_share) > 4:
        shares.append(f"{sum(len(each.values) for each in by_share[4:])} of others")
    return f"{AVERAGE}: draws in proportion to probability, {', '.join(shares)}."


def _record(
    predicted: StoredPredictions, names: list[str], request: ResponseRequest
) -> PredictionsRecord:
    from bayes_ssi.foundations.packages import versions
    from bayes_ssi.results.predictions.requested_predictions import MotionRecord, PredictionsRecord

    transfer = None if request.frequencies_hz is None else request.transfer_name
    damping = request.damping
    return PredictionsRecord(
        study=predicted.stored.record.study,
        result_created=predicted.stored.record.created,
        configuration=predicted.configuration,
        predictions_of=tuple(names),
        draws=predicted.n_draws,
        level=request.level,
        quantity=request.output.quantity,
        places=tuple(request.output.labels),
        damping=damping if isinstance(damping, (int, float)) else tuple(damping),
        transfer_functions=transfer,
        records=tuple(
            MotionRecord(motion.name, len(motion), motion.dt) for motion in request.motions
        ),
        versions=versions(),
    )
