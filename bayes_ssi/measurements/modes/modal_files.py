"""Files of identified modes: mostly CSV, with one row per mode, as a spreadsheet saves it.

The guide's chapter on them has an example. Rows that start with ``#`` hold a key and its values:
``band_hz``, ``source``, ``failed_check`` (a sentence; there may be several) and
``identification`` (a file in the same directory); anything else there is a comment, allowed above
the column names only. Other tables that people keep are understood, too
(:mod:`bayes_ssi.measurements.modes.table_spellings`).

The JSON file beside it holds ``sensors``, and for m modes at n sensors ``frequencies_hz`` (m),
``unit_shapes`` (m lists of n components, null where not measured) and
``covariance_of_log_frequencies_and_unit_shapes`` (m + m n, m + m n), shapes mode by mode, null
where errors are independent. Frequencies and shapes tell which row of the CSV file is which mode,
so that its modes may be renamed, sorted or left out. Its ``identifications`` are records of each
vibration record that the modes come from, one, or several where modes were merged. Paths of figures
are relative to the file's directory.
"""

import csv
import io
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.foundations.text_files import first_bytes, read_columns
from bayes_ssi.foundations.universal_files import begins_universal, read_data_sets
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import RESERVED_NAMES, IdentifiedMode, of_modes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.modes.table_spellings import (
    Line,
    columns_of,
    component_text,
    has_frequencies,
    mode_of,
    upright,
)

REQUIRED_COLUMNS = ("label", "frequency_hz")
NUMBER_COLUMNS = RESERVED_NAMES[1:]

ONCE = ("source", "band_hz", "identification")  # keys that a file may hold once
DELIMITERS = ",;\t"
MOST_MODES = 5000  # of a file that is not one of other things


@checked
def read_modal_data(
    path: str | Path, *, band_hz: Sequence[float] | None = None, sheet: str | int = 0
) -> ModalData:
    """Read identified modes from a CSV file, or from the data sets 55 of a universal file.

    A universal file is recognised by its first line; every node and direction that moves is a
    sensor, named ``12 x``. The CSV file has a row for each mode, under names of columns:
    ``frequency_hz``, which is required, ``label``, ``frequency_cov``, ``shape_sd``, ``damping`` and
    ``damping_sd``; every other column is a sensor. Cells without a value were not measured.

    Args:
        path: the file.
        band_hz: lowest and highest frequency (Hz) of the search, in place of a CSV file's own; a
            universal file cannot state them.
        sheet: of a workbook.

    Raises:
        OSError: the file cannot be read.
        ValueError: the content is not understood, or the band is missing; the message names the
            file and, for CSV, the line and the column.
    """
    path = Path(path)
    if begins_universal(first_bytes(path)):
        if band_hz is None:
            raise ValueError(
                f"{path}: give band_hz (--band); a universal file does not state the band"
            )
        return _read_universal(path, band_hz)
    lines = _split(path, sheet)
    table = upright([line for line in lines if line.cells[0][:1] != "#"])
    if not table:
        raise ValueError(f"{path}: the file holds no table of modes")
    columns = columns_of(table[0], table[1:])
    modes = tuple(mode_of(line, columns, i) for i, line in enumerate(table[1:], 1))
    if not modes:
        raise ValueError(f"{path}: no mode below the column names")
    stated = _read_statements(lines)
    bands = stated["band_hz"] if band_hz is None else [band_hz]
    if not bands:
        raise ValueError(
            f"{path}: no band; add a line such as '# band_hz, 0, 6' above the column names: the "
            "lowest and highest frequency (Hz) of the search for modes"
        )
    low, high = bands[0]
    sensors = tuple(dict.fromkeys(name for _, name, *_ in columns if name not in RESERVED_NAMES))
    covariance: FloatArray | None = None
    identifications: tuple[IdentificationSummary, ...] = ()
    for name in stated["identification"]:
        beside = path.parent / name
        content = _read_companion(beside, path)
        covariance = _covariance_of(content, beside, modes, sensors)
        identifications = content.identifications
    try:
        return ModalData(
            modes, (low, high), sensors, "".join(stated["source"]), covariance, identifications,
            tuple(stated["failed_check"]),
        )  # fmt: skip
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


