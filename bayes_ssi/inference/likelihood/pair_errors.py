"""Sizes of the errors of pairs of identified and model modes, identification and prediction."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_ssi.foundations.arrays import FloatArray, row_sums
from bayes_ssi.inference.likelihood.error_groups import ErrorGroups, ErrorSizes, Separation
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.joint_errors import JointErrors
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


@dataclass(frozen=True, eq=False)
class JointPairs:
    """The errors of single pairs whose identified modes have a joint covariance.

    Methods take the residuals (B, P) of frequencies, the model's unit shapes (B, S s), and squared
    prediction errors (B or 1, 1 or 2) of frequencies and, where scored, shapes.
    """

    data: ModalData
    pairs: PairedModes

    @property
    def least_variances(self) -> tuple[FloatArray, FloatArray]:
        """Variances of frequencies and of shapes in the directions that the data determine best."""
        return self._errors(tuple(self._modes)).least_variances

    def log_ratios(
        self, frequencies: FloatArray, unit_shapes: FloatArray, variances: FloatArray
    ) -> FloatArray:
        """Log of the joint density of each pair over the product of single ones, (B, P)."""
        n, modes = len(frequencies), self._by_mode(frequencies, unit_shapes, variances)
        ratios = [errors.log_ratio(*residuals).reshape(n, -1) for errors, residuals in modes]
        return np.concatenate(ratios, axis=1)

    def errors(
        self, frequencies: FloatArray, unit_shapes: FloatArray, variances: FloatArray
    ) -> list[FloatArray]:
        """The errors of each pair regardless of the others, four arrays (B, P).

        Standard-normal ones of frequencies, given those of shapes; the squares of those of shapes,
        chi-square with as many degrees of freedom as the shape has directions to err in; the sum of
        the variances in these directions, and that of their squares.
        """
        n, parts = len(frequencies), []
        for errors, residuals in self._by_mode(frequencies, unit_shapes, variances):
            white = errors.white(*residuals)
            of_shapes = np.broadcast_to(white.shape_var, white.shapes.shape)
            squares = white.shapes * white.shapes / of_shapes
            parts.append(
                [
                    white.numbers[:, 0].reshape(n, -1),
                    *(row_sums(x).reshape(n, -1) for x in (squares, of_shapes, of_shapes**2)),
                ]
            )
        return [np.concatenate(of_modes, axis=1) for of_modes in zip(*parts, strict=True)]

    def _by_mode(
        self, frequencies: FloatArray, unit_shapes: FloatArray, variances: FloatArray
    ) -> Iterator[tuple[JointErrors, tuple[FloatArray, FloatArray, tuple[ErrorSizes, ErrorSizes]]]]:
        """The errors of each identified mode, and its pairs' residuals, a row for each of them."""
        n, (n_sensors, n_shapes) = len(frequencies), self.pairs.unit_shapes.shape
        shapes = unit_shapes.reshape(n, n_shapes, n_sensors)
        for errors, pairs in self._modes.values():
            scored = np.flatnonzero(np.isin(self.pairs.with_shape, pairs))
            unit = shapes[:, scored].reshape(n * len(pairs), len(errors.shapes), n_sensors)
            repeated = np.repeat(variances, len(pairs), axis=0) if len(variances) > 1 else variances
            zero = np.zeros(len(repeated))
            frequency, shape = (ErrorSizes(repeated[:, i], zero, zero) for i in (0, -1))
            yield errors, (frequencies[:, pairs].reshape(-1, 1), unit, (frequency, shape))

    @cached_property
    def _modes(self) -> dict[str, tuple[JointErrors, list[int]]]:
        """The errors of each identified mode, and its pairs."""
        labels = [mode.label for mode in self.pairs.modes]
        return {
            label: (
                self._errors((label,)),
                [i for i, other in enumerate(labels) if other == label],
            )
            for label in dict.fromkeys(labels)
        }

    def _errors(self, labels: Sequence[str]) -> JointErrors:
        """The errors of some identified modes; of several, their prediction errors are not used."""
        pairs = PairedModes.of(self.data, [(label, 1) for label in labels])
        covariance, n = pairs.identification_covariance(self.data), len(labels)
        same = Separation(np.zeros((1, n, n)), np.zeros((1, n, n)))
        frequencies = ErrorGroups([0], np.arange(n)[None], covariance[None, :n, :n], same)
        return JointErrors.of(covariance, pairs, frequencies, range(len(pairs.with_shape)))
