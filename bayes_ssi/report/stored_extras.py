"""What may lie beside a ranking in its directory: a search, its sensitivity, predictions."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from bayes_ssi.appendages.hypotheses import Place
from bayes_ssi.ranking.sensitivity import Sensitivity, sensitivity_of_record
from bayes_ssi.results.load import StoredResult, load_result

__all__ = ["StoredExtras", "StoredPredictionFiles", "StoredSearch", "load_beside"]

# Tables of predictions that a page has room for; the others are curves, shown as figures.
TABLES = ("frequencies.csv", "peaks.csv")

T = TypeVar("T")


@dataclass(frozen=True)
class StoredSearch:
    """What a search found, as it was stored.

    Attributes:
        probability_of_any: that there is at least one appendage.
        places: place → probability that an appendage hangs there.
        hypotheses: records of the hypotheses, the most probable first.
        averaged_parameters: records of the baseline's parameters.
    """

    probability_of_any: float
    places: dict[Place, float]
    hypotheses: list[dict[str, Any]]
    averaged_parameters: list[dict[str, Any]]


@dataclass(frozen=True)
class StoredPredictionFiles:
    """Predictions that were saved: their record, tables (the first row names columns), figures."""

    record: dict[str, Any]
    tables: dict[str, list[list[str]]]
    figures: list[Path]


@dataclass(frozen=True)
class StoredExtras:
    """What lies beside a ranking; None where there is none."""

    search: StoredSearch | None
    sensitivity: Sensitivity | None
    predictions: StoredPredictionFiles | None


def load_beside(directory: str | Path) -> tuple[StoredResult, StoredExtras]:
    """A result and everything beside it.

    Raises:
        ValueError: a part of it is damaged or incomplete; the message names the file.
    """
    stored = load_result(directory)
    path = stored.directory
    return stored, StoredExtras(
        _read(path / "search.json", _search),
        _read(path / "sensitivity.json", sensitivity_of_record),
        _read(path / "predictions" / "predictions.json", _Predictions(path / "predictions")),
    )


def _read(path: Path, make: Callable[[Any], T]) -> T | None:
    if not path.is_file():
        return None
    try:
        return make(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: damaged: {type(error).__name__}: {error}") from error


def _search(record: dict[str, Any]) -> StoredSearch:
    return StoredSearch(
        float(record["probability_of_any"]),
        {
            Place(place["kind"], tuple(place["floors"])): float(place["probability"])
            for place in record["places"]
        },
        list(record["hypotheses"]),
        list(record["averaged_parameters"]),
    )


@dataclass(frozen=True)
class _Predictions:
    directory: Path

    def __call__(self, record: dict[str, Any]) -> StoredPredictionFiles:
        tables = {}
        for name in TABLES:
            if (self.directory / name).is_file():
                with (self.directory / name).open(encoding="utf-8", newline="") as file:
                    tables[name] = list(csv.reader(file))
        return StoredPredictionFiles(
            dict(record), tables, sorted(self.directory.glob("figures/*.png"))
        )
