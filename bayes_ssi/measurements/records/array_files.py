"""Records in files of named arrays: MATLAB .mat, numpy .npz and HDF5.

An array of samples has a row or a column for each sensor; its longer side is time. Scalars
``rate_hz`` or ``dt_s`` and texts ``quantity`` and ``unit`` in the same file (for HDF5 also
attributes of the array) state what the samples are, and ``sensors`` their names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.text_files import require_regular_file
from bayes_ssi.measurements.records.channels import STATED, Channels, with_statements


def read_arrays(path: Path, keys: Sequence[str]) -> Channels:
    """Read the channels of a file of arrays.

    Args:
        keys: names of the arrays that hold samples; the only one with more than one number if
            empty.
    """
    require_regular_file(path)
    try:
        arrays = READERS[path.suffix.lower()](path)
    except OSError:
        raise ValueError("cannot be read; damaged, or not what its name says?") from None
    samples = {n: array for n, array in arrays.items() if n not in STATED and _may_be(array)}
    keys = list(keys) or list(samples)
    if not keys:
        held = ", ".join(f"{n!r} ({array.dtype}, {array.shape})" for n, array in arrays.items())
        raise ValueError(f"holds no rows or columns of real numbers; it holds {held or 'nothing'}")
    require_known("no array of samples", keys, samples)
    blocks = [_in_rows(samples[key]) for key in keys]
    lengths = {block.shape[1] for block in blocks}
    if len(lengths) > 1:
        raise ValueError(
            f"arrays {', '.join(map(repr, keys))} differ in length; name those to read by keys"
        )
    stated = {key: _scalar(arrays[key]) for key in STATED if key in arrays}
    names = [str(each).strip() for each in np.ravel(arrays.get("sensors", []))]
    if not names and len(keys) > 1 and all(len(block) == 1 for block in blocks):
        names = list(keys)
    joined = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return with_statements(np.ascontiguousarray(joined, dtype=float), names, stated)


def _may_be(array: np.ndarray) -> bool:
    return array.dtype.kind in "iuf" and array.size > 1 and array.ndim <= 2


def _in_rows(array: np.ndarray) -> FloatArray:
    """The array with a row for each sensor."""
    rows = np.atleast_2d(array)
    return rows.T if rows.shape[0] > rows.shape[1] else rows


def _scalar(array: np.ndarray) -> Any:
    if array.size != 1:
        return array.tolist()
    scalar = array.ravel()[0]
    return scalar.decode() if isinstance(scalar, bytes) else scalar


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (ValueError, AttributeError) as error:
        raise ValueError(f"cannot be read; damaged, or not an .npz file? {error}") from None


def _read_mat(path: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path, chars_as_strings=True)
    except NotImplementedError:  # MATLAB 7.3 saves HDF5
        return _read_hdf5(path)
    except (MatReadError, ValueError, TypeError) as error:
        raise ValueError(f"cannot be read; damaged, or not a .mat file? {error}") from None
    arrays = {name: np.asarray(value) for name, value in content.items() if name[:2] != "__"}
    return {name: _plain(array) for name, array in arrays.items()}


def _plain(array: np.ndarray) -> np.ndarray:
    """A cell array of texts as an array of texts."""
    if array.dtype != object:
        return array
    return np.array([str(np.ravel(each)[0]) for each in array.ravel() if np.size(each)])


def _read_hdf5(path: Path) -> dict[str, np.ndarray]:
    import h5py

    arrays: dict[str, np.ndarray] = {}

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufSO":
            texts = item.dtype.kind == "O" and h5py.check_string_dtype(item.dtype) is not None
            if item.dtype.kind != "O" or texts:
                arrays[name] = np.asarray(item.asstr()[()] if texts else item[()])
            arrays.update(
                (key, np.asarray(item.attrs[key]))
                for key in (*STATED, "sensors")
                if key in item.attrs
            )

    with h5py.File(path, "r") as file:
        arrays.update((k, np.asarray(v)) for k, v in file.attrs.items() if k in STATED)
        file.visititems(add)
    return arrays


READERS: dict[str, Callable[[Path], dict[str, np.ndarray]]] = {
    ".npz": _read_npz, ".mat": _read_mat, ".h5": _read_hdf5, ".hdf5": _read_hdf5,
}  # fmt: skip
