"""Symmetric sparse matrices from entries of which files state one triangle or both."""

from __future__ import annotations

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
