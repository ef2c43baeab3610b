"""The density of a unit mode shape of unknown sign, ``exp(-(1 - |φ_e·φ|)/σ²) / Z_d(σ)``."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from bayes_ssi.priors import FloatArray

__all__ = ["log_shape_normaliser", "log_sphere_area"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
# The integral is taken this many standard deviations about the integrand's top.
WIDTHS = 9.0


def log_sphere_area(d: int) -> float:
    """log |S^(d-1)|, the area of the unit sphere in d dimensions."""
    return math.log(2.0) + 0.5 * d * math.log(math.pi) - float(gammaln(0.5 * d))


def log_shape_normaliser(shape_sd: FloatArray, d: int) -> FloatArray:
    """log Z_d(σ), the normalising constant of the shape's density on the sphere.

    ``Z_d(σ) = 2 |S^(d-2)| ∫_0^(π/2) exp(-(1 - cos t)/σ²) sin^(d-2)(t) dt``, by Gauss-Legendre
    quadrature over the part of the interval in which the integrand is not negligible.

    Args:
        shape_sd: σ, of any shape, positive.
        d: number of sensors, at least 2.
    """
    sd = np.asarray(shape_sd, dtype=float)[..., None]
    # The logarithm of the integrand is highest where sin² t = (d - 2) σ² cos t, and as wide
    # there as its second derivative says.
    a = (d - 2) * sd * sd
    cosine = 2.0 / (a + np.sqrt(a * a + 4.0))
    top = np.sqrt(np.maximum(a * cosine, 0.0))  # sin t
    curvature = cosine / sd**2 + ((d - 2) / top**2 if d > 2 else 0.0)
    half = WIDTHS / np.sqrt(curvature)
    begin = np.maximum(0.0, np.arcsin(np.minimum(top, 1.0)) - half)
    end = np.minimum(0.5 * math.pi, np.arcsin(np.minimum(top, 1.0)) + half)
    t = begin + 0.5 * (end - begin) * (_NODES + 1.0)
    log_integrand = -2.0 * (np.sin(0.5 * t) / sd) ** 2 + (d - 2) * np.log(np.sin(t))
    peak = log_integrand.max(axis=-1, keepdims=True)
    # Not by a matrix product, whose rounding of one value depends on how many there are.
    integral = 0.5 * (end - begin)[..., 0] * (np.exp(log_integrand - peak) * _WEIGHTS).sum(-1)
    return math.log(2.0) + log_sphere_area(d - 1) + np.log(integral) + peak[..., 0]
