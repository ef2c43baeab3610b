"""Groups of correlated normal errors, as arrays of one shape for a whole batch.

A batch has B rows of parameter values. What no parameter enters has one row, for all of them. How
sums are added up does not depend on B, so that a row gets the same last digit in any batch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    # Difference of their numbers; infinite for modes of different tests that are not correlated.
    modes: FloatArray

    @classmethod
    def of(
        cls, first: Sequence[ModeOfTest], second: Sequence[ModeOfTest], by_label: bool
    ) -> Separation:
        """Separation (n, m) of modes; in different tests by label alone, or by number."""
        shape = len(first), len(second)
        tests = np.array([[float(a.test != b.test) for b in second] for a in first])
        modes = np.array([[_distance(a, b, by_label) for b in second] for a in first])
        return cls(tests.reshape(shape), modes.reshape(shape))

    def within(self, members: NDArray[np.intp]) -> Separation:
        """Separation (G, n, n) within groups (G, n) of the modes."""
        pairs = members[:, :, None], members[:, None, :]
        return Separation(self.tests[pairs], self.modes[pairs])

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """σ² ρ_tests^[t ≠ s] ρ_modes^|i - j|, (B or 1, ...)."""
        variance, tests, modes = (size.reshape(-1, *(1,) * self.tests.ndim) for size in sizes)
        return variance * (tests**self.tests * modes**self.modes)


def _distance(a: ModeOfTest, b: ModeOfTest, by_label: bool) -> float:
    if by_label and a.test != b.test:
        return 0.0 if a.label == b.label else np.inf
    return abs(a.number - b.number)


@dataclass(frozen=True, eq=False)
class ErrorGroups:
    """G groups of n errors, which are correlated within their group."""

    groups: list[int]  # (G,), indices of the groups among all
    members: NDArray[np.intp]  # (G, n), positions of the errors
    identification: FloatArray  # (G, n, n), covariance of their identification errors
    separation: Separation  # (G, n, n) each, for prediction errors
    dimensions: FloatArray | float = 1.0  # (G, 1), of each error: a number or a vector in a plane

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """Covariance (B or 1, G, n, n) of the errors, whose components are independent."""
        covariance: FloatArray = self.identification + self.separation.covariance(sizes)
        return covariance

    def variances(self, sizes: ErrorSizes) -> FloatArray:
        """Variances (B or 1, G, n) of single errors."""
        single = np.einsum("gii->gi", self.identification)
        variances: FloatArray = single + sizes.variance[:, None, None]
        return variances

    def log_ratios(self, errors: FloatArray, sizes: ErrorSizes) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B, G).

        ``errors`` (B, G, n, k) have k components, of which only as many vary as there are
        dimensions.
        """
        joint, single = (
            log_density((residuals * residuals).sum(axis=-1), variances, self.dimensions)
            for variances, residuals in (
                conditional_errors(self.covariance(sizes), errors),
                (self.variances(sizes), errors),
            )
        )
        return joint - single


def stacked(groups: Mapping[int, Sequence[int]]) -> Iterator[tuple[list[int], NDArray[np.intp]]]:
    """Indices (G,) and members (G, n) of groups by their index, those of equal size together."""
    for n in sorted(set(map(len, groups.values()))):
        same = [i for i, members in groups.items() if len(members) == n]
        yield same, np.array([groups[i] for i in same], dtype=np.intp)


def log_density(
    squares: FloatArray, variances: FloatArray, dimensions: FloatArray | float = 1.0
) -> FloatArray:
    """Log density (B, ...) of independent errors at squared lengths (B, ..., n), but for constants.

    -inf where a variance is not positive.
    """
    terms = squares / variances + dimensions * np.log(variances)
    regular = (variances > 0.0).all(axis=-1)
    return np.where(regular, -0.5 * row_sums(np.moveaxis(terms, -1, 1)), -np.inf)


def conditional_errors(covariance: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances (..., n) and errors (..., n, k), of n errors each given those before it."""
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
