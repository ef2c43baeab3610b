"""The file beside a CSV file of modes, which names it: their covariance, and how they were found.

The JSON file holds ``sensors``, and for m modes at n sensors ``frequencies_hz`` (m),
``unit_shapes`` (m lists of n components, null where not measured) and
``covariance_of_log_frequencies_and_unit_shapes`` (m + m n, m + m n), shapes mode by mode, null
where errors are independent. Frequencies and shapes tell which row of the CSV file is which mode,
so that its modes may be renamed, sorted or left out.

Its ``identifications`` are records of each vibration record that the modes come from, one, or
several where modes were merged. Paths of figures are relative to the file's directory.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.measurements.modes.identification_summary import IdentificationSummary
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.joint_covariance import of_modes
from bayes_ssi.measurements.modes.modal_data import ModalData


@dataclass(frozen=True)
class Companion:
    """The content of the file."""

    sensors: tuple[str, ...]
    frequencies_hz: FloatArray
    unit_shapes: tuple[tuple[float | None, ...], ...]
    covariance_of_log_frequencies_and_unit_shapes: Any  # a large list of lists, or None
    identifications: tuple[IdentificationSummary, ...]


def write_companion(data: ModalData, path: Path) -> None:
    """Write what a CSV file does not hold of these modes to a new file."""
    shapes = [
        tuple(float(component) if np.isfinite(component) else None for component in shape)
        for shape in data.unit_shapes.T
    ]
    identifications = tuple(
        replace(each, figures=tuple(os.path.relpath(file, path.parent) for file in each.figures))
        for each in data.identifications
    )
    content = Companion(
        data.sensors, data.frequencies_hz, tuple(shapes), data.covariance, identifications
    )
    with path.open("x", encoding="utf-8") as file:
        json.dump(to_record(content), file)


def read_companion(path: Path, csv_path: Path) -> Companion:
    """The file that a CSV file names."""
    lost = "and with it the covariance, and what is known of failed checks"
    try:
        content = from_record(Companion, json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ValueError(
            f"{csv_path}: no file {path.name}, which its line 'identification' names, in its "
            f"directory; put it there, or remove the line, {lost}"
        ) from None
    except ValueError as error:
        raise ValueError(
            f"{path}: no record of the identification that this version reads: {error}; identify "
            f"again, or remove the line 'identification' of {csv_path.name}, {lost}"
        ) from None
    moved = tuple(
        replace(each, figures=tuple(str(path.parent / file) for file in each.figures))
        for each in content.identifications
    )
    return replace(content, identifications=moved)


def covariance_of(
    content: Companion, path: Path, modes: Sequence[IdentifiedMode], sensors: Sequence[str]
) -> FloatArray | None:
    """The joint covariance of ``modes``, in their order; None if the file holds none."""
    if content.covariance_of_log_frequencies_and_unit_shapes is None:
        return None
    if content.sensors != tuple(sensors):
        raise ValueError(
            f"{path}: the sensors, {', '.join(map(repr, content.sensors))}, are not those of the "
            "CSV file; names and order must be the same in both files"
        )
    frequencies = content.frequencies_hz
    m, n = len(frequencies), len(sensors)
    size = m + m * n
    try:
        shapes = np.array(content.unit_shapes, dtype=float).reshape(m, n)
        matrix = np.reshape(content.covariance_of_log_frequencies_and_unit_shapes, (size, size))
        matrix = matrix.astype(float)
    except (TypeError, ValueError):
        raise ValueError(
            f"{path}: {m} modes at {n} sensors need unit_shapes {(m, n)} and a covariance "
            f"{(size, size)} of numbers"
        ) from None
    sds = np.sqrt(np.maximum(matrix.diagonal(), 0.0))
    places: list[int] = []
    for mode in modes:
        i = int(np.abs(frequencies - mode.frequency_hz).argmin())
        of_shape = sds[m + n * i : m + n * (i + 1)]
        # Numbers in the CSV file may be rounded, by less than their standard deviations.
        if i in places or not _is_same(mode, frequencies[i], shapes[i], sds[i], of_shape):
            raise ValueError(
                f"{path}: not the covariance of these modes: mode {mode.label!r} differs in "
                "frequency or shape by more than its standard deviation; identify again, or remove "
                "the line 'identification' of the CSV file to use each mode's own errors"
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
