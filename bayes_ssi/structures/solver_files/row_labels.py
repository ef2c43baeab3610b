"""Labels of rows, "node direction", from the numbers and names that programs give directions."""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from bayes_ssi.structures.solver_files.text_entries import require_whole_lines

# Displacements along and rotations about the axes, in the order in which programs number them.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
TRANSLATIONS = DIRECTIONS[:3]
# What labels of rows begin with whose node the program made itself: they are no displacements of
# points of the structure.
INTERNAL = "internal"
_LABEL = re.compile(r"(\S.*?)[\s.,;]+(\w+)")

_NAMES = {
    name: direction
    for number, direction in enumerate(DIRECTIONS, start=1)
    for name in (
        str(number),
        direction,
        f"u{direction}" if number <= 3 else f"rot{direction[1]}",
        f"u{number}" if number <= 3 else f"r{number - 3}",
    )
}


def direction(name: str | int) -> str:
    """The direction that a program calls 1 to 6, U1 to R3, UX to ROTZ, or x to rz."""
    known = _NAMES.get(str(name).strip().lower())
    if known is None:
        raise ValueError(
            f"direction must be x, y, z, rx, ry or rz (or 1 to 6, U1 to R3, UX to ROTZ), got "
            f"{name!r}"
        )
    return known


def label(node: object, name: str | int) -> str:
    """ "12 x" for direction 1 of node 12."""
    return f"{str(node).strip()} {direction(name)}"


def numbered_label(node: object, number: int) -> str:
    """ "12 x" for 1; "12 dof8" for what is no displacement: warping, pressure, temperature."""
    known = 1 <= number <= len(DIRECTIONS)
    return label(node, number) if known else f"{node} dof{number}"


def read_labels(path: Path) -> list[str]:
    """Labels of lines such as ``12 x``, ``12 UX``, ``12 1`` or ``12.1``."""
    require_whole_lines(path)
    labels = []
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if not text:
                continue
            match = _LABEL.fullmatch(text)
            if match is None:
                raise ValueError(
                    f"{path}: line {number}: expected a node and a direction, got {text!r}"
                )
            try:
                labels.append(label(match[1], match[2]))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    return labels


def direction_of(name: str) -> str:
    """The direction in a label: x of "12 x" and of "12 x (2)"; nothing for internal rows."""
    if name.startswith(f"{INTERNAL} "):
        return ""
    return re.sub(r" \(\d+\)$", "", name).rsplit(" ", 1)[-1]


def without_repetitions(labels: Iterable[str]) -> tuple[tuple[str, ...], int]:
    """Labels of which the second of a name becomes "12 x (2)", and how many were changed."""
    labels = tuple(labels)
    seen: Counter[str] = Counter()
    unique = []
    for name in labels:
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(unique), len(labels) - len(seen)
