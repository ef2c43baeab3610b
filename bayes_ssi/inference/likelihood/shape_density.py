"""The density of a unit mode shape of unknown sign, ``exp(-(1 - |φ_e·φ|)/σ²) / Z_d(σ)``."""

import math
from functools import cache

import numpy as np
from scipy.special import gammaln

from bayes_ssi.foundations.arrays import FloatArray

# Normalisers are computed to the accuracy of the numbers that hold them.
REACH = 9.0  # standard deviations of integrals; beyond, less than e^(-40) of the largest integrand
N_NODES = 64  # of the quadrature
N_TERMS = 12  # of the series for small errors
# The last term of the series at the largest error for which it is used.
NEGLIGIBLE = np.finfo(float).eps / 16.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(N_NODES)


def log_sphere_area(d: int) -> float:
    """log |S^(d-1)|, the area of the unit sphere in d dimensions."""
    return math.log(2.0) + 0.5 * d * math.log(math.pi) - float(gammaln(0.5 * d))


def log_shape_normaliser(shape_sd: FloatArray, d: int) -> FloatArray:
    """log Z_d(σ), the normalising constant of the shape's density on the sphere.

    ``Z_d(σ) = 2 |S^(d-2)| ∫_0^(π/2) exp(-(1 - cos t)/σ²) sin^(d-2)(t) dt``: by a series where σ is
    small, by quadrature elsewhere.

    Args:
        shape_sd: σ, of any shape, positive.
    """
    sd = np.asarray(shape_sd, dtype=float)
    coefficients, largest = _series(d)
    variance = sd * sd
    small = variance < largest
    # log Z_d of two caps in a flat space, and a correction for the curvature of the sphere.
    curved = np.full(sd.shape, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        curved = curved * variance + coefficient
    with np.errstate(divide="ignore", invalid="ignore"):
        log_caps = math.log(2.0) + 0.5 * (d - 1) * np.log(2.0 * math.pi * variance)
        normaliser = np.array(log_caps + np.log1p(curved * variance))
    if not small.all():
        rest = _log_integral(np.zeros(()), sd[~small], d)
        normaliser[~small] = math.log(2.0) + log_sphere_area(d - 1) + rest
    return normaliser


def log_shape_survival(distances: FloatArray, shape_sd: FloatArray, d: int) -> FloatArray:
    """log P(1 - |φ_e·φ| > distance) of a shape drawn from the density, of any shape.

    ``∫_t^(π/2) exp(-(1 - cos s)/σ²) sin^(d-2)(s) ds`` with ``1 - cos t`` the distance, over the
    same integral from zero. Accurate also far out, where the probability itself would be zero.

    Args:
        distances: 1 - |φ_e·φ|, between 0 and 1.
        shape_sd: σ, positive, of a shape that broadcasts with ``distances``.
    """
    distance = np.clip(np.asarray(distances, dtype=float), 0.0, 1.0)
    log_tail = _log_integral(2.0 * np.arcsin(np.sqrt(0.5 * distance)), shape_sd, d)
    whole = log_shape_normaliser(shape_sd, d) - math.log(2.0) - log_sphere_area(d - 1)
    return np.minimum(log_tail - whole, 0.0)


@cache
def _series(d: int) -> tuple[FloatArray, float]:
    """Coefficients of Z_d / (2 (2πσ²)^((d-1)/2)) - 1 = c_1 σ² + c_2 σ⁴ + ..., and the largest σ².

    One of the two caps alone is a von Mises-Fisher density, with κ = 1/σ² and a Bessel function
    e^(-κ) I_(d/2-1)(κ), of which this is the series for a large κ (Abramowitz and Stegun, 9.7.1).
    The caps reach into each other by about e^(-κ).
    """
    k = np.arange(1, N_TERMS + 1)
    factors = -((d - 2.0) ** 2 - (2.0 * k - 1.0) ** 2) / (8.0 * k)
    coefficients = np.multiply.accumulate(factors, dtype=float)
    # The last term must be negligible; it is zero where the series ends.
    last = max(abs(float(coefficients[-1])), NEGLIGIBLE)
    converged = math.pow(NEGLIGIBLE / last, 1.0 / N_TERMS)
    kappa = 1.0 / converged
    while kappa - 0.5 * (d - 1) * math.log(kappa) < -math.log(NEGLIGIBLE):
        kappa *= 1.05
    return coefficients, 1.0 / kappa


def _log_integral(start: FloatArray, shape_sd: FloatArray, d: int) -> FloatArray:
    """log ∫ exp(-(1 - cos t)/σ²) sin^(d-2)(t) dt from ``start`` to π/2, of any shape.

    Gauss-Legendre, over the part of the interval in which the integrand is not negligible.
    """
    variance, start = np.asarray(shape_sd, dtype=float)[..., None] ** 2, start[..., None]
    # The logarithm of the integrand is highest where sin² t = (d - 2) σ² cos t, with the
    # width that its second derivative there gives.
    a = (d - 2) * variance
    highest = 2.0 / (a + np.sqrt(a * a + 4.0))  # cos t of the maximum
    top = np.arcsin(np.sqrt(np.minimum(a * highest, 1.0)))
    reach = REACH * np.sqrt(variance / (highest + (1.0 / highest if d > 2 else 0.0)))
    begin = np.maximum(start, top - reach)
    # Beyond its maximum the logarithm of the integrand falls by its slope and its curvature.
    first = np.maximum(begin, top)
    sine, cosine = np.sin(first), np.cos(first)
    slope = sine / variance
    curvature = cosine / variance
    if d > 2:
        slope = slope - (d - 2) * cosine / sine
        curvature = curvature + (d - 2) / sine**2
    length = REACH**2 / (slope + np.sqrt(slope**2 + REACH**2 * curvature))
    half = 0.5 * np.maximum(np.minimum(0.5 * math.pi, first + length) - begin, 0.0)
    t = begin + half * (_NODES + 1.0)
    log_integrand = -2.0 * np.sin(0.5 * t) ** 2 / variance
    if d > 2:
        log_integrand += (d - 2) * np.log(np.sin(t))
    peak = log_integrand.max(axis=-1, keepdims=True)
    # Not by a matrix product, whose rounding of one value depends on how many there are.
    integral = half[..., 0] * (np.exp(log_integrand - peak) * _WEIGHTS).sum(-1)
    with np.errstate(divide="ignore"):
        return np.asarray(peak[..., 0] + np.log(integral))
