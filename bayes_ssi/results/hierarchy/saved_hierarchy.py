"""Hierarchies on disk."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.packages import versions
from bayes_ssi.results.hierarchy.hierarchy_record import Hierarchy
from bayes_ssi.results.result_files import new_directory, read_json, read_record, write_json

# The file that every directory of this kind holds.
MARKER = "hierarchy.json"
# Increased whenever the format of the files changes.
FORMAT = 1
# Number of draws of the parameters in the next test that are written.
NEXT_TESTS = 1000


@dataclass(frozen=True)
class HierarchyRecord:
    """What ``hierarchy.json`` holds.

    Attributes:
        results: name of a test → directory of its result; empty where they were not read from
            files.
        command: the command that reproduces it; empty where it was made from Python.
    """

    hierarchy: Hierarchy
    results: Mapping[str, str]
    command: str
    created: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    versions: Mapping[str, str] = field(default_factory=versions)
    format: int = FORMAT


@checked
def save_hierarchy(
    hierarchy: Hierarchy,
    directory: str | Path,
    *,
    covariate: float | None = None,
    results: Mapping[str, str] | None = None,
    overwrite: bool = False,
    command: str = "",
) -> None:
    """Write a hierarchy, and draws of the parameters in the next test, to a new directory.

    Args:
        hierarchy: the result.
        directory: where it goes.
        covariate: its value in the next test; the mean of the tests if None.
        results: name of a test → directory of its result, for the record.
        overwrite: replace a hierarchy that exists.
        command: the command that reproduces the result, for the record.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds something else.
        ValueError: there is no covariate.
    """
    draws = hierarchy.next_test(NEXT_TESTS, covariate)
    with new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        write_json(partial / MARKER, HierarchyRecord(hierarchy, results or {}, command))
        path = partial / "next_test.csv"
        with path.open("x", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([parameter.name for parameter in hierarchy.parameters])
            writer.writerows([f"{value:.7g}" for value in row] for row in draws)


@checked
def load_hierarchy(directory: str | Path) -> Hierarchy:
    """Read a directory that :func:`save_hierarchy` wrote.

    Raises:
        ValueError: it does not exist, is damaged, or was written by another version.
    """
    path = Path(directory) / MARKER
    stored_format = read_json(path).get("format")
    if stored_format != FORMAT:
        raise ValueError(
            f"{directory}: a hierarchy of format {stored_format!r}, this version reads format "
            f"{FORMAT}; compute it again"
        )
    return read_record(HierarchyRecord, path).hierarchy
