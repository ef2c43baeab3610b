"""Methods that read modes at peaks of short-time spectra: quick, without errors or damping.

Frequency domain decomposition: singular vectors of the spectral matrix at its peaks.

Brincker, Zhang and Andersen (2001). It gives no errors, and its frequencies are no finer than the
lines of its spectra.

Time–frequency instantaneous estimators: modes where phases between channels stand still.

After Bonato, Ceravolo, De Stefano and Molinari (2000), as inferred from its abstract and from
papers that use it: while a mode dominates, the phase between two channels is 0 or 180 degrees. The
frequencies at which it stays there with the least dispersion over time are those of modes, and the
amplitude ratios at these give the shape. It gives no errors.
"""

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.identification_settings import METHODS
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.resonances import (
    Resonances,
    real_shapes,
    with_positive_largest,
)


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


def peaks_of(indicator: FloatArray, frequencies_hz: FloatArray, near: FloatArray) -> list[int]:
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


def fdd(record: Record, band_hz: tuple[float, float], near: Resonances) -> ModalData:
    """The peaks of the first singular value nearest uphill of some modes."""
    frequencies, transforms = short_time_spectra(record, band_hz, METHODS.fdd_periods)
    matrices = np.einsum("ift,jft->fij", transforms, transforms.conj()) / transforms.shape[2]
    values, vectors = np.linalg.eigh(matrices)
    lines = peaks_of(values[:, -1], frequencies, near.frequencies_hz)
    shapes = real_shapes(vectors[lines, :, -1].T)
    return ModalData.from_arrays(frequencies[lines], shapes, band_hz, record.sensors)


def tfie(record: Record, band_hz: tuple[float, float], near: Resonances) -> ModalData:
    """The frequencies of least phase dispersion nearest uphill of some modes."""
    frequencies, transforms = short_time_spectra(record, band_hz, METHODS.tfie_periods)
    lines = peaks_of(phase_constancy(transforms), frequencies, near.frequencies_hz)
    shapes = np.empty((len(transforms), len(lines)))
    for column, line in zip(shapes.T, lines, strict=True):
        motion = transforms[:, line]
        reference = motion[np.abs(motion).mean(1).argmax()]
        ratios = motion * reference.conj() / np.abs(reference) ** 2
        column[:] = np.median(ratios.real, axis=1)
    shapes /= np.sqrt((shapes**2).sum(0))
    shapes, _ = with_positive_largest(shapes)
    return ModalData.from_arrays(frequencies[lines], shapes, band_hz, record.sensors)


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
