"""Ground motion: an acceleration at equal time steps, in m/s², and the files that hold it.

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
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_one_of
from bayes_ssi.foundations.text_files import read_columns

# Unit of an acceleration → its value in m/s²; standard gravity, inch and foot are exact by
# definition.
UNITS = {
    "g": 9.80665, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 0.001, "in/s2": 0.0254, "ft/s2": 0.3048,
}  # fmt: skip
SPELLINGS = {"gal": "cm/s2", "gals": "cm/s2", "g0": "g", "gs": "g"}
# In m/s². Earthquakes have been recorded with 40 m/s² (Iwate-Miyagi 2008; Aoi et al. 2008, Science
# 322), and with hardly more.
LARGEST_RECORDED = 50.0


def checked_unit(unit: str) -> str:
    """The unit of acceleration as a key of :data:`UNITS`, from any usual spelling of it.

    Files write ``CM/S/S``, ``cm/sec^2``, ``M/S**2``, ``m s-2``, ``Gal`` or ``g's``, among others.
    """
    plain = str(unit).lower().replace("²", "2").replace("⁻", "-")
    plain = re.sub(r"[\s^*·.'’()\[\]]", "", plain)
    plain = re.sub(r"sec(?:ond)?", "s", plain)
    plain = re.sub(r"(?:/s/s|/?s-2)$", "/s2", plain)
    plain = SPELLINGS.get(plain, plain)
    if plain not in UNITS:
        require_one_of("unit of acceleration", unit, UNITS)
    return plain


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """The acceleration of the ground, linear between samples.

    Attributes:
        acceleration: (n_samples,), in m/s².
        dt: time between samples in s.
        name: name for titles and tables.

    Raises:
        ValueError: there are fewer than two samples, one is not finite, or dt is not positive.
    """

    acceleration: FloatArray
    dt: float
    name: str = ""

    def __post_init__(self) -> None:
        where = f"ground motion {self.name!r}" if self.name else "ground motion"
        try:
            acceleration = np.array(self.acceleration, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"{where}: the acceleration must be a list of numbers") from None
        if acceleration.ndim != 1 or len(acceleration) < 2:
            got = acceleration.shape if acceleration.ndim != 1 else len(acceleration)
            raise ValueError(f"{where}: needs a row of two samples or more, got {got}")
        if not np.isfinite(acceleration).all():
            first = int(np.flatnonzero(~np.isfinite(acceleration))[0])
            raise ValueError(
                f"{where}: sample {first + 1} is not finite: {float(acceleration[first])!r}"
            )
        if not (isinstance(self.dt, (int, float, np.number)) and 0.0 < self.dt < math.inf):
            raise ValueError(f"{where}: dt must be positive and finite (s), got {self.dt!r}")
        acceleration.setflags(write=False)
        object.__setattr__(self, "acceleration", acceleration)
        object.__setattr__(self, "dt", float(self.dt))

    @classmethod
    def of(
        cls, samples: Sequence[float] | FloatArray, unit: str, dt: float, name: str = ""
    ) -> GroundMotion:
        """From samples in any unit of acceleration.

        Args:
            samples: (n_samples,), accelerations.
            unit: unit of the samples, ``"g"``, ``"m/s2"`` or ``"cm/s2"``.
            dt: time between samples in s.
            name: for titles and tables.

        Raises:
            ValueError: as for the class, or the unit is not known.
        """
        scale = UNITS[checked_unit(unit)]
        plain = cls(samples, dt, name)  # type: ignore[arg-type]
        return cls(scale * plain.acceleration, dt, name)

    def __len__(self) -> int:
        return len(self.acceleration)

    @cached_property
    def times(self) -> FloatArray:
        """Times of the samples (n_samples,), in s, from 0."""
        times: FloatArray = np.arange(len(self.acceleration), dtype=np.float64)
        times *= self.dt
        return times

    @property
    def nyquist_hz(self) -> float:
        """Half the sampling frequency; the samples carry nothing above it."""
        return 0.5 / self.dt

    def warnings(self, frequencies_hz: FloatArray) -> list[str]:
        """What an analyst should know before using this record, a sentence each.

        Args:
            frequencies_hz: (n_modes,), ascending frequencies of the structure that it shakes.
        """
        warnings = []
        if self.peak_acceleration > LARGEST_RECORDED:
            warnings.append(
                f"record {self.name}: its peak, {self.peak_acceleration / UNITS['g']:.3g} g, is "
                "beyond that of any earthquake recorded; is its unit right?"
            )
        above = np.flatnonzero(frequencies_hz > self.nyquist_hz)
        if len(above):
            warnings.append(
                f"record {self.name}: {self.dt:g} s between samples carry frequencies up to "
                f"{self.nyquist_hz:g} Hz; mode {above[0] + 1} of the structure, at "
                f"{frequencies_hz[above[0]]:.3g} Hz, and any above it are not driven as the ground "
                "drives them"
            )
        return warnings

    @property
    def peak_acceleration(self) -> float:
        """PGA in m/s²."""
        return float(np.abs(self.acceleration).max())


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

    :mod:`bayes_ssi.structures.response.ground_motion` describes the files.

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
