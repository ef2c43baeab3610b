"""Modes of one record by each of several methods, side by side.

All but the Bayesian FFT look near modes that are given, as a user who compares them would. A method
more is a function like theirs, a line in OTHERS and its name in METHOD_NAMES.

NExT-ERA, natural excitation technique and eigensystem realisation: correlations R(τ) of a
stationary record, from lag 1 on, are sums of free decays (James, Carne and Lauffer 1993), whose
poles are those of candidates for modes, with shapes at all sensors. Standard deviations and
correlations come from a jackknife: the record is divided into segments, and the modes are
identified again without each of them.

SSI-cov, covariance-driven stochastic subspace identification, by pyOMA2 (an optional extra), with
its first-order perturbation for frequencies and dampings (Döhler and Mevel 2013). The standard
deviations of its shapes lack the normalisation, are 25 to 300 times too large (version 1.4.3), and
are not used. Every order is computed: with steps of two, pyOMA2 leaves out singular vectors, and
standard deviations come out at 0.6 to 0.8 of the scatter; data-driven identification ("dat") claims
0.4 to 0.7 of it, and is not offered.

The others read modes at peaks of short-time spectra, without errors or damping. FDD, frequency
domain decomposition (Brincker, Zhang and Andersen 2001): singular vectors of the spectral matrix at
its peaks; frequencies are no finer than the lines. TFIE, time–frequency instantaneous estimators
after Bonato, Ceravolo, De Stefano and Molinari (2000), as inferred from the abstract and from
papers that use it: while a mode dominates, the phase between two channels is 0 or 180 degrees. The
frequencies at which it stays there with the least dispersion over time are those of modes, and the
amplitude ratios at these give the shape.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from io import StringIO
from itertools import islice

import numpy as np

from bayes_ssi.foundations.argument_types import require_one_of
from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.measurements.modes.identification_summary import BAYESIAN_FFT, METHOD_NAMES
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.mode_candidates import MOST_DIRECTIONS, poles_of_orders
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.spectra import Resonances, real_shapes
from bayes_ssi.structures.modal import mac

CORRELATION_PERIODS = 3.0  # of the lowest frequency: lags of NExT-ERA and SSI-cov
MOST_SEGMENTS = 20  # of NExT-ERA's jackknife
FEWEST_SEGMENTS = 8
HIGHEST_ORDER = 40
SAME_LOG_FREQUENCY = 0.05  # poles of a record and a part are one mode within this
SAME_SHAPE_MAC = 0.8  # and above this
SUBSPACE_SEGMENTS = 50  # for SSI-cov's covariances, as pyOMA2 chooses
FDD_PERIODS = 50.0  # of a window, which resolves a fiftieth of the lowest frequency
TFIE_PERIODS = 20.0  # long enough to tell modes apart, and short for many instants


Band = tuple[float, float]


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
    return OTHERS[method](piece, identified.band_hz, near)


def compared(record: Record, identified: ModalData) -> dict[str, ModalData | str]:
    """The modes by every method, or why a method does not give them."""
    modes: dict[str, ModalData | str] = {}
    for method in METHOD_NAMES:
        try:
            modes[method] = modes_by(method, record, identified)
        except ValueError as error:
            modes[method] = str(error)
    return modes


def next_era(record: Record, band_hz: Band, near: Resonances) -> ModalData:
    """The order is the lowest at which all modes appear in the record and without each segment."""
    sums, directions, rate_hz = correlations(record, band_hz)
    n_segments, mean = len(sums), sums.mean(0)

    def modes(part: FloatArray) -> Iterator[Resonances]:
        decays = np.einsum("sr,lsq->lrq", directions, part)
        half = len(decays) // 2
        poles = poles_of_orders(decays, 1.0 / rate_hz, 0.0, band_hz, half, HIGHEST_ORDER, part)
        return (of_order._replace(shapes=real_shapes(of_order.shapes)) for of_order in poles)

    without = [modes((n_segments * mean - part) / (n_segments - 1)) for part in sums]
    by_order = islice(zip(modes(mean), *without, strict=False), 2 * near.n_modes - 1, None, 2)
    for whole, *parts in by_order:
        center = _matched(whole, near)
        others = [] if center is None else [_matched(part, center) for part in parts]
        if center is not None and all(other is not None for other in others):
            break
    else:
        raise ValueError(
            "NExT-ERA: no order shows the modes at "
            + ", ".join(f"{f:.3f}" for f in near.frequencies_hz)
            + " Hz in the record and without each of its segments"
        )
    vectors = np.array([_vector(other, center) for other in others if other is not None])
    deviations = vectors - vectors.mean(0)
    jackknifed = (n_segments - 1) / n_segments * deviations.T @ deviations
    variances = jackknifed.diagonal()
    n, m = center.shapes.shape
    return ModalData.from_arrays(
        center.frequencies_hz,
        center.shapes,
        band_hz,
        record.sensors,
        frequency_cov=np.sqrt(variances[:m]),
        damping=center.dampings,
        damping_sd=center.dampings * np.sqrt(variances[m : 2 * m]),
        shape_sd=np.sqrt(variances[2 * m :].reshape(m, n).sum(1) / (n - 1)),
    )


def correlations(record: Record, band_hz: Band) -> tuple[FloatArray, FloatArray, float]:
    """Correlation functions of the segments of a record, with the directions of most motion.

    Returns:
        (segments, lags, n, r): R(τ), τ = 1, 2, …, of n sensors with r directions; the directions
        (n, r); and the rate in Hz.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high).detrended()
    n_lags = 2 * max(2, round(CORRELATION_PERIODS * slow.rate_hz / low))
    n_segments = min(MOST_SEGMENTS, slow.n_samples // (2 * n_lags))
    if n_segments < FEWEST_SEGMENTS:
        needed = FEWEST_SEGMENTS * 2 * n_lags / slow.rate_hz
        raise ValueError(
            f"NExT-ERA: the record lasts {record.duration_s:g} s, but standard deviations from "
            f"{low:g} Hz on need {needed:.0f} s or more"
        )
    length = slow.n_samples // n_segments
    n = len(slow.sensors)
    samples = slow.samples
    _, vectors = np.linalg.eigh(samples @ samples.T)
    directions = vectors[:, ::-1][:, : min(n, MOST_DIRECTIONS)]
    n_padded = next_fast_len(length + n_lags, real=True)
    sums = np.empty((n_segments, n_lags, n, directions.shape[1]))
    pairs = length - np.arange(1, n_lags + 1)
    for segment, start in zip(sums, range(0, n_segments * length, length), strict=True):
        part = samples[:, start : start + length]
        transforms = rfft(part, n_padded)
        of_directions = rfft(directions.T @ part, n_padded)
        products = transforms[:, None] * of_directions.conj()
        segment[:] = np.moveaxis(irfft(products, n_padded)[..., 1 : n_lags + 1] / pairs, -1, 0)
    return sums, directions, slow.rate_hz


def _matched(candidates: Resonances, modes: Resonances) -> Resonances | None:
    """Of the candidates, those that are the modes, each once; None if one is missing."""
    if not candidates.n_modes:
        return None
    apart = np.abs(np.log(candidates.frequencies_hz[:, None] / modes.frequencies_hz))
    alike = mac(candidates.shapes, modes.shapes)
    apart = np.where((apart < SAME_LOG_FREQUENCY) & (alike > SAME_SHAPE_MAC), apart, np.inf)
    chosen = apart.argmin(0)
    if np.isinf(apart.min(0)).any() or len(set(chosen.tolist())) < len(chosen):
        return None
    return candidates.at(chosen.tolist())


def _vector(modes: Resonances, center: Resonances) -> FloatArray:
    """(ln f, ln ζ, shapes) with the signs of the centre's shapes."""
    signs = np.sign((modes.shapes * center.shapes).sum(0))
    shapes = (modes.shapes * signs).T.ravel()
    return np.concatenate([np.log(modes.frequencies_hz), np.log(modes.dampings), shapes])


def ssi_cov(record: Record, band_hz: Band, near: Resonances) -> ModalData:
    """The modes nearest to some, from the order of twice their number."""
    with optional_package("pyOMA2", extra="oma"):
        from pyoma2.functions import ssi
    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high)
    half = round(0.5 * CORRELATION_PERIODS * slow.rate_hz / low)
    order, n_segments = 2 * near.n_modes, SUBSPACE_SEGMENTS
    samples = np.array(slow.samples)
    logging.getLogger("pyoma2").setLevel(logging.WARNING)
    with redirect_stderr(StringIO()):  # bars of progress
        hankel, root = ssi.build_hank(samples, samples, half, "cov", calc_unc=True, nb=n_segments)
        states = ssi.SSI_fast(hankel, half, order)
        frequencies, dampings, shapes, _, sds, damping_sds, *_ = ssi.SSI_poles(
            *states[:3], order, 1.0 / slow.rate_hz, calc_unc=True, H=hankel, T=root
        )
    of_order = frequencies[:, -1]
    chosen = []
    for frequency in near.frequencies_hz:
        apart = np.abs(of_order / frequency - 1.0)
        if not np.nanmin(apart, initial=np.inf) < SAME_LOG_FREQUENCY:
            raise ValueError(f"SSI-cov: order {order} shows no mode at {frequency:.4g} Hz")
        chosen.append(int(np.nanargmin(apart)))
    found = of_order[chosen]
    return ModalData.from_arrays(
        found,
        real_shapes(shapes[chosen, -1].T),
        band_hz,
        record.sensors,
        frequency_cov=sds[chosen, -1] / found,
        damping=dampings[chosen, -1],
        damping_sd=damping_sds[chosen, -1],
    )


def fdd(record: Record, band_hz: Band, near: Resonances) -> ModalData:
    """The peaks of the first singular value nearest uphill of some modes."""
    frequencies, transforms = _short_time_spectra(record, band_hz, FDD_PERIODS)
    matrices = np.einsum("ift,jft->fij", transforms, transforms.conj()) / transforms.shape[2]
    values, vectors = np.linalg.eigh(matrices)
    lines = _peaks_of(values[:, -1], frequencies, near.frequencies_hz)
    shapes = real_shapes(vectors[lines, :, -1].T)
    return ModalData.from_arrays(frequencies[lines], shapes, band_hz, record.sensors)


def tfie(record: Record, band_hz: Band, near: Resonances) -> ModalData:
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
    record: Record, band_hz: Band, periods: float
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


OTHERS: dict[str, Callable[[Record, Band, Resonances], ModalData]] = {
    "next-era": next_era,
    "ssi-cov": ssi_cov,
    "fdd": fdd,
    "tfie": tfie,
}
