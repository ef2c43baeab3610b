"""Modes identified from a record, with the joint covariance of their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.resonances import Resonances, with_positive_largest


class MethodModes(NamedTuple):
    """m modes by one method; None for what the method does not give."""

    frequencies_hz: FloatArray  # (m,)
    shapes: FloatArray  # (n, m), real, at unit length
    frequency_covs: FloatArray | None = None  # (m,), standard deviations over the frequencies
    dampings: FloatArray | None = None  # (m,)
    damping_sds: FloatArray | None = None  # (m,)
    shape_sds: FloatArray | None = None  # (m,)

    def modal_data(
        self, band_hz: tuple[float, float], sensors: tuple[str, ...], source: str = ""
    ) -> ModalData:
        """The modes as data of model classes, with the errors that the method claims."""

        def of(values: FloatArray | None, i: int) -> float | None:
            return None if values is None else float(values[i])

        modes = tuple(
            IdentifiedMode(
                str(i + 1), float(f), self.shapes[:, i], of(self.frequency_covs, i),
                of(self.shape_sds, i), of(self.dampings, i), of(self.damping_sds, i),
            )
            for i, f in enumerate(self.frequencies_hz)
        )  # fmt: skip
        return ModalData(modes, band_hz, sensors, source)


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
    """

    method: str
    band_hz: tuple[float, float]
    sensors: tuple[str, ...]
    frequencies_hz: FloatArray
    dampings: FloatArray
    shapes: FloatArray
    covariance: FloatArray

    @property
    def n_modes(self) -> int:
        """Number of modes, m."""
        return len(self.frequencies_hz)

    @property
    def poles(self) -> Resonances:
        """The modes without their errors."""
        return Resonances(self.frequencies_hz, self.dampings, self.shapes)

    @property
    def method_modes(self) -> MethodModes:
        """The modes with their errors, but for correlations."""
        return MethodModes(
            self.frequencies_hz, self.shapes, self.frequency_covs, self.dampings,
            self.damping_sds, self.shape_sds,
        )  # fmt: skip

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
        signed, signs = with_positive_largest(shapes)
        of_shapes = [
            sign * (np.eye(n - 1) - np.outer(shape, shape)) @ rest / length
            for shape, length, sign in zip(shapes.T, lengths, signs, strict=True)
        ]
        jacobian = block_diag(np.eye(2 * m), *of_shapes)
        return replace(
            self,
            sensors=tuple(np.delete(self.sensors, place).tolist()),
            shapes=signed,
            covariance=jacobian @ self.covariance @ jacobian.T,
        )

    def modal_data(self, source: str = "") -> ModalData:
        """The modes as data of model classes, labelled 1, 2, … in ascending order of frequency.

        Args:
            source: where they come from.
        """
        kept = np.r_[: self.n_modes, 2 * self.n_modes : len(self.covariance)]  # not the dampings
        data = self.method_modes.modal_data(self.band_hz, self.sensors, source)
        return replace(data, covariance=self.covariance[np.ix_(kept, kept)])

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
