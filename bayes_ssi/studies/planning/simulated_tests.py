"""Tests simulated under the likelihood, such that any layout of sensors can read its data off.

The errors of a shape at the sensors of a layout have the density of
:mod:`~bayes_ssi.inference.likelihood.shape_density`: φ_e = cos t · u + sin t · τ with u the unit
shape there. One vector ε of standard normal numbers, a number for each candidate, gives all
layouts their errors: τ is the direction of ε across u, and t the quantile of its length's
probability, which is about σ times that length. Layouts are so compared on the same errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.shape_density import (
    log_shape_normaliser,
    log_shape_survival,
    log_sphere_area,
)
from bayes_ssi.studies.planning.planned_class import PlannedClass


class ShapeSums(NamedTuple):
    """Sums over the sensors of a layout, of shapes (N, J): they grow sensor by sensor."""

    own: FloatArray  # Σ φ²
    crossed: FloatArray  # Σ φ ε
    noise: FloatArray  # Σ ε²


@dataclass(frozen=True, eq=False)
class SimulatedTests:
    """N tests, each with up to J identified modes at all candidate sensors."""

    frequencies_hz: FloatArray  # (N, J), identified ones; 1 where there is none
    present: NDArray[np.bool_]  # (N, J)
    shapes: FloatArray  # (N, n_candidates, J), of the structure; 0 for spurious modes
    noise: FloatArray  # (N, n_candidates, J), ε
    shape_sd: FloatArray  # (N,), σ

    @classmethod
    def joined(cls, parts: Sequence[SimulatedTests]) -> SimulatedTests:
        """Tests of several classes, with as many places for modes as any of them needs."""
        most = max(part.present.shape[1] for part in parts)

        def padded(name: str, empty: float) -> Any:
            arrays = [getattr(part, name) for part in parts]
            rooms = [[(0, 0)] * (a.ndim - 1) + [(0, most - a.shape[-1])] for a in arrays]
            filled = zip(arrays, rooms, strict=True)
            return np.concatenate([np.pad(a, r, constant_values=empty) for a, r in filled])

        return cls(
            padded("frequencies_hz", 1.0),
            padded("present", False),
            padded("shapes", 0.0),
            padded("noise", 0.0),
            np.concatenate([part.shape_sd for part in parts]),
        )

    def sensor_sums(self, sensor: int) -> ShapeSums:
        """What one sensor adds to the sums."""
        shape, noise = self.shapes[:, sensor], self.noise[:, sensor]
        return ShapeSums(shape * shape, shape * noise, noise * noise)

    def coefficients(self, sums: ShapeSums, d: int) -> tuple[FloatArray, FloatArray]:
        """a and b, (N, J) each, of the identified unit shape a φ + b ε at d sensors."""
        own, crossed, noise = sums
        moves = own > 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            length = np.sqrt(np.where(moves, own, 1.0))
            across = np.where(moves, noise - crossed * crossed / length**2, noise)
            across = np.sqrt(np.maximum(across, np.finfo(float).tiny))
            distance = shape_distances(across, self.shape_sd[:, None], d)
            cosine = np.where(moves, 1.0 - distance, 0.0)
            sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
            a = np.where(moves, cosine / length - sine * crossed / (across * length**2), 0.0)
        return np.where(self.present, a, 0.0), np.where(self.present, sine / across, 0.0)


def shape_distances(lengths: FloatArray, shape_sd: FloatArray, d: int) -> FloatArray:
    """1 - |φ_e·φ| that is as probable as the length of d - 1 standard normal numbers.

    The density of y = 1 - cos t is that of x = 2y/σ², χ² with d - 1 degrees of freedom, times
    (1 - y/2)^((d-3)/2), which makes x smaller by 1 + (d-3) σ²/4. Where that is not all, Newton's
    method on the logarithm of the survival does the rest.

    Args:
        lengths: of the normal numbers, positive.
        shape_sd: σ, which broadcasts with them.
    """
    x = lengths * lengths
    variance = np.broadcast_to(shape_sd * shape_sd, x.shape)
    y = 0.5 * variance * x / np.maximum(1.0 + 0.25 * (d - 3) * variance, 0.1)
    y = np.clip(y, NEAREST, 1.0 - NEAREST)
    # The next term of the logarithm of (1 - y/2)^((d-3)/2), and shapes far from the identified one.
    left = (abs(d - 3) * y * y > NEGLIGIBLE) | (y > 0.2)
    if left.any():
        y[left] = _by_newton(y[left], x[left], variance[left], d)
    return y


# Of distances 1 - |φ_e·φ|, from either end of theirs; and in nats.
NEAREST, NEGLIGIBLE = 1e-12, 0.01


def _by_newton(y: FloatArray, x: FloatArray, variance: FloatArray, d: int) -> FloatArray:
    sd = np.sqrt(variance)
    with np.errstate(divide="ignore"):
        wanted = np.maximum(np.log(gammaincc(0.5 * (d - 1), 0.5 * x)), -600.0)
    whole = log_shape_normaliser(sd, d) - math.log(2.0) - log_sphere_area(d - 1)
    for _ in range(4):
        survival = log_shape_survival(y, sd, d)
        density = 0.5 * (d - 3) * np.log(y * (2.0 - y)) - y / variance - whole
        step = (survival - wanted) * np.exp(survival - density)
        y = np.clip(y + step, 0.1 * y, 0.5 * (1.0 + y))
    return np.clip(y, NEAREST, 1.0 - NEAREST)


def simulate(planned: PlannedClass, n: int, rng: np.random.Generator) -> SimulatedTests:
    """n tests of a class: parameters, identified, missed and spurious modes, and their errors."""
    z = planned.draw(n, rng)
    modes = planned.modes(z)
    variances = planned.error_variances(z)
    low, high = planned.test.band_hz
    n_modes = modes.frequencies_hz.shape[1]
    errors = np.sqrt(variances[:, :1]) * rng.standard_normal((n, n_modes))
    identified = modes.frequencies_hz * (1.0 + errors)
    seen = rng.random((n, n_modes)) < planned.identification.detection_probability
    seen &= (identified > low) & (identified < high)
    n_spurious = rng.poisson(planned.identification.expected_spurious_modes, n)
    spurious = rng.uniform(low, high, (n, max(int(n_spurious.max()), 1)))
    is_there = np.arange(spurious.shape[1]) < n_spurious[:, None]
    present = np.concatenate([seen, is_there], axis=1)
    frequencies = np.concatenate([identified, spurious], axis=1)
    no_shapes = np.zeros((n, modes.shapes.shape[1], spurious.shape[1]))
    shapes = np.concatenate([modes.shapes, no_shapes], axis=2)
    noise = rng.standard_normal(shapes.shape)
    # Identified modes first, as many places as the test with the most needs.
    order = np.argsort(~present, axis=1, kind="stable")[:, : max(int(present.sum(axis=1).max()), 1)]
    present = np.take_along_axis(present, order, axis=1)
    frequencies = np.take_along_axis(frequencies, order, axis=1)
    return SimulatedTests(
        np.where(present, frequencies, 1.0),
        present,
        np.where(present[:, None], np.take_along_axis(shapes, order[:, None], axis=2), 0.0),
        np.take_along_axis(noise, order[:, None], axis=2),
        np.sqrt(variances[:, 1]),
    )
