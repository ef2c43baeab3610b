"""Tables of modes as people keep them, turned into the columns that files of modes have.

Units in names are understood, ``Frequency [Hz]``, ``omega (rad/s)``, ``Period (s)``, ``Damping
[%]``, and other words for the label; components in two columns, ``roof mag`` and ``roof phase
(deg)`` or ``roof re`` and ``roof im``, or as ``0.5∠2.1°``; tables with a column for each mode; and
modes without labels, which are 1, 2, …. What may mean two things is refused with its cure.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from bayes_ssi.foundations.argument_types import repeated
from bayes_ssi.foundations.text_files import WORKBOOKS, first_bytes, read_columns
from bayes_ssi.measurements.modes.identified_mode import RESERVED_NAMES

T = TypeVar("T", float, complex)

FREQUENCY = r"(natural_|modal_|eigen_?)?freq(uency|uenz)?"
# What people call a column, all but letters and units as underscores, and what it is.
SPELLED = {
    "label": r"label|mode|name|id|no\.?|nr\.?|#|mode_(no|nr|number|name)\.?",
    "frequency_hz": rf"({FREQUENCY}|f|fn)_hz",
    "frequency_rad_s": rf"({FREQUENCY}|omega|ω)_rad_s",
    "period_s": r"(natural_)?period_s",
    "frequency_cov_%": r"frequency_cov_%|cov_%",
    "damping": r"(damping(_ratio)?|zeta|ζ|xi|ξ)(_-)?",
    "damping_%": r"(damping(_ratio)?|zeta|ζ|xi|ξ)_%",
    "damping_sd_%": r"damping_sd_%",
}
# Of those above, the column that a file is documented to have, and what makes it of their numbers.
MEANT: dict[str, tuple[str, Callable[[float], float]]] = {
    "frequency_rad_s": ("frequency_hz", lambda omega: omega / (2.0 * np.pi)),
    "period_s": ("frequency_hz", lambda period: 1.0 / period),
    "frequency_cov_%": ("frequency_cov", lambda percent: 0.01 * percent),
    "damping_%": ("damping", lambda percent: 0.01 * percent),
    "damping_sd_%": ("damping_sd", lambda percent: 0.01 * percent),
}
OF_A_MODE = (*RESERVED_NAMES, *MEANT)  # columns that are no sensors
FREQUENCIES = ("frequency_hz", "frequency_rad_s", "period_s")
PARTS = {"ma": "size", "am": "size", "ab": "size", "ph": "phase", "re": "re", "im": "im"}
PART = re.compile(
    r"(.+?)[\s_]+[(\[]?(mag|magnitude|amp|amplitude|abs|phase|re|real|im|imag)[)\]]?"
    r"\s*(?:[(\[]\s*(deg|°|rad)\s*[)\]])?",
    re.IGNORECASE,
)
POLAR = re.compile(r"(.+?)\s*∠\s*(.+?)\s*(°|deg|rad)?")


@dataclass(frozen=True)
class Line:
    """One line of the file that is not blank."""

    path: Path
    number: int
    cells: list[str]
    decimal_comma: bool

    @property
    def is_comment(self) -> bool:
        return self.cells[0].startswith("#")

    def key_and_cells(self) -> tuple[str, list[str]]:
        """The key that a comment states, in lower case, and the cells behind it."""
        first, *others = self.cells
        plain = first.lstrip("# ").strip()
        # '# band_hz: 0, 6', '# band_hz = 0, 6' and '# band_hz, 0, 6' are what people write, also
        # above cells that semicolons separate.
        stated = re.fullmatch(r"(\w+)\s*[:=,]\s*(.*)", plain)
        cells = [stated[2], *others] if stated else others
        return (stated[1] if stated else plain).lower(), [cell for cell in cells if cell]

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
    cells = {
        cell.strip(' "\ufeff')
        for line in text.lower().split("\n")[:50]
        for cell in re.split("[,;\t]", line)
    }
    return "label" in cells or any(
        spelled(cell) in FREQUENCIES or re.fullmatch(FREQUENCY, cell) for cell in cells
    )


def has_frequencies(names: Sequence[str]) -> bool:
    return any(spelled(name) in FREQUENCIES for name in names)


def upright(table: list[Line]) -> list[Line]:
    """The table with a row for each mode, also where it has a column for each."""
    heads = [line.cells[0] for line in table]
    if not has_frequencies(heads) or has_frequencies(table[0].cells):
        return table
    n = max(len(line.cells) for line in table)
    padded = [line.cells + [""] * (n - len(line.cells)) for line in table]
    turned = [list(cells) for cells in zip(*padded, strict=True)]
    turned[0][0] = turned[0][0] or "label"
    return [replace(table[0], cells=cells) for cells in turned]


def spelled(name: str) -> str:
    """A name of this file's own columns as :data:`SPELLED` has it; others, of sensors, as it is."""
    plain = re.sub(r"[\s_()\[\]/]+", "_", name.lower()).strip("_")
    if plain in RESERVED_NAMES:
        return plain
    return next((column for column, form in SPELLED.items() if re.fullmatch(form, plain)), name)


