"""Files of named arrays: numpy's .npz, MATLAB's .mat (version 7.3, which is HDF5, too) and HDF5."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.text_files import damage_named, require_regular_file

ARRAY_FILES = (".npz", ".mat", ".h5", ".hdf5")


def read_arrays(
    path: Path, names: Collection[str] | None = None, attributes: Collection[str] = ()
) -> dict[str, Any]:
    """Name → array of a file, in its order; of MATLAB, also cells, and sparse ones before 7.3.

    A field of a MATLAB structure has the name ``structure.field``.

    Args:
        names: those to read; all if None.
        attributes: of HDF5, of the file and of its arrays, that count as arrays where they are.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import matfile_version

    require_regular_file(path)
    # Opened here: numpy leaves a damaged archive open.
    with damage_named(path), path.open("rb") as file:
        if path.suffix.lower() == ".npz":
            with np.load(file, allow_pickle=False) as arrays:
                return {n: arrays[n] for n in arrays.files if names is None or n in names}
        if path.suffix.lower() != ".mat" or matfile_version(path)[0] == 2:
            return _read_hdf5(path, names, attributes)
        wanted = None if names is None else [name.partition(".")[0] for name in names]
        read = loadmat(path, spmatrix=False, variable_names=wanted)
        return dict(
            field
            for name, array in read.items()
            if not name.startswith("__")
            for field in _fields(name, array)
        )


def _fields(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The value itself, or the fields of a structure."""
    if getattr(value, "dtype", None) is None or not value.dtype.names or value.size != 1:
        yield name, _of_cells(value)
        return
    for field in value.dtype.names:
        yield from _fields(f"{name}.{field}", value.flat[0][field])


def _of_cells(value: Any) -> Any:
    """A cell array of texts as an array of texts; anything else as it is."""
    cells: Any = value.ravel() if isinstance(value, np.ndarray) and value.dtype.hasobject else []
    if not len(cells) or any(np.asarray(cell).dtype.kind != "U" for cell in cells):
        return value
    return np.array([str(np.ravel(cell)[0]) for cell in cells if np.size(cell)])


def _holds_values(kind: np.dtype[Any]) -> bool:
    """Numbers, texts, or references to what MATLAB's cells hold."""
    import h5py

    return (
        kind.kind in "biufcS"
        or h5py.check_string_dtype(kind) is not None
        or h5py.check_ref_dtype(kind) is not None
    )


def _read_hdf5(
    path: Path, names: Collection[str] | None, attributes: Collection[str]
) -> dict[str, Any]:
    import h5py

    with h5py.File(path, "r") as file:
        arrays = {key: np.asarray(file.attrs[key]) for key in attributes if key in file.attrs}
        items: dict[str, Any] = {}
        file.visititems(items.__setitem__)  # in groups too
        for name, item in items.items():
            # MATLAB keeps what cells hold in groups that begin so.
            if name.startswith("#") or (names is not None and name not in names):
                continue
            if not hasattr(item, "dtype") or not _holds_values(item.dtype):
                continue
            if h5py.check_ref_dtype(item.dtype):
                arrays[name] = np.array([_text(file[cell]) for cell in item[()].ravel("F")])
                continue
            if item.attrs.get("MATLAB_class") == b"char":
                arrays[name] = np.array(_text(item))
                continue
            array = np.asarray(item.asstr()[()] if item.dtype.kind == "O" else item[()])
            # MATLAB's order of dimensions is the other one.
            arrays[name] = array.T if path.suffix.lower() == ".mat" else array
            arrays |= {key: np.asarray(item.attrs[key]) for key in attributes if key in item.attrs}
    return arrays


def _text(characters: Any) -> str:
    """What MATLAB keeps as the codes of characters, in a cell or by itself."""
    return "".join(map(chr, characters[()].ravel())) if characters.dtype.kind == "u" else ""
