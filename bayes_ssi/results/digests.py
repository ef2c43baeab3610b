"""Digests of a result's files, by which a file that was changed afterwards is recognised."""

from __future__ import annotations

import hashlib
from pathlib import Path

from bayes_ssi.results.json_files import read_json, write_json

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
