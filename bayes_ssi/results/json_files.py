"""Records on disk, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TypeVar

from bayes_ssi.foundations.codec import from_record, to_record

T = TypeVar("T")


def write_json(path: Path, value: Any) -> None:
    """Write the record of an object, from :func:`~bayes_ssi.foundations.codec.to_record`."""
    text = json.dumps(to_record(value), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_record(kind: type[T], path: Path) -> T:
    """Read an object from a record that :func:`write_json` wrote."""
    record = read_json(path)
    try:
        return from_record(kind, record)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_json(path: Path) -> dict[str, Any]:
    """Read a record."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path.parent}: not a result directory: no {path.name}") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: damaged: {error}") from None
    if not isinstance(record, dict):
        raise ValueError(f"{path}: damaged: not a record")
    return record