def column_names(line: Line) -> list[str]:
    own = "label" in map(str.lower, line.cells)  # beside it others that may be labels are not
    names = [
        cell if own and spelled(cell) == "label" != cell.lower() else spelled(cell)
        for cell in line.cells
    ]
    while names and not names[-1]:
        names.pop()
    if names and not names[0] and "label" not in names:
        names[0] = "label"  # an index, as spreadsheets keep it
    if not has_frequencies(names):
        for name in names:
            if re.fullmatch(FREQUENCY, name, re.IGNORECASE):
                raise line.error(f"column {name!r}: state its unit, '{name} (Hz)' or '(rad/s)'")
        raise line.error(
            f"no column 'frequency_hz' among {', '.join(map(repr, names))}; the columns are label, "
            "frequency_hz, optionally frequency_cov, shape_sd, damping and damping_sd, and one for "
            "each sensor"
        )
    if not all(names):
        raise line.error("a column has no name")
    meant = [MEANT[name][0] if name in MEANT else name for name in names]
    if twice := repeated(meant):
        raise line.error(f"two columns are named {twice[0]!r}")
    return names


def combined(columns: list[str], rows: Sequence[Line]) -> tuple[list[str], list[Line]]:
    """The table with one column for each sensor where two hold parts of its components."""
    parts: dict[str, dict[str, str]] = {}  # sensor → part of its components → column
    rad, unstated = set(), []
    for column in columns:
        if column not in OF_A_MODE and (match := PART.fullmatch(column)):
            part = PARTS[match[2].lower()[:2]]
            parts.setdefault(match[1], {})[part] = column
            rad |= {column} if (match[3] or "").lower() == "rad" else set()
            unstated += [column] if part == "phase" and not match[3] else []
    pairs = {n: of for n, of in parts.items() if set(of) in ({"size", "phase"}, {"re", "im"})}
    if not pairs:
        return columns, list(rows)
    taken = {column for of in pairs.values() for column in of.values()}
    kept = [column for column in columns if column not in taken]
    made, phases = [], [0.0]
    for row in rows:
        cells = dict(zip(columns, row.cells + [""] * len(columns), strict=False))
        beyond = row.cells[len(columns) :]  # which is refused
        numbers = {c: row.parse(float, cells[c], c) if cells[c] else np.nan for c in taken}
        phases += [abs(numbers[column]) for column in unstated if numbers.get(column)]
        components = [
            complex(numbers[of["re"]], numbers[of["im"]])
            if "im" in of
            else numbers[of["size"]] * np.exp(1j * numbers[p] * (1.0 if p in rad else np.pi / 180))
            for of in pairs.values()
            for p in [of.get("phase", "")]
        ]
        texts = [component_text(complex(each)) for each in components]
        made.append(replace(row, cells=[*(cells[c] for c in kept), *texts, *beyond]))
    if 0.0 < np.nanmax(phases) <= 2.0 * np.pi:
        (column, *_) = unstated
        raise rows[0].error(f"column {column!r}: state its unit, '{column} (deg)' or '(rad)'")
    return [*kept, *pairs], made


def component(text: str, column: str, line: Line) -> complex:
    if not text:
        return complex("nan")
    name = f"sensor {column!r}"
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
