"""Tables of modes as people keep them, as the columns that files of modes are documented to have.

Units in names are understood, ``Frequency [Hz]``, ``omega (rad/s)``, ``Period (s)``, ``Damping
[%]``, and other words for the label; components in two columns, ``roof mag`` and ``roof phase
(deg)`` or ``roof re`` and ``roof im``, or as ``0.5∠2.1°``; tables with a column for each mode; and
modes without labels, which are 1, 2, …. What may mean two things is refused with its cure.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bayes_ssi.foundations.argument_types import repeated
from bayes_ssi.foundations.text_files import WORKBOOKS, first_bytes, read_columns
from bayes_ssi.measurements.modes.identified_mode import RESERVED_NAMES, IdentifiedMode

T = TypeVar("T", float, complex)
Conversion = Callable[[Any], Any]
# Of a column: its name, the documented column or the sensor, the part of the sensor's components
# that it holds, and the conversion of its cells.
Meaning = tuple[str, str, str, Conversion]

FREQUENCY = r"(natural_|modal_|eigen_?)?freq(uency|uenz)?"
UNSTATED = re.compile(FREQUENCY, re.IGNORECASE)  # which may be in Hz or rad/s
DAMPING = r"(damping(_ratio)?|zeta|ζ|xi|ξ)"
# What people call a column, all but letters and units as underscores; the column that it is, and
# its numbers from theirs.
SPELLED: dict[str, tuple[str, Conversion]] = {
    **{name: (name, float) for name in RESERVED_NAMES},
    r"mode|name|id|no\.?|nr\.?|#|mode_(no|nr|number|name)\.?": ("label", float),
    rf"({FREQUENCY}|f|fn)_hz": ("frequency_hz", float),
    rf"({FREQUENCY}|omega|ω)_rad_s": ("frequency_hz", lambda omega: omega / (2.0 * np.pi)),
    r"(natural_)?period_s": ("frequency_hz", lambda period: 1.0 / period),
    r"(frequency_)?cov_%": ("frequency_cov", lambda percent: 0.01 * percent),
    rf"{DAMPING}(_-)?": ("damping", float),
    rf"{DAMPING}_%": ("damping", lambda percent: 0.01 * percent),
    r"damping_sd_%": ("damping_sd", lambda percent: 0.01 * percent),
}
PART = re.compile(
    r"(.+?)[\s_]+[(\[]?(mag|magnitude|amp|amplitude|abs|phase|re|real|im|imag)[)\]]?"
    r"\s*(?:[(\[]\s*(deg|°|rad)\s*[)\]])?",
    re.IGNORECASE,
)
PARTS = {"ma": "size", "am": "size", "ab": "size", "ph": "phase", "re": "re", "im": "im"}
OTHER_PART = {"size": "phase", "phase": "size", "re": "im", "im": "re"}
POLAR = re.compile(r"(.+?)\s*∠\s*(.+?)\s*(°|deg|rad)?")


@dataclass(frozen=True)
class Line:
    """One line of the file that is not blank."""

    path: Path
    number: int
    cells: list[str]
    decimal_comma: bool

    def error(self, message: str) -> ValueError:
        return ValueError(f"{self.path}, line {self.number}: {message}")

    def parse(self, kind: Callable[[str], T], text: str, column: str) -> T:
        try:
            if "_" in text:  # Python would accept the underscore, a typing error here
                raise ValueError
            return kind(text.replace(",", ".") if self.decimal_comma else text)
        except ValueError:
            raise self.error(f"{column}: {text!r} is not a number") from None


def holds_modes(path: Path) -> bool:
    """Whether one of the first lines of a text, or of a workbook, names columns of modes."""
    is_book = path.suffix.lower() in WORKBOOKS
    text = read_columns(path)[0] if is_book else first_bytes(path).decode("utf-8", errors="ignore")
    text = text[:8192].replace("\0", "").lower()  # which UTF-16 has beside letters
    cells = {cell.strip(' "\r\ufeff') for cell in re.split('[,;\t\n"]', text)}
    return "label" in cells or has_frequencies(cells) or any(map(UNSTATED.fullmatch, cells))


def has_frequencies(names: Iterable[str]) -> bool:
    return any(_spelled(name)[0] == "frequency_hz" for name in names)


def upright(table: list[Line]) -> list[Line]:
    """The table with a row for each mode, also where it has a column for each."""
    heads = [line.cells[0] for line in table]
    if not has_frequencies(heads) or has_frequencies(table[0].cells):
        return table
    turned = [list(cells) for cells in zip_longest(*(line.cells for line in table), fillvalue="")]
    turned[0][0] = turned[0][0] or "label"
    return [replace(table[0], cells=cells) for cells in turned]


def _spelled(name: str) -> tuple[str, Conversion]:
    """The column of this file's own that a name means, "" of a sensor's, and its conversion."""
    plain = re.sub(r"[\s_()\[\]/]+", "_", name.lower()).strip("_")
    return next((own for form, own in SPELLED.items() if re.fullmatch(form, plain)), ("", float))


def columns_of(head: Line, rows: Sequence[Line]) -> list[Meaning]:
    """What the columns of a table are, by their names and, of phases, by their size."""
    names = list(head.cells)
    while names and not names[-1]:
        names.pop()
    spelled = [_spelled(name) for name in names]
    if not has_frequencies(names):
        for name in filter(UNSTATED.fullmatch, names):
            raise head.error(f"column {name!r}: state its unit, '{name} (Hz)' or '(rad/s)'")
        if len(names) == 1:
            raise head.error("columns must be separated by commas, semicolons or tabs")
        raise head.error(
            f"no column 'frequency_hz' among {', '.join(map(repr, names))}; the columns are label, "
            "frequency_hz, optionally frequency_cov, shape_sd, damping and damping_sd, and one for "
            "each sensor"
        )
    if not names[0] and all(own != "label" for own, _ in spelled):
        names[0], spelled[0] = "label", ("label", float)  # an index, as spreadsheets keep it
    if not all(names):
        at = names.index("") + 1
        raise head.error(f"column {at} has no name; name it, or remove it if it counts rows")
    is_stated = "label" in map(str.lower, names)  # beside it others that may be labels are not
    parts = [PART.fullmatch(name) for name in names]
    of_sensors = [(part[1], PARTS[part[2][:2].lower()]) if part else ("", "") for part in parts]
    meanings, unstated = list[Meaning](), list[int]()
    for j, (name, (own, conversion), part) in enumerate(zip(names, spelled, parts, strict=True)):
        sensor, kind = of_sensors[j]
        if own and not (is_stated and own == "label" != name.lower()):
            meanings.append((name, own, "whole", conversion))
        elif part and (sensor, OTHER_PART[kind]) in of_sensors:
            in_degrees = kind == "phase" and (part[3] or "").lower() != "rad"
            unstated += [j] if in_degrees and not part[3] else []
            in_rad = (lambda phase: np.deg2rad(phase.real)) if in_degrees else np.real
            meanings.append((name, sensor, kind, in_rad))
        else:
            meanings.append((name, name, "whole", complex))
    first, counts = meanings[0], [row.cells[0] == str(i) for i, row in enumerate(rows, 1)]
    if first[1] not in RESERVED_NAMES and len(rows) > 1 and all(counts):
        raise head.error(f"column {first[0]!r} counts the modes; name it 'label'")
    if twice := repeated(
        [f"{column} {part}".removesuffix(" whole") for _, column, part, _ in meanings]
    ):
        raise head.error(f"two columns are named {twice[0]!r}")
    _require_degrees(head, rows, unstated)
    return meanings


def _require_degrees(head: Line, rows: Sequence[Line], columns: Sequence[int]) -> None:
    """Ask for the unit of columns of phases that state none where all are angles in rad, too."""
    cells = [(row, row.cells[j]) for row in rows for j in columns if any(row.cells[j : j + 1])]
    largest = max((abs(row.parse(float, cell, "phase")) for row, cell in cells), default=0.0)
    if 0.0 < largest <= 2.0 * np.pi:
        name = head.cells[columns[0]]
        raise head.error(f"column {name!r}: state its unit, '{name} (deg)' or '(rad)'")


def mode_of(line: Line, columns: Sequence[Meaning], number: int) -> IdentifiedMode:
    """The mode of a row; its label is its number where no column holds it."""
    if any(line.cells[len(columns) :]):
        raise line.error(f"{len(line.cells)} cells for {len(columns)} columns")
    cells = [*line.cells, *[""] * len(columns)]
    label, numbers, parts = str(number), dict[str, float](), dict[str, dict[str, complex]]()
    for (name, column, part, conversion), text in zip(columns, cells, strict=False):
        if column == "label":
            label = text
        elif column not in RESERVED_NAMES:
            of_sensor = parts.setdefault(column, {})
            of_sensor[part] = conversion(_component(text, column, line))
        elif text:
            try:
                numbers[column] = conversion(line.parse(float, text, name))
            except ZeroDivisionError:
                raise line.error(f"{name}: must be positive, got 0") from None
    if "frequency_hz" not in numbers:
        raise line.error("frequency_hz: the cell is empty")
    if not 0.0 <= numbers.get("damping", 0.0) < 1.0:
        raise line.error(
            f"damping: {numbers['damping']:g} is no fraction of critical damping; if it is in "
            "percent, name the column 'damping (%)'"
        )
    shape = np.array([_whole(**of_sensor) for of_sensor in parts.values()])
    measured = shape[np.isfinite(shape)]
    try:
        return IdentifiedMode(
            label,
            shape=(shape if measured.imag.any() else shape.real) if len(measured) else None,
            **numbers,
        )
    except ValueError as error:
        raise line.error(str(error)) from None


def _whole(whole: complex = 0.0, re: complex = 0.0, im: complex = 0.0, size: complex = 0.0,
           phase: complex = 0.0) -> complex:  # fmt: skip
    """A component of the parts that columns state."""
    return complex(whole + re + 1j * im + size * np.exp(1j * phase))


def _component(text: str, sensor: str, line: Line) -> complex:
    if not text:
        return complex("nan")
    name = f"sensor {sensor!r}"
    if (polar := POLAR.fullmatch(text)) is not None:
        size, phase = (line.parse(float, part, name) for part in polar.groups()[:2])
        if not polar[3] and phase:
            raise line.error(f"{name}: {text!r}: state the unit of the phase, ° or rad")
        return complex(size * np.exp(1j * (phase if polar[3] == "rad" else np.deg2rad(phase))))
    # Space around the sign, as in "0.3 + 0.1i", is how people write complex numbers.
    written = re.sub(r"(?<=[\dji])\s*([+-])\s*(?=[\d.])", r"\1", text) if " " in text else text
    value = line.parse(complex, written.replace("i", "j"), name)
    if not np.isfinite(value):
        raise line.error(f"{name}: {text!r} is not finite; leave a missing value empty")
    return value


def component_text(component: complex) -> str:
    if not np.isfinite(component):
        return ""
    if isinstance(component, complex):
        return f"{float(component.real)!r}{float(component.imag):+}j"
    return repr(float(component))
