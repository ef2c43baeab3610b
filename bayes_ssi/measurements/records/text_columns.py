"""Columns of samples in text, as spreadsheets, loggers and other programs write them.

::

    # rate_hz, 50
    # quantity, acceleration
    # unit, m/s2
    floor 1, floor 2, floor 3
    0.012, -0.003, 0.008
    0.010, -0.001, 0.011

Lines that start with ``#`` may hold the keys ``rate_hz`` or ``dt_s``, ``quantity`` and ``unit``.
Rows of numbers begin somewhere below them; other text may stand above, and ``Sampling rate: 20 Hz``
in it counts. Right above the numbers are the names of the columns, and perhaps a row of units. A
unit of motion behind a name, ``roof (mg)``, is that of the samples. Columns are separated by
semicolons, tabs, commas or spaces, or as a first line ``sep=;`` says, with decimal points or
commas. Empty cells and ``NaN`` were not measured.

No sensor is a column of instants: one of dates and times of day (ISO, ``12.05.2024 10:00:00,05``,
``05/12/2024 10:00:00.05 AM``; perhaps in two columns); one that is named as time, in s unless the
name has a unit (``Time [ms]``, ``t_us``), seconds since 1970 and finer units by their size; one
that is named as a count; and a first column that rises by equal steps. Where instants are missing,
so are the samples.
"""

import csv
import math
import re
from collections.abc import Sequence
from contextlib import suppress
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import counted
from bayes_ssi.foundations.text_files import read_columns
from bayes_ssi.measurements.records.channels import (
    STATED,
    Channels,
    at_places,
    instants_of,
    with_statements,
)
from bayes_ssi.measurements.records.record import quantity_of

if TYPE_CHECKING:
    from pandas import DataFrame, Series

STATEMENT = re.compile(rf"\s*#\s*({'|'.join(STATED)})\s*[,;:=\t]\s*(.*?)[\s,;]*$")
STATED_RATE = re.compile(
    r"\W*(?:sampl\w+[ _](?:rate|frequency)|fs|abtastrate)\s*([\[(]hz[\])])?\s*[:=,;\t]\s*"
    r"(\d+(?:[.,]\d+)?)\s*(hz)?\W*$",
    re.IGNORECASE,
)
OTHER_LENGTH = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
LINES_OF_TEXT = 1000  # above the numbers, at most
SINCE_1970 = 1e8  # s, beyond which times are not those of a record
LONGEST_STEP_S = 0.5  # of records; a longer one is in another unit
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
DATE = r"(\d{1,4})([-./])(\d{1,2})\2(\d{1,4})"
CLOCK_TIME = r"\d{1,2}:\d\d(:\d\d)?([.,]\d*)?( ?[AP]M)?(Z|[+-]\d\d:?\d\d)?"
STAMP = re.compile(f"{DATE}|{CLOCK_TIME}|{DATE}[T ]{CLOCK_TIME}".replace(r"\2", "[-./]"), re.I)
BEHIND_NAME = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]|(.*?)[ _]([mµμun]?s)", re.IGNORECASE)
CLOCK = re.compile(
    r"t|time( ?stamp)?s?|dates?( ?time)?|datum|zeit(stempel)?|uhrzeit|unix ?time|epoch|x value|"
    r"seconds|elapsed( time)?"
)
COUNT = re.compile(
    r"(samples?|index|idx|rows?|scan|record|point|counter)( ?(no|nr|number|#))?\.?|(no|nr)\.?|#"
)
SECONDS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6,
    "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0,
}  # fmt: skip
UNITS = ", ".join(SECONDS)


class _Layout(NamedTuple):
    """Where the numbers of a text begin, and how they are written."""

    delimiter: str | None  # None for spaces
    first: int  # line, from 0
    decimal: str


