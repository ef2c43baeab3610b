"""Short-time spectra of a record, and the modes that simple methods read at their peaks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.record import Record


class Peaks(NamedTuple):
    """Modes without damping and without errors.

    Attributes:
        frequencies_hz: (m,), ascending.
        shapes: (n, m), real, at unit length, the largest component positive.
    """

    frequencies_hz: FloatArray
    shapes: FloatArray


def short_time_spectra(
    record: Record, band_hz: tuple[float, float], periods: float
) -> tuple[FloatArray, ComplexArray]:
    """Frequencies (F,) of a band, and transforms (n, F, T) of T half-overlapping Hann windows."""
    from scipy.signal import detrend, stft

    low, high = record.checked_band(band_hz)
    length = round(periods * record.rate_hz / low)
    if 2 * length > record.n_samples:
        raise ValueError(
            f"the record lasts {record.duration_s:g} s; from {low:g} Hz on, "
            f"{2 * periods / low:.0f} s or more are needed"
        )
    frequencies, _, transforms = stft(
        detrend(record.samples, axis=1), record.rate_hz, nperseg=length, boundary=None, padded=False
    )
    in_band = (frequencies >= low) & (frequencies <= high)
    return frequencies[in_band], transforms[:, in_band]


def peaks_of(indicator: FloatArray, frequencies_hz: FloatArray, near: Sequence[float]) -> list[int]:
    """Lines at which an indicator (F,) is highest, from each of some frequencies uphill."""
    lines = []
    for frequency in near:
        line = int(np.abs(frequencies_hz - frequency).argmin())
        while True:
            around = range(max(0, line - 1), min(len(indicator), line + 2))
            higher = max(around, key=lambda k: indicator[k])
            if higher == line:
                break
            line = higher
        lines.append(line)
    return sorted(lines)
