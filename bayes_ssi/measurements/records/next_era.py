"""Modes from correlation functions: natural excitation technique, eigensystem realisation (ERA).

Correlations R(τ) of a stationary record, from lag 1 on, are sums of free decays (James, Carne and
Lauffer 1993). Block Hankel matrices H0 and H1 of R, one lag apart, give H0 = U Σ Vᵀ and the state
matrix A = Σ^(-1/2) Uᵀ H1 V Σ^(-1/2) at an order (Juang and Pappa 1985); the poles are
ln(eig A)·rate, and shapes follow from the first block row of H0 for all sensors.
Standard deviations and correlations come from a jackknife: the record is divided into segments,
and the modes are identified again without each of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.measurements.records.local_fit import HEAVIEST
from bayes_ssi.measurements.records.modal_estimates import ModalEstimates, Poles, real_shapes
from bayes_ssi.measurements.records.record import Record
from bayes_ssi.structures.modal import mac

# Segments of the jackknife, each at least twice as long as the lags.
MOST_SEGMENTS, FEWEST_SEGMENTS = 20, 8
# The Hankel matrices reach over this many periods of the band's lowest frequency.
PERIODS = 3.0
# Directions of the most motion that take part in the Hankel matrices; there may be many sensors.
MOST_DIRECTIONS = 8
HIGHEST_ORDER = 40
# Poles of two orders, or of a record and a part of it, are one mode within these.
SAME_FREQUENCY, SAME_SHAPE = 0.05, 0.8


@dataclass(frozen=True, eq=False)
class Correlations:
    """Correlation functions of the segments of a record, with the directions of most motion.

    Attributes:
        sums: (segments, lags, n, r): R(τ), τ = 1, 2, …, of n sensors with r directions.
        directions: (n, r).
    """

    sums: FloatArray
    directions: FloatArray
    rate_hz: float
    band_hz: tuple[float, float]

    @property
    def whole(self) -> FloatArray:
        """(lags, n, r)"""
        return self.sums.mean(0)

    def without_each(self) -> Iterator[FloatArray]:
        """The correlations without each segment in turn."""
        total, n = self.sums.sum(0), len(self.sums)
        for own in self.sums:
            yield (total - own) / (n - 1)


def correlations(record: Record, band_hz: tuple[float, float]) -> Correlations:
    """Correlation functions of a record's segments."""
    from scipy.fft import irfft, next_fast_len, rfft

    low, high = record.checked_band(band_hz)
    slow = record.decimated_to(high).detrended()
    half = max(2, round(PERIODS * slow.rate_hz / low))
    n_lags = 2 * half
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
    for own, start in zip(sums, range(0, n_segments * length, length), strict=True):
        part = samples[:, start : start + length]
        transforms = rfft(part, n_padded)
        of_directions = rfft(directions.T @ part, n_padded)
        products = transforms[:, None] * of_directions.conj()
        own[:] = np.moveaxis(irfft(products, n_padded)[..., 1 : n_lags + 1] / pairs, -1, 0)
    return Correlations(sums, directions, slow.rate_hz, (low, high))


class Realisation(NamedTuple):
    """What is needed of Hankel matrices to find poles at any order up to the highest.

    Attributes:
        singular_values: (o,), of H0.
        shifted: (o, o), Uᵀ H1 V.
        first_row: (n, o), the first block row of H0 for all sensors, times V.
    """

    singular_values: FloatArray
    shifted: FloatArray
    first_row: FloatArray
    rate_hz: float
    band_hz: tuple[float, float]


