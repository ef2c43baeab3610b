"""Groups of correlated normal errors, for a whole batch.

A batch has B rows of parameter values. What no parameter enters has one row, for all of them. How
sums are added up does not depend on B, so that a row gets the same last digit in any batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, row_sums


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


class Separation(NamedTuple):
    """How far apart modes are: in different tests or in the same one, and in their numbers."""

    tests: FloatArray
    # Difference of their numbers; zero for modes of one label, and one at least for all others.
    modes: FloatArray

    @classmethod
    def of(cls, modes: Sequence[ModeOfTest]) -> Separation:
        """Separation (n, n) of modes from one another."""
        tests, labels, numbers = (np.array([mode[i] for mode in modes]) for i in range(3))
        apart = np.maximum(np.abs(numbers[:, None] - numbers), 1.0)
        same_label = labels[:, None] == labels
        return cls((tests[:, None] != tests).astype(float), np.where(same_label, 0.0, apart))

    def within(self, members: Sequence[int]) -> Separation:
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
        covariance: FloatArray = self.identification + self.separation.covariance(sizes)
        return covariance

    def variances(self, sizes: ErrorSizes) -> FloatArray:
        """Variances (B or 1, n) of single errors."""
        variances: FloatArray = self.identification.diagonal() + sizes.variance[:, None]
        return variances

    def log_ratio(self, errors: FloatArray, sizes: ErrorSizes) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B,).

        ``errors`` (B, n, k) have k components, of which only as many vary as there are dimensions.
        """
        joint, single = (
            log_density((residuals * residuals).sum(axis=-1), variances, self.dimensions)
            for variances, residuals in (
                conditional_errors(self.covariance(sizes), errors),
                (self.variances(sizes), errors),
            )
        )
        return joint - single


def log_density(
    squares: FloatArray, variances: FloatArray, dimensions: FloatArray | float = 1.0
) -> FloatArray:
    """Log density (B,) of independent errors at squared lengths (B, n), but for constants.

    -inf where a variance is not positive.
    """
    terms = squares / variances + dimensions * np.log(variances)
    regular = (variances > 0.0).all(axis=-1)
    return np.where(regular, -0.5 * row_sums(terms), -np.inf)


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
