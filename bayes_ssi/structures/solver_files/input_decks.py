"""Geometry from input decks of Abaqus and CalculiX: lines of ``*NODE`` and ``*ELEMENT``.

Faces of shell and solid elements are given by their first, the corner nodes (Abaqus Elements Guide,
"Element library: faces and node ordering"; CalculiX CrunchiX User's Manual, section 6.2). Nodes on
the middle of sides follow the corners, and are not drawn.
"""

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

from bayes_ssi.structures.geometry import Geometry, Point

# Keywords whose option INPUT names a file with their data lines, or with more of the deck.
WITH_INPUT = ("*INCLUDE", "*NODE", "*ELEMENT")
# Beams and trusses begin so; a drawing joins their nodes in the order in which the deck states
# them.
MEMBERS = ("B2", "B3", "T2", "T3", "PIPE")
# Of solids, and of shells and membranes: their number of nodes.
SURFACES = re.compile(r"(C3D|S|M3D)(\d+)")
Faces = tuple[tuple[int, ...], ...]
TETRAHEDRON = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
BRICK = (
    (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)
)  # fmt: skip
SOLIDS: dict[int, Faces] = {
    **dict.fromkeys((4, 10), TETRAHEDRON),
    **dict.fromkeys((6, 15), WEDGE),
    **dict.fromkeys((8, 20), BRICK),
}
SHELLS: dict[int, Faces] = {
    **dict.fromkeys((3, 6), ((0, 1, 2),)),
    **dict.fromkeys((4, 8, 9), ((0, 1, 2, 3),)),
}


def geometry_of_deck(path: Path) -> Geometry | None:
    """Nodes that a deck states, and its beams, shells and solids; None if it states no node.

    Decks that it includes are read as well. Nodes that it generates or copies, and parts that it
    places elsewhere, are missing. Faces that two solids share lie within the structure.
    """
    nodes: dict[str, Point] = {}
    lines: list[tuple[str, str]] = []
    solids: dict[frozenset[str], tuple[str, ...]] = {}
    shells: dict[frozenset[str], tuple[str, ...]] = {}
    begun: list[int] = []  # the element and nodes of a shell or solid, which may take two lines
    for place, keyword, options, fields in data_lines(path):
        if keyword not in ("*NODE", "*ELEMENT"):
            continue
        try:
            kind = options.get("TYPE", "").upper()
            count, faces = _faces(kind)
            numbers = [int(each) for each in fields[: 1 if keyword == "*NODE" else None]]
            if keyword == "*NODE":
                x, y, z = ([float(each) for each in fields[1:4]] + [0.0] * 3)[:3]
                nodes[str(numbers[0])] = (x, y, z)
            elif kind.startswith(MEMBERS):
                lines += pairwise(map(str, numbers[1:]))
            elif faces:
                begun += numbers
                if len(begun) > count + 1:
                    raise ValueError(kind)
                if len(begun) <= count:
                    continue
                for corners in faces:
                    face = tuple(str(begun[1 + corner]) for corner in corners)
                    if not kind.startswith("C3D"):
                        shells[frozenset(face)] = face
                    elif solids.pop(frozenset(face), None) is None:
                        solids[frozenset(face)] = face
                begun = []
        except ValueError:
            raise ValueError(
                f"{place}: expected whole numbers of nodes and elements, and coordinates, got "
                f"{', '.join(fields)!r}"
            ) from None
    if not nodes:
        return None
    return Geometry(
        nodes,
        tuple(line for line in lines if set(line) <= nodes.keys()),
        faces=tuple(face for key, face in (solids | shells).items() if key <= nodes.keys()),
    )


def _faces(kind: str) -> tuple[int, Faces]:
    """Number of nodes, and corners of the faces; no faces of other elements, such as beams."""
    match = SURFACES.match(kind)
    if match is None:
        return 0, ()
    count = int(match[2])
    return count, (SOLIDS if match[1] == "C3D" else SHELLS).get(count, ())


def data_lines(
    path: Path, keyword: str = "", options: Mapping[str, str] = MappingProxyType({})
) -> Iterator[tuple[str, str, Mapping[str, str], list[str]]]:
    """File and line, keyword, its options and the fields of each line of data."""
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip().rstrip(",")
            if not text or text.startswith("**"):
                continue
            first, *others = (each.strip() for each in text.split(","))
            if not text.startswith("*"):
                yield f"{path}: line {number}", keyword, options, [first, *others]
                continue
            keyword = first.upper()
            pairs = (each.partition("=") for each in others)
            options = {name.strip().upper(): value.strip() for name, _, value in pairs}
            if keyword in WITH_INPUT and "INPUT" in options:
                inside = "" if keyword == "*INCLUDE" else keyword
                yield from data_lines(path.parent / options["INPUT"], inside, options)
