"""What the text files of solvers hold: numbers in lines, entries of matrices, labels of rows.

Numbers are read fast, and refused with their line. Labels are "node direction", from the numbers
and names that programs give directions.
"""

import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_regular_file

Rows = NDArray[np.intp]

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


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number, from 1, and text of each line of a file that is not blank."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            if line.strip():
                yield number, line.rstrip("\n")


def read_labels(path: Path) -> list[str]:
    """Labels of lines such as ``12 x``, ``12 UX``, ``12 1`` or ``12.1``."""
    require_whole_lines(path)
    labels = []
    for number, line in numbered_lines(path):
        match = _LABEL.fullmatch(line.strip())
        try:
            if match is None:
                raise ValueError(f"expected a node and a direction, got {line.strip()!r}")
            labels.append(label(match[1], match[2]))
        except ValueError as error:
            raise ValueError(f"{path}: line {number}: {error}") from None
    return labels


def direction_of(name: str) -> str:
    """The direction in a label: x of "12 x" and of "12 x (2)"; nothing for internal rows."""
    if name.startswith(f"{INTERNAL} "):
        return ""
    return re.sub(r" \(\d+\)$", "", name).rsplit(" ", 1)[-1]


def read_number_lines(
    path: Path, columns: str, *, width: int | None = None, delimiter: str | None = None,
    skip: int = 0, comment: str = "",
) -> FloatArray:  # fmt: skip
    """The numbers (n_lines, n_columns) of a file that has the same columns in every line.

    Args:
        columns: what they hold, for messages.
        width: their number; that of the names between commas in ``columns`` if None.
        delimiter: between numbers; white space if None.
    """
    require_whole_lines(path)
    width = width or columns.count(",") + 1
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
        try:
            numbers = np.loadtxt(
                path, comments=comment or None, delimiter=delimiter, skiprows=skip, ndmin=2
            )
        except ValueError:
            numbers = np.empty((0, 0))
    if numbers.shape[1] == width and np.isfinite(numbers).all():
        return numbers
    # Fortran's exponents, as in 1.0D+06, or a line that is none of numbers.
    rows = []
    for number, line in numbered_lines(path):
        if number <= skip or (comment and line.strip().startswith(comment)):
            continue
        fields = line.strip().split(delimiter)
        try:
            row = [float(field.replace("D", "E").replace("d", "e")) for field in fields]
        except ValueError:
            row = []
        if len(row) != width or not np.isfinite(row).all():
            shown = " ".join(" ".join(fields).split())
            raise ValueError(f"{path}: line {number}: expected {columns}, got {shown:.60}")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: no line of numbers ({columns}); truncated?")
    return np.array(rows)


def require_whole_lines(path: Path) -> None:
    """Refuse a file whose last line does not end: its last number may be cut off."""
    require_regular_file(path)
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size == 0:
            raise ValueError(f"{path}: the file is empty")
        file.seek(-1, 2)
        if file.read(1) in b"\r\n\x1a":  # DOS ends files with the last of these
            return
    raise ValueError(f"{path}: ends within a line, whose last number may be cut off: truncated?")


def matrix_of_lines(
    path: Path, entries: FloatArray, size: int, first_line: int = 1, *, to_the_last: str = ""
) -> sp.csc_array:
    """The matrix (size, size) of lines row, column, value (n, 3), counted from ``first_line``.

    Args:
        to_the_last: "row" or "column" if the last one must have an entry, as of a stiffness.
    """
    places = rows_from_one(path, entries[:, :2], size, first_line)
    if to_the_last and places.max() < size - 1:
        raise ValueError(
            f"{path}: ends with {to_the_last} {places.max() + 1} of {size}: truncated, or of "
            "another model?"
        )
    return matrix_of_entries(path, places, entries[:, 2], size)


def rows_from_one(path: Path, values: FloatArray, size: int, first_line: int = 1) -> Rows:
    """Rows and columns (n, m), counted from 0, that a file counts from 1 in n lines."""
    places = whole_numbers(path, values, "row and column", first_line)
    wrong = np.argwhere((places < 1) | (places > size))
    if len(wrong):
        raise ValueError(
            f"{path}: line {first_line + wrong[0, 0]}: row and column must be from 1 to {size}, "
            f"got {places[tuple(wrong[0])]}; does the file belong to another model?"
        )
    return places - 1


def whole_numbers(path: Path, values: FloatArray, what: str, first_line: int = 1) -> Rows:
    """Numbers of rows or nodes (n, m) that a file states in n lines."""
    whole = values.astype(np.intp)
    wrong = np.argwhere(whole != values)
    if len(wrong):
        raise ValueError(
            f"{path}: line {first_line + wrong[0, 0]}: {what} must be a whole number, got "
            f"{values[tuple(wrong[0])]:g}"
        )
    return whole


def matrix_of_entries(
    name: object, places: Rows, values: FloatArray, size: int, *, is_whole: bool = False
) -> sp.csc_array:
    """The matrix (size, size), of which one triangle alone may be stated unless it ``is_whole``.

    ``places`` (n, 2) are rows and columns of the entries, counted from 0.
    """
    matrix = sp.coo_array((values, tuple(places.T)), shape=(size, size)).tocsc()
    if matrix.nnz != len(values):
        raise ValueError(f"{name}: {len(values) - matrix.nnz} entries are stated twice")
    return matrix if is_whole else from_triangle(matrix)


def from_triangle(matrix: sp.csc_array) -> sp.csc_array:
    """The whole of a symmetric matrix of which one triangle alone may be stated.

    Entries stated on one side of the diagonal, above or below, are mirrored where none is stated
    on both; else the matrix is whole, which is left to the check for symmetry.
    """
    lower, upper = sp.tril(matrix, -1, format="csc"), sp.triu(matrix, 1, format="csc")
    if ((lower != 0).multiply((upper != 0).T)).nnz:
        return matrix
    return sp.csc_array(matrix + lower.T + upper.T)
