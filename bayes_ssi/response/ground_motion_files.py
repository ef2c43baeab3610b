"""Files of ground motion: PEER's AT2, and plain text or CSV of one or two columns.

AT2: four lines of header, of which the third names the unit and the fourth holds the number of
points and dt, then the accelerations in rows. Unit, number and dt are checked.

Plain files hold one column, acceleration, or two, time (s) and acceleration, separated by spaces,
commas, semicolons or tabs (with semicolons or tabs a decimal comma is understood)::

    # unit, cm/s2
    # dt_s, 0.005
    time_s, acceleration
    0.000, -0.12
    0.005, -0.15

Lines that start with ``#`` may hold the keys ``unit`` and ``dt_s``; other remarks and one row of
column names are passed over, but a unit that the name of the last column holds, as in
``acceleration_g`` or ``acc (cm/s2)``, counts. The unit must be given there or by the caller, and
dt by a time column, the key or the caller; what is given twice must agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayes_ssi.response.ground_motion import UNITS, GroundMotion, checked_unit

__all__ = ["read_ground_motion"]

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?"
# A unit at the end of a column's name: acceleration_g, acc (m/s2), a [cm/s^2].
UNIT_IN_NAME = re.compile(r"[\s_(\[](g|gal|c?m/s(?:\^|\*\*)?[2²])[\s)\]]*$", re.IGNORECASE)
# Written times are rounded: one may be off by this share of a step. A missing sample puts one off
# by half a step or more.
TIME_TOLERANCE = 0.25
# Two statements of dt agree within this.
DT_TOLERANCE = 1e-3


def read_ground_motion(
    path: str | Path, *, unit: str | None = None, dt: float | None = None
) -> GroundMotion:
    """Read a record (see the module's text for the forms it may have).

    Args:
        path: the file; one whose name ends in .AT2 is read as PEER's.
        unit: "g", "m/s2" or "cm/s2", of the accelerations; needed where the file does not say.
        dt: time between samples in s, where the file does not say.

    Raises:
        OSError: the file cannot be read.
        ValueError: the content is not understood, unit or dt are not given or given differently,
            or there are fewer than two samples. The message names the file.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file in UTF-8") from None
    if not text.strip():
        raise ValueError(f"{path}: the file is empty")
    try:
        if dt is not None and not 0.0 < dt < math.inf:
            raise ValueError(f"dt must be positive and finite (s), got {dt!r}")
        unit = None if unit is None else checked_unit(unit)
        read = _read_at2 if path.suffix.lower() == ".at2" else _read_plain
        return read(text, path.stem, unit, dt)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read_at2(text: str, name: str, unit: str | None, dt: float | None) -> GroundMotion:
    lines = text.splitlines()
    at = next((i for i, line in enumerate(lines) if "NPTS" in line.upper()), None)
    if at is None:
        raise ValueError("not a PEER AT2 file: no line of its header names NPTS and DT")
    n_points, file_dt = _points_and_dt(lines[at])
    stated = re.search(r"units?\s+of\s+([^\s,;.]+)", " ".join(lines[:at]), re.IGNORECASE)
    samples = _numbers(lines[at + 1 :], at + 2)
    if len(samples) != n_points:
        raise ValueError(f"the header says NPTS = {n_points}, but {len(samples)} values follow")
    found_unit = _agreed_unit(unit, checked_unit(stated.group(1)) if stated else None)
    return GroundMotion.of(samples, found_unit, _agreed_dt(dt, file_dt), name)


def _points_and_dt(line: str) -> tuple[int, float | None]:
    """NPTS and DT of an AT2 header, in its newer form (NPTS= 3, DT= .01 SEC) or its older one."""
    points = re.search(r"NPTS\s*=\s*(\d+)", line, re.IGNORECASE)
    step = re.search(rf"DT\s*=\s*({NUMBER})", line, re.IGNORECASE)
    older = re.match(rf"\s*(\d+)\s+({NUMBER})\s+NPTS", line, re.IGNORECASE)
    if points is None and older is not None:
        return int(older.group(1)), float(older.group(2))
    if points is None:
        raise ValueError(f"the header's line {line.strip()!r} holds no number of points (NPTS)")
    return int(points.group(1)), None if step is None else float(step.group(1))


def _numbers(lines: Sequence[str], first_line: int) -> list[float]:
    """All numbers of some lines; in AT2's fixed columns a minus sign may touch its neighbour."""
    numbers: list[float] = []
    for i, line in enumerate(lines, first_line):
        if rest := re.sub(NUMBER, "", line).strip():
            raise ValueError(f"line {i}: expected accelerations, found {rest!r}")
        numbers += [float(each.translate(_FORTRAN)) for each in re.findall(NUMBER, line)]
    return numbers


_FORTRAN = str.maketrans("dD", "eE")


def _read_plain(text: str, name: str, unit: str | None, dt: float | None) -> GroundMotion:
    units: list[str] = []
    dts: list[float] = []
    rows: list[list[float]] = []
    named = False
    for i, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        if line.lstrip().startswith("#"):
            key, _, value = line.lstrip(" \t#").partition(",")
            if key.strip() == "unit":
                units.append(checked_unit(value.strip(" ,;\t")))
            elif key.strip() == "dt_s":
                dts.append(_number(value.strip(" ,;\t"), i, "dt_s"))
            continue
        cells = _cells(line)
        if not rows and not named and not any(_is_number(cell) for cell in cells):
            named = True
            if found := UNIT_IN_NAME.search(line.strip()):
                units.append(checked_unit(found.group(1)))
            continue
        if len(cells) not in (1, 2) or (rows and len(cells) != len(rows[0])):
            expected = f"{len(rows[0])}, as above" if rows else "1 or 2"
            raise ValueError(f"line {i}: expected {expected} column(s), found {len(cells)}")
        rows.append([_number(cell, i, "value") for cell in cells])
    if not rows:
        raise ValueError("the file holds no acceleration")
    table = np.array(rows)
    if len(rows) >= 2 and table.shape[1] == 2:
        dts.append(_step_of(table[:, 0]))
    for stated_dt in dts:
        dt = _agreed_dt(dt, stated_dt)
    for stated_unit in units:
        unit = _agreed_unit(unit, stated_unit)
    if len(rows) < 2:
        raise ValueError(f"a record needs two samples or more, got {len(rows)}")
    return GroundMotion.of(table[:, -1], _agreed_unit(unit, None), _agreed_dt(dt, None), name)


def _cells(line: str) -> list[str]:
    for delimiter in (";", "\t"):
        if delimiter in line:
            return [cell.strip().replace(",", ".") for cell in line.split(delimiter)]
    return [cell.strip() for cell in line.split(",")] if "," in line else line.split()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str, line: int, what: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"line {line}: {what} must be a finite number, found {cell!r}")
    return number


