"""Predictions as CSV files: one row for each model class, place and point."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results.predictions.bands import Band
from bayes_ssi.results.predictions.predictions import (
    predicted_modes,
    predicted_shapes,
    shown_places,
)
from bayes_ssi.results.predictions.response_bands import ResponseBands
from bayes_ssi.results.result_files import read_record, write_csv

# The file that every directory of predictions holds.
MARKER = "predictions.json"
# Tables that fit on a page; the others are curves, shown as figures.
TABLES = ("frequencies.csv", "peaks.csv")


@dataclass(frozen=True)
class MotionRecord:
    """A ground motion of the time histories."""

    name: str
    samples: int
    dt_s: float


@dataclass(frozen=True)
class PredictionsRecord:
    """What was predicted, and from what."""

    study: str
    result_created: str
    configuration: str  # the one that is predicted; empty where there is only one
    predictions_of: tuple[str, ...]
    draws: int
    level: float
    quantity: str
    places: tuple[str, ...]
    damping: float | tuple[float, ...]
    transfer_functions: str | None  # their output and input; None where there are none
    records: tuple[MotionRecord, ...]
    versions: Mapping[str, str]


@dataclass(frozen=True)
class SavedPredictions:
    """Saved predictions: their record, tables (the first row names columns) and figures."""

    record: PredictionsRecord
    tables: Mapping[str, list[list[str]]]
    figures: tuple[Path, ...]


def load_saved_predictions(result: Path) -> SavedPredictions | None:
    """The predictions saved in a result directory; None if there are none."""
    directory = result / "predictions"
    if not (directory / MARKER).is_file():
        return None
    tables = {}
    for name in TABLES:
        if (directory / name).is_file():
            with (directory / name).open(encoding="utf-8", newline="") as file:
                tables[name] = list(csv.reader(file))
    figures = tuple(sorted(directory.glob("figures/*.png")))
    return SavedPredictions(read_record(PredictionsRecord, directory / MARKER), tables, figures)


COLUMNS = ("low", "median", "high")


def save_predictions(
    directory: str | Path, data: ModalData, responses: Sequence[ResponseBands]
) -> None:
    """Write predictions of one request into ``directory``, which exists.

    ``frequencies.csv``, ``mode_shapes.csv`` and, where requested, ``transfer_functions.csv``,
    ``time_histories.csv`` and ``peaks.csv`` (for both).
    """
    directory, request = Path(directory), responses[0].request
    level = request.level
    _write(
        directory / "frequencies.csv",
        ("model_class", "mode", "identified_hz", "before_hz", *COLUMNS, "share"),
        (
            (each.name, mode.label, mode.identified_hz, mode.before_hz, *mode.after_hz, mode.share)
            for each in responses
            for mode in predicted_modes(data, each.predictions, level)
        ),
    )
    _write(
        directory / "mode_shapes.csv",
        ("model_class", "mode", "place", *COLUMNS),
        (
            (each.name, label, *row)
            for each in responses
            for label, shape in predicted_shapes(data, each.predictions, level)
            for row in zip(shown_places(each.predictions, data), *shape, strict=True)
        ),
    )
    if request.frequencies_hz is not None:
        _write(
            directory / "transfer_functions.csv",
            ("model_class", "place", "frequency_hz", *COLUMNS),
            (
                (each.name, *row)
                for each in responses
                if each.transfer_functions is not None
                for row in _points(each, request.frequencies_hz, each.transfer_functions)
            ),
        )
    if request.motions:
        _write(
            directory / "time_histories.csv",
            ("record", "model_class", "place", "time_s", *COLUMNS),
            (
                (motion.name, each.name, *row)
                for motion in request.motions
                for each in responses
                for row in _points(each, motion.times, each.time_histories[motion.name])
            ),
        )
    if request.frequencies_hz is not None or request.motions:
        _write(
            directory / "peaks.csv",
            ("model_class", "of", "unit", "place", *COLUMNS),
            (row for each in responses for row in _peaks(each)),
        )


def _peaks(each: ResponseBands) -> Iterator[Sequence[object]]:
    transfer = f"transfer function: {each.request.transfer_name}"
    for motion, *row in each.peak_rows():
        yield (each.name, transfer if motion is None else f"time history: {motion}", *row)


def _points(each: ResponseBands, points: FloatArray, band: Band) -> Iterator[Sequence[object]]:
    """Place, point, low, median and high."""
    for i, place in enumerate(each.request.output.labels):
        for row in zip(points, *(part[i] for part in band), strict=True):
            yield (place, *row)


def _write(path: Path, heading: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file with seven digits of every number."""
    write_csv(
        path,
        heading,
        ([f"{c:.7g}" if isinstance(c, (float, np.floating)) else c for c in row] for row in rows),
    )
