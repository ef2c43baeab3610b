"""Bends: coordinates of a mixture's component that follow a curved ridge.

The first, wide whitened coordinates w of a component stay as they are, and the thin ones become
w_j = v_j + P_j(v_1, …, v_m) with polynomials P_j of the wide ones: a map whose Jacobian is 1, so
that a density of v is one of w.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.settings import RIDGES


@dataclass(frozen=True, eq=False)
class Bend:
    """The polynomials of one component's thin coordinates."""

    coefficients: FloatArray  # (d - m, F), of all monomials of the wide coordinates
    n_wide: int  # m
    degree: int
    reach: float = RIDGES.reach  # of the variables; beyond, polynomials are constant

    def straightened(self, w: FloatArray) -> FloatArray:
        """Coordinates v (d, n) of w (d, n)."""
        return self._shifted(w, -1.0)

    def bent(self, v: FloatArray) -> FloatArray:
        """Coordinates w (d, n) of v (d, n)."""
        return self._shifted(v, 1.0)

    def widened(self, factor: float) -> Bend:
        """The bend of the same ridge for a component ``factor`` times as wide."""
        _, degrees = monomials(np.zeros((self.n_wide, 1)), self.degree)
        coefficients = self.coefficients * factor ** (degrees - 1.0)
        return replace(self, coefficients=coefficients, reach=self.reach / factor)

    def _shifted(self, w: FloatArray, sign: float) -> FloatArray:
        wide, thin = w[: self.n_wide], w[self.n_wide :]
        terms, _ = monomials(np.clip(wide, -self.reach, self.reach), self.degree)
        return np.concatenate([wide, thin + sign * (self.coefficients @ terms)])


def bend_along(
    wide: FloatArray, thin: FloatArray, weights: FloatArray, degree: int
) -> tuple[Bend, FloatArray]:
    """Thin coordinates as polynomials of wide ones, by weighted least squares.

    Args:
        wide: (m, n), whitened coordinates of points on a ridge.
        thin: (k, n), coordinates of these points, in standard deviations across the ridge.
        weights: (n,), at most one.

    Returns:
        The bend of all coordinates, the wide ones first, and the width (m + k,) of each: one, but
        for what the polynomials leave.
    """
    terms, _ = monomials(wide, degree)
    weighted = terms * weights
    gram = weighted @ terms.T
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-9
    fitted = np.linalg.solve(gram, weighted @ thin.T).T
    n, n_fitted = float(weights.sum()), len(terms)
    # What is left of points that the fit has not seen, as it would be of noise.
    unseen = (n + n_fitted) / max(n - n_fitted, 1.0)
    left = unseen * ((thin - fitted @ terms) ** 2 @ weights) / n
    widths = np.sqrt(1.0 + left)
    bend = Bend(fitted / widths[:, None], len(wide), degree)
    return bend, np.append(np.ones(len(wide)), widths)


def n_monomials(n_variables: int, degree: int) -> int:
    """How many monomials of so many variables there are up to a degree, the constant included."""
    return math.comb(n_variables + degree, degree)


def monomials(variables: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """All monomials (F, n) of ``variables`` (m, n) up to a degree, and the degree (F,) of each."""
    terms, degrees = np.ones((1, variables.shape[1])), np.zeros(1)
    for variable in variables:
        lower = [degrees <= degree - exponent for exponent in range(1, degree + 1)]
        powers = [terms[kept] * variable**exponent for exponent, kept in enumerate(lower, 1)]
        of_powers = [degrees[kept] + exponent for exponent, kept in enumerate(lower, 1)]
        terms = np.concatenate([terms, *powers])
        degrees = np.concatenate([degrees, *of_powers])
    return terms, degrees
