"""Sensors: combinations of degrees of freedom that accelerometers measure.

An accelerometer measures at a point and in a direction, which need not be a degree of freedom: on
a rigid floor that moves by u and v and turns by θ, one at (x, y) along x measures u - y θ. That is
a row of the sensor matrix, with terms for these degrees of freedom only, however many the
structure has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, Places, as_slice


@dataclass(frozen=True)
class Sensor:
    """A point and direction in which motion is measured.

    Attributes:
        label: its name in the data.
        motion: label of a degree of freedom → what the sensor measures of its unit displacement;
            stored as pairs.

    Raises:
        ValueError: the label or the motion is empty, or a number in the motion is not finite.
    """

    label: str
    motion: tuple[tuple[str, float], ...]

    def __init__(self, label: str, motion: Mapping[str, float]) -> None:
        if not isinstance(label, str) or not label.strip():
            raise ValueError(f"Sensor: label must be text and not empty, got {label!r}")
        pairs = tuple((place, float(share)) for place, share in dict(motion).items())
        if not pairs or not all(math.isfinite(share) for _, share in pairs):
            raise ValueError(
                f"sensor {label!r}: motion must give a finite number for one degree of freedom or "
                f"more, got {motion!r}"
            )
        object.__setattr__(self, "label", label)
        object.__setattr__(self, "motion", pairs)


@dataclass(frozen=True, eq=False)
class SensorMatrix:
    """The sensor matrix (n_sensors, n_dof) of a structure, by its nonzero terms.

    Rows with fewer terms than the longest are padded with terms of weight zero.
    """

    rows: NDArray[np.intp]  # (n_sensors, n_terms), degrees of freedom
    weights: FloatArray  # (n_sensors, n_terms)

    @classmethod
    def of(
        cls, motions: Sequence[Mapping[str, float]], degrees_of_freedom: Sequence[str]
    ) -> SensorMatrix:
        """From each sensor's motion: degree of freedom → its weight in the measurement."""
        row = {label: i for i, label in enumerate(degrees_of_freedom)}
        longest = max(map(len, motions), default=1)
        rows = np.zeros((len(motions), longest), dtype=np.intp)
        weights = np.zeros((len(motions), longest))
        for i, motion in enumerate(motions):
            rows[i, : len(motion)] = [row[label] for label in motion]
            rows[i, len(motion) :] = rows[i, 0]
            weights[i, : len(motion)] = list(motion.values())
        return cls(rows, weights)

    @cached_property
    def _is_selection(self) -> bool:
        return self.rows.shape[1] == 1 and bool((self.weights == 1.0).all())

    def apply(self, motions: FloatArray, axis: int = 1) -> FloatArray:
        """Motions at the sensors, given all degrees of freedom along ``axis``.

        Shapes (B, n_dof, n_modes) become (B, n_sensors, n_modes). Only measured degrees of freedom
        are read, and terms are added one by one: in a matrix product, a row could depend on the
        size of its batch.
        """
        before = (slice(None),) * (motions.ndim - 1 - axis)
        if self._is_selection:
            chosen: FloatArray = motions.T[(*before, self._terms[0])].T
            return chosen
        column = [1] * motions.ndim
        column[axis] = len(self.rows)
        total: FloatArray | None = None
        for rows, weights in zip(self._terms, self.weights.T, strict=True):
            motion: FloatArray = motions.T[(*before, rows)].T
            own = None if isinstance(rows, slice) else motion  # a slice does not copy
            part = np.multiply(motion, weights.reshape(column), out=own)
            total = part if total is None else np.add(total, part, out=total)
        assert total is not None  # a sensor has one term or more
        return total

    @cached_property
    def _terms(self) -> list[Places]:
        return [as_slice(rows) for rows in self.rows.T]
