"""Spectral matrices of a record in a band, by sine tapers, and how modes respond in them.

The sine tapers v_t(j) = √(2/(N+1)) sin(πtj/(N+1)), t = 1, 2, …, are orthonormal, so that for a
stationary record the w transforms of w tapers at one frequency are independent complex Gaussian
vectors, whose covariance is the spectral matrix there, averaged over w + 1 lines of width 1/T
(Riedel and Sidorenko 1995). They leak far less than the lines of a record that is cut off at its
ends, which is decisive where channels are coherent: what leaks from a resonance is larger than
the sensors' noise. A taper's transform is the difference of two lines of the record padded to
twice its length.

Around a few modes they are expressed in the directions in which the sensors move together. Channels
are scaled by the part of their power that no other channel explains, which is their noise or less;
the leading real directions of what is left hold all that modes do. In these few coordinates the
quiet part of the band has the unit matrix.
"""

import math
from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray, joined
from bayes_ssi.measurements.records.record import Record

BandHz = tuple[float, float]  # lowest and highest frequency
DAMPING = 0.015  # of structures, most probable before
MOST_DAMPING = 0.2  # structures, and dampers on them, are damped less

FEWEST_TAPERS = 3  # of two, blocks overlap: a quarter of the information counts twice
MOST_TAPERS_SUMMED = 64  # what blocks share is 1.2 transforms from here on, 1.4 at 400
LEVEL_WIDTH = 0.001  # to either side of a line, over which a sensor's level is a mean
FEWEST_LEVEL_LINES = 8  # half lines of that mean
QUIET_SHARE = 1.0 / 3.0  # of a band's blocks: its background
# Added to every direction, as shares of its quiet power and of the mean of all: a background
# that vanishes in some direction would explain blocks of few lines without bound.
FLOOR_SHARE = 0.1
MEAN_FLOOR_SHARE = 0.001

# Integrations that lead from accelerations to what is measured.
INTEGRATIONS = {"acceleration": 0, "velocity": 1, "displacement": 2}


class Spectra(NamedTuple):
    """Spectral matrices of K blocks of lines, ascending in frequency."""

    frequencies_hz: FloatArray  # (K,), centres of the blocks
    widths_hz: FloatArray  # (K,), over which each block's matrix is an average
    weights: FloatArray  # (K,), independent transforms that the block's matrix is the mean of
    # (K, n, n), Hermitian: two-sided power spectral densities of accelerations.
    matrices: ComplexArray


class Transforms(NamedTuple):
    """The lines of a band of a record padded to twice its length, as accelerations."""

    first: int
    line_hz: float
    share: float
    values: ComplexArray  # (n, L), half a line of the record apart

    @property
    def frequencies_hz(self) -> FloatArray:
        """(L,)"""
        return 0.5 * self.line_hz * np.arange(self.first, self.first + self.values.shape[1])

    @property
    def band_hz(self) -> BandHz:
        last = self.first + self.values.shape[1] - 1
        return 0.5 * self.line_hz * self.first, 0.5 * self.line_hz * last

    def turned(self, delays_s: FloatArray) -> "Transforms":
        """The lines of sensors that are no longer late by ``delays_s`` (n,)."""
        turns = np.exp(2j * np.pi * np.outer(delays_s, self.frequencies_hz))
        return self._replace(values=self.values * turns)

    def relative_to(self, sensor: int) -> "Transforms":
        """The lines over the level of one sensor's around each: amplification of its motion."""
        power = np.abs(self.values[sensor]) ** 2
        totals = np.concatenate([[0.0], np.cumsum(power)])
        places = np.arange(len(power))
        half_lines = np.round(LEVEL_WIDTH * (self.first + places))
        reach = np.maximum(FEWEST_LEVEL_LINES, half_lines).astype(int)
        low, high = np.maximum(places - reach, 0), np.minimum(places + reach + 1, len(power))
        level = (totals[high] - totals[low]) / (high - low)
        return self._replace(values=self.values / np.sqrt(np.maximum(level, np.finfo(float).tiny)))

    def spectra(self, low_hz: float, high_hz: float, relative_width: float) -> Spectra:
        """The spectral matrices of blocks of a band's lines; one of w tapers stands for w lines."""
        lowest, highest = self.band_hz
        low, high = max(low_hz, lowest) / self.line_hz, min(high_hz, highest) / self.line_hz
        centres, numbers, line = [], [], math.ceil(low)
        while line + (n := max(FEWEST_TAPERS, round(relative_width * line))) <= high:
            centres.append(2 * line + n - 1)  # in half lines
            numbers.append(n)
            line += n
        if not centres:
            raise ValueError(
                f"band_hz: the record has only {max(0, int(high) - math.ceil(low) + 1)} lines in "
                f"the band, fewer than {FEWEST_TAPERS}; take a wider band or a longer record"
            )
        matrices = np.empty((len(centres), len(self.values), len(self.values)), dtype=complex)
        for matrix, centre, n in zip(matrices, centres, numbers, strict=True):
            t, at = np.arange(1, n + 1), centre - self.first
            below, above = np.maximum(at - t, 0), np.minimum(at + t, self.values.shape[1] - 1)
            tapered = self.values[:, below] - self.values[:, above]
            matrix[:] = tapered @ tapered.conj().T / (n * self.share)
        return Spectra(
            0.5 * self.line_hz * np.array(centres, dtype=float),
            self.line_hz * (np.array(numbers) + 1.0),
            self.share * np.array([_independent(n) for n in numbers]),
            matrices,
        )


