"""Random structures, and vibration records of them that are exactly stationary and Gaussian.

Shear buildings of 2 to 12 storeys and frames in space (two directions and rotation a floor, with
eccentric masses); stiffnesses and masses scattered by 20 %; damping 0.5 to 5 %; some of the degrees
of freedom measured; noise 0.2 to 20 %; 5 to 60 minutes; loads on all floors, or the ground's motion
seen by absolute accelerations; bands that cut through the spectrum. A mode is clear where the exact
spectral matrix, noise included, has a peak of its first singular value that stands out by 6 dB.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.signal import find_peaks

import bayes_ssi as bs

CLEAR_DB = 6.0


class Case(NamedTuple):
    """A record and what it should be identified as: modes of the structure, at the sensors.

    ``of_ground`` gives the absolute accelerations of unit motion of the ground, (K, sensors, 1);
    ``clear_at``, which modes are clear at some sensors alone.
    """

    record: bs.Record
    band_hz: tuple[float, float]
    frequencies_hz: np.ndarray
    dampings: np.ndarray
    shapes: np.ndarray
    clear: np.ndarray
    is_ground: bool
    of_ground: Callable[[np.ndarray], np.ndarray]
    clear_at: Callable[[Sequence[int]], np.ndarray] | None = None


def chain(stiffnesses: np.ndarray) -> np.ndarray:
    """Stiffness matrix of masses in series, the first one on the ground."""
    k = np.diag(stiffnesses + np.r_[stiffnesses[1:], 0.0])
    return k - np.diag(stiffnesses[1:], 1) - np.diag(stiffnesses[1:], -1)


def shear_building(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass and stiffness matrices, and the influence of the ground."""
    n = int(rng.integers(2, 13))
    masses = 1e5 * rng.lognormal(0.0, 0.2, n)
    return np.diag(masses), chain(2e8 * rng.lognormal(0.0, 0.2, n)), np.ones(n)


