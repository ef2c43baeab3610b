"""Spectral matrices of a record in a band, by sine tapers.

The sine tapers v_t(j) = √(2/(N+1)) sin(πtj/(N+1)), t = 1, 2, …, are orthonormal, so that for a
stationary record the w transforms of w tapers at one frequency are independent complex Gaussian
vectors, whose covariance is the spectral matrix there, averaged over w + 1 lines of width 1/T
(Riedel and Sidorenko 1995). They leak far less than the lines of a record that is cut off at its
ends, which is decisive where channels are coherent: what leaks from a resonance is larger than
the sensors' noise. A taper's transform is the difference of two lines of the record padded to
twice its length.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.record import Record

# Blocks of fewer lines overlap too much: of two, a quarter of the information is counted twice.
FEWEST_TAPERS = 3
# A sensor's level around a line is the mean of this share of the frequency to either side, and of
# so many half lines at least.
LEVEL_WIDTH, LINES_OF_LEVEL = 0.001, 8
# Integrations that lead from accelerations to what is measured.
INTEGRATIONS = {"acceleration": 0, "velocity": 1, "displacement": 2}


class Spectra(NamedTuple):
    """Spectral matrices of K blocks of lines, ascending in frequency.

    Attributes:
        frequencies_hz: (K,), centres of the blocks.
        widths_hz: (K,), over which each block's matrix is an average.
        weights: (K,), independent transforms that the block's matrix is the mean of.
        matrices: (K, n, n), Hermitian: two-sided power spectral densities of accelerations.
    """

    frequencies_hz: FloatArray
    widths_hz: FloatArray
    weights: FloatArray
    matrices: ComplexArray


class Transforms(NamedTuple):
    """The lines of a band of a record padded to twice its length, as accelerations.

    Attributes:
        values: (n, L), half a line of the record apart.
    """

    first: int
    line_hz: float
    share: float
    values: ComplexArray

    @property
    def frequencies_hz(self) -> FloatArray:
        """(L,)"""
        return 0.5 * self.line_hz * np.arange(self.first, self.first + self.values.shape[1])

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        last = self.first + self.values.shape[1] - 1
        return 0.5 * self.line_hz * self.first, 0.5 * self.line_hz * last

    def turned(self, delays_s: FloatArray) -> Transforms:
        """The lines of sensors that are no longer late by ``delays_s`` (n,)."""
        turns = np.exp(2j * np.pi * np.outer(delays_s, self.frequencies_hz))
        return self._replace(values=self.values * turns)

    def relative_to(self, sensor: int) -> Transforms:
        """The lines over the level of one sensor's around each: amplification of its motion."""
        power = np.abs(self.values[sensor]) ** 2
        totals = np.concatenate([[0.0], np.cumsum(power)])
        places = np.arange(len(power))
        reach = np.maximum(LINES_OF_LEVEL, np.round(LEVEL_WIDTH * (self.first + places))).astype(
            int
        )
        low, high = np.maximum(places - reach, 0), np.minimum(places + reach + 1, len(power))
        level = (totals[high] - totals[low]) / (high - low)
        return self._replace(values=self.values / np.sqrt(np.maximum(level, np.finfo(float).tiny)))

    def spectra(self, low_hz: float, high_hz: float, relative_width: float) -> Spectra:
        """The spectral matrices of blocks of a band's lines."""
        low, high = self.band_hz
        centres, numbers = _blocks(
            max(low_hz, low) / self.line_hz, min(high_hz, high) / self.line_hz, relative_width
        )
        matrices = np.empty((len(centres), len(self.values), len(self.values)), dtype=complex)
        for matrix, centre, n in zip(matrices, centres, numbers, strict=True):
            t = np.arange(1, n + 1)
            at = centre - self.first
            below, above = np.maximum(at - t, 0), np.minimum(at + t, self.values.shape[1] - 1)
            tapered = self.values[:, below] - self.values[:, above]
            matrix[:] = tapered @ tapered.conj().T / (n * self.share)
        weights = self.share * np.array([_independent(int(n)) for n in numbers])
        return Spectra(
            0.5 * self.line_hz * np.array(centres, dtype=float),
            self.line_hz * (np.array(numbers) + 1.0),
            weights,
            matrices,
        )


def transforms_of(
    record: Record, band_hz: tuple[float, float], mask: FloatArray | None = None
) -> Transforms:
    """The lines of a band.

    Args:
        mask: (N,) factors of the samples, from 0 to 1; all 1 if None.
    """
    from scipy.fft import rfft
    from scipy.signal import detrend

    n_padded = 2 * (record.n_samples + 1)
    line_hz = record.rate_hz * 2.0 / n_padded
    first = max(1, math.floor(2.0 * band_hz[0] / line_hz))
    last = min(n_padded // 2, math.ceil(2.0 * band_hz[1] / line_hz))
    values = np.empty((len(record.sensors), last - first + 1), dtype=complex)
    for row, samples in zip(values, record.samples, strict=True):
        straight = detrend(samples)
        if mask is not None:
            straight *= mask
        row[:] = rfft(straight, n_padded)[first : last + 1]
    omega = np.pi * line_hz * np.arange(first, last + 1)
    values *= omega ** INTEGRATIONS[record.quantity] / math.sqrt(record.rate_hz * n_padded)
    return Transforms(first, line_hz, 1.0 if mask is None else float((mask**2).mean()), values)


def _blocks(low: float, high: float, relative_width: float) -> tuple[list[int], list[int]]:
    """Centres of the blocks, in half lines, and their numbers of tapers.

    A block of w tapers stands for w lines.
    """
    centres, numbers = [], []
    line = math.ceil(low)
    while True:
        n = max(FEWEST_TAPERS, round(relative_width * line))
        if line + n > high:
            break
        centres.append(2 * line + n - 1)
        numbers.append(n)
        line += n
    if not centres:
        raise ValueError(
            f"band_hz: the record has only {max(0, int(high) - math.ceil(low) + 1)} lines in the "
            f"band, fewer than {FEWEST_TAPERS}; take a wider band or a longer record"
        )
    return centres, numbers


@cache
def _independent(n: int) -> float:
    """Independent transforms in a block of n tapers, when blocks follow each other by n lines.

    Neighbouring blocks share what their tapers have in common: the sum of squared correlations
    of all pairs of transforms adds to the variance of every mean over many blocks.
    """
    t = np.arange(1, n + 1)
    shared = 0.0
    for apart in (1, 2, 3):  # those further apart share less than a thousandth
        total = np.zeros((n, n), dtype=complex)
        for sign in (-1, 1):
            for other in (-1, 1):
                between = 2 * n * apart + other * t - sign * t[:, None]
                # ∫ exp(-iπ d x) dx from 0 to 1, for a whole d.
                odd = between % 2 != 0
                kernel = np.where(odd, 2.0 / (1j * np.pi * np.where(odd, between, 1)), between == 0)
                total += 0.5 * sign * other * kernel
        shared += 2.0 * float((np.abs(total) ** 2).sum())
    return n / (1.0 + shared / n)
