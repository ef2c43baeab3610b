"""Columns of samples in text, as spreadsheets, loggers and other programs write them.

Rows of numbers begin below lines that start with ``#`` and may hold the keys ``rate_hz`` or
``dt_s``, ``quantity`` and ``unit``; below other text, in which ``Sampling rate: 20 Hz`` counts; and
right below the names of the columns, and perhaps a row of units. The guide's chapter on vibration
records says how columns of instants are recognised, and what is refused.
"""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import counted
from bayes_ssi.foundations.text_files import WORKBOOKS, read_columns, sheet_names
from bayes_ssi.measurements.records.channels import (
    STATED,
    Channels,
    advances,
    at_places,
    instants_of,
    with_statements,
)
from bayes_ssi.measurements.records.record import quantity_of

if TYPE_CHECKING:
    from pandas import DataFrame, Series

STATEMENT = re.compile(rf"\s*#\s*({'|'.join(STATED)})\s*[,;:=\t]\s*(.*?)[\s,;]*$")
STATED_RATE = re.compile(
    r"(?=.*hz)\W*(?:sampl\w+[ _](?:rate|frequency)|fs|abtastrate)\s*(?:[\[(]hz[\])])?\s*[:=,;\t]\s*"
    r"(\d+(?:[.,]\d+)?)\s*(?:hz)?\W*$", re.IGNORECASE,
)  # fmt: skip
LINES_OF_TEXT = 1000  # above the numbers, at most
SINCE_1970 = 1e8  # s, beyond which times are not those of a record
LONGEST_STEP_S = 0.5  # of records; a longer one is in another unit
NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)(e[+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)
DATE = r"(\d{1,4})([-./])(\d{1,2})\2(\d{1,4})"
CLOCK_TIME = r"\d{1,2}:\d\d(:\d\d)?([.,]\d*)?( ?[AP]M)?(Z|[+-]\d\d:?\d\d)?"
STAMP = re.compile(f"{DATE}|{CLOCK_TIME}|{DATE}[T ]{CLOCK_TIME}".replace(r"\2", "[-./]"), re.I)
BRACKETED = re.compile(r"(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]")
SUFFIXED = re.compile(r"(.*?)[ _]([mµμun]?s)")
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


def read_columns_of_record(
    path: Path, rate_hz: float | None = None, keys: Sequence[str] = ()
) -> Channels:
    """Read the channels of a text file, or of a workbook's sheet, ``keys``, its first if empty.

    The rate that the user states tells the unit of times that have none.
    """
    text, delimiter = read_columns(path, *keys)
    try:
        layout = _Layout.of(text.split("\n"), delimiter)
    except ValueError as error:
        others = sheet_names(path) if path.suffix.lower() in WORKBOOKS else []
        if len(others) < 2:
            raise
        choices = ", ".join(map(repr, others))
        raise ValueError(f"{error}; name the sheet (--key): one of {choices}") from None
    table = _table(layout)
    if len(table) < 2:
        raise ValueError(f"a record needs two samples or more, got {len(table)}")
    stamps = _stamps_in_seconds(table)
    sensors, steps_s, begins_s, places = {}, [], [], np.arange(len(table))
    for j, (name, unit) in _headings(layout, table).items():
        in_s = 1.0 if j in stamps else _unit_of_instants(table, j, name, unit.lower(), rate_hz)
        if in_s is None:
            sensors[j] = name, unit
            continue
        if table[j].isna().any():
            raise ValueError(f"column {name or 'of times'!r}: an instant is missing in a row")
        step, of_column = instants_of(table[j].to_numpy(), name or "times")
        steps_s += [in_s * step] if in_s > 0.0 else []
        begins_s += [in_s * float(table[j].iloc[0])] if in_s > 0.0 and j not in stamps else []
        places = max(places, of_column, key=lambda instants: instants[-1])
    # Not from one origin, as of an epoch beside times from the beginning, where they are farther.
    apart_s, step_s = np.abs(np.subtract.outer(begins_s, begins_s)), min(steps_s, default=0.0)
    if ((apart_s > 0.5 * step_s) & (apart_s < step_s * len(table))).any():
        begins = ", ".join(f"{begin:.6g}" for begin in begins_s)
        raise ValueError(f"columns of times begin at {begins} s; give all the same instants")
    if len(sensors) >= len(table):
        raise ValueError(
            f"{len(table)} rows of {len(sensors)} samples; a record has a row for each instant and "
            "a column for each sensor: is the table the wrong way round? If so, transpose it"
        )
    samples = np.ascontiguousarray(_numbers(table[list(sensors)], layout).T)
    motion = dict.fromkeys(unit for _, unit in sensors.values() if quantity_of(unit))
    for name, unit in sensors.values():
        if motion and unit and unit not in motion:
            raise ValueError(
                f"column {name!r} in {unit!r} beside others in {next(iter(motion))!r} is no "
                "motion, or in another unit; remove it"
            )
    names = [name for name, _ in sensors.values()]
    return with_statements(at_places(samples, places), names, _statements(layout), steps_s, motion)


class _Layout(NamedTuple):
    """Lines of a text, where their numbers begin, and how they are written."""

    lines: list[str]
    delimiter: str | None  # None for spaces
    first: int  # line of numbers, from 0
    decimal: str

    @classmethod
    def of(cls, lines: list[str], stated: str | None) -> "_Layout":
        """The delimiter that gives most columns, and the first of the rows of numbers."""
        numbered = ((i, line) for i, line in enumerate(lines) if _is_text(line))
        top = list(islice(numbered, LINES_OF_TEXT))
        layouts = []
        for delimiter in (stated,) if stated else (";", "\t", ",", None):
            rows = [_cells(line, delimiter) for _, line in top]
            beside = [0, *map(len, rows), 0]
            for k, row in enumerate(rows):
                held = [cell for cell in row if cell]
                is_row = held and all(NUMBER.fullmatch(c) or STAMP.fullmatch(c) for c in held)
                if is_row and (len(row) in (beside[k], beside[k + 2]) or len(rows) == 1):
                    layouts.append((len(row), delimiter, top[k][0], rows[k:]))
                    break
        if not layouts:
            text = "no rows of numbers, one for each instant, separated by , ; tab or spaces"
            raise ValueError(text)
        _, delimiter, first, rows = next((one for one in layouts if one[0] > 1), layouts[0])
        numbers = "".join(cell for row in rows for cell in row if NUMBER.fullmatch(cell))
        is_decimal = "," in numbers or (delimiter in (";", "\t") and "." not in numbers)
        return cls(lines, delimiter, first, "," if is_decimal else ".")

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """The number of the line and the cells of each row."""
        for i in range(self.first, len(self.lines)):
            if _is_text(self.lines[i]):
                yield i + 1, _cells(self.lines[i], self.delimiter)


def _cells(line: str, delimiter: str | None) -> list[str]:
    spaced = line if delimiter else " ".join(line.split())
    try:
        (cells,) = csv.reader([spaced], delimiter=delimiter or " ", skipinitialspace=True)
    except (csv.Error, ValueError):
        return [line]
    return [cell.strip() for cell in cells]


def _is_text(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _statements(layout: _Layout) -> dict[str, str]:
    """What the lines above the numbers state (:data:`STATED`)."""
    stated: dict[str, str] = {}
    for number, line in enumerate(layout.lines[: layout.first], 1):
        if (match := STATEMENT.match(line) or STATED_RATE.match(line)) is None:
            continue
        *key, value = match.groups()
        name = key[0] if key else "rate_hz"
        value = value.replace(",", ".") if name in ("rate_hz", "dt_s") else value
        if stated.setdefault(name, value) != value:
            raise ValueError(f"line {number}: {name} is {stated[name]}, and now {value}")
    return stated


def _table(layout: _Layout) -> "DataFrame":
    """The rows of cells: numbers, or texts where a column has others, NaN where they are empty."""
    import pandas as pd

    # Until 3.1, numbers are wrong in their last digit unless this is asked for.
    exact: Any = {"float_precision": "round_trip"} if pd.__version__ < "3.1" else {}
    table = None
    try:
        table = pd.read_csv(
            StringIO("\n".join(layout.lines[layout.first :])), sep=layout.delimiter or r"\s+",
            header=None, decimal=layout.decimal, comment="#", skipinitialspace=True,
            low_memory=False, **exact,
        )  # fmt: skip
    except pd.errors.ParserError as error:
        reason = " ".join(str(error).split())
    # What ends early is filled with NaN, as are cells left empty.
    if table is None or table.iloc[:, -1].isna().any():
        _, first = next(layout.rows())
        for line, cells in layout.rows():
            if len(cells) != len(first):
                had = f"{counted(len(cells), 'cell')}, where the rows above have {len(first)}"
                raise ValueError(f"line {line}: {had}")
    if table is None:
        raise ValueError(f"{reason}; do quotation marks match?")
    return table[: table.last_valid_index() + 1]  # spreadsheets may end in empty rows


def _numbers(table: "DataFrame", layout: _Layout) -> FloatArray:
    other = "." if layout.decimal == "," else ","
    for j in table:
        if table[j].dtype.kind not in "iuf":
            is_text = (not NUMBER.fullmatch(cell) or other in cell for cell in map(str, table[j]))
            row = next((i for i, each in enumerate(is_text) if each), 0)
            line, _ = next(islice(layout.rows(), row, None))
            raise ValueError(
                f"line {line}, column {j + 1}: {str(table[j][row])!r} is not a number with "
                f"{layout.decimal!r} for decimals; a record has one of every sensor in every row: "
                "leave it empty where nothing was measured, and remove lines of other things"
            )
    return np.asarray(table.to_numpy(dtype=float))


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
    """Seconds of dates or times of day, from the first."""
    import pandas as pd

    first = str(stamps.iloc[0])
    date = re.match(DATE, first)
    forms = [""]
    if date and len(date[1]) == 4:
        forms, stamps = ["ISO8601"], stamps.str.replace("/", "-")
    elif date:
        clock, sign = "%I:%M:%S.%f %p" if first[-1] in "mM" else "%H:%M:%S.%f", date[2]
        days = ["%d.%m."] if sign == "." else [f"%m{sign}%d{sign}", f"%d{sign}%m{sign}"]
        forms = [f"{day}{'%Y' if len(date[4]) == 4 else '%y'} {clock}" for day in days]
        stamps = stamps.str.replace(r"(:\d\d)(?= |$)", r"\1.0", regex=True)
    read = []
    for form in forms:
        with suppress(ValueError, TypeError):
            to = pd.to_datetime(stamps, format=form, utc=True) if form else pd.to_timedelta(stamps)
            read.append(np.asarray((to - to.iloc[0]).dt.total_seconds(), dtype=float))
    if not read:
        raise ValueError(
            f"time stamps such as {first!r} are not understood; write all in ISO form, such as "
            "2024-05-12T10:00:00.010"
        )
    # Whether the day or the month comes first shows at midnight, by the smaller step.
    seconds = min(read, key=lambda each: np.abs(np.diff(each)).max())
    return seconds if date else np.unwrap(seconds, period=86400.0)


def _headings(layout: _Layout, table: "DataFrame") -> dict[int, tuple[str, str]]:
    """Column → its name and its unit, each empty where it has none; empty columns leave."""
    n = 1 + max(table.columns)
    filled = 1 + max(j for j in table if table[j].notna().any())

    def fitting(line: str) -> list[str]:
        """Cells of a line, one for each column; none if they differ in number."""
        words = re.split(r"\s{2,}|\t", line.strip())
        for cells in (_cells(line, layout.delimiter), *([] if layout.delimiter else [words])):
            while len(cells) > filled and cells[-1].lower() in ("", "comment"):
                cells.pop()
            if n > table.shape[1] and len(cells) == n - 1:  # dates and times of day have one name
                cells.insert(1, "")
            elif len(cells) == n - 1 and np.array_equal(table[0], 1 + table.index):
                cells.insert(0, "")  # R gives them no name
            if filled <= len(cells) <= n:
                return cells + [""] * (n - len(cells))
        return []

    texts = ["", "", *filter(_is_text, layout.lines[: layout.first])]
    names, units = fitting(texts[-1]), []
    n_names = len(_cells(texts[-1], layout.delimiter))
    if not names and layout.delimiter and n_names > 1:
        raise ValueError(f"{n_names} column names for {filled} columns")
    if any(map(_known_unit, names)) and (higher := fitting(texts[-2])):
        units, names = names, higher
    headings = {}
    for j, (name, unit) in enumerate(zip(names or [""] * n, units or [""] * n, strict=True)):
        if j not in table or (table[j].isna().all() and name.lower() in ("", "comment")):
            continue
        if table[j].isna().all():
            raise ValueError(f"column {name!r} is empty; remove it")
        unit = unit.strip("[]() ")
        if (match := BRACKETED.fullmatch(name)) is not None and match[2]:
            name, unit = match.groups() if _known_unit(match[2]) else (name, unit or match[2])
        elif (match := SUFFIXED.fullmatch(name)) and CLOCK.fullmatch(_plain(match[1])):
            name, unit = match.groups()
        headings[j] = name, unit
    return headings


def _plain(name: str) -> str:
    return re.sub(r"[\s_]+", " ", name.lower()).strip()


def _known_unit(text: str) -> bool:
    unit = text.strip("[]() ")
    return unit.lower() in SECONDS or quantity_of(unit) is not None


def _unit_of_instants(
    table: "DataFrame", j: int, name: str, unit: str, rate_hz: float | None
) -> float | None:
    """The unit in s of a column of instants, 0 of one that counts them, None of a sensor's."""
    if table[j].dtype.kind not in "iuf":
        return None
    if COUNT.fullmatch(_plain(name)):
        return 0.0
    values = table[j].to_numpy()
    step, first = float(np.median(np.diff(values))), abs(float(values[0]))
    is_clock = CLOCK.fullmatch(_plain(name)) is not None
    may_be = (j == 0 or unit in SECONDS) and not quantity_of(unit) and table.shape[1] > 1
    if not (is_clock or (may_be and advances(values))):
        return None
    if unit:
        if unit not in SECONDS:
            known = ", ".join(SECONDS)
            raise ValueError(f"column {name!r}: {unit!r} is no unit of time; choose from {known}")
        return SECONDS[unit]
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