def space_frame(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Floors with two directions and a rotation each, whose masses are off the stiffnesses."""
    n = int(rng.integers(2, 6))
    masses = 1e5 * rng.lognormal(0.0, 0.2, n)
    along = 2e8 * rng.lognormal(0.0, 0.2, n)
    across = 2e8 * rng.uniform(0.6, 1.6) * rng.lognormal(0.0, 0.2, n)
    twist = rng.uniform(0.8, 2.0) * 0.5 * (along + across)
    k = np.zeros((3 * n, 3 * n))
    for i, stiffness in enumerate((along, across, twist)):
        k[i::3, i::3] = chain(stiffness)
    m = np.zeros((3 * n, 3 * n))
    off = rng.normal(0.0, 0.15, (n, 2))
    for i in range(n):
        ex, ey = off[i]
        own = np.array([[1.0, 0.0, -ey], [0.0, 1.0, ex], [-ey, ex, 0.7 + ex**2 + ey**2]])
        m[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = masses[i] * own
    angle = rng.uniform(0.0, np.pi)
    return m, k, np.tile([np.cos(angle), np.sin(angle), 0.0], n)


def spectra_of(
    f: np.ndarray, shapes: np.ndarray, dampings: np.ndarray, at_hz: np.ndarray
) -> np.ndarray:
    """Accelerations (K, sensors, loads) of unit loads: shapes are pairs at sensors and loads."""
    beta = f / np.maximum(at_hz, 1e-9)[:, None]
    h = 1.0 / (1.0 - beta**2 - 2j * dampings * beta)
    at_sensors, at_loads = shapes
    return np.einsum("im,km,jm->kij", at_sensors, h, at_loads, optimize=True)


def stationary(transfer, n_samples: int, rate_hz: float, rng: np.random.Generator) -> np.ndarray:
    """A piece of a periodic Gaussian record, half as long again, with the exact spectra."""
    n = 2 * ((3 * n_samples // 2 + 1) // 2)
    frequencies = np.fft.rfftfreq(n, 1.0 / rate_hz)
    parts = []
    for part in np.array_split(frequencies, max(1, len(frequencies) // 20000)):
        response = transfer(part)
        white = rng.standard_normal((2, len(part), response.shape[2])).view(float)
        parts.append(np.einsum("kij,kj->ik", response, white[0] + 1j * white[1]))
    lines = np.concatenate(parts, axis=1)
    lines[:, 0] = 0.0
    return np.fft.irfft(lines, n, axis=1)[:, :n_samples]


def case(seed: int) -> Case:
    """The record of a seed."""
    rng = np.random.default_rng([28, seed])
    m, k, ground = space_frame(rng) if rng.random() < 0.4 else shear_building(rng)
    values, vectors = eigh(k, m)
    f = np.sqrt(values) / (2.0 * np.pi)
    n = len(f)
    n_sensors = int(rng.integers(2, min(n, 15) + 1)) if n > 2 else 2
    sensors = np.sort(rng.choice(n, n_sensors, replace=False))
    mean_damping = np.exp(rng.uniform(np.log(0.005), np.log(0.05)))
    dampings = (mean_damping * rng.lognormal(0.0, 0.2, n)).clip(0.004, 0.06)
    noise = np.exp(rng.uniform(np.log(0.002), np.log(0.2)))
    minutes = np.exp(rng.uniform(np.log(5.0), np.log(60.0)))
    n_seen = int(rng.integers(1, min(n, 8) + 1))
    rate_hz = float(rng.choice([50.0, 100.0]))
    while f[min(n_seen, n - 1)] * 1.1 > 0.45 * rate_hz:
        n_seen -= 1
    high = f[n_seen - 1] * 1.15 if n_seen == n else 0.5 * (f[n_seen - 1] + f[n_seen])
    first = int(rng.integers(0, max(1, n_seen // 2))) if rng.random() < 0.4 else 0
    low = 0.6 * f[0] if first == 0 else 0.5 * (f[first - 1] + f[first])
    band = (float(low), float(min(high, 0.45 * rate_hz)))
    n_samples = int(60.0 * minutes * rate_hz)
    is_ground = rng.random() < 0.2
    participation = -(vectors.T @ m @ ground)[None]

    def of_ground(at_hz: np.ndarray) -> np.ndarray:
        response = spectra_of(f, (vectors[sensors], participation), dampings, at_hz)
        return response + ground[sensors][:, None]

    if is_ground:
        transfer = of_ground
    else:
        loads = vectors * np.sqrt(m.diagonal())[:, None] * rng.lognormal(0.0, 0.3, n)[:, None]

        def transfer(at_hz: np.ndarray) -> np.ndarray:
            return spectra_of(f, (vectors[sensors], loads), dampings, at_hz)

    samples = stationary(transfer, n_samples, rate_hz, rng)
    scale = samples.std(1)
    samples += noise * scale[:, None] * rng.standard_normal(samples.shape)
    names = tuple(f"s{i + 1}" for i in sensors)
    # Exact spectra: those of the loads by lines of unit variance, and of white noise.
    inside = (f > band[0]) & (f < band[1])
    step = max(0.1 * (dampings * f).min(), (band[1] - band[0]) / 20000)
    grid = np.arange(0.8 * band[0], 1.25 * band[1], step)
    n_period = 2 * ((3 * n_samples // 2 + 1) // 2)
    matrices = np.empty((len(grid), len(sensors), len(sensors)), dtype=complex)
    for part, of_part in zip(
        *(np.array_split(a, max(1, len(grid) // 5000)) for a in (grid, matrices)), strict=True
    ):
        response = transfer(part)
        of_part[:] = response @ response.conj().swapaxes(1, 2) * 2.0
    matrices += n_period * np.diag((noise * scale) ** 2)

    def clear_at(places: Sequence[int]) -> np.ndarray:
        clear = np.zeros(n, dtype=bool)
        level = 10.0 * np.log10(np.linalg.eigvalsh(matrices[:, places][:, :, places])[:, -1])
        peaks, _ = find_peaks(level, prominence=CLEAR_DB)
        for peak in grid[peaks]:
            near = np.abs(f - peak) / (dampings * f)
            i = int(near.argmin())
            clear[i] |= bool(near[i] < 1.0)
        return clear[inside]

    shapes = vectors[sensors]
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    record = bs.Record(samples, rate_hz, names, "acceleration", "m/s2")
    return Case(
        record, band, f[inside], dampings[inside], shapes[:, inside], clear_at(range(len(sensors))),
        is_ground, of_ground, clear_at,
    )  # fmt: skip
