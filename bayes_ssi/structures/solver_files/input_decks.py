"""Geometry from input decks of Abaqus and CalculiX: lines of ``*NODE`` and ``*ELEMENT``."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from bayes_ssi.structures.geometry import Geometry, Point
from bayes_ssi.structures.solver_files.element_faces import OuterFaces, node_count

# Keywords whose option INPUT names a file with their data lines, or with more of the deck.
WITH_INPUT = ("*INCLUDE", "*NODE", "*ELEMENT")
# Beams and trusses begin so; a drawing joins their nodes in the order in which the deck states
# them.
MEMBERS = ("B2", "B3", "T2", "T3", "PIPE")


def geometry_of_deck(path: Path) -> Geometry | None:
    """Nodes that a deck states, and its beams, shells and solids; None if it states no node.

    Decks that it includes are read as well. Nodes that it generates or copies, and parts that it
    places elsewhere, are missing.
    """
    nodes: dict[str, Point] = {}
    lines: list[tuple[str, str]] = []
    faces = OuterFaces()
    begun: list[int] = []  # the element and nodes of a shell or solid, which may take two lines
    for place, keyword, options, fields in _data_lines(path, "", {}):
        try:
            kind = options.get("TYPE", "").upper()
            numbers = [int(each) for each in fields[: 1 if keyword == "*NODE" else None]]
            if keyword == "*NODE":
                x, y, z = ([float(each) for each in fields[1:4]] + [0.0] * 3)[:3]
                nodes[str(numbers[0])] = (x, y, z)
            elif kind.startswith(MEMBERS):
                lines += pairwise(map(str, numbers[1:]))
            elif (count := node_count(kind)) is not None:
                begun += numbers
                if len(begun) > count + 1:
                    raise ValueError(kind)
                if len(begun) > count:
                    faces.add(kind, begun[1:])
                    begun = []
        except ValueError:
            raise ValueError(
                f"{place}: expected whole numbers of nodes and elements, and coordinates, got "
                f"{', '.join(fields)!r}"
            ) from None
    if not nodes:
        return None
    of_faces = (tuple(map(str, face)) for face in faces)
    return Geometry(
        nodes,
        tuple(line for line in lines if set(line) <= nodes.keys()),
        faces=tuple(face for face in of_faces if set(face) <= nodes.keys()),
    )


def _data_lines(
    path: Path, keyword: str, options: dict[str, str]
) -> Iterator[tuple[str, str, dict[str, str], list[str]]]:
    """File and line, keyword, its options and the fields of each line of nodes and elements."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip().rstrip(",")
            if not text or text.startswith("**"):
                continue
            if not text.startswith("*"):
                if keyword in ("*NODE", "*ELEMENT"):
                    fields = [each.strip() for each in text.split(",")]
                    yield f"{path}: line {number}", keyword, options, fields
                continue
            first, *others = (each.strip() for each in text.split(","))
            keyword = first.upper()
            pairs = (each.partition("=") for each in others)
            options = {name.strip().upper(): value.strip() for name, _, value in pairs}
            if keyword in WITH_INPUT and "INPUT" in options:
                inside = "" if keyword == "*INCLUDE" else keyword
                yield from _data_lines(path.parent / options["INPUT"], inside, options)
