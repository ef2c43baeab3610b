"""Modes of one record by each of several methods, side by side.

All but the Bayesian FFT look near modes that are given, as a user who compares them would, and give
no errors. NExT-ERA: poles of free decays (:mod:`bayes_ssi.measurements.records.mode_candidates`).
FDD, frequency domain decomposition (Brincker, Zhang and Andersen 2001): singular vectors of the
spectral matrix at its peaks. TFIE, time–frequency instantaneous estimators after Bonato, Ceravolo,
De Stefano and Molinari (2000), as inferred from the abstract and from papers that use it: while a
mode dominates, the phase between two channels is 0 or 180 degrees. The frequencies at which it
stays there over time are those of modes, and the amplitude ratios at these give the shape.
"""

import numpy as np

from bayes_ssi.foundations.argument_types import require_one_of
from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.modes.identification_summary import BAYESIAN_FFT, METHOD_NAMES
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.mode_candidates import candidates
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.spectra import BandHz, Resonances, real_shapes, transforms_of
from bayes_ssi.structures.modal import mac

REACH = 1.3  # by which lines reach beyond a band
SAME_LOG_FREQUENCY = 0.05  # a pole is that of a mode within this
SAME_SHAPE_MAC = 0.8  # and above this
FDD_PERIODS = 50.0  # of a window, which resolves a fiftieth of the lowest frequency
TFIE_PERIODS = 20.0  # long enough to tell modes apart, and short for many instants
LINES_AROUND = 2  # within which the peak of a mode is


def modes_by(method: str, record: Record, identified: ModalData) -> ModalData:
    """The modes of a record by one method, near those that are identified.

    All but the Bayesian FFT see the longest piece of a record with gaps.
    """
    if method == BAYESIAN_FFT:
        return identified
    require_one_of("method", method, METHOD_NAMES)
    if len(identified.sensors) < 2:
        raise ValueError(f"{METHOD_NAMES[method]}: needs two sensors or more")
    dampings = np.array([mode.damping for mode in identified.modes])
    near = Resonances(identified.frequencies_hz, dampings, identified.unit_shapes)
    piece = record.selected(identified.sensors).longest_piece()
    others = {"next-era": next_era, "fdd": fdd, "tfie": tfie}
    return others[method](piece, identified.band_hz, near)


def compared(record: Record, identified: ModalData) -> dict[str, ModalData | str]:
    """The modes by every method, or why a method does not give them."""
    modes: dict[str, ModalData | str] = {}
    for method in METHOD_NAMES:
        try:
            modes[method] = modes_by(method, record, identified)
        except ValueError as error:
            modes[method] = str(error)
    return modes


def next_era(record: Record, band_hz: BandHz, near: Resonances) -> ModalData:
    low, high = record.checked_band(band_hz)
    reach = (low / REACH, min(high * REACH, record.nyquist_hz))
    poles = candidates(transforms_of(record, reach), low, high).poles
    poles = poles._replace(shapes=real_shapes(poles.shapes))
    apart = np.abs(np.log(poles.frequencies_hz[:, None] / near.frequencies_hz))
    alike = mac(poles.shapes, near.shapes)
    apart = np.where((apart < SAME_LOG_FREQUENCY) & (alike > SAME_SHAPE_MAC), apart, np.inf)
    nearest = np.vstack([apart, np.full(apart.shape[1], np.inf)]).argmin(0).tolist()
    if np.isinf(apart).all(0).any() or len(set(nearest)) < len(nearest):
        named = ", ".join(f"{f:.3f}" for f in near.frequencies_hz)
        raise ValueError(f"NExT-ERA: orders do not agree on the modes at {named} Hz")
    chosen = poles.at(nearest)
    return ModalData.from_arrays(
        chosen.frequencies_hz, chosen.shapes, band_hz, record.sensors, damping=chosen.dampings
    )


def fdd(record: Record, band_hz: BandHz, near: Resonances) -> ModalData:
    """The peaks of the first singular value nearest uphill of some modes."""
    frequencies, transforms = _short_time_spectra(record, band_hz, FDD_PERIODS)
    matrices = np.einsum("ift,jft->fij", transforms, transforms.conj()) / transforms.shape[2]
    values, vectors = np.linalg.eigh(matrices)
    lines = _peaks_of(values[:, -1], frequencies, near.frequencies_hz)
    shapes = real_shapes(vectors[lines, :, -1].T)
    return ModalData.from_arrays(frequencies[lines], shapes, band_hz, record.sensors)


def tfie(record: Record, band_hz: BandHz, near: Resonances) -> ModalData:
    """The frequencies of least phase dispersion nearest uphill of some modes."""
    frequencies, transforms = _short_time_spectra(record, band_hz, TFIE_PERIODS)
    n = len(transforms)
    # Mean cosine of twice the phase differences of all pairs over time: 1 where all phases stay at
    # 0 or 180 degrees, 0 where they are anywhere. Products of pairs of channels with twice their
    # phases have twice the differences.
    doubled = (transforms / np.abs(transforms)) ** 2
    together = np.abs(doubled.sum(0)) ** 2 - n
    constancy = (together / (n * (n - 1))).mean(1)
    lines = _peaks_of(constancy, frequencies, near.frequencies_hz)
    shapes = np.empty((n, len(lines)))
    for column, line in zip(shapes.T, lines, strict=True):
        motion = transforms[:, line]
        reference = motion[np.abs(motion).mean(1).argmax()]
        ratios = motion * reference.conj() / np.abs(reference) ** 2
        column[:] = np.median(ratios.real, axis=1)
    return ModalData.from_arrays(frequencies[lines], real_shapes(shapes), band_hz, record.sensors)


def _short_time_spectra(
    record: Record, band_hz: BandHz, periods: float
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


def _peaks_of(indicator: FloatArray, frequencies_hz: FloatArray, near: FloatArray) -> list[int]:
    """Lines at which an indicator (F,) is highest, within a few lines of some frequencies."""
    lines = np.abs(frequencies_hz[:, None] - near).argmin(0)
    far = np.abs(np.arange(len(indicator))[:, None] - lines) > LINES_AROUND
    peaks = sorted(np.where(far, -np.inf, indicator[:, None]).argmax(0).tolist())
    if len(set(peaks)) < len(peaks):
        named = ", ".join(f"{f:.3f}" for f in near)
        raise ValueError(f"two of the modes at {named} Hz have one peak")
    return peaks
