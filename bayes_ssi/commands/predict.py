"""``bayes-ssi predict``: modes and responses from a stored result, with credible bands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bayes_ssi.commands.response_options import response_request
from bayes_ssi.commands.terminal import (
    console,
    exit_if_failed,
    is_quiet,
    json_option,
    print_record,
    progress_bars,
    say,
    say_warnings,
)

if TYPE_CHECKING:
    from bayes_ssi.results.predictions.prediction_files import PredictionsRecord
    from bayes_ssi.results.predictions.predictions import Predictions
    from bayes_ssi.results.predictions.response_bands import ResponseBands, ResponseRequest
    from bayes_ssi.results.predictions.stored_predictions import StoredPredictions


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option(
    "--study",
    type=click.Path(path_type=Path),
    help="Study file, if it has moved since the result was saved.",
)
@click.option(
    "--class",
    "classes",
    metavar="NAME",
    multiple=True,
    help="Model class, or hypothesis of a search; may be repeated.  [default: average, over all by "
    "their probabilities]",
)
@click.option(
    "--configuration",
    metavar="NAME",
    help="Configuration of the structure, if several were tested.",
)
@click.option(
    "--quantity",
    type=click.Choice(["displacement", "acceleration", "drift"]),
    default="acceleration",
    show_default=True,
    help="Displacement relative to the ground, absolute acceleration, or drift.",
)
@click.option(
    "--at",
    "places",
    metavar="PLACE",
    multiple=True,
    help="Degree of freedom or sensor of the structure; for drift LOWER:UPPER, where LOWER may be "
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
@click.option(
    "--band",
    type=(float, float),
    metavar="LOW HIGH",
    help="Frequencies of transfer functions in Hz.  [default: band of the data]",
)
@click.option(
    "--record",
    "records",
    type=click.Path(path_type=Path),
    metavar="FILE",
    multiple=True,
    help="Ground motion (AT2, text or CSV) for time histories; may be repeated.",
)
@click.option("--unit", help="Unit of the records (g, m/s2, cm/s2, …), in place of the file's.")
@click.option("--dt", type=float, help="Time step of the records in s, if not in the file.")
@click.option(
    "--level",
    type=float,
    default=0.95,
    show_default=True,
    help="Probability of the credible bands.",
)
@click.option(
    "--draws",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Number of posterior draws.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Directory for tables and figures.  [default: RESULT/predictions]",
)
@click.option("--overwrite", is_flag=True, help="Replace existing predictions.")
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
    from bayes_ssi.results.predictions.prediction_files import MARKER, save_predictions
    from bayes_ssi.results.predictions.predictions import AVERAGE
    from bayes_ssi.results.predictions.response_bands import predict_responses
    from bayes_ssi.results.predictions.stored_predictions import load_predictions
    from bayes_ssi.results.result_files import new_directory, require_new, write_json

    predicted = load_predictions(result, study, draws, configuration)
    of_one = len(predicted.model_classes) == 1
    names = dict.fromkeys(classes or (list(predicted.model_classes) if of_one else [AVERAGE]))
    request, remarks = response_request(predicted, predicted.of(next(iter(names))), **options)
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
        save_predictions(partial, predicted.data, responses)
        save_prediction_figures(partial / "figures", predicted.data, responses)

    from bayes_ssi.report.tables.prediction_tables import frequency_table, peak_table, shape_table

    where = console()
    title = predicted.stored.record.study
    test = f", configuration {predicted.configuration!r}" if predicted.configuration else ""
    say(where, f"{title}{test}: {predicted.n_draws} stored draws; nothing was sampled.")
    if predicted.n_draws < draws:
        say(where, f"(!) --draws {draws}: no more than {predicted.n_draws} draws are stored.")
    say(where, *(_composition(each.predictions) for each in responses), *remarks)
    where.print(frequency_table(predicted.data, responses))
    shapes = shape_table(predicted.data, responses[0])
    if shapes is not None:
        where.print(shapes)
    if request.frequencies_hz is not None or request.motions:
        where.print(peak_table(responses))
    n_tables, n_figures = (len(list(directory.glob(f"**/*.{kind}"))) for kind in ("csv", "png"))
    say(where, f"Saved in {directory}: {n_tables} tables and {n_figures} figures.")
    say_warnings(where, answer(predicted.stored).warnings)
    failed = predicted.stored.comparison.failed_checks
    print_record(
        lambda: {
            "directory": str(directory),
            **to_record(record),
            "modes": _modes(predicted, responses),
            "failed_checks": failed,
        }
    )
    if not predicted.stored.record.failed_checks_accepted:
        exit_if_failed(failed)


def _modes(predicted: StoredPredictions, responses: Sequence[ResponseBands]) -> dict[str, Any]:
    """Predicted frequencies, for a JSON record: low, median and high of each mode."""
    from bayes_ssi.results.predictions.predictions import predicted_modes

    return {
        each.name: {
            mode.label: list(mode.after_hz)
            for mode in predicted_modes(predicted.data, each.predictions, each.request.level)
        }
        for each in responses
    }


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
    from bayes_ssi.results.predictions.prediction_files import MotionRecord, PredictionsRecord

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
