"""Matrices of a finite-element model: from the files that programs write, and checked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.choices import listed_choices, require_known
from bayes_ssi.foundations.named_arrays import array_names, read_arrays
from bayes_ssi.foundations.text_files import damage_named
from bayes_ssi.structures.finite_elements.finite_element_settings import FEM

Matrix = sp.csc_array
# Endings of files that hold one matrix, and of those that hold several.
SINGLE = (".mtx", ".mtx.gz", ".npy")
SEVERAL = (".npz", ".mat")


@checked
def read_matrix(path: str | Path, key: str | None = None) -> Any:
    """A matrix, sparse or dense, from a file.

    Files of scipy (``.npz``, as :func:`scipy.sparse.save_npz` writes them) and Matrix Market
    (``.mtx``) hold one; of numpy (``.npz``) and MATLAB (``.mat``, version 7.3 too) several, by
    key.

    Args:
        path: the file; its ending gives the format.
        key: the key of the array, where there are several.

    Returns:
        The array in the file: a sparse one, or (n, m) numbers. Vectors, such as lists of measured
        degrees of freedom, are read as well.

    Raises:
        OSError: there is no such file, or it cannot be opened.
        ValueError: it is damaged or truncated, has an unknown format, or no array at ``key``.
    """
    path = Path(path)
    with path.open("rb") as file:  # raises where there is no file, before any library is called
        is_matrix_market = file.read(14) == b"%%MatrixMarket"
    name = path.name.lower()
    if name.endswith(SEVERAL):
        names = array_names(path)
        if key is None and _is_one_sparse(path, names):
            with damage_named(path):
                return sp.load_npz(path)
        chosen = _chosen(path, key, names)
        return read_arrays(path, [chosen])[chosen]
    # Programs give Matrix Market files other endings, too.
    if not (is_matrix_market or name.endswith(SINGLE)):
        endings = ", ".join((*SINGLE, *SEVERAL))
        raise ValueError(f"{path}: unknown format; choose a file ending in {endings}")
    if key is not None:
        raise ValueError(f"{path}: it holds a single matrix, without a key, got {key!r}")
    from scipy.io import mmread

    with damage_named(path):
        if name.endswith(".npy"):
            return np.load(path, allow_pickle=False)
        return mmread(path, spmatrix=False)


def matrix_keys(path: Path) -> tuple[str, ...] | None:
    """Keys of the arrays in a file that holds several; None for a file of one array."""
    if path.suffix.lower() not in SEVERAL:
        return None
    names = array_names(path)
    return None if _is_one_sparse(path, names) else names


def _is_one_sparse(path: Path, names: Sequence[str]) -> bool:
    """Whether a file is one of :func:`scipy.sparse.save_npz`, which holds the parts of a matrix."""
    return path.suffix.lower() == ".npz" and "format" in names


def _chosen(path: Path, key: str | None, names: Sequence[str]) -> str:
    if key is None and len(names) == 1:
        return names[0]
    if key is None:
        raise ValueError(
            f"{path}: several arrays, and no key says which; choose from {listed_choices(names)}"
        )
    require_known(f"{path}: no array", [key], names)
    return key


def checked_matrix(matrix: Any, name: str, size: int | None = None) -> Any:
    """A square, symmetric, finite and real matrix; a copy.

    Returns:
        A sparse matrix in compressed columns if a sparse one is given, else an array (n, n).
    """
    if isinstance(matrix, (str, Path)):
        raise TypeError(f"{name} must be an array, got {matrix!r}; read a file with read_matrix")
    is_sparse = sp.issparse(matrix)
    matrix = matrix if is_sparse else np.asarray(matrix)
    if matrix.dtype.kind not in "biufc":
        shown = " ".join(repr(matrix).split())
        raise TypeError(f"{name} must be a sparse or dense matrix of numbers, got {shown:.80}")
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"{name} must be square, got shape {matrix.shape}")
    if not matrix.shape[0]:
        raise ValueError(f"{name} is empty")
    if size is not None and matrix.shape[0] != size:
        raise ValueError(f"{name} has {matrix.shape[0]} rows, the matrices before it {size}")
    if matrix.dtype.kind == "c":
        raise ValueError(f"{name} must be real, got complex numbers")
    matrix = sp.csc_array(matrix, dtype=float) if is_sparse else matrix.astype(float)
    if not np.isfinite(matrix.data if is_sparse else matrix).all():
        raise ValueError(f"{name} holds numbers that are not finite")
    largest, asymmetry = abs(matrix).max(), abs(matrix - matrix.T).max()
    if asymmetry > FEM.file_rounding * largest:
        raise ValueError(
            f"{name} must be symmetric, but entries differ from their transposes by up to "
            f"{asymmetry:.3g}, the largest entry being {largest:.3g}; was only one triangle stored?"
        )
    return 0.5 * (matrix + matrix.T)
