"""Sensors whose clock is late: their motion has a phase that grows with frequency.

At a peak of the spectra where one mode moves all sensors, they move in phase or in opposition. A
sensor that is late by τ turns by -2π f τ there, which moves the phases of first singular vectors.
A clock that runs at another rate is later in the second half of the record than in the first.
"""

from collections.abc import Sequence

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.identification_settings import CHECKS


def late_sensors(samples: FloatArray, rate_hz: float, sensors: Sequence[str]) -> list[str]:
    """A sentence for each sensor that seems late or early, or whose clock runs at another rate.

    Args:
        samples: (n, N), of sensors that all move.
        rate_hz: samples per second.
    """
    n_window = 2 * samples.shape[1] // (CHECKS.windows + 1)
    if len(samples) < 2 or n_window < CHECKS.windows:
        return []
    frequencies, transforms = _peaks(samples, rate_hz, n_window)
    half = transforms.shape[2] // 2
    parts = [transforms, transforms[:, :, :half], transforms[:, :, half:]]
    whole, first, second = (_lateness(frequencies, part) for part in parts)
    if whole is None or first is None or second is None:
        return []
    remarks = []
    growths = second[0] - first[0]
    grow = np.abs(growths) > CHECKS.late_sds * np.hypot(first[1], second[1])
    for name, seconds, deviation, growth, grows in zip(sensors, *whole, growths, grow, strict=True):
        if grows:
            remarks.append(
                f"sensor {name!r}: its clock runs at another rate; it is later by {growth:.2g} s "
                "in the second half of the record than in the first"
            )
        elif abs(seconds) > CHECKS.late_sds * deviation:
            remarks.append(
                f"sensor {name!r}: {abs(seconds):.2g} s {'late' if seconds > 0.0 else 'early'} "
                "against the others; are the clocks synchronised?"
            )
    return remarks


def _peaks(samples: FloatArray, rate_hz: float, n_window: int) -> tuple[FloatArray, ComplexArray]:
    """Frequencies (L,) of the peaks of power, and the transforms there (n, L, windows)."""
    from scipy.signal import find_peaks, stft

    def spectra_of(row: FloatArray) -> ComplexArray:
        scaled = (row - row.mean()) / row.std()
        transforms: ComplexArray = stft(
            scaled, rate_hz, nperseg=n_window, boundary=None, padded=False
        )[2]
        return transforms

    # Sensor by sensor, and twice: the spectra of all would fill memory.
    power = sum((np.abs(spectra_of(row)) ** 2).mean(1) for row in samples)
    levels = np.log(np.maximum(power, CHECKS.least_peak_power * np.max(power)))
    lines = find_peaks(levels, prominence=np.log(CHECKS.peak_power))[0]
    return lines * rate_hz / n_window, np.array([spectra_of(row)[lines] for row in samples])


def _lateness(
    frequencies_hz: FloatArray, transforms: ComplexArray
) -> tuple[FloatArray, FloatArray] | None:
    """τ in s of each sensor against the others, and its standard deviation.

    None where too few peaks show one mode alone.
    """
    values, vectors = np.linalg.eigh(np.einsum("ilw,jlw->lij", transforms, transforms.conj()))
    alone = values[:, -1] > CHECKS.share_of_one_mode * values.sum(1)
    if alone.sum() < CHECKS.fewest_peaks:
        return None
    # Twice the phase is the same for motion in phase and in opposition; (L, n), as long as power.
    doubled, omega = vectors[alone, :, -1] ** 2, 2.0 * np.pi * frequencies_hz[alone, None]
    n_lines, n = doubled.shape
    weights, mean_omega = n * np.abs(doubled), np.sqrt((omega**2).mean())
    seconds, turned = common_delays(doubled, omega, 801, 10)
    left = 0.5 * np.angle(turned * np.exp(2j * omega * seconds))
    scatter = (weights * left**2).sum() / weights.sum() / (1.0 - 1.0 / n_lines) / (1.0 - 1.0 / n)
    shared = weights / np.sqrt(weights.sum(1, keepdims=True))
    information = np.diag((weights * omega**2).sum(0)) - (shared * omega).T @ (shared * omega)
    # A sensor that hardly moves may be late by all that phases can tell apart.
    sound = np.radians(CHECKS.sound_phase_deg)
    latest = 0.5 * np.pi / mean_omega
    covariance = np.linalg.inv(information / (sound**2 + scatter) + np.eye(n) / latest**2)
    against_mean = np.eye(n) - 1.0 / n
    deviations = np.sqrt((against_mean @ covariance @ against_mean).diagonal())
    # Overlapping modes turn each other by more at higher frequencies, as lateness does.
    return seconds, np.maximum(deviations, sound / mean_omega)


def common_delays(
    squares: ComplexArray, omega: FloatArray, n_sought: int, n_rounds: int
) -> tuple[FloatArray, ComplexArray]:
    """Delays (n,) in s that the phases of modes have in common; the median sensor is on time.

    Least squares of the phases of modes and of sensors, in turn.

    Args:
        squares: (L, n), of the shapes' components, whose phases are twice theirs.
        omega: (L, 1), angular frequencies.
        n_sought: delays that are tried, over half a period of the root mean square frequency.

    Returns:
        The delays, and the squares turned by the phases of the modes.
    """
    sought = np.linspace(-0.5, 0.5, n_sought) * np.pi / np.sqrt((omega**2).mean())
    seconds = np.zeros(squares.shape[1])
    for _ in range(n_rounds):
        modes = (squares * np.exp(2j * omega * seconds)).sum(1, keepdims=True)
        turned = squares * np.conj(modes / np.abs(modes))
        seconds = sought[(turned.T @ np.exp(2j * omega * sought)).real.argmax(1)]
        seconds = seconds - np.median(seconds)
    return seconds, turned
