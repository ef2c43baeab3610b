"""p-values by their logarithms: combined, and as standard deviations.

Logarithms, since the p-values of a model that is far from the data are below the smallest number
that a float holds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc, gammaln, log_ndtr, logsumexp, ndtri_exp

from bayes_ssi.foundations.arrays import FloatArray

LOWEST_LOG_P = -1e300


def log_two_sided(residuals: FloatArray) -> FloatArray:
    """log P(|x| > |residual|) of a standard-normal x."""
    return np.asarray(math.log(2.0) + log_ndtr(-np.abs(residuals)), dtype=float)


def log_chi_square(squares: FloatArray, n: NDArray[np.intp] | int) -> FloatArray:
    """log P(χ² > squares) with ``n`` degrees of freedom; NaN where ``squares`` is."""
    a, x = 0.5 * np.asarray(n, dtype=float), 0.5 * squares
    with np.errstate(divide="ignore", invalid="ignore"):
        log_p = np.log(gammaincc(a, x))
        # Far out, Γ(a, x) ≈ x^(a-1) e^(-x) / (1 - (a - 1)/x), its series taken for a geometric one.
        far_out = (a - 1.0) * np.log(x) - x - gammaln(a) - np.log1p((1.0 - a) / x)
    return np.where(np.isneginf(log_p), far_out, log_p)


def log_joint(log_p: FloatArray, counted: NDArray[np.bool_]) -> FloatArray:
    """Fisher's combination (B,) of the independent p-values (B, n) that are counted.

    The product of m of them is smaller with probability ``Π p · Σ_{k<m} (-ln Π p)^k / k!``. It is
    one where none is counted.
    """
    k = np.arange(max(1, log_p.shape[1]))
    log_product = np.where(counted, log_p, 0.0).sum(axis=1)
    total = np.clip(-log_product, 0.0, -LOWEST_LOG_P)  # by rounding it may be below zero
    with np.errstate(divide="ignore", invalid="ignore"):
        log_powers = np.where(k == 0, 0.0, k * np.log(total)[:, None])
    m = np.maximum(counted.sum(axis=1), 1)
    log_terms = np.where(k < m[:, None], log_powers - gammaln(k + 1.0), -np.inf)
    return np.asarray(logsumexp(log_terms, axis=1) - total, dtype=float)


def log_harmonic_mean(log_p: FloatArray, axis: int) -> FloatArray:
    """The harmonic mean of p-values that depend on one another in an unknown way.

    Nearly a p-value itself whatever their dependence: exactly one where they are equal; of a
    hundred independent ones it is below 0.01 with probability 0.011 (Wilson 2019, The harmonic
    mean p-value for combining dependent tests, PNAS 116).
    """
    n = log_p.shape[axis]
    lowest = np.maximum(log_p, LOWEST_LOG_P)
    return np.asarray(np.minimum(math.log(n) - logsumexp(-lowest, axis=axis), 0.0), dtype=float)


def log_combined(log_p: FloatArray, axis: int) -> FloatArray:
    """One p-value of several independent ones, along an axis of (B, n).

    Small if many are somewhat small, by Fisher's combination, or if one is very small, by the
    harmonic mean; the two are combined by their harmonic mean.
    """
    rows = np.moveaxis(log_p, axis, 1)
    many = log_joint(rows, np.ones(rows.shape, dtype=bool))
    return log_harmonic_mean(np.stack([many, log_harmonic_mean(rows, axis=1)]), axis=0)


def standard_deviations(log_p: float) -> float:
    """The distance from the mean that a normal variable exceeds, on both sides, with this p."""
    return max(0.0, -float(ndtri_exp(log_p - math.log(2.0))))
