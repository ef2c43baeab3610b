"""Tests simulated under the likelihood, which any layout of sensors can read its data off.

The errors of a shape at the sensors of a layout have the density of
:mod:`~bayes_ssi.inference.likelihood.shape_density`: φ_e = cos t · u + sin t · τ, with u the unit
shape there. One vector ε of standard normal numbers, a number for each candidate, gives all
layouts their errors: τ is the direction of ε across u, and t has the probability of its length,
which is about t/σ. Layouts are so compared on the same errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.studies.planning.planned_class import PlannedClass


class SimulatedTests(NamedTuple):
    """N tests, each with up to J identified modes at all candidate sensors."""

    frequencies_hz: FloatArray  # (N, J), identified ones; NaN where there is none
    shapes: FloatArray  # (N, n_candidates, J), of the structure; 0 for spurious modes
    noise: FloatArray  # (N, n_candidates, J), ε
    shape_sd: FloatArray  # (N,), σ

    @classmethod
    def joined(cls, parts: Sequence[SimulatedTests]) -> SimulatedTests:
        """Tests of several classes, with as many places for modes as any of them needs."""
        most = max(part.frequencies_hz.shape[1] for part in parts)
        wider = []
        for hz, shapes, noise, shape_sd in parts:
            room = [(0, 0), (0, 0), (0, most - hz.shape[1])]
            found = np.pad(hz, room[1:], constant_values=np.nan)
            wider.append(cls(found, np.pad(shapes, room), np.pad(noise, room), shape_sd))
        return joined(wider)

    def rows(self, which: slice) -> SimulatedTests:
        """Some of the tests."""
        return SimulatedTests._make(array[which] for array in self)

    def identified_shapes(self, layout: Sequence[int]) -> FloatArray:
        """Unit shapes (N, d, J) as the d sensors of a layout give them."""
        shapes, noise = self.shapes[:, layout], self.noise[:, layout]
        length = np.sqrt(np.square(shapes).sum(axis=1, keepdims=True))
        unit = shapes / np.where(length > 0.0, length, 1.0)
        across = noise - unit * (unit * noise).sum(axis=1, keepdims=True)
        size = np.sqrt(np.square(across).sum(axis=1, keepdims=True))
        size = np.maximum(size, np.finfo(float).tiny)  # at one sensor nothing is across
        distance = shape_distances(size, self.shape_sd[:, None, None], len(layout))
        cosine = np.where(length > 0.0, 1.0 - distance, 0.0)
        return np.asarray(cosine * unit + np.sqrt(1.0 - cosine * cosine) * across / size)


def shape_distances(lengths: FloatArray, shape_sd: FloatArray, d: int) -> FloatArray:
    """1 - |φ_e·φ| that is as probable as the length of d - 1 standard normal numbers.

    The density of y = 1 - cos t is that of x = 2y/σ², χ² with d - 1 degrees of freedom, times
    (1 - y/2)^((d-3)/2), of which the first term of the logarithm, -(d - 3) y/4, is another rate.
    """
    rate = 1.0 + 0.25 * (d - 3) * shape_sd**2
    return np.asarray(np.clip(0.5 * shape_sd**2 * lengths**2 / rate, 0.0, 1.0))


def simulate(planned: PlannedClass, n: int, rng: np.random.Generator) -> SimulatedTests:
    """n tests of a class: parameters, identified, missed and spurious modes, and their errors."""
    modes = planned.modes(planned.draw(n, rng))
    identification = planned.model_class.identification
    low, high = planned.configuration.data.band_hz
    shape = modes.frequencies_hz.shape
    errors = np.sqrt(modes.variances[:, :1]) * rng.standard_normal(shape)
    found = modes.frequencies_hz * (1.0 + errors)
    seen = rng.random(shape) < identification.detection_probability
    found[~(seen & (found > low) & (found < high))] = np.nan
    n_spurious = rng.poisson(identification.expected_spurious_modes, n)
    spurious = rng.uniform(low, high, (n, max(int(n_spurious.max()), 1)))
    spurious[np.arange(spurious.shape[1]) >= n_spurious[:, None]] = np.nan
    frequencies = np.concatenate([found, spurious], axis=1)
    without = np.zeros((n, modes.shapes.shape[1], spurious.shape[1]))
    shapes = np.concatenate([modes.shapes, without], axis=2)
    noise = rng.standard_normal(shapes.shape)
    # Identified modes first, as many places as the test with the most needs.
    missing = np.isnan(frequencies)
    order = np.argsort(missing, axis=1, kind="stable")[:, : max(int((~missing).sum(1).max()), 1)]
    shapes = np.where(missing[:, None], 0.0, shapes)
    return SimulatedTests(
        np.take_along_axis(frequencies, order, axis=1),
        np.take_along_axis(shapes, order[:, None], axis=2),
        np.take_along_axis(noise, order[:, None], axis=2),
        np.sqrt(modes.variances[:, 1]),
    )
