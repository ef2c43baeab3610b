"""Faces of shell and solid elements of Abaqus and CalculiX, by their first, the corner nodes.

Abaqus Elements Guide, "Element library: faces and node ordering"; CalculiX CrunchiX User's Manual,
section 6.2. Nodes on the middle of sides follow the corners, and are not drawn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray

Rows = NDArray[np.intp]


def whole_numbers(path: Path, values: FloatArray, what: str, first_line: int) -> Rows:
    """Numbers of rows or nodes that a file states."""
    whole = values.astype(np.intp)
    wrong = np.flatnonzero(whole != values)
    if len(wrong):
        raise ValueError(
            f"{path}: line {first_line + wrong[0]}: {what} must be a whole number, got "
            f"{values[wrong[0]]:g}"
        )
    return whole


def rows_from_one(path: Path, values: FloatArray, size: int | None, first_line: int) -> Rows:
    """Rows counted from 0 of rows that a file counts from 1."""
    rows = whole_numbers(path, values, "row and column", first_line)
    wrong = np.flatnonzero((rows < 1) | (rows > (size or np.iinfo(np.intp).max)))
    if len(wrong):
        upto = f"from 1 to {size}" if size else "1 or more"
        raise ValueError(
            f"{path}: line {first_line + wrong[0]}: row and column must be {upto}, got "
            f"{rows[wrong[0]]}; does the file belong to another model?"
        )
    return rows - 1


def from_entries(
    path: Path, rows: Rows, columns: Rows, values: FloatArray, size: int
) -> sp.csc_array:
    """The whole matrix, whether the file states one triangle or both.

    Args:
        rows, columns, values: of the entries; rows and columns counted from 0.

    Returns:
        (size, size), with both triangles; not checked for symmetry where the file states both.
    """
    matrix = sp.coo_array((values, (rows, columns)), shape=(size, size)).tocsc()
    if matrix.nnz != len(values):
        raise ValueError(f"{path}: {len(values) - matrix.nnz} entries are stated twice")
    return from_triangle(matrix)


def from_triangle(matrix: sp.csc_array) -> sp.csc_array:
    """The whole of a symmetric matrix of which one triangle alone may be stated.

    Entries stated on one side of the diagonal, above or below, are mirrored where none is stated
    on both; else the matrix is whole, which is left to the check for symmetry.
    """
    lower, upper = sp.tril(matrix, -1, format="csc"), sp.triu(matrix, 1, format="csc")
    if ((lower != 0).multiply((upper != 0).T)).nnz:
        return matrix
    return sp.csc_array(matrix + lower.T + upper.T)


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
