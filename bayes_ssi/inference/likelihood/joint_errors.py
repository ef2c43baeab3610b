"""Errors of frequencies and shapes together, where data have a joint covariance of both.

The residuals of paired modes are r_f = f/f_e - 1, and the errors of shapes in the planes that touch
the sphere of unit shapes at the identified ones: r_φ long, as in the density on the sphere, and
towards the model's shape. They are jointly normal with the covariance ``C + Σ``: C that of the
identification, of the logarithms of frequencies and of unit shapes, and Σ that of the prediction
errors (:mod:`~bayes_ssi.inference.likelihood.correlated_errors`). Their joint density over the
product of single ones multiplies the likelihood of independent errors. It is one where C + Σ is
diagonal and the same for all components of a shape, so that the density on the sphere remains;
otherwise the integral over all shapes differs from one by the order of σ².

In the axes of C's part of the shapes, ``C + Σ`` of all shapes is diagonal where their prediction
errors are independent, and only frequencies need a factorisation at each row of a batch. Where
tests share the errors of their shapes, all of ``C + Σ`` is factorised at each row, whose model
shapes say how the tests' planes are turned into common ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray, row_sums
from bayes_ssi.inference.likelihood.error_groups import (
    ErrorGroups,
    ErrorSizes,
    conditional_errors,
    log_density,
    many_conditional_errors,
)
from bayes_ssi.inference.likelihood.shape_planes import in_common_plane, tangents, turned
from bayes_ssi.measurements.modes.joint_covariance import plane_bases
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import SOLVER


class WhiteErrors(NamedTuple):
    """Errors as independent normal numbers with variances, for a batch of B.

    Attributes:
        frequencies: (B, P), each given all shapes and the frequencies before it.
        frequency_var: (B or 1, P).
        shapes: (B, K), along the axes of the shapes' covariance.
        shape_var: (B or 1, K).
        shape_squares: (B, S), squared lengths of the errors of shapes.
    """

    frequencies: FloatArray
    frequency_var: FloatArray
    shapes: FloatArray
    shape_var: FloatArray
    shape_squares: FloatArray

    @property
    def numbers(self) -> FloatArray:
        """Standard-normal numbers (B, P + K)."""
        frequencies = self.frequencies / np.sqrt(self.frequency_var)
        return np.concatenate([frequencies, self.shapes / np.sqrt(self.shape_var)], axis=1)


@dataclass(frozen=True, eq=False)
class ShapeAxes:
    """The covariance of the identification errors of S shapes and P frequencies of one test.

    Attributes:
        variances: (K,), of the errors of all shapes along the axes of their covariance.
        axes: (S, n, K), their components at n sensors.
        between: (K, P), covariance of the errors along the axes with those of frequencies.
    """

    variances: FloatArray
    axes: FloatArray
    between: FloatArray

    @classmethod
    def of(cls, data: ModalData, labels: Sequence[str]) -> ShapeAxes:
        """Those of the modes with these labels."""
        m, n = len(data.modes), len(data.sensors)
        covariance = identification_covariance(data)
        places = [data.labels.index(label) for label in labels]
        scored = [i for i in places if data.modes[i].scored_shape is not None]
        rows = [m + n * i + k for i in scored for k in range(n)]
        bases = plane_bases([data.modes[i] for i in scored], n)
        basis = block_diag(*bases) if bases else np.zeros((0, 0))
        variances, turn = np.linalg.eigh(basis.T @ covariance[np.ix_(rows, rows)] @ basis)
        axes = basis @ turn
        return cls(
            np.maximum(variances, 0.0),  # by rounding below zero
            axes.reshape(len(scored), n, len(variances)),
            axes.T @ covariance[np.ix_(rows, places)],
        )

    @classmethod
    def joined(
        cls, tests: Sequence[ShapeAxes], columns: Sequence[NDArray[np.intp]], n: int
    ) -> ShapeAxes:
        """Those of several tests, whose sensors are ``columns`` of n."""
        variances = np.concatenate([test.variances for test in tests])
        axes = np.zeros((sum(len(test.axes) for test in tests), n, len(variances)))
        shape = axis = 0
        for test, sensors in zip(tests, columns, strict=True):
            end, last = shape + len(test.axes), axis + len(test.variances)
            axes[shape:end, sensors, axis:last] = test.axes
            shape, axis = end, last
        return cls(
            variances,
            axes,
            block_diag(*(test.between for test in tests)),
        )

    def least_variances(self, of_frequencies: FloatArray) -> FloatArray:
        """Least variances (P,) of frequencies, whose covariance is (P, P), given the shapes."""
        known = self.variances > SOLVER.rounding * self.variances.max(initial=0.0)
        gain = self.between[known] / self.variances[known, None]
        given_shapes = of_frequencies - self.between[known].T @ gain
        return np.maximum(np.linalg.eigvalsh(given_shapes), 0.0)


def identification_covariance(data: ModalData) -> FloatArray:
    """That of the logarithms of m frequencies and of m unit shapes at n sensors, (m + m n, ...)."""
    if data.covariance is not None:
        return data.covariance
    frequencies = [mode.frequency_cov or 0.0 for mode in data.modes]
    shapes = np.repeat([mode.shape_sd or 0.0 for mode in data.modes], len(data.sensors))
    return np.diag(np.concatenate([frequencies, shapes]) ** 2)


@dataclass(frozen=True, eq=False)
class JointErrors:
    """The errors of P frequencies and S shapes that are correlated with one another.

    Attributes:
        frequencies: the frequencies, one group.
        shapes: positions (S,) of the shapes.
        identified: (S, n), the identified shapes at unit length, at all sensors.
        single_var: (S,), of identification errors of a component, the mean over its directions.
        dimensions: (S,), directions in which each shape can err.
        repeated: groups of all shapes, those of one mode in several tests in one; none where no
            test repeats the error of another.
    """

    frequencies: ErrorGroups
    shapes: list[int]
    axes: ShapeAxes
    identified: FloatArray
    single_var: FloatArray
    dimensions: FloatArray
    repeated: Sequence[Sequence[int]] = ()

    @property
    def largest_array(self) -> int:
        """Size of the largest array for a row of a batch that no other row shares."""
        size = len(self.axes.variances) + self.frequencies.members.shape[1]
        return size**2 if self.repeated else size

    def white(
        self, residuals: FloatArray, shapes: FloatArray, sizes: tuple[ErrorSizes, ErrorSizes]
    ) -> WhiteErrors:
        """The errors without correlation.

        Args:
            residuals: (B, P), of frequencies.
            shapes: (B, S, n), model shapes at unit length, with the signs of the identified ones.
            sizes: prediction errors of frequencies and of shapes.
        """
        covariance = self.frequencies.covariance(sizes[0])[:, 0]
        errors = tangents(self.identified, shapes)
        # Products of single rows: how they are added up must not depend on the batch.
        s, n, k = self.axes.axes.shape
        along = (errors.reshape(len(errors), 1, s * n) @ self.axes.axes.reshape(s * n, k))[:, 0]
        squares = (errors * errors).sum(axis=2)
        if self.repeated:
            of_all = self._all_at_once(residuals, covariance, along, shapes, sizes[1])
            return WhiteErrors(*of_all, squares)
        variances = self.axes.variances + sizes[1].variance[:, None]
        gain = self.axes.between.T / variances[:, None]
        rest = residuals[:, :, None] - gain @ along[:, :, None]
        given_shapes = covariance - gain @ self.axes.between
        frequency_var, frequencies = conditional_errors(given_shapes, rest)
        return WhiteErrors(frequencies[:, :, 0], frequency_var, along, variances, squares)

    def _all_at_once(
        self,
        residuals: FloatArray,
        of_frequencies: FloatArray,
        along: FloatArray,
        shapes: FloatArray,
        sizes: ErrorSizes,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The errors without correlation, where shapes of several tests err together."""
        n = along.shape[1]
        variance, rho = sizes.variance[:, None], sizes.between_tests[:, None]
        covariance = np.zeros((len(along), n + residuals.shape[1], n + residuals.shape[1]))
        covariance[:, :n, :n] = (variance * rho)[:, :, None] * self._alike(shapes)
        i = np.arange(n)
        covariance[:, i, i] += self.axes.variances + variance * (1.0 - rho)
        covariance[:, n:, :n] = self.axes.between.T
        covariance[:, n:, n:] = of_frequencies
        both = np.concatenate([along, residuals], axis=1)
        variances, white = many_conditional_errors(covariance, both)
        return white[:, n:], variances[:, n:], white[:, :n], variances[:, :n]

    def _alike(self, shapes: FloatArray) -> FloatArray:
        """Correlations (B, K, K) of errors along the axes, if those of a mode are all the same."""
        n = shapes.shape[2]
        vectors = []
        for members in self.repeated:
            of_tests = shapes[:, None, members]
            at_model = turned(np.eye(n)[:, None], self.identified[members], of_tests)
            rotations = in_common_plane(at_model, of_tests).transpose(0, 2, 1, 3)  # (B, m, n, n)
            axes = self.axes.axes[members].transpose(0, 2, 1)
            vectors.append(row_sums(axes @ rotations))
        joined = np.concatenate(vectors, axis=2)
        return joined @ joined.transpose(0, 2, 1)

    def log_ratio(
        self, residuals: FloatArray, shapes: FloatArray, sizes: tuple[ErrorSizes, ErrorSizes]
    ) -> FloatArray:
        """Log of the joint density over the product of single ones, (B,); as :meth:`white`."""
        white = self.white(residuals, shapes, sizes)
        joint = log_density(white.frequencies**2, white.frequency_var)
        joint += log_density(white.shapes**2, white.shape_var)
        single = log_density(residuals**2, self.frequencies.variances(sizes[0])[:, 0])
        of_shapes = self.single_var + sizes[1].variance[:, None]
        single += log_density(white.shape_squares, of_shapes, self.dimensions)
        return joint - single
