"""Frequency domain decomposition: singular vectors of the spectral matrix at its peaks.

Brincker, Zhang and Andersen (2001). It gives no errors, and its frequencies are no finer than the
lines of its spectra.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_ssi.measurements.records.modal_estimates import real_shapes
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.short_time import Peaks, peaks_of, short_time_spectra

# A window of so many periods of the lowest frequency resolves its fiftieth.
PERIODS = 50.0


def fdd(record: Record, band_hz: tuple[float, float], near: Sequence[float]) -> Peaks:
    """The peaks of the first singular value nearest uphill of some frequencies.

    Args:
        near: about where the peaks are, in Hz.
    """
    frequencies, transforms = short_time_spectra(record, band_hz, PERIODS)
    matrices = np.einsum("ift,jft->fij", transforms, transforms.conj()) / transforms.shape[2]
    values, vectors = np.linalg.eigh(matrices)
    lines = peaks_of(values[:, -1], frequencies, near)
    return Peaks(frequencies[lines], real_shapes(vectors[lines, :, -1].T))
