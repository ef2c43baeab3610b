"""The joint errors of pairs of identified and model modes: of all together, or of each pair."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.joint_errors import JointErrors
from bayes_ssi.inference.likelihood.likelihood_terms import row_sums
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.measurements.modes.modal_data import ModalData


class Residuals(NamedTuple):
    """Residuals of all pairs at a batch of B parameter values.

    Attributes:
        frequencies: (B, P).
        shapes: (B, S n), in the planes at the identified shapes.
        frequency_var: (B or 1,), squared prediction error of frequencies.
        shape_var: (B or 1,), of shapes.
    """

    frequencies: FloatArray
    shapes: FloatArray
    frequency_var: FloatArray
    shape_var: FloatArray


class OwnErrors(NamedTuple):
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


@dataclass(frozen=True, eq=False)
class JointPairs:
    """The errors of pairs whose identified modes have a joint covariance."""

    data: ModalData
    pairs: PairedModes

    @cached_property
    def together(self) -> JointErrors:
        """The errors of all pairs, each of another identified mode."""
        return JointErrors.of(self.data, [mode.label for mode in self.pairs.modes])

    @property
    def least_variances(self) -> tuple[FloatArray, FloatArray]:
        """Variances of all identified modes' frequencies and shapes, where best determined."""
        return JointErrors.of(self.data, list(self._of_modes)).least_variances

    def log_ratio(self, residuals: Residuals) -> FloatArray:
        """Log of the joint density of all pairs over the product of single ones, (B,)."""
        return self.together.log_ratio(*residuals)

    def log_ratios_of_pairs(self, residuals: Residuals) -> FloatArray:
        """Log of the joint density of each pair over the product of single ones, (B, P)."""
        n = len(residuals.frequencies)
        each = [errors.log_ratio(*own).reshape(n, -1) for errors, own in self._each(residuals)]
        return np.concatenate(each, axis=1)

    def errors_of_pairs(self, residuals: Residuals) -> OwnErrors:
        """The errors of each pair, whatever those of the others."""
        n, parts = len(residuals.frequencies), []
        for errors, own in self._each(residuals):
            white = errors.white(*own)
            variances = np.broadcast_to(white.shape_var, white.shapes.shape)
            each = (
                white.frequencies / np.sqrt(white.frequency_var),
                white.shape_squares,
                row_sums(variances),
                row_sums(variances * variances),
            )
            parts.append([rows.reshape(n, -1) for rows in each])
        return OwnErrors(*(np.concatenate(rows, axis=1) for rows in zip(*parts, strict=True)))

    def _each(self, residuals: Residuals) -> Iterator[tuple[JointErrors, Residuals]]:
        """The errors of each identified mode, and its pairs' residuals, a row for each of them."""
        n_sensors, first = len(self.data.sensors), 0
        labels = [mode.label for mode in self.pairs.modes]
        for label, errors in self._of_modes.items():
            pairs = [i for i, other in enumerate(labels) if other == label]
            frequencies = residuals.frequencies[:, pairs].reshape(-1, 1)
            width = n_sensors * len(errors.dimensions)
            columns = slice(first, first + width * len(pairs))
            first = columns.stop
            shapes = residuals.shapes[:, columns].reshape(len(frequencies), width)
            variances = residuals.frequency_var, residuals.shape_var
            if len(residuals.frequency_var) > 1:
                variances = np.repeat(variances[0], len(pairs)), np.repeat(variances[1], len(pairs))
            yield errors, Residuals(frequencies, shapes, *variances)

    @cached_property
    def _of_modes(self) -> dict[str, JointErrors]:
        labels = dict.fromkeys(mode.label for mode in self.pairs.modes)
        return {label: JointErrors.of(self.data, [label]) for label in labels}
