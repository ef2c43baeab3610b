"""Modes from correlation functions: natural excitation technique, eigensystem realisation (ERA).

Correlations R(τ) of a stationary record, from lag 1 on, are sums of free decays (James, Carne and
Lauffer 1993). Block Hankel matrices H0 and H1 of R, one lag apart, give H0 = U Σ Vᵀ and the state
matrix A = Σ^(-1/2) Uᵀ H1 V Σ^(-1/2) at an order (Juang and Pappa 1985); the poles are
ln(eig A)·rate, and shapes follow from the first block row of H0 for all sensors.
Standard deviations and correlations come from a jackknife: the record is divided into segments,
and the modes are identified again without each of them.
"""

from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.measurements.records.identification_settings import FIT, METHODS
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.measurements.records.resonances import Resonances, block_hankel, real_shapes
from bayes_ssi.structures.modal import mac


class Correlations(NamedTuple):
    """Correlation functions of the segments of a record, with the directions of most motion."""

    sums: FloatArray  # (segments, lags, n, r): R(τ), τ = 1, 2, …, of n sensors with r directions
    directions: FloatArray  # (n, r)
    rate_hz: float
    band_hz: tuple[float, float]


def correlations(record: Record, band_hz: tuple[float, float]) -> Correlations:
    """Correlation functions of a record's segments."""
    from scipy.fft import irfft, next_fast_len, rfft

    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high).detrended()
    half = max(2, round(METHODS.correlation_periods * slow.rate_hz / low))
    n_lags = 2 * half
    n_segments = min(METHODS.most_segments, slow.n_samples // (2 * n_lags))
    if n_segments < METHODS.fewest_segments:
        needed = METHODS.fewest_segments * 2 * n_lags / slow.rate_hz
        raise ValueError(
            f"NExT-ERA: the record lasts {record.duration_s:g} s, but standard deviations from "
            f"{low:g} Hz on need {needed:.0f} s or more"
        )
    length = slow.n_samples // n_segments
    n = len(slow.sensors)
    samples = slow.samples
    _, vectors = np.linalg.eigh(samples @ samples.T)
    directions = vectors[:, ::-1][:, : min(n, METHODS.most_directions)]
    n_padded = next_fast_len(length + n_lags, real=True)
    sums = np.empty((n_segments, n_lags, n, directions.shape[1]))
    pairs = length - np.arange(1, n_lags + 1)
    for segment, start in zip(sums, range(0, n_segments * length, length), strict=True):
        part = samples[:, start : start + length]
        transforms = rfft(part, n_padded)
        of_directions = rfft(directions.T @ part, n_padded)
        products = transforms[:, None] * of_directions.conj()
        segment[:] = np.moveaxis(irfft(products, n_padded)[..., 1 : n_lags + 1] / pairs, -1, 0)
    return Correlations(sums, directions, slow.rate_hz, (low, high))


class _Realisation:
    """Hankel matrices of correlations (lags, n, r), all or without a segment, for any order."""

    def __init__(self, part: FloatArray, data: Correlations) -> None:
        from scipy.linalg import svd

        self.data = data
        blocks = np.einsum("sr,lsq->lrq", data.directions, part)
        half = len(blocks) // 2
        left, values, right = svd(block_hankel(blocks, half), check_finite=False)
        self.highest_order = min(METHODS.highest_order, len(values))
        left, right = left[:, : self.highest_order], right[: self.highest_order].T
        self.singular_values = values[: self.highest_order]
        # The first block row of H0 for all sensors, times V; Uᵀ H1 V.
        self.first_row = part[:half].transpose(1, 0, 2).reshape(part.shape[1], -1) @ right
        self.shifted = left.T @ block_hankel(blocks[1:], half) @ right

    def poles(self, order: int) -> Resonances:
        """The modes in the band, of less damping than structures may have."""
        root = np.sqrt(self.singular_values[:order])
        discrete, states = np.linalg.eig(self.shifted[:order, :order] / root / root[:, None])
        with np.errstate(divide="ignore"):
            continuous = np.log(discrete.astype(complex)) * self.data.rate_hz
        size = np.maximum(np.abs(continuous), np.finfo(float).tiny)
        frequencies, dampings = size / (2.0 * np.pi), -continuous.real / size
        low, high = self.data.band_hz
        kept = (continuous.imag > 0.0) & (dampings > 0.0) & (dampings < FIT.most_damping)
        kept &= (frequencies > low) & (frequencies < high)
        kept = np.flatnonzero(kept)[np.argsort(frequencies[kept])]
        shapes = (self.first_row[:, :order] / root) @ states[:, kept]
        return Resonances(frequencies[kept], dampings[kept], real_shapes(shapes))


def next_era(record: Record, band_hz: tuple[float, float], near: Resonances) -> ModalData:
    """Frequencies, dampings and shapes of modes, with standard deviations from a jackknife.

    The order is the lowest at which all modes appear in the record and without each segment.
    """
    data = correlations(record, band_hz)
    total, n_segments = data.sums.sum(0), len(data.sums)
    without = [_Realisation((total - part) / (n_segments - 1), data) for part in data.sums]
    whole = _Realisation(data.sums.mean(0), data)
    for order in range(2 * near.n_modes, whole.highest_order + 1, 2):
        center = _matched(whole.poles(order), near)
        if center is None:
            continue
        others = [_matched(part.poles(order), center) for part in without]
        if all(other is not None for other in others):
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


def _matched(candidates: Resonances, modes: Resonances) -> Resonances | None:
    """Of the candidates, those that are the modes, each once; None if one is missing."""
    if not candidates.n_modes:
        return None
    apart = np.abs(np.log(candidates.frequencies_hz[:, None] / modes.frequencies_hz))
    alike = mac(candidates.shapes, modes.shapes)
    apart = np.where(
        (apart < METHODS.same_log_frequency) & (alike > METHODS.same_shape_mac), apart, np.inf
    )
    chosen = apart.argmin(0)
    if np.isinf(apart.min(0)).any() or len(set(chosen.tolist())) < len(chosen):
        return None
    return candidates.at(chosen.tolist())


def _vector(modes: Resonances, center: Resonances) -> FloatArray:
    """(ln f, ln ζ, shapes) with the signs of the centre's shapes."""
    signs = np.sign((modes.shapes * center.shapes).sum(0))
    shapes = (modes.shapes * signs).T.ravel()
    return np.concatenate([np.log(modes.frequencies_hz), np.log(modes.dampings), shapes])
