"""Sizes of the errors of pairs of identified and model modes, identification and prediction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_ssi.foundations.arrays import FloatArray, row_sums
from bayes_ssi.inference.likelihood.error_groups import ErrorGroups, ErrorSizes, Separation
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.joint_errors import JointErrors, ShapeAxes, WhiteErrors
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.shape_density import log_sphere_area
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable, as_product


@dataclass(frozen=True, eq=False)
class UnpairedModes:
    """The terms of a likelihood that belong to modes without a counterpart."""

    data: ModalData
    identification: IdentificationModel

    def log_missed(
        self, frequencies_hz: FloatArray, prediction_var: FloatArray, which: Sequence[int]
    ) -> FloatArray:
        """log(1 - p_D P_in), (B, len(which)): log probability that these model modes are missed.

        Args:
            frequencies_hz: (B, n_modes), of all model modes.
            prediction_var: (B, 1), squared prediction errors of frequencies.
            which: of the model modes, from 0.
        """
        if not which:
            return np.zeros((len(frequencies_hz), 0))
        low, high = self.data.band_hz
        frequencies = frequencies_hz.T[which].T
        sd = np.sqrt(prediction_var + self._typical_frequency_var) * frequencies
        inside = ndtr((high - frequencies) / sd) - ndtr((low - frequencies) / sd)
        return np.log1p(-self.identification.detection_probability * inside)

    def near_a_limit(
        self, frequencies_hz: FloatArray, prediction_var: FloatArray, which: Iterable[int]
    ) -> NDArray[np.bool_]:
        """Whether model modes are within two standard errors of a limit other than zero.

        Arguments are as for :meth:`log_missed`; false (B, n_modes) for modes not in ``which``.
        """
        reach = 2.0 * np.sqrt(prediction_var + self._typical_frequency_var) * frequencies_hz
        limits = [limit for limit in self.data.band_hz if limit > 0]
        near = np.zeros(frequencies_hz.shape, dtype=bool)
        for mode in which:
            for limit in limits:
                near[:, mode] |= np.abs(frequencies_hz[:, mode] - limit) < reach[:, mode]
        return near

    def log_spurious(self, mode: IdentifiedMode) -> float:
        """The log density of an identified mode that belongs to no model mode."""
        low, high = self.data.band_hz
        density = math.log(self.identification.expected_spurious_modes / (high - low))
        return density - (log_sphere_area(mode.n_measured) if mode.scored_shape is not None else 0)

    @cached_property
    def _typical_frequency_var(self) -> float:
        """Squared identification error assumed for modes that were not identified."""
        return float(np.mean([(mode.frequency_cov or 0.0) ** 2 for mode in self.data.modes]))


def prediction_sizes(error: ErrorModel, pairs: PairedModes) -> list[Product]:
    """Prediction errors of frequencies and, where a shape is scored, of shapes."""
    shape = [as_product(error.shape_sd)] if len(pairs.with_shape) else []
    return [as_product(error.frequency_cov), *shape]


@dataclass(frozen=True, eq=False)
class PairErrors:
    """The errors of pairs for a batch of B parameter values."""

    error: ErrorModel
    pairs: PairedModes
    parameters: tuple[Parameter, ...]

    @cached_property
    def _sizes(self) -> ProductTable:
        return ProductTable(tuple(prediction_sizes(self.error, self.pairs)), self.parameters)

    def prediction_var(self, values: FloatArray) -> FloatArray:
        """Squared prediction errors (B, 1 or 2) of frequencies and, where scored, shapes."""
        return self._sizes.evaluate(values) ** 2

    def prediction_var_once(self, values: FloatArray) -> FloatArray:
        """The same, (1, 1 or 2) where no parameter enters them."""
        fixed = not any(each.parameters for each in prediction_sizes(self.error, self.pairs))
        return self.prediction_var(values[:1] if fixed else values)

    def of_pairs(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard errors of the paired frequencies (B, P), as fractions, and shapes (B, S)."""
        prediction_var = self.prediction_var(values)
        frequency_sds = np.sqrt(prediction_var[:, :1] + self.pairs.frequency_var)
        if not len(self.pairs.with_shape):
            return frequency_sds, np.zeros((len(values), 0))
        return frequency_sds, np.sqrt(prediction_var[:, 1:] + self.pairs.shape_var)

    def least(
        self, values: FloatArray, own: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Smallest standard errors (B,) of a frequency and of a shape; infinite where none is.

        Where errors are correlated, this is the error of the difference between modes or tests that
        the data determine best.

        Args:
            values: (B, n_parameters).
        """
        prediction_var = self.prediction_var(values) * self._least_independent_share(values)
        frequency, shape = (
            np.sqrt(prediction_var[:, column] + variances.min())
            if len(variances)
            else np.full(len(values), np.inf)
            for column, variances in zip((0, -1), own, strict=True)
        )
        return frequency, shape

    def _least_independent_share(self, values: FloatArray) -> FloatArray | float:
        """A bound (B, 1) on the smallest eigenvalue of the correlation matrix of errors."""
        if not self.error.is_correlated:
            return 1.0
        table = ProductTable(self.error.correlations, self.parameters)
        tests, modes = table.evaluate(values).T
        # 1 - ρ for one correlation for all, (1 - ρ)/(1 + ρ) for ρ^|i - j|.
        return ((1.0 - tests) * (1.0 - modes) / (1.0 + modes))[:, None]


class PairResiduals(NamedTuple):
    """Residuals of all pairs at a batch of B parameter values.

    Attributes:
        frequencies: (B, P).
        unit_shapes: (B, S s), of the model.
        variances: squared prediction errors (B or 1, 1 or 2) of frequencies and, where scored,
            shapes.
    """

    frequencies: FloatArray
    unit_shapes: FloatArray
    variances: FloatArray


class SingleErrors(NamedTuple):
    """Each pair's errors regardless of the others', which are independent of each other.

    Attributes:
        frequencies: (B, P), standard-normal: residuals given those of the shape.
        shape_squares: (B, P), chi-square with as many degrees of freedom as the shape has
            directions to err in; zero without a shape.
        shape_variances: (B, P), the sum of the variances in these directions.
        shape_squared_variances: (B, P), the sum of their squares.
    """

    frequencies: FloatArray
    shape_squares: FloatArray
    shape_variances: FloatArray
    shape_squared_variances: FloatArray

    @classmethod
    def of(cls, white: WhiteErrors) -> SingleErrors:
        """Those of one mode, (B, 1)."""
        variances = np.broadcast_to(white.shape_var, white.shapes.shape)
        sums = (white.shapes * white.shapes / variances, variances, variances * variances)
        return cls(
            white.frequencies / np.sqrt(white.frequency_var),
            *(row_sums(each)[:, None] for each in sums),
        )


@dataclass(frozen=True, eq=False)
class JointPairs:
    """The errors of single pairs whose identified modes have a joint covariance."""

    data: ModalData
    pairs: PairedModes

    @property
    def least_variances(self) -> tuple[FloatArray, FloatArray]:
        """Variances of frequencies and of shapes in the directions that the data determine best.

        Those of frequencies are conditional on shapes.
        """
        labels = list(self._modes)
        axes = ShapeAxes.of(self.data, labels)
        places = [self.data.labels.index(label) for label in labels]
        assert self.data.covariance is not None
        return axes.least_variances(self.data.covariance[np.ix_(places, places)]), axes.variances

    def log_ratios(self, residuals: PairResiduals) -> FloatArray:
        """Log of the joint density of each pair over the product of single ones, (B, P)."""
        n = len(residuals.frequencies)
        return np.concatenate(
            [errors.log_ratio(*own).reshape(n, -1) for errors, own in self._each(residuals)], axis=1
        )

    def errors(self, residuals: PairResiduals) -> SingleErrors:
        """The errors of each pair, whatever those of the others."""
        n = len(residuals.frequencies)
        parts = [SingleErrors.of(errors.white(*own)) for errors, own in self._each(residuals)]
        return SingleErrors(
            *(
                np.concatenate([rows.reshape(n, -1) for rows in of_modes], axis=1)
                for of_modes in zip(*parts, strict=True)
            )
        )

    def _each(
        self, residuals: PairResiduals
    ) -> Iterator[tuple[JointErrors, tuple[FloatArray, FloatArray, tuple[ErrorSizes, ErrorSizes]]]]:
        """The errors of each identified mode, and its pairs' residuals, a row for each of them."""
        for errors, pairs, shapes in self._modes.values():
            frequencies = residuals.frequencies[:, pairs].reshape(-1, 1)
            n_sensors, n_shapes = self.pairs.unit_shapes.shape
            n_rows = len(residuals.frequencies)
            unit = residuals.unit_shapes.reshape(n_rows, n_shapes, n_sensors)[:, shapes]
            unit = unit.reshape(len(frequencies), len(errors.shapes), n_sensors)
            variances = residuals.variances
            if len(variances) > 1:
                variances = np.repeat(variances, len(pairs), axis=0)
            none = np.zeros(len(variances))
            frequency, shape = (ErrorSizes(variances[:, i], none, none) for i in (0, -1))
            yield errors, (frequencies, unit, (frequency, shape))

    @cached_property
    def _modes(self) -> dict[str, tuple[JointErrors, list[int], list[int]]]:
        """The errors of each identified mode, its pairs, and which of the scored shapes are its."""
        pairs, found = self.pairs, {}
        labels = [mode.label for mode in pairs.modes]
        for label in dict.fromkeys(labels):
            own = [i for i, other in enumerate(labels) if other == label]
            shapes = [s for s, pair in enumerate(pairs.with_shape) if labels[pair] == label]
            errors = JointErrors(
                frequencies=ErrorGroups(
                    [0],
                    np.zeros((1, 1), dtype=np.intp),
                    pairs.frequency_var[own[:1]].reshape(1, 1, 1),
                    Separation(np.zeros((1, 1, 1)), np.zeros((1, 1, 1))),
                ),
                shapes=shapes[:1],
                axes=ShapeAxes.of(self.data, [label]),
                identified=pairs.unit_shapes.T[shapes[:1]],
                single_var=pairs.shape_var[shapes[:1]],
                dimensions=np.array([pairs.n_measured[s] - 1.0 for s in shapes[:1]]),
            )
            found[label] = errors, own, shapes
        return found
