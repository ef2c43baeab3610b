"""Exact response of damped oscillators to a record that is linear between samples, by filters.

A mode of pole λ = -ζω + iω√(1-ζ²) has the state s' = λ s + f, f being the record; displacement,
velocity and acceleration of the mode are imaginary parts of multiples of s. Over a step in which
f is linear,

    s_after = E s_before + dt (φ₁(z) - φ₂(z)) f_before + dt φ₂(z) f_after,    z = λ dt, E = e^z,

with φ₁ = (e^z - 1)/z and φ₂ = (e^z - 1 - z)/z². With q for the delay by one sample, s is the output
of the filter (c₁ + c₀ q)/(1 - E q) on f, c₁ = dt φ₂ and c₀ = dt (φ₁ - φ₂). Numerator and
denominator times 1 - E* q make it a filter of second order, whose coefficients are real for the
imaginary part of a multiple of s.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray

ComplexArray = NDArray[np.complex128]


def modal_histories(
    poles: ComplexArray, factors: ComplexArray, record: FloatArray, dt: float
) -> Iterator[FloatArray]:
    """Im(factor · s) of every mode, from rest (s = 0 at the first sample).

    Args:
        poles: (B, n_modes), λ of every mode.
        factors: (B, n_modes).
        record: (n_samples,), f.

    Yields:
        (n_modes + 1, n_samples) for each row of B in turn, in an array that is reused; its last
        row is the record.
    """
    from scipy.signal import lfilter

    z = poles * dt
    decay = np.exp(z)
    phi1, phi2 = phi_functions(z)
    after, before = factors * (dt * phi2), factors * (dt * (phi1 - phi2))
    turned = after * decay.conj()
    numerators = np.stack([after, before - turned, -before * decay.conj()], axis=-1).imag
    denominators = np.stack([np.ones(z.shape), -2.0 * decay.real, np.abs(decay) ** 2], axis=-1)
    # From a filter at rest, s would begin at c₁ f rather than at zero.
    initial = np.stack([-after, turned], axis=-1).imag * record[0]
    histories = np.empty((z.shape[1] + 1, len(record)))
    histories[-1] = record
    for row in zip(numerators, denominators, initial, strict=True):
        for mode, (numerator, denominator, state) in enumerate(zip(*row, strict=True)):
            histories[mode], _ = lfilter(numerator, denominator, record, zi=state)
        yield histories


def phi_functions(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """φ₁(z) = (e^z - 1)/z and φ₂(z) = (e^z - 1 - z)/z², without cancellation for small z."""
    small = np.abs(z) < 0.5
    series = np.zeros_like(z)
    for k in range(16, 1, -1):  # 1/2! + z/3! + z²/4! + …
        series = (series * z + 1.0) / k
    other = np.where(small, 1.0, z)
    phi2 = np.where(small, series, ((np.exp(other) - 1.0) / other - 1.0) / other)
    return 1.0 + z * phi2, phi2
