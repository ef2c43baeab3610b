"""What a stored result predicts: the question, its answer, and that as tables and CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from bayes_ssi.ground_motion import GroundMotion
from bayes_ssi.predictions import AVERAGE, Band, Prediction, Predictions
from bayes_ssi.priors import FloatArray
from bayes_ssi.response import Damping, Output, checked_frequencies, damping_ratios
from bayes_ssi.stored_predictions import StoredPredictions

__all__ = [
    "PER_GROUND",
    "UNITS",
    "Answer",
    "Question",
    "answer",
    "frequency_table",
    "peak_table",
    "save_tables",
]

UNITS = {"displacement": "m", "acceleration": "m/s²", "drift": "m"}
PER_GROUND = {"displacement": "s²", "acceleration": "-", "drift": "s²"}


@dataclass(frozen=True, eq=False)
class Question:
    """What is to be predicted.

    Attributes:
        output: the response quantity and its places.
        damping: ratio of all modes, or of each.
        frequencies_hz: (F,), of transfer functions from the ground's acceleration.
        motion: ground motion of time histories; none are computed if None.
        level: of the credible bands.

    Raises:
        ValueError: damping, frequencies or level make no sense.
    """

    output: Output
    damping: Damping
    frequencies_hz: FloatArray
    motion: GroundMotion | None = None
    level: float = 0.95

    def __post_init__(self) -> None:
        checked_frequencies(self.frequencies_hz)
        damping_ratios(self.damping, np.size(self.damping))
        Prediction(np.zeros(1)).band(self.level)


@dataclass(frozen=True, eq=False)
class Answer:
    """Predictions of one model class, or of the average.

    Attributes:
        predictions: the draws.
        question: what was asked.
        transfer_functions: amplitudes, draws (n, n_places, F).
        time_histories: draws (n, n_places, n_samples), where there is a ground motion.
        peaks: draws (n, n_places), where there is a ground motion.
    """

    predictions: Predictions
    question: Question
    transfer_functions: Prediction
    time_histories: Prediction | None
    peaks: Prediction | None

    @property
    def name(self) -> str:
        return self.predictions.name


def answer(predicted: StoredPredictions, name: str, question: Question) -> Answer:
    """Predictions of the model class ``name``, or of the average over all for ``"average"``.

    Raises:
        ValueError: there is no such class, it has changed since it was sampled, or a place is
            not on its structure.
        TypeError: its structure does not know its masses.
    """
    predictions = predicted.average() if name == AVERAGE else predicted.of_class(name)
    output, damping, motion = question.output, question.damping, question.motion
    histories = None if motion is None else predictions.time_histories(motion, output, damping)
    return Answer(
        predictions,
        question,
        predictions.transfer_functions(question.frequencies_hz, output, damping),
        histories,
        None if histories is None else Prediction(np.abs(histories.draws).max(-1)),
    )


def frequency_table(predicted: StoredPredictions, answers: Sequence[Answer]) -> Table:
    """Predicted frequency of every identified mode, median and band.

    A mode that only some of the averaged classes explain shows in what share of the draws.
    """
    table = _table("Natural frequencies (Hz)")
    for heading in ("model class", "mode", "identified", "median", "band", "share"):
        table.add_column(heading, justify="left" if heading == "model class" else "right")
    for each in answers:
        for label, prediction in _frequencies(predicted, each.predictions):
            low, median, high = prediction.band(each.question.level)
            identified = predicted.stored.data.mode(label).frequency_hz
            cells = (
                each.name, label, f"{identified:.4g}", f"{median:.4g}",
                f"{low:.4g}-{high:.4g}", f"{prediction.share:.3g}",
            )  # fmt: skip
            table.add_row(*map(Text, cells))
    return table


def peak_table(answers: Sequence[Answer]) -> Table:
    """Peak of the transfer function and of the time history at every place."""
    quantity = answers[0].question.output.quantity
    table = _table(f"Peak {quantity}: median and band")
    table.add_column("model class", overflow="fold")
    table.add_column("place", overflow="fold")
    table.add_column(f"transfer function ({PER_GROUND[quantity]})", justify="right")
    table.add_column(f"time history ({UNITS[quantity]})", justify="right")
    for each in answers:
        level = each.question.level
        highest = Prediction(each.transfer_functions.draws.max(-1)).band(level)
        peaks = None if each.peaks is None else each.peaks.band(level)
        for i, place in enumerate(each.question.output.labels):
            cells = (
                each.name,
                place,
                _interval(highest, i),
                "-" if peaks is None else _interval(peaks, i),
            )
            table.add_row(*map(Text, cells))
    return table


def save_tables(
    predicted: StoredPredictions, answers: Sequence[Answer], directory: str | Path
) -> list[Path]:
    """Write the answers to one question as CSV files into a new directory.

    ``frequencies.csv``, ``transfer_functions.csv`` and, where there is a ground motion,
    ``time_histories.csv`` and ``peaks.csv``: a row a class, place and point, with low, median and
    high.

    Raises:
        FileExistsError: the directory exists.
    """
    directory = Path(directory)
    directory.mkdir(parents=True)
    question = answers[0].question
    columns = ("low", "median", "high")
    _write(
        directory / "frequencies.csv",
        ("model_class", "mode", "share", *columns),
        (
            (each.name, label, prediction.share, *prediction.band(question.level))
            for each in answers
            for label, prediction in _frequencies(predicted, each.predictions)
        ),
    )
    transfer = [(each.name, each.transfer_functions) for each in answers]
    _write_over(
        directory / "transfer_functions.csv", "frequency_hz", question.frequencies_hz,
        question, transfer,
    )  # fmt: skip
    if question.motion is not None:
        histories = [(each.name, each.time_histories) for each in answers if each.time_histories]
        _write_over(
            directory / "time_histories.csv", "time_s", question.motion.times, question, histories
        )
        _write(
            directory / "peaks.csv",
            ("model_class", "place", *columns),
            (
                (each.name, place, *numbers)
                for each in answers
                if each.peaks is not None
                for place, *numbers in zip(
                    question.output.labels, *each.peaks.band(question.level), strict=True
                )
            ),
        )
    return sorted(directory.iterdir())


def _frequencies(
    predicted: StoredPredictions, predictions: Predictions
) -> Iterable[tuple[str, Prediction]]:
    """The identified modes that a prediction explains."""
    explained = {label for each in predictions.classes for label in each.pairing}
    for label in predicted.stored.data.labels:
        if label in explained:
            yield label, predictions.frequencies_hz(label)


def _interval(band: Band, i: int) -> str:
    low, median, high = (part[i] for part in band)
    return f"{median:.4g} ({low:.4g}-{high:.4g})"


def _table(title: str) -> Table:
    return Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)


def _write_over(
    path: Path,
    axis: str,
    points: FloatArray,
    question: Question,
    predictions: Iterable[tuple[str, Prediction]],
) -> None:
    """A row a class, place and point of an axis."""

    def rows() -> Iterable[Sequence[object]]:
        for name, prediction in predictions:
            band = prediction.band(question.level)
            for i, place in enumerate(question.output.labels):
                for row in zip(points, *(part[i] for part in band), strict=True):
                    yield (name, place, *row)

    _write(path, ("model_class", "place", axis, "low", "median", "high"), rows())


def _write(path: Path, names: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in rows:
            writer.writerow(
                f"{cell:.6g}" if isinstance(cell, (float, np.floating)) else cell for cell in row
            )
