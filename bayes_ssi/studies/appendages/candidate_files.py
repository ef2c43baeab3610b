"""Candidates of a search from a CSV file: one row per place."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.text_files import read_columns
from bayes_ssi.structures.candidate import Candidate
from bayes_ssi.structures.geometry import Point
from bayes_ssi.structures.motion import Place
from bayes_ssi.studies.appendages.candidates import require_distinct

REQUIRED = ("name", "place")
DIRECTION = ("x", "y", "z")
COORDINATES = ("x_coord", "y_coord", "z_coord")
COLUMNS = (*REQUIRED, *DIRECTION, *COORDINATES, "to")


@checked
def read_candidates(path: str | Path) -> tuple[Candidate, ...]:
    """Candidates of a search from a CSV file.

    ::

        name,        place,     x,   y,   z, x_coord, y_coord, z_coord
        roof edge,   node 7,  0.6, 0.8,    ,    12.0,     0.0,     9.5
        mast,        node 9 x,    ,    ,    ,    15.0,     0.0,    11.0

    ``place`` is the label of a degree of freedom or of a sensor. Where a row gives a direction by
    its cosines ``x``, ``y``, ``z`` (scaled to unit length; an empty one is zero), ``place`` is a
    node with degrees of freedom that are labelled by it and the axis: ``node 7 x``, ``node 7 y``,
    ``node 7 z``. Coordinates are optional, and so is ``to``, the label of the other end of an
    element between two places (``0`` for the ground).

    Args:
        path: the file; rows that begin with ``#`` are comments, and columns are separated by commas
            or as a first line such as ``sep=;`` says.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is empty, a column is missing or unknown, a cell is not valid, or a name or
            place is there twice; the message names the file and the line.
    """
    path = Path(path)
    text, delimiter = read_columns(path)
    reader = csv.reader(text.splitlines(), delimiter=delimiter or ",", skipinitialspace=True)
    numbered = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    lines = [(n, row) for n, row in numbered if any(row) and not row[0].startswith("#")]
    if len(lines) < 2:
        raise ValueError(f"{path}: no candidate below the column names {','.join(REQUIRED)}")
    columns = _columns(lines[0][1], path)
    candidates = []
    for number, row in lines[1:]:
        where = f"{path}, line {number}"
        if len(row) > len(columns):
            raise ValueError(f"{where}: {len(row)} cells for {len(columns)} columns")
        try:
            candidates.append(_candidate(dict(zip(columns, row, strict=False))))
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
    try:
        require_distinct(candidates)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return tuple(candidates)


def _columns(names: list[str], path: Path) -> list[str]:
    missing = [name for name in REQUIRED if name not in names]
    unknown = [name for name in names if name not in COLUMNS]
    repeated = [name for name in names if names.count(name) > 1]
    for wrong, what in ((missing, "no column"), (unknown, "unknown column"),
                        (repeated, "two columns")):  # fmt: skip
        if wrong:
            raise ValueError(
                f"{path}: {what} {wrong[0]!r}; the columns are {', '.join(REQUIRED)} and, if "
                f"needed, {', '.join(COLUMNS[len(REQUIRED) :])}"
            )
    return names


def _candidate(cells: Mapping[str, str]) -> Candidate:
    place: Place | dict[str, float] = cells.get("place", "")
    direction = _numbers(cells, DIRECTION)
    if direction is not None:
        length = math.hypot(*direction)
        if length == 0.0:
            raise ValueError("x, y, z: a direction of zeros")
        x, y, z = (cosine / length for cosine in direction)
        direction = x, y, z
        each = zip(DIRECTION, direction, strict=True)
        place = {f"{place} {axis}": cosine for axis, cosine in each if cosine != 0.0}
    to: Place | None = cells.get("to") or None
    coordinates = _numbers(cells, COORDINATES)
    if coordinates is not None and any(not cells.get(name) for name in COORDINATES):
        raise ValueError("x_coord, y_coord, z_coord: give all three, or none")
    return Candidate(
        cells.get("name", ""),
        place,
        to=0 if to == "0" else to,
        coordinates=coordinates,
        direction=direction,
    )


def _numbers(cells: Mapping[str, str], names: tuple[str, str, str]) -> Point | None:
    """Three numbers, zero where a cell is empty; None where all are."""
    if not any(cells.get(name) for name in names):
        return None
    numbers = []
    for name in names:
        cell = cells.get(name) or "0"
        try:
            number = float(cell)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise ValueError(f"{name}: {cell!r} is not a number")
        numbers.append(number)
    x, y, z = numbers
    return x, y, z
