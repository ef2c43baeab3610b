"""Predictions that were saved in a result directory, for reports."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bayes_ssi.results.json_files import read_record

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
    """What was predicted, and from what.

    Attributes:
        configuration: the one that is predicted; empty where there is only one.
        transfer_functions: their output and input; None where there are none.
    """

    study: str
    result_created: str
    configuration: str
    predictions_of: tuple[str, ...]
    draws: int
    level: float
    quantity: str
    places: tuple[str, ...]
    damping: float | tuple[float, ...]
    transfer_functions: str | None
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