def read_columns_of_record(
    path: Path, rate_hz: float | None = None, keys: Sequence[str] = ()
) -> Channels:
    """Read the channels of a text file or workbook (see the module's docstring for its form).

    Args:
        rate_hz: the rate as the user states it, which tells the unit of times that have none.
        keys: the sheet of a workbook, its first if empty.
    """
    text, delimiter = read_columns(path, *keys)
    lines = text.split("\n")
    layout = _layout(lines, delimiter)
    stated = _statements(lines[: layout.first])
    table = _table(lines, layout)
    if len(table) < 2:
        raise ValueError(f"a record needs two samples or more, got {len(table)}")
    stamps = _stamps_in_seconds(table)
    names, units = _names_and_units(lines[: layout.first], layout, table)
    sensors, rates, places = [], [], np.arange(len(table))
    for j in table:
        unit = 1.0 if j in stamps else _unit_of_instants(table, j, names[j], units[j], rate_hz)
        if unit is None:
            sensors.append(j)
            continue
        if table[j].isna().any():
            raise ValueError(f"column {names[j] or 'of times'!r}: an instant is missing in a row")
        step, of_column = instants_of(table[j].to_numpy(), names[j] or "times")
        rates += [1.0 / (unit * step)] if unit > 0.0 else []
        places = max(places, of_column, key=lambda instants: instants[-1])
    if len(sensors) >= len(table):
        raise ValueError(
            f"{len(table)} rows of {len(sensors)} samples; a record has a row for each instant and "
            "a column for each sensor: is the table the wrong way round? If so, transpose it"
        )
    _require_numbers(table[sensors], lines, layout)
    samples = np.ascontiguousarray(table[sensors].to_numpy(dtype=float).T)
    named = [names[j] for j in sensors]
    channels = with_statements(at_places(samples, places), named if any(named) else [], stated)
    motion = _units_of_motion(named, [units[j] for j in sensors])
    return channels._replace(
        rates_hz=(*channels.rates_hz, *rates), units=(*channels.units, *motion)
    )


def _cells(line: str, delimiter: str | None) -> list[str]:
    spaced = line if delimiter else " ".join(line.split())
    try:
        (cells,) = csv.reader([spaced], delimiter=delimiter or " ", skipinitialspace=True)
    except (csv.Error, ValueError):
        return [line]
    return [cell.strip() for cell in cells]


