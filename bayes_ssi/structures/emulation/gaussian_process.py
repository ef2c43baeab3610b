"""Smooth functions of several variables by kriging, with errors from points left out.

Several outputs share one correlation, exp(-Σ (Δx_k / l_k)² / 2), about a polynomial trend of
second degree, or first while points are few: universal kriging (Santner, Williams and Notz, The
Design and Analysis of Computer Experiments, 2018, ch. 4). The lengths l_k and the share of noise
maximise the restricted likelihood with one variance for all outputs. What the process predicts at
a point from all others follows in closed form (Dubrule 1983).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from scipy.optimize import minimize

from bayes_ssi.foundations.arrays import FloatArray

# Least and largest share of noise in the variance: rounding errors of the factorisation need
# the least; a function with jumps takes the most.
NOISE = (1e-10, 1e-1)
# Shortest and longest, in units of the variables' own spread: shorter ones leave points
# uncorrelated, longer ones are polynomials.
LENGTHS = (0.1, 100.0)
# Points from which lengths are estimated: more hardly change them, at a cost of their third power.
MOST_FITTED = 250


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    x: FloatArray  # (N, d), the points
    y: FloatArray  # (N, n_outputs), the outputs there
    lengths: FloatArray  # (d,), correlation lengths
    noise: float

    @classmethod
    def fitted(
        cls,
        x: FloatArray,
        y: FloatArray,
        weights: FloatArray | float = 1.0,
        start: "GaussianProcess | None" = None,
    ) -> "GaussianProcess":
        """The process of greatest likelihood; the last points decide where there are many.

        Args:
            x: (N, d), N at least twice the number of terms of a linear trend.
            weights: (n_outputs,), factors that make the outputs comparable for the likelihood.
        """
        some = slice(max(len(x) - MOST_FITTED, 0), None)
        spread = np.maximum(x.std(axis=0), 1e-12)
        first = [*(3.0 * spread), 1e-6] if start is None else [*start.lengths, start.noise]
        low, high = np.log([*np.outer(spread, LENGTHS), NOISE]).T
        optimum = minimize(
            _negative_log_likelihood,
            np.clip(np.log(first), low, high),
            (x[some], weights * y[some]),
            method="L-BFGS-B",
            jac=True,
            bounds=list(zip(low, high, strict=True)),
            options={"maxiter": 60 if start is None else 20},
        )
        *lengths, noise = np.exp(optimum.x)
        return cls(x, y, np.array(lengths), float(noise))

    def mean(self, x: FloatArray) -> FloatArray:
        """The outputs (B, n_outputs) expected at ``x`` (B, d); row i depends on row i alone."""
        answer = np.empty((len(x), self.y.shape[1]))
        step = 256  # rows, whose correlations stay in the processor's cache
        for begin in range(0, len(x), step):
            rows = x[begin : begin + step]
            answer[begin : begin + step] = np.einsum(
                "bn,no->bo", self._correlations(rows), self._solved.weights
            ) + np.einsum("bp,po->bo", trend_terms(rows, len(self.x)), self._solved.coefficients)
        return answer

    def spreads(self, x: FloatArray, also_at: FloatArray | None = None) -> FloatArray:
        """Standard errors (B,) at ``x`` (B, d), in units of the process's standard deviation.

        Outputs at further points ``also_at`` (C, d) are taken for known.
        """
        process = self
        if also_at is not None and len(also_at):
            known = np.vstack([self.x, also_at])
            process = GaussianProcess(known, np.zeros((len(known), 1)), self.lengths, self.noise)
        solved = process._solved
        r = process._correlations(x).T
        half = scipy.linalg.solve_triangular(solved.cholesky, r, lower=True)
        missing = trend_terms(x, len(process.x)).T - solved.half_trend.T @ half
        of_trend = scipy.linalg.solve_triangular(solved.trend_root, missing, trans=1)
        variance = 1.0 + self.noise - (half**2).sum(0) + (of_trend**2).sum(0)
        return np.sqrt(np.maximum(variance, self.noise))

    @cached_property
    def left_out(self) -> tuple[FloatArray, FloatArray]:
        """What all other points predict at each: outputs (N, n_outputs), and spreads (N,)."""
        projected = self._solved.projected_inverse
        of_own = np.diag(projected)
        return self.y - projected @ self.y / of_own[:, None], 1.0 / np.sqrt(of_own)

    def _correlations(self, x: FloatArray) -> FloatArray:
        return _correlations(x / self.lengths, self.x / self.lengths)

    @cached_property
    def _solved(self) -> "_Solved":
        r = self._correlations(self.x)
        r[np.diag_indices_from(r)] = 1.0 + self.noise
        return _Solved(r, trend_terms(self.x, len(self.x)), self.y)


class _Solved:
    """The equations of universal kriging, solved: R = L Lᵀ are the correlations, F the trend."""

    def __init__(self, r: FloatArray, trend: FloatArray, y: FloatArray) -> None:
        self.cholesky = root = scipy.linalg.cholesky(r, lower=True)  # L
        self.half_trend = scipy.linalg.solve_triangular(root, trend, lower=True)  # L⁻¹ F (N, p)
        half_y = scipy.linalg.solve_triangular(root, y, lower=True)
        q, self.trend_root = np.linalg.qr(self.half_trend)  # of Fᵀ R⁻¹ F, upper triangular
        # β (p, n_outputs), and R⁻¹ (y - F β) (N, n_outputs).
        self.coefficients = scipy.linalg.solve_triangular(self.trend_root, q.T @ half_y)
        residual = half_y - self.half_trend @ self.coefficients
        self.weights = scipy.linalg.solve_triangular(root, residual, lower=True, trans=1)

    @property
    def projected_inverse(self) -> FloatArray:
        """R⁻¹ - R⁻¹ F (Fᵀ R⁻¹ F)⁻¹ Fᵀ R⁻¹, which maps outputs to the weights."""
        inverse = scipy.linalg.cho_solve((self.cholesky, True), np.eye(len(self.cholesky)))
        solved = scipy.linalg.solve_triangular(self.cholesky, self.half_trend, lower=True, trans=1)
        of_trend = scipy.linalg.solve_triangular(self.trend_root, solved.T, trans=1)
        return np.asarray(inverse - of_trend.T @ of_trend)


def _negative_log_likelihood(
    logs: FloatArray, x: FloatArray, y: FloatArray
) -> tuple[float, FloatArray]:
    """The restricted log-likelihood per output, negative, and its gradient (lengths, noise)."""
    *lengths, noise = np.exp(logs)
    scaled = x / np.array(lengths)
    r = _correlations(scaled, scaled)
    with_noise = r.copy()
    with_noise[np.diag_indices_from(r)] = 1.0 + noise
    trend = trend_terms(x, len(x))
    try:
        solved = _Solved(with_noise, trend, y)
    except scipy.linalg.LinAlgError:
        return 1e10, np.zeros(len(logs))
    degrees = len(x) - trend.shape[1]
    squares = np.maximum((solved.weights * y).sum() / y.shape[1], 1e-300)
    value = (
        0.5 * degrees * np.log(squares)
        + np.log(np.diag(solved.cholesky)).sum()
        + np.log(np.abs(np.diag(solved.trend_root))).sum()
    )
    weights = solved.weights
    inner = solved.projected_inverse - (degrees / squares / y.shape[1]) * (weights @ weights.T)
    of_r = inner * r
    # ∂r/∂log l_k = r Δ_k²; a sum over pairs of a (Δ_k)² needs no array of pairs and variables.
    rows = of_r.sum(axis=1)
    of_lengths = 2.0 * ((scaled**2 * rows[:, None]).sum(0) - (scaled * (of_r @ scaled)).sum(0))
    of_noise = noise * np.trace(inner)
    return float(value), 0.5 * np.array([*of_lengths, of_noise])


def _correlations(a: FloatArray, b: FloatArray) -> FloatArray:
    """exp(-|a - b|²/2) for rows of ``a`` (B, d) and ``b`` (N, d), in units of the lengths."""
    products = np.einsum("bd,nd->bn", a, b)
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)
    return np.asarray(np.exp(np.minimum(products - 0.5 * squares, 0.0)))


def trend_terms(x: FloatArray, n_points: int) -> FloatArray:
    """Terms (B, p) of the trend at ``x`` (B, d): of second degree if there are points enough."""
    if n_points < 2 * n_quadratic_terms(x.shape[1]):
        return np.column_stack([np.ones(len(x)), x])
    return quadratic_terms(x)


def quadratic_terms(x: FloatArray) -> FloatArray:
    """Terms (B, p) of a polynomial of second degree at ``x`` (B, d)."""
    first, second = np.triu_indices(x.shape[1])
    return np.column_stack([np.ones(len(x)), x, x[:, first] * x[:, second]])


def n_quadratic_terms(n_variables: int) -> int:
    return (n_variables + 1) * (n_variables + 2) // 2