@checked
def write_modal_data(data: ModalData, path: str | Path) -> tuple[Path, ...]:
    """Write identified modes to a new CSV file.

    Their joint covariance, and how they were identified, are in a file next to it.

    Args:
        data: the modes; :func:`bayes_ssi.read_modal_data` reads them back unchanged.
        path: path of the file; the other ends in ``.identification.json`` in place of ``.csv``.

    Returns:
        The files that were written.

    Raises:
        FileExistsError: a file exists.
    """
    path, beside = modal_files(path)
    has_companion = data.covariance is not None or bool(data.identifications)
    files = (path, beside) if has_companion else (path,)
    for written in files:
        if written.exists():
            raise FileExistsError(f"{written} exists; give another name")
    optional = [
        name
        for name in NUMBER_COLUMNS[1:]
        if any(getattr(mode, name) is not None for mode in data.modes)
    ]
    with path.open("x", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if data.source:
            writer.writerow(["# source", data.source])
        writer.writerows(["# failed_check", check] for check in data.failed_checks)
        writer.writerow(["# band_hz", *(repr(float(bound)) for bound in data.band_hz)])
        if has_companion:
            writer.writerow(["# identification", beside.name])
        writer.writerow([*REQUIRED_COLUMNS, *optional, *data.sensors])
        for mode in data.modes:
            numbers = [getattr(mode, name) for name in ("frequency_hz", *optional)]
            components = [np.nan] * len(data.sensors) if mode.shape is None else mode.shape
            writer.writerow(
                [mode.label]
                + ["" if number is None else repr(float(number)) for number in numbers]
                + [component_text(component) for component in components]
            )
    if has_companion:
        _write_companion(data, beside)
    return files


def modal_files(path: str | Path) -> tuple[Path, Path]:
    """The files that :func:`write_modal_data` may write."""
    return Path(path), Path(path).with_suffix(".identification.json")


def _split(path: Path, sheet: str | int) -> list[Line]:
    """The lines that are not blank, at the delimiter that gives a column of frequencies."""
    text, stated = read_columns(path, sheet)
    if (n_lines := text.count("\n")) > MOST_MODES:
        raise ValueError(
            f"{path}: {n_lines:,} lines; a file of modes has one for each of at most "
            f"{MOST_MODES:,}. If it is a record, identify its modes"
        )
    delimiters = DELIMITERS if stated is None else stated
    cuts = [_lines(path, text, delimiter) for delimiter in delimiters]
    whole = (cut for cut in cuts if any(has_frequencies(line.cells) for line in cut))
    return next(whole, max(cuts, key=lambda cut: len(cut[-1].cells)))


def _lines(path: Path, text: str, delimiter: str) -> list[Line]:
    """The lines that are not blank, cut at ``delimiter``."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True)
    lines, number = [], 1
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                lines.append(Line(path, number, [cell.strip() for cell in row], delimiter != ","))
            number = reader.line_num + 1  # a quoted cell may run over several lines
    except csv.Error as error:
        raise ValueError(f"{path}, line {number}: not CSV: {error}") from None
    return lines


def _read_statements(lines: list[Line]) -> dict[str, list[Any]]:
    """Key → what its lines state: texts, and the two frequencies of a band."""
    stated: dict[str, list[Any]] = {key: [] for key in (*ONCE, "failed_check")}
    first: dict[str, int] = {}
    is_below = False
    for line in lines:
        cell, *others = line.cells
        if cell[:1] != "#":
            is_below = True
            continue
        # '# band_hz: 0, 6', '# band_hz = 0, 6' and '# band_hz, 0, 6' are what people write, also
        # above cells that semicolons separate.
        key, *behind = re.split(r"\s*[:=,]\s*", cell.strip("# "), maxsplit=1)
        key, values = key.lower(), [value for value in (*behind, *others) if value]
        if key in ONCE and first.setdefault(key, line.number) != line.number:
            raise line.error(f"a second line of {key}; the first is line {first[key]}")
        if key == "band_hz":
            separators = r"[,;]?\s+|;" if line.decimal_comma else r"[,\s]+"
            values = [part for value in values for part in re.split(separators, value) if part]
            if len(values) != 2:
                raise line.error(f"band_hz needs two frequencies in Hz, got {values!r}")
            stated[key].append([line.parse(float, value, "band_hz") for value in values])
        elif key == "identification" and len(values) != 1:
            raise line.error(f"{key} needs the name of one file, got {values!r}")
        elif key in stated:
            stated[key].append(", ".join(values))
        elif key == "covariance":
            raise line.error("of an earlier version; identify again, or remove it and its file")
        elif is_below:
            raise line.error(
                "a row beginning with '#' below the column names that holds no key; comments "
                "belong above them, and no mode's label may begin with '#'"
            )
    return stated


@dataclass(frozen=True)
class Companion:
    sensors: tuple[str, ...]
    frequencies_hz: FloatArray
    unit_shapes: tuple[tuple[float | None, ...], ...]
    covariance_of_log_frequencies_and_unit_shapes: Any  # a large list of lists, or None
    identifications: tuple[IdentificationSummary, ...]


def _write_companion(data: ModalData, path: Path) -> None:
    """Write what a CSV file does not hold of these modes to a new file."""
    shapes = [
        tuple(float(component) if np.isfinite(component) else None for component in shape)
        for shape in data.unit_shapes.T
    ]
    identifications = tuple(
        replace(each, figures=tuple(os.path.relpath(file, path.parent) for file in each.figures))
        for each in data.identifications
    )
    content = Companion(
        data.sensors, data.frequencies_hz, tuple(shapes), data.covariance, identifications
    )
    with path.open("x", encoding="utf-8") as file:
        json.dump(to_record(content), file)


def _read_companion(path: Path, csv_path: Path) -> Companion:
    """The file that a CSV file names."""
    lost = "and with it the covariance, and what is known of failed checks"
    try:
        content = from_record(Companion, json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ValueError(
            f"{csv_path}: no file {path.name}, which its line 'identification' names, in its "
            f"directory; put it there, or remove the line, {lost}"
        ) from None
    except ValueError as error:
        raise ValueError(
            f"{path}: no record of the identification that this version reads: {error}; identify "
            f"again, or remove the line 'identification' of {csv_path.name}, {lost}"
        ) from None
    moved = tuple(
        replace(summary, figures=tuple(str(path.parent / file) for file in summary.figures))
        for summary in content.identifications
    )
    return replace(content, identifications=moved)


def _covariance_of(
    content: Companion, path: Path, modes: Sequence[IdentifiedMode], sensors: Sequence[str]
) -> FloatArray | None:
    """The joint covariance of ``modes``, in their order; None if the file holds none."""
    if content.covariance_of_log_frequencies_and_unit_shapes is None:
        return None
    if content.sensors != tuple(sensors):
        raise ValueError(
            f"{path}: the sensors, {', '.join(map(repr, content.sensors))}, are not those of the "
            "CSV file; names and order must be the same in both files"
        )
    frequencies = content.frequencies_hz
    m, n = len(frequencies), len(sensors)
    size = m + m * n
    try:
        shapes = np.array(content.unit_shapes, dtype=float).reshape(m, n)
        matrix = np.reshape(content.covariance_of_log_frequencies_and_unit_shapes, (size, size))
        matrix = matrix.astype(float)
    except (TypeError, ValueError):
        raise ValueError(
            f"{path}: {m} modes at {n} sensors need unit_shapes {(m, n)} and a covariance "
            f"{(size, size)} of numbers"
        ) from None
    sds = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
    places: list[int] = []
    for mode in modes:
        i = int(np.abs(frequencies - mode.frequency_hz).argmin())
        unit = np.full(n, np.nan) if mode.unit_shape is None else mode.unit_shape
        measured = np.isfinite(shapes[i])
        # Numbers in the CSV file may be rounded, by less than their standard deviations.
        is_same = abs(mode.frequency_hz / frequencies[i] - 1.0) <= sds[i]
        is_same &= np.array_equal(np.isfinite(unit), measured)
        of_shape = sds[m + n * i : m + n * (i + 1)][measured]
        is_same &= np.linalg.norm((unit - shapes[i])[measured]) <= np.linalg.norm(of_shape)
        if i in places or not is_same:
            raise ValueError(
                f"{path}: not the covariance of these modes: mode {mode.label!r} differs in "
                "frequency or shape by more than its standard deviation; identify again, or remove "
                "the line 'identification' of the CSV file to use each mode's own errors"
            )
        places.append(i)
    return of_modes(matrix, places, m, n)


DATA_OF_AXES = {"x": "r1", "y": "r2", "z": "r3"}
# Of data sets 55, data at nodes: the analysis types that are modes.
ANALYSIS_TYPES = {2: "normal", 3: "complex", 7: "complex, second order"}


def _read_universal(path: Path, band_hz: Sequence[float]) -> ModalData:
    """Read the modes of a universal file.

    Returns:
        Modes labelled 1, 2, … in ascending order of frequency. A complex mode's frequency is
        |λ|/2π and its damping -Re λ/|λ|, λ being its eigenvalue in rad/s.
    """
    sets = read_data_sets(path, 55)
    sets = [s for s in sets if s["analysis_type"] in ANALYSIS_TYPES]
    if not sets:
        raise ValueError(f"{path}: no data set 55 with a normal or complex mode")
    modes = sorted((*_frequency_and_damping(s), i) for i, s in enumerate(sets))
    frequencies, dampings, order = (np.array(column) for column in zip(*modes, strict=True))
    # Of each mode, node and direction → component; what no mode moves is no sensor.
    motions = [
        {
            (int(node), direction): component
            for direction, key in DATA_OF_AXES.items()
            for node, component in zip(one["node_nums"], one[key], strict=True)
        }
        for one in sets
    ]
    moving = sorted({place for motion in motions for place, c in motion.items() if c != 0})
    components = [[motions[i].get(place, np.nan) for i in order] for place in moving]
    try:
        return ModalData.from_arrays(
            frequencies,
            np.reshape(components, (len(moving), len(sets))),
            band_hz,
            tuple(f"{node} {direction}" for node, direction in moving),
            path.name,
            damping=np.where((dampings > 0.0) & (dampings < 1.0), dampings, np.nan),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _frequency_and_damping(one: Mapping[str, Any]) -> tuple[float, float]:
    if ANALYSIS_TYPES[one["analysis_type"]] == "normal":
        return float(one["freq"]), float(one.get("modal_damp_vis", 0.0))
    size = abs(one["eig"])
    return float(size / (2.0 * math.pi)), float(-np.real(one["eig"]) / size) if size else 0.0