def transforms_of(
    record: Record, band_hz: BandHz, mask: FloatArray | None = None, n_before: int = 0
) -> Transforms:
    """The lines of a band; the samples have factors from 0 to 1, ``mask`` (N,), if it is given.

    ``n_before`` samples of rest precede them, so that tapers take little of what begins early.
    """
    from scipy.fft import rfft
    from scipy.signal import detrend

    n_padded = 2 * (n_before + record.n_samples + 1)
    line_hz = record.rate_hz * 2.0 / n_padded
    first = max(1, math.floor(2.0 * band_hz[0] / line_hz))
    last = min(n_padded // 2, math.ceil(2.0 * band_hz[1] / line_hz))
    values = np.empty((len(record.sensors), last - first + 1), dtype=complex)
    for row, samples in zip(values, record.samples, strict=True):
        straight = detrend(samples)
        if mask is not None:
            straight *= mask
        row[:] = rfft(np.pad(straight, (n_before, 0)), n_padded)[first : last + 1]
    omega = np.pi * line_hz * np.arange(first, last + 1)
    values *= omega ** INTEGRATIONS[record.quantity] / math.sqrt(record.rate_hz * n_padded)
    share = 1.0 if mask is None else float((mask**2).mean())
    share *= record.n_samples / (n_before + record.n_samples)
    return Transforms(first, line_hz, share, values)


@cache
def _independent(n: int) -> float:
    """Independent transforms in a block of n tapers, when blocks follow each other by n lines.

    Neighbouring blocks share what their tapers have in common: the sum of squared correlations
    of all pairs of transforms adds to the variance of every mean over many blocks.
    """
    m = min(n, MOST_TAPERS_SUMMED)
    t = np.arange(1, m + 1)
    shared = 0.0
    for apart in (1, 2, 3):  # those further apart share less than a thousandth
        total = np.zeros((m, m), dtype=complex)
        for sign, other in product((-1, 1), repeat=2):
            between = 2 * m * apart + other * t - sign * t[:, None]
            # ∫ exp(-iπ d x) dx from 0 to 1, for a whole d.
            odd = between % 2 != 0
            kernel = np.where(odd, 2.0 / (1j * np.pi * np.where(odd, between, 1)), between == 0)
            total += 0.5 * sign * other * kernel
        shared += 2.0 * float((np.abs(total) ** 2).sum())
    return n / (1.0 + shared / n)


class LocalSpectra(NamedTuple):
    """Spectral matrices of K blocks in r directions of n channels."""

    frequencies_hz: FloatArray  # (K,), centres of the blocks
    widths_hz: FloatArray  # (K,), of the blocks
    weights: FloatArray  # (K,), independent transforms of each
    matrices: ComplexArray  # (K, r, r)
    floor: FloatArray  # (r,), added to the diagonal in fits
    to_channels: FloatArray  # (n, r), what the channels measure of each direction
    from_channels: FloatArray  # (r, n), the directions of what channels measure
    # (K, n - r, r), cross spectra of all other directions, of unit noise, with these.
    rest: ComplexArray
    rest_to_channels: FloatArray  # (n, n - r)
    neighbours: "Resonances"  # p modes beside the band, in its directions
    of_neighbours: ComplexArray  # (K, p), their responses

    @property
    def band_hz(self) -> BandHz:
        """From where to where the blocks reach."""
        half = 0.5 * self.widths_hz
        return float(self.frequencies_hz[0] - half[0]), float(self.frequencies_hz[-1] + half[-1])

    @property
    def line_hz(self) -> float:
        """Width in Hz of one independent transform."""
        return float(self.widths_hz.sum() / self.weights.sum())

    @property
    def powers(self) -> FloatArray:
        """1, x, x² of the blocks (3, K), x from -1 to 1 over the band."""
        low, high = self.band_hz
        x = (2.0 * self.frequencies_hz - low - high) / (high - low)
        return np.stack([x**0, x, x**2])

    def beside(self, neighbours: "Resonances") -> "LocalSpectra":
        """The same beside modes of its directions."""
        return self._replace(neighbours=neighbours, of_neighbours=neighbours.responses(self))

    def motions(self, modes: "Resonances", h: ComplexArray) -> ComplexArray:
        """h φ of neighbours and modes (K, p + m, r)."""
        of_neighbours = self.of_neighbours[:, None] * self.neighbours.shapes
        both = np.concatenate([of_neighbours, h[:, None] * modes.shapes], axis=2)
        return np.asarray(both.swapaxes(1, 2))


def noise_scales(spectra: Spectra) -> FloatArray:
    """Root of the power (n,) of each channel that no other channel explains."""
    weights = spectra.weights / spectra.weights.sum()
    mean = np.einsum("k,kij->ij", weights, spectra.matrices)
    roots = np.sqrt(np.maximum(mean.diagonal().real, np.finfo(float).tiny))
    n, n_lines = len(mean), float(spectra.weights.sum())
    # Fewer lines than channels explain everything.
    ridge = 1e-9 + (n / n_lines if n_lines < 2.0 * n else 0.0)
    coherence = mean / roots / roots[:, None] + ridge * np.eye(n)
    partial = 1.0 / np.linalg.inv(coherence).diagonal().real
    return np.asarray(roots * np.sqrt(partial.clip(1e-9, 1.0)), dtype=np.float64)


def local_spectra(spectra: Spectra, n_directions: int) -> LocalSpectra:
    """The spectra in their leading directions."""
    scales = noise_scales(spectra)
    scaled = spectra.matrices / scales / scales[:, None]
    mean = np.einsum("k,kij->ij", spectra.weights, scaled.real) / spectra.weights.sum()
    vectors = np.linalg.eigh(mean)[1][:, ::-1]
    r = min(n_directions, len(scales))
    leading, others = vectors[:, :r], vectors[:, r:]
    powers = np.einsum("kii->k", scaled).real
    quiet = np.argsort(powers, kind="stable")[: max(1, round(QUIET_SHARE * len(powers)))]
    background = scaled[quiet].real.mean(0)
    values, turns = np.linalg.eigh(leading.T @ background @ leading)
    values = values.clip(1e-9 * values[-1])
    floored = (1.0 + FLOOR_SHARE) * values + MEAN_FLOOR_SHARE * values.mean()
    roots = np.sqrt(floored)
    noise = np.sqrt(np.einsum("ia,ij,ja->a", others, background, others).clip(1e-9))
    from_scaled = (leading @ turns / roots).T
    rest_from_scaled = (others / noise).T
    return LocalSpectra(
        *spectra[:3],
        from_scaled @ scaled @ from_scaled.T,
        1.0 - values / floored,
        scales[:, None] * (leading @ turns * roots),
        from_scaled / scales,
        rest_from_scaled @ scaled @ from_scaled.T,
        scales[:, None] * (others * noise),
        Resonances.none(r),
        np.empty((len(powers), 0), dtype=complex),
    )


class Resonances(NamedTuple):
    """m modes without errors in r directions or n channels."""

    frequencies_hz: FloatArray  # (m,)
    dampings: FloatArray  # (m,), fractions of critical damping
    shapes: NDArray[Any]  # (r, m), complex or real, at unit length

    @classmethod
    def none(cls, n: int) -> "Resonances":
        return cls(np.empty(0), np.empty(0), np.empty((n, 0), dtype=complex))

    @property
    def n_modes(self) -> int:
        return len(self.frequencies_hz)

    def at(self, places: Sequence[int] | NDArray[Any]) -> "Resonances":
        """Those at some places, or those that a mask (m,) leaves."""
        return Resonances(*(array[..., list(places)] for array in self))

    def without(self, *places: int) -> "Resonances":
        return self.at([i for i in range(self.n_modes) if i not in places])

    def joined(self, others: "Resonances") -> "Resonances":
        """These modes and others, in ascending order."""
        both = self.beside(others)
        return both.at(np.argsort(both.frequencies_hz, kind="stable"))

    def beside(self, others: "Resonances") -> "Resonances":
        """These modes, and then the others."""
        return joined([self, others], axis=-1)

    @property
    def half_widths_hz(self) -> FloatArray:
        """Half of the half-power bandwidths, ζ f (m,)."""
        return self.dampings * self.frequencies_hz

    def in_directions(self, data: LocalSpectra) -> "Resonances":
        """Modes of all channels in the directions of a band, at unit length, turned."""
        shapes = data.from_channels @ self.shapes
        lengths = np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)
        return self._replace(shapes=turned(shapes / lengths))

    def responses(self, data: LocalSpectra) -> ComplexArray:
        """Means of h = 1 / (1 - β² - 2i ζ β) over the blocks (K, m), β the mode's f over f."""
        return self.response_slopes(data)[0]

    def response_slopes(
        self, data: LocalSpectra
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Means of h over the blocks, and their derivatives by ln f and ln ζ, (K, m) each."""
        f, zeta = self.frequencies_hz, self.dampings.clip(1e-6, 0.99)
        root = np.sqrt(1.0 - zeta**2)
        p, conjugate = poles = f * np.array([1j * zeta + root, 1j * zeta - root])
        # h = f² / ((f - p)(f - p')) = 1 + [p² / (f - p) - p'² / (f - p')] / (p - p')
        centres, halves = data.frequencies_hz[:, None], 0.5 * data.widths_hz[:, None]
        poles = poles[:, None]
        low, high = centres - halves - poles, centres + halves - poles
        means = np.log(high / low) / (2.0 * halves)  # of 1 / (f - p)
        a, b = poles**2 * means
        a_slope, b_slope = 2.0 * poles * means + poles**2 / (low * high)  # by p
        apart = p - conjugate
        h = 1.0 + (a - b) / apart

        def slope(of_p: ComplexArray, of_conjugate: ComplexArray) -> ComplexArray:
            change = a_slope * of_p - b_slope * of_conjugate
            return (change - (h - 1.0) * (of_p - of_conjugate)) / apart

        by_zeta = zeta * f
        return (
            h,
            slope(p, conjugate),
            slope(by_zeta * (1j - zeta / root), by_zeta * (1j + zeta / root)),
        )


def turned(shapes: ComplexArray) -> ComplexArray:
    """Shapes (n,) or (n, m) at the phase at which their real parts are longest."""
    return np.asarray(shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0))))


def real_shapes(shapes: NDArray[Any]) -> FloatArray:
    """The real parts of turned shapes (n, m), at unit length, the largest component positive."""
    real = turned(shapes).real
    real = real / np.sqrt((real**2).sum(0))
    largest = np.abs(real).argmax(0)
    return np.asarray(real * np.sign(real[largest, np.arange(real.shape[1])]))
