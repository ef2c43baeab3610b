"""Records on disk, as JSON."""

from __future__ import annotations

import hashlib
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


DIGESTS = "digests.json"


def write_digests(directory: Path) -> None:
    """Write the digests of all files that are in a directory now."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    write_json(
        directory / DIGESTS,
        {path.relative_to(directory).as_posix(): _digest(path) for path in files},
    )


def check_digest(directory: Path, name: str) -> None:
    """Check that a file is as it was saved."""
    if read_json(directory / DIGESTS).get(name) != _digest(directory / name):
        raise ValueError(
            f"{directory / name}: changed after the result was saved, so that its numbers are not "
            "those that were computed; run the study again"
        )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