def _is_text(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _layout(lines: Sequence[str], stated: str | None) -> _Layout:
    """The delimiter that gives most columns, and the first of the rows of numbers."""
    top = list(islice(((i, line) for i, line in enumerate(lines) if _is_text(line)), LINES_OF_TEXT))
    layouts = []
    for delimiter in (stated,) if stated else (";", "\t", ",", None):
        rows = [(i, _cells(line, delimiter)) for i, line in top[:2]]
        before = 0
        for k, (i, row) in enumerate(rows):
            if k + 2 < len(top):
                rows.append((top[k + 2][0], _cells(top[k + 2][1], delimiter)))
            after = len(rows[k + 1][1]) if k + 1 < len(rows) else 0
            if _is_row(row) and (len(row) in (before, after) or len(top) == 1):
                layouts.append((len(row), delimiter, i))
                break
            before = len(row)
    if not layouts:
        raise ValueError("no rows of numbers, one for each instant, separated by , ; tab or spaces")
    n, delimiter, first = next((layout for layout in layouts if layout[0] > 1), layouts[0])
    below = (_cells(line, delimiter) for line in lines[first : first + LINES_OF_TEXT])
    numbers = [cell for row in below for cell in row[:n] if NUMBER.fullmatch(cell)]
    comma, point = (next((c for c in numbers if sign in c), None) for sign in ",.")
    if comma and point:
        raise ValueError(f"decimal commas and points are mixed, as in {comma!r} and {point!r}")
    decimal = "," if comma or (delimiter in (";", "\t") and not point) else "."
    return _Layout(delimiter, first, decimal)


def _is_row(cells: Sequence[str]) -> bool:
    """Whether all cells are numbers, instants or empty, but not all of them empty."""
    held = [cell for cell in cells if cell]
    return bool(held) and all(NUMBER.fullmatch(c) or STAMP.fullmatch(c) for c in held)


def _statements(lines: Sequence[str]) -> dict[str, str]:
    """What the lines above the numbers state (:data:`STATED`)."""
    stated: dict[str, str] = {}
    for number, line in enumerate(lines, 1):
        if (match := STATEMENT.match(line)) is not None:
            key, value = match.groups()
        elif (match := STATED_RATE.match(line)) is not None and (match[1] or match[3]):
            key, value = "rate_hz", match[2]
        else:
            continue
        value = value.replace(",", ".") if key in ("rate_hz", "dt_s") else value
        if stated.setdefault(key, value) != value:
            raise ValueError(f"line {number}: {key} is {stated[key]}, and now {value}")
    return stated


def _table(lines: Sequence[str], layout: _Layout) -> "DataFrame":
    """The rows of cells: numbers, or texts where a column has others, NaN where they are empty."""
    import pandas as pd

    # Until 3.1, numbers are wrong in their last digit unless this is asked for.
    exact: Any = {"float_precision": "round_trip"} if pd.__version__ < "3.1" else {}
    try:
        table = pd.read_csv(
            StringIO("\n".join(lines[layout.first :])), sep=layout.delimiter or r"\s+", header=None,
            decimal=layout.decimal, comment="#", skipinitialspace=True, low_memory=False, **exact,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        if (match := OTHER_LENGTH.search(str(error))) is None:
            raise ValueError(" ".join(str(error).split())) from None
        before, line, cells = map(int, match.groups())
        raise ValueError(
            f"line {layout.first + line}: {counted(cells, 'cell')}, where the rows above have "
            f"{before}"
        ) from None
    # What ends early is filled with NaN, as are cells left empty.
    last = table.shape[1] - 1
    short = np.flatnonzero(table[last].isna())
    numbers = _line_numbers(lines, layout) if len(short) and last else []
    for row in short[: len(numbers)].tolist():
        n_cells = len(_cells(lines[numbers[row] - 1], layout.delimiter))
        if n_cells <= last:
            raise ValueError(
                f"line {numbers[row]}: {counted(n_cells, 'cell')}, where the rows above have "
                f"{last + 1}"
            )
    held = np.flatnonzero(table.notna().any(axis=1))  # spreadsheets may end in empty rows
    return table[: held[-1] + 1]


def _line_numbers(lines: Sequence[str], layout: _Layout) -> list[int]:
    """The number of the line of each row."""
    return [i for i, line in enumerate(lines, 1) if i > layout.first and _is_text(line)]


def _stamps_in_seconds(table: "DataFrame") -> list[int]:
    """Turn columns of dates and times of day to seconds, two into one; their places."""
    stamps = []
    texts = [j for j in table if table[j].dtype.kind == "O"]
    for j in texts:
        if j not in table or table[j].isna().all() or not STAMP.fullmatch(str(table[j][0])):
            continue
        column = table[j]
        if ":" not in str(column[0]) and j + 1 in texts and ":" in str(table[j + 1][0]):
            column = column + " " + table.pop(j + 1)
        table[j] = _seconds(column.str.strip().str.replace(",", "."))
        stamps.append(j)
    return stamps


def _seconds(stamps: "Series[str]") -> FloatArray:
    """Seconds of dates or times of day, from any instant."""
    import pandas as pd

    def of(instants: "Series") -> FloatArray:
        return np.asarray((instants - instants.iloc[0]).dt.total_seconds(), dtype=float)

    first = str(stamps.iloc[0])
    date = re.match(DATE, first)
    try:
        if date is None:  # perhaps over midnight
            return np.unwrap(of(pd.to_timedelta(stamps)), period=86400.0)
        if stamps.str.extract(r"(Z|[+-]\d\d:?\d\d)$").fillna("")[0].nunique() > 1:
            raise ValueError("zones differ")
        if len(date[1]) == 4:
            return of(pd.to_datetime(stamps.str.replace("/", "-"), format="ISO8601"))
        year = "%Y" if len(date[4]) == 4 else "%y"
        sign, half = date[2], " %p" if first[-1] in "mM" else ""
        clock = f"%{'I' if half else 'H'}:%M:%S.%f{half}"
        whole = stamps.str.replace(r"(:\d\d)(?= |$)", r"\1.0", regex=True)
        read = []
        for order in ("%d.%m.",) if sign == "." else (f"%m{sign}%d{sign}", f"%d{sign}%m{sign}"):
            with suppress(ValueError):
                read.append(of(pd.to_datetime(whole, format=f"{order}{year} {clock}")))
        # Whether the day or the month comes first shows at midnight, by the smaller step.
        return min(read, key=lambda seconds: np.abs(np.diff(seconds)).max())
    except (ValueError, TypeError, AttributeError):
        raise ValueError(
            f"time stamps such as {first!r} are not understood; write all in ISO form, such as "
            "2024-05-12T10:00:00.010"
        ) from None


def _names_and_units(
    above: Sequence[str], layout: _Layout, table: "DataFrame"
) -> tuple[dict[int, str], dict[int, str]]:
    """Column → its name and its unit, each empty where it has none; empty columns leave."""
    n = 1 + max(table.columns)
    filled = 1 + max(j for j in table if table[j].notna().any())
    joined = n - table.shape[1]

    def fitting(line: str) -> list[str]:
        """Cells of a line, one for each column; none if they differ in number."""
        cuts = [_cells(line, layout.delimiter)]
        if layout.delimiter is None:
            cuts += [re.split(r"\s{2,}|\t", line.strip()), [line.strip()]]
        for cells in cuts:
            while len(cells) > filled and cells[-1].lower() in ("", "comment"):
                cells = cells[:-1]
            if joined and len(cells) == n - 1:
                cells = [cells[0], "", *cells[1:]]
            if filled <= len(cells) <= n:
                return cells + [""] * (n - len(cells))
        return []

    texts = [line for line in above if _is_text(line)]
    names = fitting(texts[-1]) if texts else []
    if texts and not names and layout.delimiter and len(_cells(texts[-1], layout.delimiter)) > 1:
        raise ValueError(
            f"{len(_cells(texts[-1], layout.delimiter))} column names for {filled} columns"
        )
    row_of_units = [""] * n
    if len(texts) > 1 and any(map(_known_unit, names)) and (higher := fitting(texts[-2])):
        row_of_units, names = names, higher
    names = names or [""] * n
    units = dict(enumerate(cell.strip("[]() ") for cell in row_of_units))
    for j, name in enumerate(names):
        if (match := BEHIND_NAME.fullmatch(name)) is None:
            continue
        base, unit = (match[1], match[2]) if match[2] else (match[3], match[4])
        if _known_unit(unit) and (match[2] or CLOCK.fullmatch(_plain(base))):
            names[j], units[j] = base, unit
        elif match[2]:
            units[j] = units[j] or unit
    for j in [*table]:
        if table[j].isna().all():
            if names[j].lower() not in ("", "comment"):
                raise ValueError(f"column {names[j]!r} is empty; remove it")
            table.pop(j)
    return dict(enumerate(names)), units


def _plain(name: str) -> str:
    return re.sub(r"[\s_]+", " ", name.lower()).strip()


def _known_unit(text: str) -> bool:
    unit = text.strip("[]() ")
    return unit.lower() in SECONDS or quantity_of(unit) is not None


def _units_of_motion(names: Sequence[str], units: Sequence[str]) -> list[str]:
    """The units of samples that columns state, all of motion if one is."""
    motion = [unit for unit in units if quantity_of(unit)]
    for name, unit in zip(names, units, strict=True):
        if motion and unit and unit not in motion:
            raise ValueError(
                f"column {name!r} in {unit!r} beside others in {motion[0]!r} is no motion, or in "
                "another unit; remove it"
            )
    return list(dict.fromkeys(motion))


def _unit_of_instants(
    table: "DataFrame", j: int, name: str, unit: str, rate_hz: float | None
) -> float | None:
    """The unit in s of a column of instants, 0 of one that counts them, None of a sensor's."""
    plain, unit = _plain(name), unit.lower()
    if table[j].dtype.kind not in "iuf":
        return None
    is_clock = CLOCK.fullmatch(plain) is not None
    if COUNT.fullmatch(plain):
        return 0.0
    if not is_clock and quantity_of(unit):
        return None
    if not (is_clock or ((j == 0 or unit in SECONDS) and _are_instants(table, j))):
        return None
    if unit:
        if unit not in SECONDS:
            raise ValueError(f"column {name!r}: {unit!r} is no unit of time; choose from {UNITS}")
        return SECONDS[unit]
    values = table[j].to_numpy()
    step, first = float(np.median(np.diff(values))), abs(float(values[0]))
    if is_clock and first > SINCE_1970:
        return 1e-3 ** ((math.log10(first / SINCE_1970)) // 3)
    if not is_clock and (name or step == 1.0):
        return 0.0
    for factor in (1.0, 1e-3, 1e-6):
        if rate_hz and math.isclose(step * factor * rate_hz, 1.0, rel_tol=0.01):
            return factor
    if step >= LONGEST_STEP_S:
        raise ValueError(
            f"column {name or 'of times'!r} advances by {step:g}: name it with its unit, as in "
            "'time (ms)', or give the rate as well (--rate)"
        )
    return 1.0


def _are_instants(table: "DataFrame", j: int) -> bool:
    """Whether one of several columns rises by equal steps, but for some, gaps."""
    if table.shape[1] == 1:
        return False
    steps = np.diff(table[j].to_numpy(dtype=float))
    usual = float(np.median(steps))
    return bool(usual > 0.0 and np.median(np.abs(steps - usual)) < 0.01 * usual)


def _require_numbers(table: "DataFrame", lines: Sequence[str], layout: _Layout) -> None:
    import pandas as pd

    for j in table:
        if table[j].dtype.kind in "iuf":
            continue
        numbers = pd.to_numeric(table[j], errors="coerce")
        row = int((numbers.isna() & table[j].notna()).to_numpy().argmax())
        raise ValueError(
            f"line {_line_numbers(lines, layout)[row]}, column {j + 1}: {str(table[j][row])!r} is "
            "not a number; a record has one of every sensor in every row"
        )
