"""Matrices of a finite-element model: from the files that programs write, and checked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray

Matrix = sp.csc_array

# Relative error, to the largest entry, of matrices that other programs wrote, perhaps with nine
# digits.
FILE_ROUNDING = 1e-8


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
    readers = {
        ".mtx": _read_single,
        ".mtx.gz": _read_single,
        ".npy": _read_single,
        ".npz": _read_npz,
        ".mat": _read_mat,
    }
    read = next((read for suffix, read in readers.items() if name.endswith(suffix)), None)
    if read is None and is_matrix_market:  # programs give such files other endings
        read = _read_single
    if read is None:
        raise ValueError(f"{path}: unknown format; choose a file ending in {', '.join(readers)}")
    try:
        return read(path, key)
    except _KeyNotFoundError as error:
        raise ValueError(f"{path}: {error}") from None
    except MemoryError:
        raise
    except Exception as error:  # a damaged file may raise anything in the libraries
        raise _damaged(path, error) from error


def matrix_keys(path: Path) -> tuple[str, ...] | None:
    """Keys of the arrays in a file that holds several; None for a file of one array."""
    suffix = path.suffix.lower()
    if suffix not in (".npz", ".mat"):
        return None
    try:
        if suffix == ".npz":
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return None if "format" in arrays.files else tuple(arrays.files)
        return _keys_of_mat(path)
    except OSError:
        raise
    except Exception as error:  # a damaged file may raise anything in the libraries
        raise _damaged(path, error) from error


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
    if asymmetry > FILE_ROUNDING * largest:
        raise ValueError(
            f"{name} must be symmetric, but entries differ from their transposes by up to "
            f"{asymmetry:.3g}, the largest entry being {largest:.3g}; was only one triangle stored?"
        )
    return 0.5 * (matrix + matrix.T)


def _damaged(path: Path, error: Exception) -> ValueError:
    reason = " ".join(str(error).split()) or "no reason given"
    return ValueError(
        f"{path}: cannot be read; damaged or truncated? {type(error).__name__}: {reason}"
    )


class _KeyNotFoundError(Exception):
    """The file can be read, but does not hold the requested array."""


def _chosen(key: str | None, keys: list[str]) -> str:
    if key is None and len(keys) == 1:
        return keys[0]
    if key is None or key not in keys:
        problem = "several arrays, and no key says which" if key is None else f"no array {key!r}"
        raise _KeyNotFoundError(f"{problem}; choose from {', '.join(map(repr, keys)) or 'nothing'}")
    return key


def _read_single(path: Path, key: str | None) -> Any:
    """An array from a file that holds only one: Matrix Market, or a single numpy array."""
    from scipy.io import mmread

    if key is not None:
        raise _KeyNotFoundError(f"it holds a single matrix, without a key, got {key!r}")
    if path.suffix.lower() == ".npy":
        return np.load(path, allow_pickle=False)
    return mmread(path, spmatrix=False)


def _read_npz(path: Path, key: str | None) -> Any:
    # Opened here: numpy leaves a damaged archive open.
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        if "format" in arrays.files and key is None:
            return sp.load_npz(path)
        return arrays[_chosen(key, arrays.files)]


def _read_mat(path: Path, key: str | None) -> Any:
    from scipy.io import loadmat

    chosen = _chosen(key, list(_keys_of_mat(path)))
    try:
        return loadmat(path, spmatrix=False, variable_names=[chosen])[chosen]
    except NotImplementedError:  # version 7.3 is another format altogether
        return _read_hdf5(path, chosen)


def _keys_of_mat(path: Path) -> tuple[str, ...]:
    from scipy.io import whosmat

    try:
        return tuple(name for name, *_ in whosmat(path))
    except NotImplementedError:  # version 7.3 is another format altogether
        import h5py

        with h5py.File(path, "r") as file:
            return tuple(name for name in file if not name.startswith("#"))


def _read_hdf5(path: Path, chosen: str) -> Any:
    import h5py

    with h5py.File(path, "r") as file:
        item = file[chosen]
        if not isinstance(item, h5py.Group):
            dense: FloatArray = np.asarray(item[()]).T  # MATLAB's order of dimensions
            return dense
        if "jc" not in item:
            raise _KeyNotFoundError(f"{chosen!r} is not a matrix")
        columns = np.asarray(item["jc"][()]).ravel()
        rows = int(item.attrs["MATLAB_sparse"])
        if "data" not in item:
            return sp.csc_array((rows, len(columns) - 1))
        parts = (item["data"][()].ravel(), item["ir"][()].ravel(), columns)
        return sp.csc_array(parts, shape=(rows, len(columns) - 1))