def realisation(whole: FloatArray, data: Correlations) -> Realisation:
    """From correlations (lags, n, r), all or without a segment."""
    from scipy.linalg import svd

    blocks = np.einsum("sr,lsq->lrq", data.directions, whole)
    half, r = len(blocks) // 2, blocks.shape[1]
    at = np.arange(half)[:, None] + np.arange(half)

    def hankel(first: int) -> FloatArray:
        matrix: FloatArray = blocks[at + first].transpose(0, 2, 1, 3).reshape(half * r, half * r)
        return matrix

    left, values, right = svd(hankel(0), check_finite=False)
    most = min(HIGHEST_ORDER, len(values))
    left, right = left[:, :most], right[:most].T
    first_row = whole[:half].transpose(1, 0, 2).reshape(whole.shape[1], -1) @ right
    shifted = left.T @ hankel(1) @ right
    return Realisation(values[:most], shifted, first_row, data.rate_hz, data.band_hz)


def poles(of: Realisation, order: int) -> Poles:
    """The modes in the band at one order, of less damping than structures may have."""
    root = np.sqrt(of.singular_values[:order])
    discrete, states = np.linalg.eig(of.shifted[:order, :order] / root / root[:, None])
    with np.errstate(divide="ignore"):
        continuous = np.log(discrete.astype(complex)) * of.rate_hz
    size = np.maximum(np.abs(continuous), np.finfo(float).tiny)
    frequencies, dampings = size / (2.0 * np.pi), -continuous.real / size
    low, high = of.band_hz
    kept = (continuous.imag > 0.0) & (dampings > 0.0) & (dampings < HEAVIEST)
    kept &= (frequencies > low) & (frequencies < high)
    kept = np.flatnonzero(kept)[np.argsort(frequencies[kept])]
    shapes = (of.first_row[:, :order] / root) @ states[:, kept]
    return Poles(frequencies[kept], dampings[kept], real_shapes(shapes))


def next_era(data: Correlations, modes: Poles, sensors: tuple[str, ...]) -> ModalEstimates:
    """Frequencies, dampings and shapes of modes, with the covariance from a jackknife.

    The order is the lowest at which all modes appear in the record and without each segment.
    """
    parts = [realisation(part, data) for part in data.without_each()]
    whole = realisation(data.whole, data)
    for order in range(2 * len(modes.frequencies_hz), len(whole.singular_values) + 1, 2):
        center = _matched(poles(whole, order), modes)
        if center is None:
            continue
        others = [_matched(poles(part, order), center) for part in parts]
        if all(other is not None for other in others):
            break
    else:
        raise ValueError(
            "NExT-ERA: no order shows the modes at "
            + ", ".join(f"{f:.3f}" for f in modes.frequencies_hz)
            + " Hz in the record and without each of its segments"
        )
    vectors = np.array([_vector(other, center) for other in others if other is not None])
    n = len(vectors)
    deviations = vectors - vectors.mean(0)
    covariance = (n - 1) / n * deviations.T @ deviations
    return ModalEstimates("NExT-ERA", data.band_hz, sensors, *center, covariance, len(data.sums))


def _matched(candidates: Poles, modes: Poles) -> Poles | None:
    """Of the candidates, those that are the modes, each once; None if one is missing."""
    if not len(candidates.frequencies_hz):
        return None
    apart = np.abs(np.log(candidates.frequencies_hz[:, None] / modes.frequencies_hz))
    alike = mac(candidates.shapes, modes.shapes)
    apart = np.where((apart < SAME_FREQUENCY) & (alike > SAME_SHAPE), apart, np.inf)
    chosen = apart.argmin(0)
    if np.isinf(apart.min(0)).any() or len(set(chosen.tolist())) < len(chosen):
        return None
    return Poles(
        candidates.frequencies_hz[chosen], candidates.dampings[chosen], candidates.shapes[:, chosen]
    )


def _vector(modes: Poles, center: Poles) -> FloatArray:
    """(ln f, ln ζ, shapes) with the signs of the centre's shapes."""
    signs = np.sign((modes.shapes * center.shapes).sum(0))
    shapes = (modes.shapes * signs).T.ravel()
    return np.concatenate([np.log(modes.frequencies_hz), np.log(modes.dampings), shapes])
