"""Exact response of damped oscillators to a record that is linear between samples, in blocks.

A mode of pole λ = -ζω + iω√(1-ζ²) has the state s' = λ s + f, f being the record; displacement,
velocity and acceleration of the mode are imaginary parts of multiples of s. Over a step in which
f is linear,

    s_after = e^z s_before + dt (φ₁(z) - φ₂(z)) f_before + dt φ₂(z) f_after,    z = λ dt,

with φ₁ = (e^z - 1)/z and φ₂ = (e^z - 1 - z)/z². Without the sample of the same instant,
v = s - dt φ₂ f, this is v_after = e^z v_before + γ f_before. The response in a block of samples is
then that to the block's part of the record, one matrix product for all oscillators, and that to
the states v at its beginning.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bayes_ssi.priors import FloatArray

__all__ = ["phi_functions", "response_in_blocks"]

ComplexArray = NDArray[np.complex128]

# Samples computed at once: the work for each grows with it, the number of calls falls.
BLOCK = 32


def response_in_blocks(
    poles: ComplexArray,
    weights: ComplexArray,
    direct: FloatArray,
    record: FloatArray,
    dt: float,
) -> Iterator[tuple[int, FloatArray]]:
    """y = Im(Σ_r weights_r s_r) + direct · f, from rest (s = 0 at the first sample).

    Args:
        poles: (B, n_modes), λ of every mode.
        weights: (B, n_outputs, n_modes).
        direct: (B, n_outputs).
        record: (n_samples,), f.
        dt: time between samples.

    Yields:
        The first sample of a block and y in it, (B, n_outputs, up to BLOCK samples).
    """
    n, n_outputs, n_modes = weights.shape
    z = poles * dt
    phi1, phi2 = phi_functions(z)
    after = dt * phi2
    gamma = dt * (phi1 - phi2) + np.exp(z) * after
    powers = np.exp(z[:, :, None] * np.arange(BLOCK + 1))  # (B, modes, BLOCK + 1)

    free = weights[:, :, :, None] * powers[:, None, :, :BLOCK]  # response to a state of 1
    at_once = direct + (weights * after[:, None, :]).sum(-1).imag
    later = (free[..., :-1] * gamma[:, None, :, None]).sum(2).imag
    impulse = np.concatenate([at_once[:, :, None], later], axis=-1).reshape(-1, BLOCK)
    # Im(a v) = Im(a) Re(v) + Re(a) Im(v), as one real product for each of the B.
    to_free = np.concatenate([free.imag, free.real], axis=2).transpose(0, 1, 3, 2)
    to_free = np.ascontiguousarray(to_free).reshape(n, n_outputs * BLOCK, 2 * n_modes)
    onward = (gamma[:, :, None] * powers[:, :, BLOCK - 1 :: -1]).reshape(-1, BLOCK)
    onward_parts = np.concatenate([onward.real, onward.imag])

    state = -after * record[0]
    for start in range(0, len(record), BLOCK):
        part = record[start : start + BLOCK]
        samples = np.zeros(BLOCK)
        samples[: len(part)] = part
        # Row i holds the samples delayed by i.
        padded = np.concatenate([np.zeros(BLOCK - 1), samples])
        delayed = np.ascontiguousarray(sliding_window_view(padded, BLOCK)[::-1])
        found = (impulse @ delayed).reshape(n, n_outputs * BLOCK)
        both = np.concatenate([state.real, state.imag], axis=1)
        found += np.matmul(to_free, both[:, :, None])[:, :, 0]
        yield start, found.reshape(n, n_outputs, BLOCK)[:, :, : len(part)]
        real, imaginary = (onward_parts @ samples).reshape(2, *state.shape)
        state = powers[:, :, BLOCK] * state + (real + 1j * imaginary)


def phi_functions(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """φ₁(z) = (e^z - 1)/z and φ₂(z) = (e^z - 1 - z)/z², without cancellation for small z."""
    small = np.abs(z) < 0.5
    series = np.zeros_like(z)
    for k in range(16, 1, -1):  # 1/2! + z/3! + z²/4! + …
        series = (series * z + 1.0) / k
    other = np.where(small, 1.0, z)
    phi2 = np.where(small, series, ((np.exp(other) - 1.0) / other - 1.0) / other)
    return 1.0 + z * phi2, phi2
