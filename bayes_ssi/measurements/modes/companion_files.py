"""Files beside the CSV file of modes, which names them: the covariance, and the identification.

The JSON file of the covariance holds ``sensors``, and for m modes at n sensors ``frequencies_hz``
(m), ``unit_shapes`` (m lists of n components, null where not measured) and
``covariance_of_log_frequencies_and_unit_shapes`` (m + m n, m + m n), shapes mode by mode.
Frequencies and shapes tell which row of the CSV file is which mode, so that its modes may be
renamed, sorted or left out.

That of the identification holds ``identifications``: a record of each vibration record that the
modes come from, one, or several where modes were merged. Paths of figures are relative to the
file's directory.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.joint_covariance import of_modes
from bayes_ssi.measurements.modes.modal_data import ModalData

T = TypeVar("T")


@dataclass(frozen=True)
class _Identifications:
    identifications: tuple[IdentificationSummary, ...]


@dataclass(frozen=True)
class _Covariance:
    sensors: tuple[str, ...]
    frequencies_hz: FloatArray
    unit_shapes: tuple[tuple[float | None, ...], ...]
    covariance_of_log_frequencies_and_unit_shapes: Any  # a large list of lists


def companion_path(csv_path: str | Path, key: str) -> Path:
    """Where it is written what a line of a CSV file with this key names."""
    return Path(csv_path).with_suffix(f".{key}.json")


def write_identifications(data: ModalData, path: Path) -> None:
    """Write how modes were identified to a new file."""
    moved = tuple(
        replace(each, figures=tuple(os.path.relpath(file, path.parent) for file in each.figures))
        for each in data.identifications
    )
    with path.open("x", encoding="utf-8") as file:
        json.dump(to_record(_Identifications(moved)), file, indent=1)


def write_covariance(data: ModalData, path: Path) -> None:
    """Write the joint covariance of these modes to a new file."""
    assert data.covariance is not None
    shapes = [
        [float(component) if np.isfinite(component) else None for component in shape]
        for shape in data.unit_shapes.T
    ]
    content = _Covariance(
        data.sensors, data.frequencies_hz.tolist(), tuple(map(tuple, shapes)),
        data.covariance.tolist(),
    )  # fmt: skip
    with path.open("x", encoding="utf-8") as file:
        json.dump(vars(content), file)


# Key of the line of a CSV file that names the file → what writes it.
COMPANIONS: Mapping[str, Callable[[ModalData, Path], None]] = {
    "covariance": write_covariance,
    "identification": write_identifications,
}


def companions_of(data: ModalData) -> list[str]:
    """Keys of what is written beside these modes."""
    has = {"covariance": data.covariance is not None, "identification": bool(data.identifications)}
    return [key for key in COMPANIONS if has[key]]


def read_identifications(path: Path, csv_path: Path) -> tuple[IdentificationSummary, ...]:
    """How the modes in a CSV file were identified."""
    lost = "and with it what is known of failed checks"
    content = _read(_Identifications, path, csv_path, "identification", lost)
    return tuple(
        replace(each, figures=tuple(str(path.parent / file) for file in each.figures))
        for each in content.identifications
    )


def _read(kind: type[T], path: Path, csv_path: Path, key: str, otherwise: str) -> T:
    """The content of a file that a line of the CSV file names by a key."""
    try:
        return from_record(kind, json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ValueError(
            f"{csv_path}: no file {path.name}, which its line {key!r} names, in its directory; put "
            f"it there, or remove the line, {otherwise}"
        ) from None
    except ValueError as error:
        raise ValueError(
            f"{path}: no record of the {key} that this version reads: {error}; identify again, or "
            f"remove the line {key!r} of {csv_path.name}, {otherwise}"
        ) from None


def read_covariance(
    path: Path, csv_path: Path, modes: Sequence[IdentifiedMode], sensors: Sequence[str]
) -> FloatArray:
    """The joint covariance of ``modes``, in their order."""
    content = _read(_Covariance, path, csv_path, "covariance", "to use each mode's own errors")
    if content.sensors != tuple(sensors):
        raise ValueError(
            f"{path}: the sensors, {', '.join(map(repr, content.sensors))}, are not those of "
            f"{csv_path.name}; names and order must be the same in both files"
        )
    frequencies = content.frequencies_hz
    m, n = len(frequencies), len(sensors)
    try:
        shapes = np.array(content.unit_shapes, dtype=float).reshape(m, -1)
        matrix = np.array(content.covariance_of_log_frequencies_and_unit_shapes, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{path}: not arrays of numbers for {m} modes at {n} sensors") from None
    if shapes.shape != (m, n) or matrix.shape != (m + m * n, m + m * n):
        raise ValueError(
            f"{path}: {m} modes at {n} sensors need unit_shapes {(m, n)} and a covariance "
            f"{(m + m * n, m + m * n)}, got {shapes.shape} and {matrix.shape}"
        )
    sds = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
    places: list[int] = []
    for mode in modes:
        i = int(np.abs(frequencies - mode.frequency_hz).argmin())
        of_shape = sds[m + n * i : m + n * (i + 1)]
        # Numbers in the CSV file may be rounded, by less than their standard deviations.
        if i in places or not _is_same(mode, frequencies[i], shapes[i], sds[i], of_shape):
            raise ValueError(
                f"{path}: not the covariance of {csv_path.name}: mode {mode.label!r} differs in "
                "frequency or shape by more than its standard deviation; identify again, or remove "
                "the line 'covariance' to use each mode's own errors"
            )
        places.append(i)
    return of_modes(matrix, places, m, n)


def _is_same(
    mode: IdentifiedMode, frequency: float, shape: FloatArray, sd: float, shape_sds: FloatArray
) -> bool:
    if not abs(mode.frequency_hz / frequency - 1.0) <= sd:
        return False
    unit = mode.unit_shape if mode.unit_shape is not None else np.full(len(shape), np.nan)
    measured = np.isfinite(shape)
    if not np.array_equal(np.isfinite(unit), measured):
        return False
    apart = np.linalg.norm(unit[measured] - shape[measured])
    return bool(apart <= np.linalg.norm(shape_sds[measured]))
