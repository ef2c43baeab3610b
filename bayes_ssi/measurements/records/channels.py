"""What one file holds of a record: channels, and what the file states about them.

In a file of named arrays (MATLAB .mat, numpy .npz and HDF5) an array of samples has a row or a
column for each sensor; its longer side is time. Scalars ``rate_hz`` or ``dt_s`` and texts
``quantity`` and ``unit`` in the same file (for HDF5 also attributes of the array) state what the
samples are, and ``sensors`` their names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.foundations.named_arrays import read_arrays

# Names under which files of arrays, attributes and comments state what the samples are.
STATED = ("rate_hz", "dt_s", "quantity", "unit")


class Channels(NamedTuple):
    """Channels of one file."""

    samples: FloatArray  # (n, N)
    names: tuple[str, ...] = ()  # of the channels; empty where the file has none
    rates_hz: tuple[float, ...] = ()
    quantities: tuple[str, ...] = ()
    units: tuple[str, ...] = ()  # every statement of the unit

    @classmethod
    def joined(cls, parts: Sequence[Channels]) -> Channels:
        """Channels of several files with the same instants; named where all files have names."""
        if len(parts) == 1:
            return parts[0]
        samples, names, *stated = zip(*parts, strict=True)
        return cls(
            np.concatenate(samples),
            tuple(chain(*names)) if all(names) else (),
            *(tuple(chain(*statements)) for statements in stated),
        )


def with_statements(
    samples: FloatArray, names: Sequence[str], stated: Mapping[str, Any]
) -> Channels:
    """Channels of a file that states things by name (:data:`STATED`)."""
    rates = [_number(stated, "rate_hz")] if "rate_hz" in stated else []
    if "dt_s" in stated:
        rates.append(1.0 / _number(stated, "dt_s"))
    return Channels(
        samples,
        tuple(names),
        tuple(rates),
        (str(stated["quantity"]),) if "quantity" in stated else (),
        (str(stated["unit"]),) if "unit" in stated else (),
    )


def _number(stated: Mapping[str, Any], key: str) -> float:
    try:
        number = float(stated[key])
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{key} must be a positive, finite number, got {stated[key]}")
    return number


def read_channels(path: Path, keys: Sequence[str]) -> Channels:
    """The channels of a file of arrays.

    Args:
        keys: names of the arrays that hold samples; the only one with more than one number if
            empty.
    """
    read = read_arrays(path, attributes=(*STATED, "sensors"))
    arrays = {name: _plain(value) for name, value in read.items()}
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


def _plain(value: Any) -> np.ndarray:
    """A cell array of texts as an array of texts."""
    array = np.asarray(value)
    if array.dtype != object:
        return array
    return np.array([str(np.ravel(each)[0]) for each in array.ravel() if np.size(each)])
