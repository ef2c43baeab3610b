"""Labels of degrees of freedom, "node direction", from the numbers and names of programs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

# Displacements along and rotations about the axes, in the order in which programs number them.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
TRANSLATIONS = DIRECTIONS[:3]
# What labels of rows begin with whose node the program made itself: they are no displacements of
# points of the structure.
INTERNAL = "internal"

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
