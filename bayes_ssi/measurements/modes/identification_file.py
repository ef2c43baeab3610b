"""The JSON file of how modes were identified, which the CSV file of the modes names.

It holds ``identifications``: a record of each vibration record that the modes come from, one, or
several where modes were merged. Paths of figures are relative to the file's directory.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.measurements.modes.identification_record import IdentificationRecord


@dataclass(frozen=True)
class _Identifications:
    identifications: tuple[IdentificationRecord, ...]


def identification_path(path: str | Path) -> Path:
    """Where it is written how the modes in a CSV file were identified."""
    return Path(path).with_suffix(".identification.json")


def write_identifications(identifications: Sequence[IdentificationRecord], path: Path) -> None:
    """Write how modes were identified to a new file."""
    moved = tuple(
        replace(each, figures=tuple(os.path.relpath(file, path.parent) for file in each.figures))
        for each in identifications
    )
    with path.open("x", encoding="utf-8") as file:
        json.dump(to_record(_Identifications(moved)), file, indent=1)


def read_identifications(path: Path, csv_path: Path) -> tuple[IdentificationRecord, ...]:
    """How the modes in a CSV file were identified."""
    try:
        content = from_record(_Identifications, json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ValueError(
            f"{csv_path}: no file {path.name}, which its line 'identification' names, in its "
            "directory; put it there, or remove the line, and with it what is known of failed "
            "checks"
        ) from None
    except ValueError as error:
        raise ValueError(
            f"{path}: no record of an identification that this version reads: {error}; identify "
            f"again, or remove the line 'identification' of {csv_path.name}, and with it what is "
            "known of failed checks"
        ) from None
    return tuple(
        replace(each, figures=tuple(str(path.parent / file) for file in each.figures))
        for each in content.identifications
    )
