"""Where a model fails: regions of its parameters, by logistic regression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bayes_ssi.foundations.arrays import FloatArray

# Prior precision of the coefficients: boundaries between two points become sharp, not infinitely.
PRECISION = 1e-3


@dataclass(frozen=True, eq=False)
class FailingPoints:
    """The probability that a model fails, from the points at which it did and did not.

    The logarithm of the odds is a polynomial of second degree, whose boundary is a plane, an
    ellipsoid or a hyperboloid.

    Attributes:
        x: (F, d), coordinates where the model failed.
        values: (F, d), the parameters' values there.
        coefficients: of the polynomial; None where it never failed.
        succeeded: (N, d), coordinates where it did not fail.
    """

    x: FloatArray
    values: FloatArray
    coefficients: FloatArray | None
    succeeded: FloatArray

    @classmethod
    def fitted(cls, failed: FloatArray, values: FloatArray, succeeded: FloatArray) -> FailingPoints:
        """Fit to points (F, d), with their values, and (N, d) where the model did not fail."""
        if not len(failed):
            return cls(failed, values, None, succeeded)
        from scipy.optimize import minimize  # takes long to import

        terms = _terms(np.vstack([failed, succeeded]))
        signs = np.repeat([1.0, -1.0], [len(failed), len(succeeded)])

        def cost(c: FloatArray) -> tuple[float, FloatArray]:
            margins = signs * (terms @ c)
            value = np.logaddexp(0.0, -margins).sum() + 0.5 * PRECISION * c @ c
            return float(value), PRECISION * c - terms.T @ (signs * expit(-margins))

        found = minimize(cost, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B")
        return cls(failed, values, found.x, succeeded)

    def expected(self, x: FloatArray) -> NDArray[np.bool_]:
        """Whether the model fails (B,) at ``x`` (B, d): by the odds, and at the nearest point."""
        if self.coefficients is None:
            return np.zeros(len(x), dtype=bool)
        return self._by_odds(x) & self._by_nearest(x)

    def is_open(self, x: FloatArray) -> NDArray[np.bool_]:
        """Whether the odds and the nearest point (B,) disagree at ``x`` (B, d)."""
        if self.coefficients is None:
            return np.zeros(len(x), dtype=bool)
        return self._by_odds(x) != self._by_nearest(x)

    def _by_odds(self, x: FloatArray) -> NDArray[np.bool_]:
        assert self.coefficients is not None
        return np.asarray(np.einsum("bp,p->b", _terms(x), self.coefficients) > 0.0)

    def _by_nearest(self, x: FloatArray) -> NDArray[np.bool_]:
        to_failed, to_succeeded = (
            ((x[:, None] - each) ** 2).sum(axis=2).min(axis=1) for each in (self.x, self.succeeded)
        )
        return np.asarray(to_failed < to_succeeded)

    def nearest(self, x: FloatArray) -> NDArray[np.intp]:
        """The point that failed nearest to each of ``x`` (B, d), as a row of ``values``."""
        away = ((x[:, None] - self.x) ** 2).sum(axis=2)
        return np.asarray(away.argmin(axis=1), dtype=np.intp)


def _terms(x: FloatArray) -> FloatArray:
    first, second = np.triu_indices(x.shape[1])
    return np.column_stack([np.ones(len(x)), x, x[:, first] * x[:, second]])
