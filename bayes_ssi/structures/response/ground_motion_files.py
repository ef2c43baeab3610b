"""Files of ground motion: PEER's AT2, and plain text or CSV of one or two columns.

AT2: four header lines, of which the third states the unit and the fourth the number of points
and dt, then the accelerations in rows.

Plain files hold one column, acceleration, or two, time (s) and acceleration, separated by spaces,
commas, semicolons or tabs (with semicolons or tabs a decimal comma is understood)::

    # unit, cm/s2
    # dt_s, 0.005
    time_s, acceleration
    0.000, -0.12
    0.005, -0.15

Lines that start with ``#`` may hold the keys ``unit`` and ``dt_s``; other comments and one row of
column names are skipped, and a first line ``sep=;`` states the delimiter. The unit is the caller's
or else the file's; dt that of a time column, of the key or of the caller, which must agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.text_files import read_columns
from bayes_ssi.structures.response.ground_motion import UNITS, GroundMotion, checked_unit

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"


# After "UNITS OF", "UNITS:" or "UNITS =" in the header of an AT2 file.
UNIT = r"\bunits?\s*(?:\bof\b|:|=)\s*([^\s,;.]+)"


# A line such as "# dt_s, 0.005" or "# unit: g".
KEY = re.compile(r"[\s#]*(unit|dt_s)\s*[,;:]\s*(.*?)[\s,;]*$")


class _Content(NamedTuple):
    """Contents of a file: accelerations, and every statement of their unit and of dt."""

    samples: Sequence[float]
    units: Sequence[str]
    dts: Sequence[float]


@checked
def read_ground_motion(
    path: str | Path, *, unit: str | None = None, dt: float | None = None
) -> GroundMotion:
    """Read the acceleration of the ground from a PEER AT2 file or from plain columns.

    :mod:`bayes_ssi.structures.response.ground_motion_files` describes the files.

    Args:
        path: the file; one whose name ends in .AT2 is read as PEER's.
        unit: "g", "m/s2" or "cm/s2", for instance, in place of the file's; needed where the file
            states none.
        dt: time between samples in s; needed where the file does not state it.

    Raises:
        OSError: the file cannot be read.
        ValueError: the content is not understood, unit or dt are missing, dt is contradicted by
            the file, or there are fewer than two samples. The message names the file.
    """
    path = Path(path)
    text, delimiter = read_columns(path)
    lines = text.splitlines()
    try:
        is_at2 = path.suffix.lower() == ".at2"
        content = _read_at2(lines) if is_at2 else _read_plain(lines, delimiter)
        if len(content.samples) < 2:
            raise ValueError(f"a record needs two samples or more, got {len(content.samples)}")
        units = [checked_unit(each) for each in (content.units if unit is None else [unit])]
        if dt is not None and not 0 < dt < math.inf:
            raise ValueError(f"dt must be positive and finite (s), got {dt!r}")
        dts = [each for each in (dt, *content.dts) if each is not None]
        if not units:
            choices = ", ".join(map(repr, UNITS))
            raise ValueError(f"the unit of the acceleration is not given; give one of {choices}")
        for other in units:
            if other != units[0]:
                raise ValueError(
                    f"two units of the acceleration are given: {units[0]!r} and {other!r}"
                )
        if not dts:
            raise ValueError("dt, the time between samples, is not given; give it in s")
        for step in dts:
            if not math.isclose(dts[0], step, rel_tol=1e-3):  # some round to three digits
                raise ValueError(f"two values of dt are given: {dts[0]!r} and {step!r} s")
        return GroundMotion.of(content.samples, units[0], dts[0], path.stem)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read_at2(lines: Sequence[str]) -> _Content:
    at = next((i for i, line in enumerate(lines) if "NPTS" in line.upper()), None)
    if at is None:
        raise ValueError("not a PEER AT2 file: no header line states NPTS and DT")
    n_points, dts = _points_and_dt(lines[at])
    units = re.findall(UNIT, " ".join(lines[:at]), re.IGNORECASE)
    samples: list[float] = []
    for i, line in enumerate(lines[at + 1 :], at + 2):
        # In AT2's fixed columns a minus sign may touch the number before it.
        if rest := re.sub(NUMBER, "", line).strip():
            raise ValueError(f"line {i}: expected accelerations, got {rest!r}")
        samples += [float(re.sub("[dD]", "e", each)) for each in re.findall(NUMBER, line)]
    if len(samples) != n_points:
        raise ValueError(f"the header says NPTS = {n_points}, but {len(samples)} values follow")
    return _Content(samples, units, dts)


def _points_and_dt(line: str) -> tuple[int, list[float]]:
    """NPTS and DT of an AT2 header, in its newer form (NPTS= 3, DT= .01 SEC) or its older one."""
    older = re.match(rf"\s*(\d+)\s+({NUMBER})\s+NPTS", line, re.IGNORECASE)
    if older is not None:
        return int(older.group(1)), [float(older.group(2))]
    points = re.search(r"NPTS\s*=\s*(\d+)", line, re.IGNORECASE)
    if points is None:
        raise ValueError(f"the header's line {line.strip()!r} holds no number of points (NPTS)")
    steps = re.findall(rf"DT\s*=\s*({NUMBER})", line, re.IGNORECASE)
    return int(points.group(1)), [float(step) for step in steps]


def _read_plain(lines: Sequence[str], delimiter: str | None) -> _Content:
    units: list[str] = []
    dts: list[float] = []
    rows: list[list[float]] = []
    column_names: list[str] = []
    for i, line in enumerate(lines, 1):
        cells = _cells(line, delimiter)
        if line.lstrip().startswith("#"):
            if (stated := KEY.match(line)) is None:
                continue
            if stated[1] == "unit":
                units.append(stated[2])
            else:
                dts.append(_number(stated[2].replace(",", "."), i, "dt_s"))
        elif not rows and not column_names and not any(_is_number(cell) for cell in cells):
            column_names = cells
        elif cells:
            if len(cells) not in (1, 2) or (rows and len(cells) != len(rows[0])):
                expected = f"{len(rows[0])}, as above" if rows else "1 or 2"
                raise ValueError(f"line {i}: expected {expected} column(s), got {len(cells)}")
            rows.append([_number(cell, i, "value") for cell in cells])
    if not rows:
        raise ValueError("the file holds no acceleration")
    table = np.array(rows)
    if len(rows) >= 2 and table.shape[1] == 2:
        dts.append(_step_of(table[:, 0]))
    return _Content(table[:, -1].tolist(), units, dts)


def _cells(line: str, stated: str | None) -> list[str]:
    """The cells of a line, at the delimiter that the file states or else the first in it."""
    delimiter = stated or next((each for each in ";\t," if each in line.strip()), None)
    if delimiter in (";", "\t"):
        line = line.replace(",", ".")
    return [cell.strip() for cell in line.split(delimiter)] if line.strip() else []


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str, line: int, what: str) -> float:
    if not _is_number(cell) or not math.isfinite(float(cell)):
        raise ValueError(f"line {line}: {what} must be a finite number, got {cell!r}")
    return float(cell)


def _step_of(times: np.ndarray) -> float:
    """The step dt of a column of times."""
    step = float(times[-1] - times[0]) / (len(times) - 1)
    deviation = np.abs(times - times[0] - step * np.arange(len(times)))
    # A missing sample puts some time off by half a step or more; rounding by much less.
    if not step > 0 or deviation.max() > 0.25 * step:
        steps = np.diff(times)
        longest = int(np.abs(steps - np.median(steps)).argmax())
        raise ValueError(
            "the first of two columns must be times in equal steps (s), but after "
            f"{float(times[longest])!r} comes {float(times[longest + 1])!r}"
        )
    return step
