"""Sensors whose clock is late: their motion has a phase that grows with frequency.

Where the record's motion is that of one mode, all sensors move in phase or in opposition. A sensor
that is late by τ turns by -2π f τ there, which moves the phases of first singular vectors of the
spectral matrices at the strongest lines. A clock that runs at another rate is later in the second
half of the record than in the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import ComplexArray, FloatArray

# Windows of the spectra, and the strongest lines of them, which take part where the first singular
# value is nearly all of the power: there one mode moves.
WINDOWS, STRONGEST, ONE_MODE = 40, 60, 0.95
# Damping, and motion besides that of the mode, turn the phases of sound sensors by some degrees; a
# late sensor turns by more, and lateness is four or more of its standard deviations.
SOUND_DEG, SURE = 10.0, 4.0


class _Lateness(NamedTuple):
    """Of each sensor against the others: τ in s, its standard deviation, and the phase it makes."""

    seconds: FloatArray
    deviations: FloatArray
    degrees: FloatArray


def late_sensors(samples: FloatArray, rate_hz: float, sensors: Sequence[str]) -> list[str]:
    """A sentence for each sensor that seems late or early, or whose clock runs at another rate.

    Args:
        samples: (n, N), of sensors that all move.
        rate_hz: samples per second.
        sensors: n names.
    """
    n_window = 2 * samples.shape[1] // (WINDOWS + 1)
    if n_window < 2 * STRONGEST:
        return []
    frequencies, transforms = _strongest_lines(samples, rate_hz, n_window)
    half = transforms.shape[2] // 2
    parts = [transforms, transforms[:, :, :half], transforms[:, :, half:]]
    whole, first, second = (_lateness(frequencies, part) for part in parts)
    if whole is None or first is None or second is None:
        return []
    remarks = []
    for i, name in enumerate(sensors):
        growth = second.seconds[i] - first.seconds[i]
        error = float(np.hypot(first.deviations[i], second.deviations[i]))
        per_second = whole.degrees[i] / max(abs(whole.seconds[i]), np.finfo(float).tiny)
        if abs(growth) > SURE * error and abs(growth) * per_second > SOUND_DEG:
            remarks.append(
                f"sensor {name!r}: its clock runs at another rate; it is later by {growth:.2g} s "
                "in the second half of the record than in the first"
            )
        elif whole.degrees[i] > SOUND_DEG and abs(whole.seconds[i]) > SURE * whole.deviations[i]:
            how = "late" if whole.seconds[i] > 0.0 else "early"
            remarks.append(
                f"sensor {name!r}: {abs(whole.seconds[i]):.2g} s {how} against the others; are the "
                "clocks synchronised?"
            )
    return remarks


def _strongest_lines(
    samples: FloatArray, rate_hz: float, n_window: int
) -> tuple[FloatArray, ComplexArray]:
    """Frequencies (L,) of the lines of most power, and their transforms (n, L, windows)."""
    from scipy.signal import stft

    def spectra_of(row: FloatArray) -> ComplexArray:
        centred = row - row.mean()
        transforms: ComplexArray = stft(
            centred, rate_hz, nperseg=n_window, boundary=None, padded=False
        )[2]
        return transforms

    scales = samples.std(1)
    powers = [(np.abs(spectra_of(row)) ** 2).mean(1) for row in samples]
    power = sum(each / scale**2 for each, scale in zip(powers, scales, strict=True))
    lines = np.sort(np.argsort(power)[-STRONGEST:])
    transforms = np.array([spectra_of(row)[lines] for row in samples])
    return lines * rate_hz / n_window, transforms / scales[:, None, None]


def _lateness(frequencies_hz: FloatArray, transforms: ComplexArray) -> _Lateness | None:
    """None where no line shows one mode alone."""
    matrices = np.einsum("ilw,jlw->lij", transforms, transforms.conj())
    values, vectors = np.linalg.eigh(matrices)
    alone = (values[:, -1] > ONE_MODE * values.sum(1)) & (frequencies_hz > 0.0)
    if alone.sum() < 3:
        return None
    motion, frequencies = vectors[alone, :, -1], frequencies_hz[alone]
    turned = motion * motion[:, np.abs(motion).mean(0).argmax()][:, None].conj()
    # Twice the phase is the same for motion in phase and in opposition.
    doubled = (turned**2 / np.abs(turned)).T  # (n, lines), as long as the motion
    candidates = np.linspace(-0.25, 0.25, 401) / frequencies.mean()
    back = np.exp(4j * np.pi * frequencies * candidates[:, None])
    seconds = candidates[(doubled @ back.T).real.argmax(1)]
    center = np.exp(4j * np.pi * frequencies * seconds[:, None])
    weights = np.abs(doubled)
    left = 0.5 * np.angle(doubled * center)
    scatter = np.sqrt((weights * left**2).sum(1) / weights.sum(1))
    seconds = seconds - np.median(seconds)
    mean_hz = np.sqrt((weights * frequencies**2).sum(1) / weights.sum(1))
    effective = weights.sum(1) ** 2 / (weights**2).sum(1)
    return _Lateness(
        seconds,
        scatter / (2.0 * np.pi * mean_hz * np.sqrt(effective)),
        np.degrees(2.0 * np.pi * mean_hz * np.abs(seconds)),
    )
