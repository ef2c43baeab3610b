"""Arguments of finite-element models: matrices, from files of programs or as given, and sensors."""

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.argument_types import checked, listed_choices, repeated, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.named_arrays import read_arrays
from bayes_ssi.foundations.text_files import damage_named, require_name
from bayes_ssi.structures.geometry import Geometry, motion_of

# A model of more degrees of freedom must name its sensors: every mode shape is kept at all of them.
SENSORS_NAMED_ABOVE = 1000
# Relative error, to the largest entry, of matrices that other programs wrote, perhaps with nine
# digits.
FILE_ROUNDING = 1e-8


Matrix = sp.csc_array
# Endings of files that hold one matrix, and of those that hold several.
SINGLE = (".mtx", ".mtx.gz", ".npy")
SEVERAL = (".npz", ".mat")


@checked
def read_matrix(path: str | Path, key: str | None = None) -> Any:
    """A matrix, sparse or dense, from a file.

    Files of scipy (``.npz``, as :func:`scipy.sparse.save_npz` writes them) and Matrix Market
    (``.mtx``) hold one; of numpy (``.npz``) and MATLAB (``.mat``, of version 7.3 full
    ones only) several, by key.

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
    arrays = arrays_of(path, key)
    if key is not None and "" in arrays:
        raise ValueError(f"{path}: it holds a single matrix, without a key, got {key!r}")
    if key is not None and not arrays:
        require_known(f"{path}: no array", [key], arrays_of(path))
    if len(arrays) != 1:
        raise ValueError(
            f"{path}: several arrays, and no key says which; choose from {listed_choices(arrays)}"
        )
    return next(iter(arrays.values()))


def arrays_of(path: Path, key: str | None = None) -> dict[str, Any]:
    """Key → numbers, of a file or at one key; the key is "" where the file holds one array."""
    from scipy.io import mmread

    with path.open("rb") as file:  # raises where there is no file, before any library is called
        is_matrix_market = file.read(14) == b"%%MatrixMarket"
    name = path.name.lower()
    if name.endswith(SEVERAL):
        arrays = read_arrays(path, None if key is None else [key])
        if key is None and name.endswith(".npz") and "format" in arrays:
            return {"": sp.load_npz(path)}  # the parts of a matrix, as save_npz writes them
        return {k: a for k, a in arrays.items() if sp.issparse(a) or a.dtype.kind in "biufc"}
    # Programs give Matrix Market files other endings, too.
    if not (is_matrix_market or name.endswith(SINGLE)):
        endings = ", ".join((*SINGLE, *SEVERAL))
        raise ValueError(f"{path}: unknown format; choose a file ending in {endings}")
    with damage_named(path):
        if name.endswith(".npy"):
            return {"": np.load(path, allow_pickle=False)}
        return {"": mmread(path, spmatrix=False)}


def checked_matrix(matrix: Any, name: str, size: int | None = None) -> Any:
    """A copy, square, symmetric, finite and real: in compressed columns if sparse, else (n, n)."""
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


Sensors = Mapping[str, "int | str"] | Sequence["int | str"]


def sensor_rows(
    n: int, labels: Sequence[str] | None, sensors: Sensors | None
) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Names and rows of the measured degrees of freedom, of ``n`` that may have labels."""
    if isinstance(labels, str) or isinstance(sensors, str):
        raise TypeError("labels and sensors must be several names, got a single text")
    if labels is not None:
        _require_names("labels", labels)
        if len(labels) != n:
            raise ValueError(f"labels: {len(labels)} for {n} degrees of freedom")
    if sensors is None:
        if n > (most := SENSORS_NAMED_ABOVE):
            raise ValueError(
                f"sensors: a model of more than {most} degrees of freedom, here "
                f'{n}, must name the measured ones, as in sensors={{"roof x": 1203}}'
            )
        return tuple(labels or (f"dof {i}" for i in range(n))), np.arange(n)
    if not isinstance(sensors, Mapping) and not all(isinstance(each, str) for each in sensors):
        raise TypeError(
            "sensors: a list holds labels; to give numbers, name them, as in "
            f'sensors={{"roof x": 1203}}, got {sensors!r}'
        )
    _require_names("sensors", list(sensors))
    if not isinstance(sensors, Mapping):
        sensors = {str(sensor): sensor for sensor in sensors}
    row_of = {label: i for i, label in enumerate(labels or ())}
    rows = [_row(name, place, n, row_of) for name, place in sensors.items()]
    return tuple(sensors), np.array(rows, dtype=np.intp)


def _row(name: str, place: object, n: int, row_of: Mapping[str, int]) -> int:
    if isinstance(place, str) and place in row_of:
        return row_of[place]
    # A whole number, of numpy perhaps, but not True.
    row = int(place) if isinstance(place, Integral) and not isinstance(place, bool) else -1
    if 0 <= row < n:
        return row
    labels = listed_choices(row_of) if row_of else "none was given"
    raise ValueError(
        f"sensor {name!r}: must be the number of a degree of freedom, from 0 to {n - 1}, or its "
        f"label ({labels}), got {place!r}"
    )


def _require_names(what: str, names: Sequence[object]) -> None:
    for name in names:
        require_name(name, what)
    if twice := repeated(names):
        raise ValueError(f"{what}: {twice[0]!r} names two degrees of freedom")


def checked_n_modes(
    n_modes: int | None, up_to_hz: float | None, n: int
) -> tuple[int | None, float | None]:
    if (n_modes is None) == (up_to_hz is None):
        raise ValueError("give either n_modes or up_to_hz, to say how many modes are computed")
    if n_modes is None:
        if not (isinstance(up_to_hz, (int, float)) and 0 < up_to_hz < math.inf):
            raise ValueError(f"up_to_hz must be a positive frequency in Hz, got {up_to_hz!r}")
        return None, float(up_to_hz)
    if not isinstance(n_modes, Integral) or isinstance(n_modes, bool) or not 1 <= n_modes <= n:
        raise ValueError(
            f"n_modes must be a whole number from 1 to {n}, the degrees of freedom, got {n_modes!r}"
        )
    return int(n_modes), None


def checked_influence(influence: ArrayLike | None, n: int) -> FloatArray | None:
    if influence is None:
        return None
    array = np.array(influence, dtype=float)
    if array.shape != (n,) or not np.isfinite(array).all():
        raise ValueError(
            f"influence must be {n} finite numbers, one per degree of freedom, got "
            f"shape {array.shape}"
        )
    array.setflags(write=False)
    return array


def require_nodes(geometry: Geometry | None, labels: Sequence[str]) -> None:
    if geometry and not any(geometry.location(motion_of(label)) for label in labels):
        raise ValueError(
            "geometry: no degree of freedom is at any of its nodes; labels are "
            f"{listed_choices(labels, 3)}, nodes {listed_choices(geometry.nodes, 3)}, and a label "
            "is the name of a node and a direction, such as 'node 7 x'"
        )
