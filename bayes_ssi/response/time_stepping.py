"""Exact response of damped oscillators to a record that is linear between samples, in blocks.

A mode of pole λ = -ζω + iω√(1-ζ²) has the state s' = λ s + f, f being the record; displacement,
velocity and acceleration of the mode are imaginary parts of multiples of s. Over a step in which
f is linear,

    s_after = e^z s_before + dt (φ₁(z) - φ₂(z)) f_before + dt φ₂(z) f_after,    z = λ dt,

with φ₁ = (e^z - 1)/z and φ₂ = (e^z - 1 - z)/z². Without the sample of the same instant,
v = s - dt φ₂ f, this is v_after = e^z v_before + γ f_before. Step by step only from block to block
of samples, for all oscillators together, that gives the states v at the beginning of every block.
The response in all blocks is then one matrix product: of the blocks' samples and states with the
response to a unit sample and to a unit state.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray

__all__ = ["phi_functions", "responses"]

ComplexArray = NDArray[np.complex128]

# Samples in a block: the work for each grows with it, the number of steps falls.
BLOCK = 32
# States that are kept at once; they should stay near the processor.
STATES = 1_000_000


def responses(
    poles: ComplexArray,
    weights: ComplexArray,
    direct: FloatArray,
    record: FloatArray,
    dt: float,
    found: FloatArray | None = None,
) -> Iterator[FloatArray]:
    """y = Im(Σ_r weights_r s_r) + direct · f, from rest (s = 0 at the first sample).

    Args:
        poles: (B, n_modes), λ of every mode.
        weights: (B, n_outputs, n_modes).
        direct: (B, n_outputs).
        record: (n_samples,), f.
        dt: time between samples.
        found: (B, n_outputs, n_samples), where to put y; if None, it is not kept.

    Yields:
        y of one row of B after another, (n_outputs, n_samples); not to be used after the next
        one is asked for where ``found`` is None.
    """
    n, n_outputs, n_modes = weights.shape
    n_blocks = -(-len(record) // BLOCK)
    whole = len(record) // BLOCK
    padded = np.zeros((n_blocks, BLOCK))
    padded.flat[: len(record)] = record
    # What the response of a block follows from: its samples, and the states at its beginning.
    causes = np.concatenate([padded, np.empty((n_blocks, 2 * n_modes))], axis=1)
    own = np.empty((n_outputs, len(record)))
    at_once = max(1, STATES // (n_blocks * n_modes))
    for start in range(0, n, at_once):
        part = slice(start, start + at_once)
        states, effects = _states_and_effects(
            poles[part] * dt, weights[part], direct[part], padded, dt
        )
        for i in range(len(effects)):
            y = own if found is None else found[start + i]
            causes[:, BLOCK:] = states[:, i]
            blocks = y[:, : whole * BLOCK].reshape(n_outputs, whole, BLOCK)
            np.matmul(causes[:whole], effects[i], out=blocks)
            if whole < n_blocks:
                rest = causes[whole] @ effects[i]
                y[:, whole * BLOCK :] = rest[:, : len(record) - whole * BLOCK]
            yield y


def _states_and_effects(
    z: ComplexArray, weights: ComplexArray, direct: FloatArray, padded: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray]:
    """States v at the beginning of blocks, and what samples and states do within a block.

    Returns:
        (n_blocks, B, 2 n_modes), real and imaginary parts in turn; and (B, n_outputs,
        BLOCK + 2 n_modes, BLOCK).
    """
    (n, n_outputs, n_modes), n_blocks = weights.shape, len(padded)
    phi1, phi2 = phi_functions(z)
    after = dt * phi2
    gamma = dt * (phi1 - phi2) + np.exp(z) * after
    powers = np.exp(z[:, :, None] * np.arange(BLOCK + 1))  # (B, modes, BLOCK + 1)

    onward = (gamma[:, :, None] * powers[:, :, BLOCK - 1 :: -1]).transpose(2, 0, 1)
    driven = padded @ np.ascontiguousarray(onward).view(np.float64).reshape(BLOCK, -1)
    states = np.empty((n_blocks, n, n_modes), dtype=np.complex128)
    states[0] = -after * padded[0, 0]
    over_a_block = np.ascontiguousarray(powers[:, :, BLOCK])
    steps = driven.view(np.complex128).reshape(n_blocks, n, n_modes)
    for before, step, state in zip(states, steps, states[1:], strict=False):
        np.multiply(over_a_block, before, out=state)
        state += step

    free = weights[:, :, :, None] * powers[:, None, :, :BLOCK]  # response to a state of 1
    impulse = np.zeros((n, n_outputs, 2 * BLOCK - 1))  # response to a sample of 1, after zeros
    impulse[..., BLOCK - 1] = direct + (weights * after[:, None, :]).sum(-1).imag
    impulse[..., BLOCK:] = (free[..., :-1] * gamma[:, None, :, None]).sum(2).imag
    effects = np.empty((n, n_outputs, BLOCK + 2 * n_modes, BLOCK))
    effects[:, :, :BLOCK] = sliding_window_view(impulse, BLOCK, axis=-1)[:, :, ::-1]
    # Im(a v) = Im(a) Re(v) + Re(a) Im(v).
    effects[:, :, BLOCK::2] = free.imag
    effects[:, :, BLOCK + 1 :: 2] = free.real
    return states.view(np.float64), effects


def phi_functions(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """φ₁(z) = (e^z - 1)/z and φ₂(z) = (e^z - 1 - z)/z², without cancellation for small z."""
    small = np.abs(z) < 0.5
    series = np.zeros_like(z)
    for k in range(16, 1, -1):  # 1/2! + z/3! + z²/4! + …
        series = (series * z + 1.0) / k
    other = np.where(small, 1.0, z)
    phi2 = np.where(small, series, ((np.exp(other) - 1.0) / other - 1.0) / other)
    return 1.0 + z * phi2, phi2
