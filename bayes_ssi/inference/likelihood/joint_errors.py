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

A batch has B rows of parameter values; what no parameter enters has one row, for all of them. How
sums are added up does not depend on B, so that a row gets the same last digit in any batch.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from bayes_ssi.foundations.arrays import FloatArray, IntArray, row_sums
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import ROUNDING


class ModeOfTest(NamedTuple):
    """A model mode in one test: index of the test, label, and number of the mode from 1."""

    test: int
    label: str
    number: int


class ErrorSizes(NamedTuple):
    """Variance and correlations of prediction errors, (B,), or (1,) for one that is fixed."""

    variance: FloatArray
    between_tests: FloatArray
    between_modes: FloatArray

    @classmethod
    def independent(cls, variance: FloatArray) -> "ErrorSizes":
        return cls(variance, *np.zeros((2, len(variance))))


class Separation(NamedTuple):
    """How far apart modes are: in different tests or in the same one, and in their numbers."""

    tests: FloatArray
    # Difference of their numbers; zero for modes of one label, and one at least for all others.
    modes: FloatArray

    @classmethod
    def of(cls, modes: Sequence[ModeOfTest]) -> "Separation":
        """Separation (n, n) of modes from one another."""
        tests, labels, numbers = (np.array([mode[i] for mode in modes]) for i in range(3))
        apart = np.maximum(np.abs(numbers[:, None] - numbers), 1.0)
        same_label = labels[:, None] == labels
        return cls((tests[:, None] != tests).astype(float), np.where(same_label, 0.0, apart))

    def within(self, members: Sequence[int]) -> "Separation":
        """Separation (m, m) of some of the modes."""
        pairs = np.ix_(members, members)
        return Separation(self.tests[pairs], self.modes[pairs])

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """σ² ρ_tests^[t ≠ s] ρ_modes^|i - j|, (B or 1, n, n)."""
        variance, tests, modes = (size[:, None, None] for size in sizes)
        return variance * (tests**self.tests * modes**self.modes)


@dataclass(frozen=True, eq=False)
class ErrorGroup:
    """n errors that are correlated with one another."""

    members: Sequence[int]  # (n,), positions of the errors among all
    identification: FloatArray  # (n, n), covariance of their identification errors
    separation: Separation  # (n, n) each, for prediction errors
    dimensions: float = 1.0  # of each error: a number or a vector in a plane

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """Covariance (B or 1, n, n) of the errors, whose components are independent."""
        return self.identification + self.separation.covariance(sizes)

    def variances(self, sizes: ErrorSizes) -> FloatArray:
        """Variances (B or 1, n) of single errors."""
        return self.identification.diagonal() + sizes.variance[:, None]

    def log_ratio(self, errors: FloatArray, sizes: ErrorSizes) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B,).

        ``errors`` (B, n, k) have k components, of which only as many vary as there are dimensions.
        """
        parts = conditional_errors(self.covariance(sizes), errors), (self.variances(sizes), errors)
        joint, single = (
            log_density((residuals * residuals).sum(axis=-1), variances, self.dimensions)
            for variances, residuals in parts
        )
        return joint - single


def log_density(
    squares: FloatArray, variances: FloatArray, dimensions: FloatArray | float = 1.0
) -> FloatArray:
    """Log density (B,) of independent errors at squared lengths (B, n), but for constants.

    -inf where a variance is not positive.
    """
    terms = squares / variances + dimensions * np.log(variances)
    return np.where((variances > 0.0).all(axis=-1), -0.5 * row_sums(terms), -np.inf)


def conditional_errors(covariance: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances (B or 1, n) and errors (B, n, k), of n errors each given those before it."""
    covariance, errors = covariance.copy(), errors.copy()
    for i in range(covariance.shape[-1] - 1):
        row = covariance[..., i, i + 1 :]
        gain = (row / covariance[..., i, i, None])[..., None]
        errors[..., i + 1 :, :] -= gain * errors[..., i, None, :]
        covariance[..., i + 1 :, i + 1 :] -= gain * row[..., None, :]
    return np.einsum("...ii->...i", covariance), errors


