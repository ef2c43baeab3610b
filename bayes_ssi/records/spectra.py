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
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.record import Record

# Blocks of fewer lines overlap too much: of two, a quarter of the information is counted twice.
FEWEST_TAPERS = 3
# Entries of matrices that are computed at once: 32 megabytes.
MOST_ENTRIES = 2_000_000


class Spectra(NamedTuple):
    """Spectral matrices of K blocks of lines, ascending in frequency.

    Attributes:
        frequencies_hz: (K,), centres of the blocks.
        weights: (K,), independent transforms that the block's matrix is the mean of.
        matrices: (K, n, n), Hermitian: two-sided power spectral densities, unit² / Hz.
        log_determinants: (K,), means over each block of those of the matrices by which its lines
            were divided; zero where they were not.
    """

    frequencies_hz: FloatArray
    weights: FloatArray
    matrices: ComplexArray
    log_determinants: FloatArray


class Lines(NamedTuple):
    """The lines of a band of a record padded to twice its length, and their division in blocks.

    Attributes:
        frequencies_hz: (L,), half a line of the record apart.
        transforms: (n, L).
        centres: (K,), the line at the centre of each block.
        n_tapers: (K,), of each block, which stands for as many lines of the record.
    """

    frequencies_hz: FloatArray
    transforms: ComplexArray
    centres: NDArray[np.intp]
    n_tapers: NDArray[np.intp]


def lines_of(record: Record, band_hz: tuple[float, float], relative_width: float) -> Lines:
    """The lines of a band.

    Args:
        record: the record; its means and linear trends are left out.
        band_hz: lowest and highest frequency.
        relative_width: width of a block over its frequency.

    Raises:
        ValueError: the record does not cover the band, or has too few lines in it.
    """
    from scipy.fft import rfft
    from scipy.signal import detrend

    low, high = record.checked_band(band_hz)
    n_padded = 2 * (record.n_samples + 1)
    line_hz = record.rate_hz * 2.0 / n_padded
    highest = min(high / line_hz, n_padded / 4)
    centres, n_tapers = _blocks(low / line_hz, highest, relative_width)
    first, last = int(centres[0] - n_tapers[0]), int(centres[-1] + n_tapers[-1])
    transforms = np.empty((len(record.sensors), last - first + 1), dtype=complex)
    for row, samples in zip(transforms, record.samples, strict=True):
        row[:] = rfft(detrend(samples), n_padded)[first : last + 1]
    transforms /= np.sqrt(record.rate_hz * n_padded)
    frequencies = 0.5 * line_hz * np.arange(first, last + 1, dtype=float)
    return Lines(frequencies, transforms, centres - first, n_tapers)


def spectra(lines: Lines, model: Callable[[FloatArray], ComplexArray] | None = None) -> Spectra:
    """The spectral matrices of the blocks.

    Args:
        lines: of a band.
        model: spectral matrices (L, n, n) at frequencies (L,), or None. Where they are given,
            every line is divided by the Cholesky factor of its own before lines are averaged, and
            the average is multiplied by that at the centre: what the model says of differences
            between the lines of a block is no error of their average then.
    """
    n = len(lines.transforms)
    matrices = np.empty((len(lines.centres), n, n), dtype=complex)
    log_determinants = np.zeros(len(matrices))
    for chunk in _chunks(lines):
        ends = chunk[[0, -1]]
        first, last = lines.centres[ends] + np.array([-1, 1]) * lines.n_tapers[ends]
        transforms = lines.transforms[:, first : last + 1]
        if model is not None:
            factors: ComplexArray = np.linalg.cholesky(
                model(lines.frequencies_hz[first : last + 1])
            )
            transforms = _solved(factors, transforms)
            logs = 2.0 * np.log(factors.diagonal(axis1=1, axis2=2).real).sum(1)
        for block in chunk:
            t = np.arange(1, lines.n_tapers[block] + 1)
            centre = lines.centres[block] - first
            tapered = transforms[:, centre - t] - transforms[:, centre + t]
            matrices[block] = tapered @ tapered.conj().T / len(t)
            if model is not None:
                log_determinants[block] = logs[centre - len(t) + 1 : centre + len(t)].mean()
    frequencies = lines.frequencies_hz[lines.centres]
    if model is not None:
        factors = np.linalg.cholesky(model(frequencies))
        matrices = factors @ matrices @ factors.conj().swapaxes(1, 2)
    weights = np.array([_independent(int(n)) for n in lines.n_tapers])
    return Spectra(frequencies, weights, matrices, log_determinants)


def _solved(factors: ComplexArray, transforms: ComplexArray) -> ComplexArray:
    """Transforms (n, L), each divided by its own factor (L, n, n)."""
    return np.linalg.solve(factors, transforms.T[..., None])[..., 0].T


def _chunks(lines: Lines) -> list[NDArray[np.intp]]:
    """Blocks, in groups whose lines need not much memory."""
    n_lines = MOST_ENTRIES // len(lines.transforms) ** 2
    groups = (lines.centres - lines.centres[0]) // max(1, n_lines)
    return np.split(np.arange(len(groups)), np.flatnonzero(np.diff(groups)) + 1)


def _blocks(low: float, high: float, relative_width: float) -> tuple[NDArray[np.intp], ...]:
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
    return np.array(centres), np.array(numbers)


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