def _step_of(times: np.ndarray) -> float:
    """dt of a column of times.

    Raises:
        ValueError: the times do not advance by equal steps.
    """
    step = float(times[-1] - times[0]) / (len(times) - 1)
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if not step > 0 or off.max() > TIME_TOLERANCE * step:
        steps = np.diff(times)
        longest = int(np.abs(steps - np.median(steps)).argmax())
        raise ValueError(
            "the first of two columns must be times in equal steps (s), but after "
            f"{float(times[longest])!r} comes {float(times[longest + 1])!r}"
        )
    return step


def _agreed_unit(given: str | None, stated: str | None) -> str:
    if given is None and stated is None:
        raise ValueError(
            f"the unit of the acceleration is not given; give one of {', '.join(map(repr, UNITS))}"
        )
    if given is not None and stated is not None and given != stated:
        raise ValueError(f"two units of the acceleration are given: {given!r} and {stated!r}")
    return given or stated  # type: ignore[return-value]


def _agreed_dt(given: float | None, stated: float | None) -> float:
    if given is None and stated is None:
        raise ValueError("dt, the time between samples, is not given; give it in s")
    if (
        given is not None
        and stated is not None
        and not math.isclose(given, stated, rel_tol=DT_TOLERANCE)
    ):
        raise ValueError(f"two values of dt are given: {given!r} and {stated!r} s")
    return given if given is not None else stated  # type: ignore[return-value]
