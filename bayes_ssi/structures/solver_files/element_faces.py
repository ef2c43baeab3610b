"""Faces of shell and solid elements of Abaqus and CalculiX, by their first, the corner nodes.

Abaqus Elements Guide, "Element library: faces and node ordering"; CalculiX CrunchiX User's Manual,
section 6.2. Nodes on the middle of sides follow the corners, and are not drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

Face = tuple[int, ...]
Faces = tuple[Face, ...]

TETRAHEDRON = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
BRICK = (
    (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)
)  # fmt: skip
# Number of nodes of a solid, and of a shell or membrane → corners of its faces.
SOLIDS: dict[int, Faces] = {
    4: TETRAHEDRON,
    10: TETRAHEDRON,
    6: WEDGE,
    15: WEDGE,
    8: BRICK,
    20: BRICK,
}
TRIANGLE, QUADRILATERAL = ((0, 1, 2),), ((0, 1, 2, 3),)
SHELLS: dict[int, Faces] = {
    3: TRIANGLE,
    6: TRIANGLE,
    4: QUADRILATERAL,
    8: QUADRILATERAL,
    9: QUADRILATERAL,
}
KIND = re.compile(r"(C3D|S|M3D)(\d+)")


def node_count(kind: str) -> int | None:
    """Number of nodes of a solid, shell or membrane; None of other elements, such as beams."""
    match = KIND.match(kind)
    if match is None:
        return None
    count = int(match[2])
    return count if count in _faces(match[1]) else None


class OuterFaces:
    """Collects elements; faces that two solids share lie within the structure."""

    def __init__(self) -> None:
        """Begin without elements."""
        self._shells: dict[frozenset[int], Face] = {}
        self._solids: dict[frozenset[int], Face] = {}

    def add(self, kind: str, nodes: Sequence[int]) -> None:
        """An element for which :func:`node_count` gives a number, by its nodes."""
        match = KIND.match(kind)
        assert match is not None
        for corners in _faces(match[1])[int(match[2])]:
            face = tuple([nodes[i] for i in corners])
            key = frozenset(face)
            if match[1] != "C3D":
                self._shells[key] = face
            elif self._solids.pop(key, None) is None:
                self._solids[key] = face

    def __iter__(self) -> Iterator[Face]:
        """The faces of shells and membranes, and those of solids that only one has."""
        yield from (self._solids | self._shells).values()


def _faces(family: str) -> dict[int, Faces]:
    return SOLIDS if family == "C3D" else SHELLS
