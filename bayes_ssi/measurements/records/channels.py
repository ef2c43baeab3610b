"""What one file holds of a record: channels, and what the file states about them.

In a file of named arrays (MATLAB .mat, numpy .npz and HDF5) an array of samples has a row or a
column for each sensor; its longer side is time. Scalars ``rate_hz`` or ``dt_s`` and texts
``quantity`` and ``unit`` in the same file (for HDF5 also attributes of the array) state what the
samples are, and ``sensors`` their names.

In a file of text, samples are columns of CSV, or of numbers separated by spaces::

    # rate_hz, 50
    # quantity, acceleration
    # unit, m/s2
    floor 1, floor 2, floor 3
    0.012, -0.003, 0.008
    0.010, -0.001, 0.011

Lines that start with ``#`` may hold the keys ``rate_hz`` or ``dt_s``, ``quantity`` and ``unit``;
other comments are skipped. A row of column names may follow. Columns are separated by commas,
semicolons, tabs (with the last two a decimal comma is understood) or spaces. A first column named
``time``, ``time_s`` or ``t``, or without a name and rising by equal steps, holds the times in s; so
does one of ISO time stamps such as ``2024-05-12T10:00:00.010``, also with a space in place of the
``T``, and with ``Z`` or an offset at the end.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import counted
from bayes_ssi.foundations.named_arrays import read_arrays
from bayes_ssi.foundations.text_files import STATED_DELIMITER, require_regular_file

# Names under which files of arrays, attributes and comments state what the samples are.
STATED = ("rate_hz", "dt_s", "quantity", "unit")
STATEMENT = re.compile(rf"\s*#\s*({'|'.join(STATED)})\s*[,;:=\t]\s*(.*?)[\s,;]*$")
# What numpy says of a cell that is no number, in rows from 0, and of a row of another length.
NO_NUMBER = re.compile(r"could not convert string (.*) to float64 at row (\d+), column (\d+)")
OTHER_LENGTH = re.compile(r"the number of columns changed from (\d+) to (\d+) at row (\d+)")
NAME_OF_TIMES = re.compile(r"(t|time)([_ ]?s|\s*[(\[]s[)\]])?$", re.IGNORECASE)
TIME_STAMP = re.compile(r'\s*"?(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d*)?(Z|[+-]\d\d:?\d\d)?)"?')


class Channels(NamedTuple):
    """Channels of one file."""

    samples: FloatArray  # (n, N)
    names: tuple[str, ...] = ()  # of the channels; empty where the file has none
    rates_hz: tuple[float, ...] = ()
    quantities: tuple[str, ...] = ()
    units: tuple[str, ...] = ()  # every statement of the unit

    @classmethod
    def joined(cls, parts: "Sequence[Channels]") -> "Channels":
        """Channels of several files with the same instants; named where all files have names."""
        if len(parts) == 1:
            return parts[0]
        samples, names, *stated = zip(*parts, strict=True)
        return cls(
            np.concatenate(samples),
            tuple(chain(*names)) if all(names) else (),
            *(tuple(chain(*statements)) for statements in stated),
        )


def with_statements(
    samples: FloatArray, names: Sequence[str], stated: Mapping[str, Any]
) -> Channels:
    """Channels of a file that states things by name (:data:`STATED`)."""
    rates = [_number(stated, "rate_hz")] if "rate_hz" in stated else []
    if "dt_s" in stated:
        rates.append(1.0 / _number(stated, "dt_s"))
    return Channels(
        samples,
        tuple(names),
        tuple(rates),
        (str(stated["quantity"]),) if "quantity" in stated else (),
        (str(stated["unit"]),) if "unit" in stated else (),
    )


def _number(stated: Mapping[str, Any], key: str) -> float:
    try:
        number = float(stated[key])
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{key} must be a positive, finite number, got {stated[key]}")
    return number


def read_arrays_of_record(path: Path, keys: Sequence[str]) -> Channels:
    """The channels of the arrays named ``keys``; if empty, of all with more than one number."""
    read = read_arrays(path, attributes=(*STATED, "sensors"))
    arrays = {name: _plain(value) for name, value in read.items()}
    samples = {
        name: array
        for name, array in arrays.items()
        if name not in STATED and array.dtype.kind in "iuf" and array.size > 1 and array.ndim <= 2
    }
    keys = list(keys) or list(samples)
    if not keys:
        held = ", ".join(f"{n!r} ({array.dtype}, {array.shape})" for n, array in arrays.items())
        raise ValueError(f"holds no rows or columns of real numbers; it holds {held or 'nothing'}")
    require_known("no array of samples", keys, samples)
    blocks = [np.atleast_2d(samples[key]) for key in keys]
    blocks = [block.T if block.shape[0] > block.shape[1] else block for block in blocks]
    lengths = {block.shape[1] for block in blocks}
    if len(lengths) > 1:
        raise ValueError(
            f"arrays {', '.join(map(repr, keys))} differ in length; name those to read by keys"
        )
    stated = {key: _scalar(arrays[key]) for key in STATED if key in arrays}
    names = [str(name).strip() for name in np.ravel(arrays.get("sensors", []))]
    if not names and len(keys) > 1 and all(len(block) == 1 for block in blocks):
        names = list(keys)
    joined = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return with_statements(np.ascontiguousarray(joined, dtype=float), names, stated)


def _scalar(array: np.ndarray) -> Any:
    if array.size != 1:
        return array.tolist()
    scalar = array.ravel()[0]
    return scalar.decode() if isinstance(scalar, bytes) else scalar


def _plain(value: Any) -> np.ndarray:
    """A cell array of texts as an array of texts."""
    array = np.asarray(value)
    if array.dtype != object:
        return array
    return np.array([str(np.ravel(each)[0]) for each in array.ravel() if np.size(each)])


def read_columns_of_record(path: Path) -> Channels:
    """Read the channels of a text file (see the module's docstring for its form)."""
    require_regular_file(path)
    with path.open(encoding="utf-8-sig") as file:
        try:
            return _read(file)
        except UnicodeDecodeError:
            raise ValueError("not a text file in UTF-8; save it as CSV (UTF-8)") from None


def _read(file: TextIO) -> Channels:
    stated: dict[str, str] = {}
    delimiter, first = None, ""
    for number, line in enumerate(file, 1):
        if number == 1 and (match := STATED_DELIMITER.match(line)):
            delimiter = match[1]
        elif line.lstrip().startswith("#"):
            if (match := STATEMENT.match(line)) is not None:
                key, value = match.groups()
                if stated.setdefault(key, value) != value:
                    raise ValueError(f"line {number}: {key} is {stated[key]}, and now {value}")
        elif line.strip():
            first = line
            break
    if not first:
        raise ValueError("the file holds no samples")
    delimiter = delimiter or next((sign for sign in ";\t," if sign in first.strip()), None)
    if delimiter in (";", "\t"):
        stated = {key: value.replace(",", ".") for key, value in stated.items()}
    cells = [cell.strip().strip('"') for cell in first.split(delimiter)]
    stamps: list[datetime] = []
    lines = _in_seconds(chain([first], file), delimiter in (";", "\t"), stamps)
    first = next(lines)
    are_numbers = [_is_number(cell.strip().strip('"')) for cell in first.split(delimiter)]
    # Between spaces a name may hold a number; between other separators, one may be missing.
    is_row = all(are_numbers) if delimiter is None else any(are_numbers)
    names = [] if is_row else cells
    lines = lines if names else chain([first], lines)
    try:
        table = np.loadtxt(lines, delimiter=delimiter, ndmin=2)
    except ValueError as error:
        raise _located(error, file, number + bool(names)) from None
    if names and delimiter is None and table.shape[1] == 1:
        names = [first.strip()]
    if len(table) < 2:
        raise ValueError(f"a record needs two samples or more, got {len(table)}")
    if names and len(names) != table.shape[1]:
        raise ValueError(f"{len(names)} column names for {table.shape[1]} columns")
    times = table[:, 0]
    is_timed = bool(stamps) or (bool(NAME_OF_TIMES.match(names[0])) if names else _are_times(table))
    columns = np.ascontiguousarray(table.T[int(is_timed) :])
    channels = with_statements(columns, names[int(is_timed) :], stated)
    if is_timed:
        channels = channels._replace(rates_hz=(*channels.rates_hz, 1.0 / step_of(times)))
    if len(columns) >= len(table):
        raise ValueError(
            f"{len(table)} rows of {len(columns)} samples; a record has a row for each instant and "
            "a column for each sensor: is the table the wrong way round?"
        )
    return channels


def _located(error: ValueError, file: TextIO, first_line: int) -> ValueError:
    """What numpy says of a table that begins in a line, with the line and the cause."""
    if match := NO_NUMBER.match(str(error)):
        text, row, column = match.groups()
        hint = "a record has one of every sensor in every row"
        if column == "1" and re.search(r"\d[:/.]\d+[:/.]\d", text):
            hint = "time stamps are read in ISO form, such as 2024-05-12T10:00:00.010"
        line = _line_of_row(file, first_line, int(row))
        return ValueError(f"line {line}, column {column}: {text} is not a number; {hint}")
    if match := OTHER_LENGTH.match(str(error)):
        before, there, row = match.groups()
        line = _line_of_row(file, first_line, int(row) - 1)
        cells = counted(int(there), "cell")
        return ValueError(f"line {line}: {cells}, where the rows above have {before}")
    return ValueError(f"below line {first_line - 1}: {error}")


def _line_of_row(file: TextIO, first_line: int, row: int) -> int:
    """The number of the line of a row of samples, from 0; others are blank or comments."""
    file.seek(0)
    numbered = islice(enumerate(file, 1), first_line - 1, None)
    rows = (n for n, line in numbered if line.strip() and not line.lstrip().startswith("#"))
    return next(islice(rows, row, None), first_line + row)


def _in_seconds(
    lines: Iterable[str], has_decimal_commas: bool, stamps: list[datetime]
) -> Iterator[str]:
    """Lines with seconds from the first time stamp in place of each; ``stamps`` gets the first."""
    for line in lines:
        line = line.replace(",", ".") if has_decimal_commas else line
        if (match := TIME_STAMP.match(line)) is not None:
            try:
                stamp = datetime.fromisoformat(match[1])
                stamps[:] = stamps or [stamp]
                seconds = (stamp - stamps[0]).total_seconds()
            except (ValueError, TypeError) as error:
                raise ValueError(f"time stamp {match[1]!r}: {error}") from None
            line = f"{seconds:.6f}{line[match.end() :]}"
        yield line


def _are_times(table: FloatArray) -> bool:
    """Whether the first of columns without names rises by equal steps, but for some, gaps."""
    if table.shape[1] == 1:
        return False
    steps = np.diff(table[:, 0])
    usual = float(np.median(steps))
    return bool(usual > 0.0 and np.median(np.abs(steps - usual)) < 0.01 * usual)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def step_of(times: FloatArray) -> float:
    """The step of a column of times in s."""
    steps = np.diff(times)
    step = float(np.median(steps))
    # Times are printed to a few digits, and may be wrong by half of the last one.
    rounding = 10.0 ** -_decimals(times)
    long = steps > 1.5 * step
    wrong = (np.abs(steps - step) > 0.01 * step + rounding) | (step <= 0.0)
    apart = times - np.linspace(times[0], times[-1], len(times))
    # Steps hardly longer than the last digit to which times are printed are rounded to one of it or
    # two, in turn: where fewer than a tenth are two, samples are missing.
    if long.mean() < 0.1 or np.ptp(apart) > 2.0 * rounding:
        wrong |= long
    if not wrong.any():
        return float(times[-1] - times[0]) / (len(times) - 1)
    at = int(wrong.argmax())
    gap = ""
    if step > 0.0 and long[at]:
        missing = np.round(steps[long] / step).astype(int) - 1
        gap = f": {missing[0]} missing"
        if len(missing) > 1:
            gap += f", and {missing[1:].sum()} more at {len(missing) - 1} other places"
    raise ValueError(
        f"times must advance by equal steps; after sample {at + 1} (at {times[at]:.10g} s) the "
        f"step is {steps[at]:.6g} s, most are {step:.6g} s{gap}"
    )


def _decimals(times: FloatArray) -> int:
    """The fewest decimals that the first times need, at most 9."""
    first = times[:100]
    exact = 1e-10 + 2.0 * np.spacing(np.abs(first).max())
    return next((k for k in range(9) if np.allclose(first, np.round(first, k), 0.0, exact)), 9)
