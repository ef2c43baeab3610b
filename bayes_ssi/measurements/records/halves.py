"""Do the halves of a record say the same of its modes?

Errors that are claimed hold for one structure under stationary loads. Frequencies that change with
amplitude or temperature, and sensors that come loose, show where the halves of a record differ by
more than their errors. Half of such a difference is the error of their mean. A clock that runs at
another rate is late in one half of the record, and early in the other.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.band_search import Group, modes_of, spectra_of_group
from bayes_ssi.measurements.records.explained_band import Explained
from bayes_ssi.measurements.records.late_clocks import Delay, delays_of
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit
from bayes_ssi.measurements.records.spectra import DAMPING, Transforms

PHASE_NOISE = 0.01  # at least, of components of first singular vectors
LEAST_SHARE = 0.3  # of each half that is used
FEWEST_CYCLES = 200.0  # of a mode in either half
MOST_SDS = 3.3  # of a difference; one in a thousand is larger by chance


def with_halves(
    bands: Sequence[Explained], halves: Sequence[Transforms], half_s: float
) -> list[Explained]:
    """Bands with the fits of their modes in each half, of ``half_s`` seconds, of the record."""
    if min(half.share for half in halves) < LEAST_SHARE:
        return list(bands)
    known = modes_of(bands, len(halves[0].values))
    fitted = []
    for band in bands:
        modes, fits = band.modes, list[LocalFit]()
        if band.is_wanted and modes.frequencies_hz.min() * half_s >= FEWEST_CYCLES:
            group = Group(*band.band_hz, modes, True)
            spectra = [spectra_of_group(transforms, group, known) for transforms in halves]
            fits = [
                Fitter(at, band.fit.one_source).fit(modes.in_directions(at), has_phases=True)
                for at in spectra
                if at is not None
            ]
        fitted.append(replace(band, halves=tuple(fits)) if len(fits) == len(halves) else band)
    return fitted


def growth_by_halves(
    band: Explained, places: Sequence[int], channels: Sequence[int], covariance: FloatArray
) -> FloatArray:
    """Factors (3, m) of errors of frequency, damping and shape; 1 where the halves agree.

    Or where the band has no halves that hold all its modes. ``covariance``, (m (2 + n))², is that
    of (ln f, ln ζ, shapes) of m modes of the whole record at n channels.
    """
    from scipy.stats import chi2

    n, m = len(channels), len(places)
    growth = np.ones((3, m))
    if not band.halves or not all(h.converged and h.are_modes.all() for h in band.halves):
        return growth
    (first, of_first), (second, of_second) = (
        Explained(half, (), True).estimates(places, channels) for half in band.halves
    )
    of_both = of_first + of_second
    apart = np.abs(np.log(np.concatenate(first[:2]) / np.concatenate(second[:2])))
    sds = np.sqrt(of_both.diagonal()[: 2 * m])
    of_mean = 0.5 * apart / np.sqrt(covariance.diagonal()[: 2 * m])
    growth[:2] = np.where(apart > MOST_SDS * sds, of_mean.clip(1.0), 1.0).reshape(2, m)
    if n > 1:
        largest = chi2.isf(chi2.sf(MOST_SDS**2, 1), n - 1)
        for i in range(m):
            sign = np.sign(first.shapes[:, i] @ second.shapes[:, i])
            across = first.shapes[:, i] - sign * second.shapes[:, i]
            at = slice(2 * m + i * n, 2 * m + (i + 1) * n)
            square = across @ np.linalg.pinv(of_both[at, at], 1e-6, hermitian=True) @ across
            growth[2, i] = np.sqrt(square / (n - 1)) if square > largest else 1.0
    return growth


def skewed_clocks(halves: Sequence[Transforms], peaks_hz: FloatArray) -> list[Delay]:
    """Sensors that are later in the second half of the record than in the first, and by how much.

    What is late by as much in both halves, and what damping turns, is the same in both.
    """
    widths = np.maximum(DAMPING * peaks_hz, 8.0 * halves[0].line_hz)
    inside = peaks_hz + 1.5 * widths < halves[0].band_hz[1]
    if min(half.share for half in halves) < LEAST_SHARE or inside.sum() < 2:
        return []
    turns = []
    for f, width in zip(peaks_hz[inside], widths[inside], strict=True):
        blocks = (half.spectra(f - width, f + 4.0 * width, 2.0 * width / f) for half in halves)
        first, second = (np.linalg.eigh(each.matrices[0])[1][:, -1] for each in blocks)
        turn = second * first.conj()
        turns.append(np.sqrt(np.abs(turn)) * np.exp(1j * np.angle(turn)))
    shapes = np.transpose(turns)
    noise = PHASE_NOISE**2 * np.eye(len(shapes))
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    delays = delays_of(shapes, np.array([noise] * len(turns)), peaks_hz[inside])
    return [delay for delay in delays if delay.is_sure]
