"""Modes identified from a record, with the joint covariance of their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData


class Poles(NamedTuple):
    """Modes without their errors.

    Attributes:
        frequencies_hz: (p,), ascending.
        dampings: (p,), fractions of critical damping.
        shapes: (n, p), real, at unit length.
    """

    frequencies_hz: FloatArray
    dampings: FloatArray
    shapes: FloatArray

    def at(self, places: Sequence[int]) -> Poles:
        """Some of the modes."""
        chosen = list(places)
        return Poles(self.frequencies_hz[chosen], self.dampings[chosen], self.shapes[:, chosen])

    def joined(self, others: Poles) -> Poles:
        """These modes and others, in ascending order."""
        frequencies = np.concatenate([self.frequencies_hz, others.frequencies_hz])
        dampings = np.concatenate([self.dampings, others.dampings])
        shapes = np.concatenate([self.shapes, others.shapes], axis=1)
        return Poles(frequencies, dampings, shapes).at(np.argsort(frequencies).tolist())


@dataclass(frozen=True, eq=False, repr=False)
class ModalEstimates(Displayed):
    """m modes at n sensors, and the covariance of their errors.

    Attributes:
        method: how they were identified.
        band_hz: of the search.
        sensors: their n names.
        frequencies_hz: (m,), ascending.
        dampings: (m,), fractions of critical damping.
        shapes: (n, m), real, at unit length, the largest component positive.
        covariance: of (ln f, ln ζ, shapes), (2m + mn, 2m + mn); shapes mode by mode. A shape at
            unit length has no error along itself.
        n_segments: of the jackknife that the covariance comes from; 0 where a model gives it.
    """

    method: str
    band_hz: tuple[float, float]
    sensors: tuple[str, ...]
    frequencies_hz: FloatArray
    dampings: FloatArray
    shapes: FloatArray
    covariance: FloatArray
    n_segments: int = 0

    @property
    def n_modes(self) -> int:
        """Number of modes, m."""
        return len(self.frequencies_hz)

    @property
    def poles(self) -> Poles:
        """The modes without their errors."""
        return Poles(self.frequencies_hz, self.dampings, self.shapes)

    @property
    def frequency_covs(self) -> FloatArray:
        """Standard deviation of each frequency over the frequency (m,)."""
        return np.sqrt(self.covariance.diagonal()[: self.n_modes])

    @property
    def damping_sds(self) -> FloatArray:
        """Standard deviation of each damping ratio (m,)."""
        m = self.n_modes
        return self.dampings * np.sqrt(self.covariance.diagonal()[m : 2 * m])

    @property
    def shape_sds(self) -> FloatArray:
        """Standard deviation of a component across its shape (m,), √(tr Cov φ / (n - 1))."""
        variances = self.covariance.diagonal()[2 * self.n_modes :].reshape(self.n_modes, -1)
        return np.sqrt(variances.sum(1) / (len(self.sensors) - 1))

    def without_sensor(self, place: int) -> ModalEstimates:
        """The modes at all sensors but one, with shapes at unit length there."""
        m, n = self.n_modes, len(self.sensors)
        rest = np.delete(np.eye(n), place, axis=0)
        shapes = rest @ self.shapes
        lengths = np.linalg.norm(shapes, axis=0)
        shapes = shapes / lengths
        jacobian = np.zeros((2 * m + m * (n - 1), 2 * m + m * n))
        jacobian[range(2 * m), range(2 * m)] = 1.0
        signed, signs = with_positive_largest(shapes)
        for i, (shape, length, sign) in enumerate(zip(shapes.T, lengths, signs, strict=True)):
            across = np.eye(n - 1) - np.outer(shape, shape)
            rows, columns = 2 * m + i * (n - 1), 2 * m + i * n
            own = sign * across @ rest / length
            jacobian[rows : rows + n - 1, columns : columns + n] = own
        return replace(
            self,
            sensors=tuple(np.delete(self.sensors, place).tolist()),
            shapes=signed,
            covariance=jacobian @ self.covariance @ jacobian.T,
        )

    def modal_data(self, source: str = "") -> ModalData:
        """The modes as data of model classes, labelled 1, 2, … in ascending order of frequency.

        Their joint covariance is among them where it is that of a model. A jackknife's has errors
        of its own, which its inverse multiplies: only the sizes of its errors are.

        Args:
            source: where they come from.
        """
        rows = zip(
            self.frequencies_hz, self.frequency_covs, self.shapes.T, self.shape_sds, self.dampings,
            self.damping_sds, strict=True,
        )  # fmt: skip
        modes = tuple(
            IdentifiedMode(
                str(i), float(f), shape, float(cov), float(sd), float(damping), float(damping_sd)
            )
            for i, (f, cov, shape, sd, damping, damping_sd) in enumerate(rows, 1)
        )
        m, size = self.n_modes, len(self.covariance)
        kept = np.r_[:m, 2 * m : size]  # without the dampings
        covariance = self.covariance[np.ix_(kept, kept)] if self.n_segments == 0 else None
        return ModalData(modes, self.band_hz, self.sensors, source, covariance)

    def distances(self, other: ModalEstimates) -> tuple[FloatArray, FloatArray]:
        """How far the modes are from those of other estimates from the same record.

        Returns:
            Differences of frequencies and of shapes, (m,) each, over the larger one of the two
            claimed standard deviations: estimates from one record share its randomness.
        """
        claimed = np.maximum(self.frequency_covs, other.frequency_covs)
        frequencies = np.abs(np.log(self.frequencies_hz / other.frequencies_hz)) / claimed
        cosines = np.abs((self.shapes * other.shapes).sum(0))
        lengths = np.sqrt(np.maximum(0.0, 2.0 - 2.0 * cosines))
        claimed = np.maximum(self.shape_sds, other.shape_sds) * math.sqrt(len(self.sensors) - 1)
        return frequencies, lengths / claimed

    def _line(self) -> str:
        modes, sensors = counted(self.n_modes, "mode"), counted(len(self.sensors), "sensor")
        return f"{modes} at {sensors}, by {self.method}"

    def _rows(self) -> list[dict[str, Any]]:
        both = zip(self.frequencies_hz.tolist(), self.dampings.tolist(), strict=True)
        return [{"frequency_hz": hz, "damping": damping} for hz, damping in both]


def real_shapes(shapes: ComplexArray) -> FloatArray:
    """Shapes (n, m) rotated to where their real parts are longest, at unit length.

    The largest component is positive.
    """
    turned = (shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0)))).real
    return with_positive_largest(turned / np.sqrt((turned**2).sum(0)))[0]


def with_positive_largest(shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shapes (n, m) with the largest component positive, and the signs (m,) that they took."""
    largest = np.abs(shapes).argmax(0)
    signs = np.sign(shapes[largest, np.arange(shapes.shape[1])])
    return shapes * signs, signs
