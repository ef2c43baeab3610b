"""Errors of identified modes that are jointly normal, with prediction errors added.

Where the data have a joint covariance C of the logarithms of frequencies and of unit shapes, the
residuals x of paired modes, r_f = f/f_e - 1 and the errors of shapes in the planes that touch the
sphere of unit shapes at the identified ones, are normal with the covariance
``C + diag(σ_f², σ_φ²)``. Their joint density over the product of single ones, each with the size of
its own errors, multiplies the likelihood of independent errors. It is one where C is diagonal and
the same for all components of a shape, so that the density on the sphere remains; otherwise the
integral over all shapes differs from one by the order of σ².

A shape's error is r_φ long, as in the density on the sphere, and points from the identified shape
to the model's. In the axes of the shapes' own covariance, that of shapes with any prediction error
is diagonal, and only frequencies need a factorisation at each row of a batch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_groups import conditional_errors
from bayes_ssi.inference.likelihood.likelihood_terms import row_sums
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.measurements.modes.joint_covariance import plane_bases
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import SOLVER


class WhiteErrors(NamedTuple):
    """Residuals as independent normal numbers with variances, for a batch of B.

    Attributes:
        frequencies: (B, P), each given all shapes and the frequencies before it.
        frequency_var: (B or 1, P).
        shapes: (B, K), in the axes of the shapes' covariance.
        shape_var: (B or 1, K).
    """

    frequencies: FloatArray
    frequency_var: FloatArray
    shapes: FloatArray
    shape_var: FloatArray

    @property
    def frequency_squares(self) -> FloatArray:
        """The sum (B,) of squares of the frequencies' residuals over their variances."""
        return row_sums(self.frequencies * self.frequencies / self.frequency_var)

    @property
    def shape_squares(self) -> FloatArray:
        """The sum (B,) of squares of the shapes' residuals over their variances."""
        return row_sums(self.shapes * self.shapes / self.shape_var)

    @property
    def log_determinant(self) -> FloatArray:
        """Of the covariance, (B or 1,)."""
        return row_sums(np.log(self.frequency_var)) + row_sums(np.log(self.shape_var))


@dataclass(frozen=True, eq=False)
class JointErrors:
    """The joint covariance of P identified modes, of which S have a shape that is scored.

    Attributes:
        of_frequencies: (P, P), covariance of identification errors.
        of_axes: (K,), variances of the errors of all shapes along the axes of their covariance.
        axes: (S n, K), components of the axes, shape by shape.
        between: (P, K), covariance of frequencies with the axes.
        single_frequency_var: (P,).
        single_shape_var: (S,), of a component of each shape, the mean over its directions.
        dimensions: (S,), directions in which each shape can err.
    """

    of_frequencies: FloatArray
    of_axes: FloatArray
    axes: FloatArray
    between: FloatArray
    single_frequency_var: FloatArray
    single_shape_var: FloatArray
    dimensions: FloatArray

    @classmethod
    def of(cls, data: ModalData, labels: Sequence[str]) -> JointErrors:
        """The errors of some modes of data with a joint covariance."""
        assert data.covariance is not None
        m, n = len(data.modes), len(data.sensors)
        places = [data.labels.index(label) for label in labels]
        scored = [i for i in places if data.modes[i].scored_shape is not None]
        rows = [m + n * i + k for i in scored for k in range(n)]
        bases = plane_bases([data.modes[i] for i in scored], n)
        basis = block_diag(*bases) if bases else np.zeros((0, 0))
        of_shapes = basis.T @ data.covariance[np.ix_(rows, rows)] @ basis
        variances, turn = np.linalg.eigh(of_shapes)
        axes = basis @ turn
        own = [data.modes[i].shape_sd or 0.0 for i in scored]
        return cls(
            of_frequencies=data.covariance[np.ix_(places, places)],
            of_axes=np.maximum(variances, 0.0),  # by rounding below zero
            axes=axes,
            between=data.covariance[np.ix_(places, rows)] @ axes,
            single_frequency_var=data.covariance[places, places],
            single_shape_var=np.array(own) ** 2,
            dimensions=np.array([data.modes[i].n_measured - 1.0 for i in scored]),
        )

    @property
    def least_variances(self) -> tuple[FloatArray, FloatArray]:
        """Variances of frequencies and of shapes in the directions that the data determine best.

        Those of frequencies (P,) are conditional on shapes.
        """
        known = self.of_axes > SOLVER.rounding * self.of_axes.max(initial=0.0)
        gain = self.between[:, known] / self.of_axes[known]
        given_shapes = self.of_frequencies - gain @ self.between[:, known].T
        return np.maximum(np.linalg.eigvalsh(given_shapes), 0.0), self.of_axes

    def of_frequencies_with(self, prediction_var: FloatArray) -> FloatArray:
        """Covariance (B, P, P) of frequencies with squared prediction errors (B,) added."""
        covariance = np.tile(self.of_frequencies, (len(prediction_var), 1, 1))
        i = np.arange(len(self.of_frequencies))
        covariance[:, i, i] += prediction_var[:, None]
        return covariance

    def white(
        self,
        residuals: FloatArray,
        errors: FloatArray,
        frequency_var: FloatArray,
        shape_var: FloatArray,
    ) -> WhiteErrors:
        """The residuals without correlation.

        Args:
            residuals: (B, P), of frequencies.
            errors: (B, S n), of shapes in their planes.
            frequency_var: (B or 1,), squared prediction error of frequencies.
            shape_var: (B or 1,), of shapes.
        """
        along = np.zeros((len(errors), len(self.of_axes)))
        for i, axis in enumerate(self.axes):
            along += errors[:, i : i + 1] * axis
        variances = self.of_axes + shape_var[:, None]
        covariance = self.of_frequencies_with(frequency_var)
        rest = residuals.copy()
        # A direction at a time: how products are added must not depend on the batch.
        for k, column in enumerate(self.between.T):
            gain = column / variances[:, k : k + 1]
            rest -= gain * along[:, k : k + 1]
            covariance -= gain[:, :, None] * column
        steps = list(conditional_errors(covariance, rest[:, :, None]))
        return WhiteErrors(
            np.stack([residual[:, 0] for _, residual in steps], axis=1),
            np.stack([variance for variance, _ in steps], axis=1),
            along,
            variances,
        )

    def log_ratio(
        self,
        residuals: FloatArray,
        errors: FloatArray,
        frequency_var: FloatArray,
        shape_var: FloatArray,
    ) -> FloatArray:
        """Log of the joint density over the product of single ones, (B,); see :meth:`white`."""
        white = self.white(residuals, errors, frequency_var, shape_var)
        joint = white.frequency_squares + white.shape_squares + white.log_determinant
        of_each = self.single_frequency_var + frequency_var[:, None]
        single = row_sums(residuals * residuals / of_each) + row_sums(np.log(of_each))
        if len(self.dimensions):
            of_shapes = self.single_shape_var + shape_var[:, None]
            squares = (errors * errors).reshape(len(errors), len(self.dimensions), -1)
            squares = row_sums(squares.transpose(0, 2, 1))
            single += row_sums(squares / of_shapes)
            single += row_sums(self.dimensions * np.log(of_shapes))
        return 0.5 * (single - joint)


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
