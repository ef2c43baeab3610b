"""Bends: coordinates of a mixture's component that follow a curved ridge.

Whitened coordinates w of a component become v by w_j = v_j + P_j(v_1, …, v_{j-1}) with polynomials
P_j: a triangular map whose Jacobian is 1, so that a density of v is one of w. With the widest
direction first, the thin ones follow the curve or sheet that the wide ones span. The polynomials
may be of the first few coordinates alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.settings import MIXTURES


@dataclass(frozen=True, eq=False)
class Bend:
    """The polynomials of one component, or of several (...) of equal degree."""

    # (..., d, F), of all monomials of d - 1 variables, or fewer; row j has those of the first j.
    coefficients: FloatArray
    degree: int
    reach: FloatArray

    @cached_property
    def n_variables(self) -> int:
        n_monomials_of = (n_monomials(m, self.degree) for m in range(self.coefficients.shape[-2]))
        return list(n_monomials_of).index(self.coefficients.shape[-1])

    @staticmethod
    def stacked(bends: Sequence[Bend]) -> Bend:
        """Several bends of equal degree as one."""
        return Bend(
            np.stack([bend.coefficients for bend in bends]),
            bends[0].degree,
            np.stack([bend.reach for bend in bends]),
        )

    def straightened(self, w: FloatArray) -> FloatArray:
        """Coordinates v (..., d, n) of w (..., d, n)."""
        v = w.copy()
        for j, polynomial in self._polynomials(v):
            v[..., j, :] -= polynomial
        return v

    def bent(self, v: FloatArray) -> FloatArray:
        """Coordinates w (..., d, n) of v (..., d, n)."""
        w = v.copy()
        for j, polynomial in self._polynomials(v):
            w[..., j, :] += polynomial
        return w

    def widened(self, factor: float) -> Bend:
        """The bend of the same ridge for a component ``factor`` times as wide."""
        degrees = _degrees(self.n_variables, self.degree)
        coefficients = self.coefficients * factor ** (degrees - 1.0)
        return replace(self, coefficients=coefficients, reach=self.reach / factor)

    def _polynomials(self, v: FloatArray) -> Iterator[tuple[int, FloatArray]]:
        """Each j and P_j (..., n) of the coordinates of v before it, as they then are."""
        terms = np.ones((*v.shape[:-2], 1, v.shape[-1]))
        for j in range(1, v.shape[-2]):
            if j <= self.n_variables:
                variable = np.clip(v[..., j - 1, :], -self.reach, self.reach)
                terms = _with_variable(terms, variable, j - 1, self.degree)
            row = self.coefficients[..., j, None, : terms.shape[-2]]
            if row.any():
                yield j, (row @ terms)[..., 0, :]


def fit_bend(
    u: FloatArray, weights: FloatArray, total: float, degree: int, floors: FloatArray
) -> tuple[Bend, FloatArray]:
    """Polynomials by weighted least squares, one coordinate after the other.

    Args:
        u: (d, n), draws in whitened coordinates of a straight component, the widest first.
        weights: (n,), of the draws.
        floors: (d,), least variances.

    Returns:
        The bend, and the width (d,) of each coordinate about its polynomial: w = u / widths.
    """
    d, reach = len(u), MIXTURES.bend_reach
    widths = np.ones(d)
    coefficients = np.zeros((d, n_monomials(d - 1, degree)))
    v = u[0]
    terms = np.ones((1, u.shape[1]))
    for j in range(1, d):
        terms = _with_variable(terms, np.clip(v, -reach, reach), j - 1, degree)
        weighted = terms * weights
        # Of monomials that the draws hardly distinguish the least coefficients will do.
        fitted = np.linalg.lstsq(weighted @ terms.T, weighted @ u[j], rcond=1e-9)[0]
        residuals = u[j] - fitted @ terms
        widths[j] = math.sqrt(float(weights @ residuals**2) / total + floors[j])
        coefficients[j, : len(terms)] = fitted / widths[j]
        v = residuals / widths[j]
    return Bend(coefficients, degree, np.full(1, reach)), widths


def bend_along(
    wide: FloatArray, thin: FloatArray, weights: FloatArray, degree: int
) -> tuple[Bend, FloatArray]:
    """Thin coordinates as polynomials of wide ones, by weighted least squares.

    Args:
        wide: (m, n), whitened coordinates of points on a ridge, at most ``bend_reach``.
        thin: (k, n), coordinates of these points, in standard deviations across the ridge.
        weights: (n,), at most one.

    Returns:
        The bend of all coordinates, the wide ones first, and the width (m + k,) of each: one, but
        for what the polynomials leave.
    """
    terms = np.ones((1, wide.shape[1]))
    for j, variable in enumerate(wide):
        terms = _with_variable(terms, variable, j, degree)
    weighted = terms * weights
    gram = weighted @ terms.T
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-9
    fitted = np.linalg.solve(gram, weighted @ thin.T).T
    n, n_fitted = float(weights.sum()), len(terms)
    # What is left of points that the fit has not seen, as it would be of noise.
    unseen = (n + n_fitted) / max(n - n_fitted, 1.0)
    left = unseen * ((thin - fitted @ terms) ** 2 @ weights) / n
    widths = np.concatenate([np.ones(len(wide)), np.sqrt(1.0 + left)])
    coefficients = np.concatenate([np.zeros((len(wide), n_fitted)), fitted])
    bend = Bend(coefficients / widths[:, None], degree, np.full(1, MIXTURES.bend_reach))
    return bend, widths


def n_monomials(n_variables: int, degree: int) -> int:
    """How many monomials of so many variables there are up to a degree, the constant included."""
    return math.comb(n_variables + degree, degree)


def _with_variable(
    terms: FloatArray, variable: FloatArray, n_variables: int, degree: int
) -> FloatArray:
    """Monomials of ``n_variables`` (..., F, n), and then those with one more variable (..., n)."""
    degrees = _degrees(n_variables, degree)
    parts, power = [terms], np.ones_like(variable)
    for exponent in range(1, degree + 1):
        power = power * variable
        parts.append(terms[..., degrees <= degree - exponent, :] * power[..., None, :])
    return np.concatenate(parts, axis=-2)


@cache
def _degrees(n_variables: int, degree: int) -> NDArray[np.intp]:
    """The degree (F,) of every monomial, in their order."""
    degrees = np.zeros(1, dtype=np.intp)
    for _ in range(n_variables):
        more = [
            degrees[degrees <= degree - exponent] + exponent for exponent in range(1, degree + 1)
        ]
        degrees = np.concatenate([degrees, *more])
    return degrees