def many_conditional_errors(
    covariance: FloatArray, errors: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Variances and errors (B, n), of n errors each given those before it; n may be a hundred.

    NaN where the covariance (B, n, n) is singular.
    """
    n = errors.shape[1]
    # The last row of the Cholesky factor of a covariance with the errors below it.
    bordered = np.zeros((len(errors), n + 1, n + 1))
    bordered[:, :n, :n] = covariance
    bordered[:, n, :n] = errors
    bordered[:, n, n] = np.finfo(float).max
    factors = _cholesky(bordered)
    roots = np.einsum("bii->bi", factors)[:, :n]
    return roots * roots, factors[:, n, :n] * roots


def _cholesky(matrices: FloatArray) -> FloatArray:
    """Cholesky factors (B, n, n); NaN where a matrix is not positive definite."""
    try:
        return np.asarray(np.linalg.cholesky(matrices), dtype=float)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full(matrices.shape, np.nan)
    middle = len(matrices) // 2
    return np.concatenate([_cholesky(matrices[:middle]), _cholesky(matrices[middle:])])


class WhiteErrors(NamedTuple):
    """Errors as independent normal numbers with variances, for a batch of B."""

    frequencies: FloatArray  # (B, P), each given all shapes and the frequencies before it
    frequency_var: FloatArray  # (B or 1, P)
    shapes: FloatArray  # (B, K), along the axes of the shapes' covariance
    shape_var: FloatArray  # (B or 1, K)
    shape_squares: FloatArray  # (B, S), squared lengths of the errors of shapes

    @property
    def numbers(self) -> FloatArray:
        """Standard-normal numbers (B, P + K)."""
        frequencies = self.frequencies / np.sqrt(self.frequency_var)
        return np.concatenate([frequencies, self.shapes / np.sqrt(self.shape_var)], axis=1)


@dataclass(frozen=True, eq=False)
class JointErrors:
    """The errors of P frequencies and S shapes that are correlated with one another."""

    frequencies: ErrorGroup
    shapes: Sequence[int]  # (S,), which ones of all
    # (K,), of the identification errors of shapes along the axes of their covariance.
    variances: FloatArray
    axes: FloatArray  # (S, n, K), their components at n sensors
    between: FloatArray  # (K, P), covariance of the errors along the axes with those of frequencies
    identified: FloatArray  # (S, n), the identified shapes at unit length
    # (S,), of identification errors of a component, the mean over its directions.
    single_var: FloatArray
    dimensions: FloatArray  # (S,), directions in which each shape can err
    # Groups of shapes, one of a mode in all tests; none where no test repeats another's error.
    repeated: Sequence[Sequence[int]] = ()

    @classmethod
    def of(
        cls,
        covariance: FloatArray,
        pairs: PairedModes,
        frequencies: ErrorGroup,
        shapes: Sequence[int],
        repeated: Sequence[Sequence[int]] = (),
    ) -> "JointErrors":
        """The errors of some frequencies and shapes of pairs with an identification covariance."""
        unit, seen = pairs.unit_shapes.T[shapes], pairs.measured.T[shapes]
        s, n = unit.shape
        first = len(pairs.modes) + n * np.array(shapes, dtype=np.intp)
        rows = (first[:, None] + np.arange(n)).ravel()
        planes = seen[:, :, None] * np.eye(n) - unit[:, :, None] * unit[:, None]
        # Directions at right angles to each shape: the eigenvalues of projections are zero or one.
        bases = [vectors[:, values > 0.5] for values, vectors in map(np.linalg.eigh, planes)]
        basis = block_diag(*bases) if s else np.zeros((0, 0))
        variances, turn = np.linalg.eigh(basis.T @ covariance[np.ix_(rows, rows)] @ basis)
        axes = basis @ turn
        return cls(
            frequencies,
            shapes,
            np.maximum(variances, 0.0),  # by rounding below zero
            axes.reshape(s, n, len(variances)),
            axes.T @ covariance[np.ix_(rows, frequencies.members)],
            unit,
            pairs.shape_var[shapes],
            np.array(pairs.n_measured)[shapes] - 1.0,
            repeated,
        )

    @property
    def least_variances(self) -> tuple[FloatArray, FloatArray]:
        """Variances of frequencies and of shapes in the directions that the data determine best.

        Those of frequencies (P,) are conditional on shapes.
        """
        known = self.variances > ROUNDING * self.variances.max(initial=0.0)
        gain = self.between[known] / self.variances[known, None]
        given_shapes = self.frequencies.identification - self.between[known].T @ gain
        return np.maximum(np.linalg.eigvalsh(given_shapes), 0.0), self.variances

    @property
    def largest_array(self) -> int:
        """Size of the largest array for a row of a batch that no other row shares."""
        size = len(self.variances) + len(self.frequencies.members)
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
        covariance = self.frequencies.covariance(sizes[0])
        errors = tangents(self.identified, shapes)
        # Products of single rows: how they are added up must not depend on the batch.
        s, n, k = self.axes.shape
        along = (errors.reshape(len(errors), 1, s * n) @ self.axes.reshape(s * n, k))[:, 0]
        squares = (errors * errors).sum(axis=2)
        if self.repeated:
            of_all = self._all_at_once(residuals, covariance, along, shapes, sizes[1])
            return WhiteErrors(*of_all, squares)
        variances = self.variances + sizes[1].variance[:, None]
        gain = self.between.T / variances[:, None]
        rest = residuals[:, :, None] - gain @ along[:, :, None]
        given_shapes = covariance - gain @ self.between
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
        covariance[:, i, i] += self.variances + variance * (1.0 - rho)
        covariance[:, n:, :n] = self.between.T
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
            vectors.append(row_sums(self.axes[members].transpose(0, 2, 1) @ rotations))
        joined = np.concatenate(vectors, axis=2)
        return joined @ joined.transpose(0, 2, 1)

    def log_ratio(
        self, residuals: FloatArray, shapes: FloatArray, sizes: tuple[ErrorSizes, ErrorSizes]
    ) -> FloatArray:
        """Log of the joint density over the product of single ones, (B,); as :meth:`white`."""
        white = self.white(residuals, shapes, sizes)
        joint = log_density(white.frequencies**2, white.frequency_var)
        single = log_density(residuals**2, self.frequencies.variances(sizes[0]))
        joint += log_density(white.shapes**2, white.shape_var)
        of_shapes = self.single_var + sizes[1].variance[:, None]
        single += log_density(white.shape_squares, of_shapes, self.dimensions)
        return joint - single


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

    def ratios_of_shapes(
        self, columns: IntArray, hz: FloatArray, shapes: FloatArray, variances: FloatArray
    ) -> FloatArray:
        """The log ratios (E,) of pairs one by one: of shapes ``columns`` (E,) among those scored.

        Model frequencies in ``hz`` (E,) and unit ``shapes`` (E, s) may be others than those of the
        batch; ``variances`` (E, 2) are squared prediction errors.
        """
        ratios, which = np.zeros(len(columns)), self.pairs.with_shape[columns]
        residuals = hz / self.pairs.frequencies_hz[which] - 1.0
        own = variances + np.outer(self.pairs.model_shape_var[columns], [0.0, 1.0])
        for errors, pairs in self._modes.values():
            members = np.flatnonzero(np.isin(which, pairs))
            frequency, shape = map(ErrorSizes.independent, own[members].T)
            of_mode = residuals[members, None], shapes[members, None]
            ratios[members] = errors.log_ratio(*of_mode, (frequency, shape))
        return ratios

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
            sums = map(row_sums, (squares, of_shapes, of_shapes**2))
            parts.append([each.reshape(n, -1) for each in (white.numbers[:, 0], *sums)])
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
            of_shapes, own = repeated[:, -1], self.pairs.model_shape_var[scored]
            if own.any():
                of_shapes = of_shapes + np.tile(own, n)
            frequency, shape = map(ErrorSizes.independent, (repeated[:, 0], of_shapes))
            yield errors, (frequencies[:, pairs].reshape(-1, 1), unit, (frequency, shape))

    @cached_property
    def _modes(self) -> dict[str, tuple[JointErrors, list[int]]]:
        """The errors of each identified mode, and its pairs."""
        labels = [mode.label for mode in self.pairs.modes]
        return {
            label: (self._errors((label,)), [i for i, other in enumerate(labels) if other == label])
            for label in dict.fromkeys(labels)
        }

    def _errors(self, labels: Sequence[str]) -> JointErrors:
        """The errors of some identified modes; of several, their prediction errors are not used."""
        pairs = PairedModes.of(self.data, [(label, 1) for label in labels])
        covariance, n = pairs.identification_covariance(self.data), len(labels)
        same = Separation(np.zeros((n, n)), np.zeros((n, n)))
        frequencies = ErrorGroup(range(n), covariance[:n, :n], same)
        return JointErrors.of(covariance, pairs, frequencies, range(len(pairs.with_shape)))


def tangents(at: FloatArray, towards: FloatArray) -> FloatArray:
    """Vectors (..., n) at right angles to a unit shape, towards another and r_φ long.

    The shapes (..., n) have signs that match, r_φ is the distance between them.
    """
    cosine = (at * towards).sum(axis=-1, keepdims=True)
    # What is at right angles is sin t long, and r_φ is 2 sin(t/2).
    return (towards - cosine * at) / np.sqrt(0.5 * (1.0 + cosine))


def turned(vectors: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Vectors (..., n) after the rotation that turns one unit shape into another.

    They are at right angles to ``start`` and come to be so to ``end``.
    """
    along = (vectors * end).sum(axis=-1, keepdims=True)
    cosine = (start * end).sum(axis=-1, keepdims=True)
    return vectors - along / (1.0 + cosine) * (start + end)


def in_common_plane(vectors: FloatArray, shapes: FloatArray) -> FloatArray:
    """Vectors (..., m, n) in the planes at m unit shapes, turned into the one at their mean."""
    sign = np.where((shapes * shapes[..., :1, :]).sum(axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    shapes = shapes * sign
    mean = shapes.sum(axis=-2, keepdims=True)
    length = np.sqrt((mean * mean).sum(axis=-1, keepdims=True))
    mean /= np.where(length == 0.0, 1.0, length)  # no sensor sees the mode in any test
    return turned(vectors * sign, shapes, mean)
