"""Matrices from the lines of text files: numbers, read fast, and refused with their line."""

import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_regular_file

Rows = NDArray[np.intp]


def read_number_lines(
    path: Path,
    columns: str,
    *,
    width: int | None = None,
    delimiter: str | None = None,
    skip: int = 0,
    comment: str = "",
) -> FloatArray:
    """The numbers of a file that has the same columns in every line.

    Args:
        columns: what they hold, for messages.
        width: their number; that of the names between commas in ``columns`` if None.
        delimiter: between numbers; white space if None.

    Returns:
        (number of lines, number of columns).
    """
    require_whole_lines(path)
    width = width or columns.count(",") + 1
    load = partial(
        np.loadtxt, comments=comment or None, delimiter=delimiter, skiprows=skip, ndmin=2
    )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
        try:
            try:
                numbers = load(path)
            except ValueError:  # Fortran's exponents, as in 1.0D+06
                with path.open(encoding="ascii") as file:
                    numbers = load(line.replace("D", "E").replace("d", "e") for line in file)
        except ValueError:
            numbers = np.empty((0, 0))
    if numbers.shape[1] == width and np.isfinite(numbers).all():
        return numbers
    for number, fields in _fields(path, delimiter, skip, comment):
        if len(fields) != width or not all(map(_is_finite, fields)):
            shown = " ".join(" ".join(fields).split())
            raise ValueError(
                f"{path}: line {number}: expected {columns}, got {shown:.60}"
            ) from None
    raise ValueError(f"{path}: no line of numbers ({columns}); truncated?")


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


def _fields(
    path: Path, delimiter: str | None, skip: int, comment: str
) -> Iterator[tuple[int, list[str]]]:
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if number > skip and text and not (comment and text.startswith(comment)):
                yield number, text.split(delimiter)


def _is_finite(field: str) -> bool:
    try:
        return bool(np.isfinite(float(field.replace("D", "E").replace("d", "e"))))
    except ValueError:
        return False


def matrix_of_lines(
    path: Path, entries: FloatArray, size: int, first_line: int = 1, *, to_the_last: str = ""
) -> sp.csc_array:
    """The matrix (size, size) of lines row, column, value; rows are counted from 1.

    Args:
        entries: (n, 3).
        first_line: of the file, that has the first entry.
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


def matrix_of_entries(path: Path, places: Rows, values: FloatArray, size: int) -> sp.csc_array:
    """The matrix (size, size), whether the file states one triangle or both.

    Args:
        places: (n, 2), rows and columns of the entries, counted from 0.
    """
    matrix = sp.coo_array((values, tuple(places.T)), shape=(size, size)).tocsc()
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
