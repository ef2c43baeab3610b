"""Time–frequency instantaneous estimators: modes where phases between channels stand still.

After Bonato, Ceravolo, De Stefano and Molinari (2000), as inferred from its abstract and from
papers that use it: while a mode dominates, the phase between two channels is 0 or 180 degrees. The
frequencies at which it stays there with the least dispersion over time are those of modes, and the
amplitude ratios at these give the shape. It gives no errors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.modal_estimates import with_positive_largest
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.short_time import Peaks, peaks_of, short_time_spectra

# Windows long enough to tell modes apart, and short enough for many instants.
PERIODS = 20.0


def tfie(record: Record, band_hz: tuple[float, float], near: Sequence[float]) -> Peaks:
    """The frequencies of least phase dispersion nearest uphill of some frequencies.

    Args:
        near: about where they are, in Hz.
    """
    frequencies, transforms = short_time_spectra(record, band_hz, PERIODS)
    lines = peaks_of(phase_constancy(transforms), frequencies, near)
    shapes = np.empty((len(transforms), len(lines)))
    for column, line in zip(shapes.T, lines, strict=True):
        own = transforms[:, line]
        reference = own[np.abs(own).mean(1).argmax()]
        ratios = own * reference.conj() / np.abs(reference) ** 2
        column[:] = np.median(ratios.real, axis=1)
    shapes /= np.sqrt((shapes**2).sum(0))
    return Peaks(frequencies[lines], with_positive_largest(shapes)[0])


def phase_constancy(transforms: ComplexArray) -> FloatArray:
    """Mean cosine (F,) of twice the phase differences of all pairs over time.

    1 where all phases stay at 0 or 180 degrees, 0 where they are anywhere.
    """
    n = len(transforms)
    # Twice the phase of each channel: products of pairs have twice their differences.
    turned = (transforms / np.abs(transforms)) ** 2
    together = np.abs(turned.sum(0)) ** 2 - n
    constancy: FloatArray = (together / (n * (n - 1))).mean(1)
    return constancy
