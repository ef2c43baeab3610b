"""Candidates for modes: poles that orders agree on, and peaks of the first singular value.

Each octave is a complex signal of its own: its lines, with flanks to either side, in the leading
directions of channels scaled to equal noise, so that strong motion elsewhere and quiet sensors are
no matter. Correlations of that signal are free decays (James, Carne and Lauffer 1993), whose block
Hankel matrices give poles at every order (Juang and Pappa 1985); a mode has one pole, not two.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray, joined
from bayes_ssi.measurements.records.spectra import (
    DAMPING,
    MOST_DAMPING,
    BandHz,
    Resonances,
    Spectra,
    Transforms,
    noise_scales,
)

SECTION_FACTOR = 2.0  # from the lowest to the highest frequency of a section
FLANK_FACTOR = 1.25  # by which a section's data reach farther
MOST_DIRECTIONS = 8  # of most motion, in Hankel matrices
BLOCK_ROWS = 24  # of Hankel matrices
HIGHEST_ORDER = 24
SAME_LOG_FREQUENCY = 0.015  # poles of two orders are one mode within this
SAME_SHAPE_MAC = 0.8  # and above this
LEAST_SHARE_OF_ORDERS = 0.3  # from which a pole may be a mode
PEAK_DB = 3.0  # by which peaks stand out
PEAK_SDS = 2.5  # standard deviations of the spectrum by which they do
CLEAR_PEAK_DB = 6.0  # those whose mode is not left out
CLEAR_PEAK_SDS = 4.5
BLOCK_WIDTH = 0.006  # of the blocks of lines for peaks
FEWEST_BLOCK_LINES = (8, 4)  # for wide and for narrow peaks
DAMPINGS_AT_PEAKS = (0.004, 0.1)  # of poles at peaks, as of structures


class Prominence(NamedTuple):
    """A peak of the first singular value."""

    frequency_hz: float
    width_hz: float
    prominence_db: float
    is_clear: bool


class Candidates(NamedTuple):
    """Candidates of a range of frequencies."""

    peaks: tuple[Prominence, ...]
    of_peaks: Resonances  # the pole at each peak, with shapes (n, p) in channels
    others: Resonances
    shares: FloatArray  # (o,), of the orders that have each of the others
    stabilisation: FloatArray  # (2, a), frequency and order of every pole of every order

    @property
    def poles(self) -> Resonances:
        return self.of_peaks.beside(self.others)

    def turned(self, delays_s: FloatArray) -> "Candidates":
        """Candidates of sensors that are no longer late by ``delays_s`` (n,)."""

        def on_time(modes: Resonances) -> Resonances:
            turns = np.exp(2j * np.pi * delays_s[:, None] * modes.frequencies_hz)
            return modes._replace(shapes=modes.shapes * turns)

        return self._replace(of_peaks=on_time(self.of_peaks), others=on_time(self.others))


def candidates(transforms: Transforms, low_hz: float, high_hz: float) -> Candidates:
    """Candidates of a range, section by section."""
    n_sections = max(1, round(math.log(high_hz / low_hz) / math.log(SECTION_FACTOR)))
    edges = np.geomspace(low_hz, high_hz, n_sections + 1).tolist()
    sections = [_Section(transforms, *ends).candidates() for ends in pairwise(edges)]
    peaks, of_peaks, others, shares, orders = zip(*sections, strict=True)
    return Candidates(
        tuple(chain(*peaks)), joined(of_peaks, axis=-1), joined(others, axis=-1),
        np.concatenate(shares), np.concatenate(orders, axis=1),
    )  # fmt: skip


def given_candidates(transforms: Transforms, band_hz: BandHz, at: Sequence[float]) -> Candidates:
    """Candidates at given frequencies, with the directions of most motion there as shapes."""
    low, high = band_hz
    frequencies = np.sort(np.array(at, dtype=float))
    if frequencies[0] <= low or frequencies[-1] >= high:
        raise ValueError(f"at: frequencies must be within {low:g} to {high:g} Hz, got {list(at)}")
    n, n_lines = len(transforms.values), int((high - low) / transforms.line_hz)
    n_unknowns = len(frequencies) * (3 * n + 1)
    if n * n_lines < n_unknowns:
        raise ValueError(
            f"the band has {n_lines} lines of {n} sensors, fewer than the {n_unknowns} unknowns of "
            f"{len(frequencies)} modes; give fewer modes, or a wider band or a longer record"
        )
    shapes = np.empty((n, len(frequencies)), dtype=complex)
    for i, f in enumerate(frequencies):
        half = max(DAMPING * f, 2.0 * transforms.line_hz)
        data = transforms.spectra(f - half, f + 2.0 * half, DAMPING)
        # Frequencies given closer than a bandwidth share a peak, and take one direction each.
        sharing = int((np.abs(np.log(frequencies[:i] / f)) < 2.0 * DAMPING).sum())
        directions = np.linalg.eigh(data.matrices[0].real)[1]
        shapes[:, i] = directions[:, -1 - min(sharing, directions.shape[1] - 1)]
    peaks = tuple(Prominence(float(f), 0.0, 0.0, True) for f in frequencies)
    modes = Resonances(frequencies, np.full(len(frequencies), DAMPING / 1.5), shapes)
    return Candidates(peaks, modes, modes.at([]), np.empty(0), np.empty((2, 0)))


class _Section:
    """Lines from below ``low`` to above ``high``, in leading directions."""

    def __init__(self, transforms: Transforms, low: float, high: float) -> None:
        self.transforms, self.low, self.high = transforms, low, high
        first, last = transforms.band_hz
        self.from_hz = max(first, low / FLANK_FACTOR)
        self.to_hz = min(last, high * FLANK_FACTOR)
        spectra = self._spectra(FEWEST_BLOCK_LINES[0], math.sqrt(low * high))
        self.scales = noise_scales(spectra)
        scaled = spectra.matrices / self.scales / self.scales[:, None]
        mean = np.einsum("k,kij->ij", spectra.weights, scaled.real)
        vectors = np.linalg.eigh(mean)[1][:, ::-1]
        self.leading = vectors[:, :MOST_DIRECTIONS]

    def _spectra(self, n_lines: int, frequency_hz: float) -> Spectra:
        """In blocks of so many lines at least at a frequency."""
        width = max(BLOCK_WIDTH, n_lines * self.transforms.line_hz / frequency_hz)
        return self.transforms.spectra(self.from_hz, self.to_hz, width)

    def candidates(self) -> Candidates:
        poles, shares, stabilisation = self._poles()
        free = np.ones(len(shares), dtype=bool)
        peaks, of_peaks = list[Prominence](), [Resonances.none(len(self.scales))]
        for peak, vector in self._peaks():
            reach = np.maximum(poles.half_widths_hz, 1.5 * peak.width_hz)
            apart = np.abs(poles.frequencies_hz - peak.frequency_hz) / reach
            near = free & (apart < 1.0)
            if near.any():
                best = int(np.where(near, shares * np.exp(-(apart**2)), -1.0).argmax())
                free[best] = False
                pole = poles.at([best])
                pole = pole._replace(dampings=pole.dampings.clip(*DAMPINGS_AT_PEAKS))
            else:
                damping = np.array([DAMPING / 1.5])
                pole = Resonances(np.array([peak.frequency_hz]), damping, vector[:, None])
            peaks.append(peak)
            of_peaks.append(pole)
        at_peaks = joined(of_peaks, axis=-1)
        return Candidates(tuple(peaks), at_peaks, poles.at(free), shares[free], stabilisation)

    def _peaks(self) -> list[tuple[Prominence, ComplexArray]]:
        """Peaks, and their singular vectors in channels."""
        peaks: list[tuple[Prominence, ComplexArray]] = []
        for n_lines in FEWEST_BLOCK_LINES:
            spectra = self._spectra(n_lines, self.low)
            powers = np.einsum("k,kii->i", spectra.weights, spectra.matrices).real
            for scales in (self.scales, np.sqrt((powers / powers.mean()).clip(1e-12))):
                for peak, vector in self._peaks_of(spectra, scales):
                    f, width = peak.frequency_hz, peak.width_hz
                    for i, (other, its_vector) in enumerate(peaks):
                        if abs(f - other.frequency_hz) < max(width, other.width_hz):
                            is_clear = other.is_clear or peak.is_clear
                            peaks[i] = other._replace(is_clear=is_clear), its_vector
                            break
                    else:
                        peaks.append((peak, vector))
        return sorted(peaks, key=lambda peak_and_vector: peak_and_vector[0].frequency_hz)

    def _peaks_of(
        self, spectra: Spectra, scales: FloatArray
    ) -> Iterator[tuple[Prominence, ComplexArray]]:
        from scipy.signal import find_peaks

        values, vectors = np.linalg.eigh(spectra.matrices / scales / scales[:, None])
        levels = 10.0 * np.log10(np.maximum(values[:, -1], np.finfo(float).tiny))
        tops, properties = find_peaks(levels, prominence=PEAK_DB)
        for top, db in zip(tops, properties["prominences"].tolist(), strict=True):
            f = float(spectra.frequencies_hz[top])
            sds = db / (4.34 * math.sqrt(2.0 / spectra.weights[top]))
            if sds < PEAK_SDS or not self.low <= f < self.high:
                continue
            clear = db > CLEAR_PEAK_DB and sds > CLEAR_PEAK_SDS
            shape = scales * vectors[top, :, -1]
            peak = Prominence(f, float(spectra.widths_hz[top]), db, bool(clear))
            yield peak, shape / np.linalg.norm(shape)

    def _poles(self) -> tuple[Resonances, FloatArray, FloatArray]:
        """Poles of clusters of orders, the share of orders that have each, and poles of orders."""
        from scipy.cluster.hierarchy import fcluster, linkage
        from scipy.spatial.distance import squareform

        of_orders = [*self._poles_of_orders()]
        f, zeta, shapes = joined(of_orders, axis=-1)
        n_orders = len(of_orders)
        orders = np.repeat(np.arange(1, n_orders + 1), [poles.n_modes for poles in of_orders])
        stabilisation = np.array([f, orders], dtype=float)
        if len(f) < 2:
            return Resonances.none(len(self.scales)), np.empty(0), stabilisation
        distances = np.abs(np.log(f[:, None] / f)) / SAME_LOG_FREQUENCY
        differences = (1.0 - np.abs(shapes.conj().T @ shapes) ** 2).clip(0.0)
        distances += differences / (1.0 - SAME_SHAPE_MAC)
        distances[np.equal.outer(orders, orders)] += 10.0  # two poles of one order are two modes
        np.fill_diagonal(distances, 0.0)
        labels = fcluster(linkage(squareform(distances, checks=False), "average"), 1.0, "distance")
        clusters = (np.flatnonzero(labels == label) for label in range(1, labels.max() + 1))
        often = [each for each in clusters if len(each) / n_orders >= LEAST_SHARE_OF_ORDERS]
        shares = np.array([len(each) for each in often]) / n_orders
        # The pole of the most usual damping.
        chosen = [int(c[np.abs(zeta[c] - np.median(zeta[c])).argmin()]) for c in often]
        in_channels = self.scales[:, None] * (self.leading @ shapes[:, chosen])
        in_channels /= np.linalg.norm(in_channels, axis=0)
        ascending = np.argsort(f[chosen])
        poles = Resonances(f[chosen], zeta[chosen], in_channels).at(ascending)
        return poles, shares[ascending], stabilisation

    def _poles_of_orders(self) -> Iterator[Resonances]:
        """Poles in the section, and their shapes in its directions, by every order from 1 on.

        Block Hankel matrices H0 and H1 of the correlations, one lag apart, give H0 = U Σ Vᴴ and the
        state matrix A = Σ^(-1/2) Uᴴ H1 V Σ^(-1/2) at an order (Juang and Pappa 1985); the poles are
        ln(eig A) / step, and shapes follow from the first block row of H0.
        """
        from scipy.linalg import svd

        correlations, step_s, start_hz = self._correlations()
        n, r = min(BLOCK_ROWS, (len(correlations) - 2) // 3), correlations.shape[1]
        blocks = (correlations[np.add.outer(range(n), range(lag, n + lag))] for lag in (1, 2))
        h0, h1 = (each.transpose(0, 2, 1, 3).reshape(n * r, n * r) for each in blocks)
        left, values, right = svd(h0, check_finite=False)
        highest = min(HIGHEST_ORDER, int((values > 1e-10 * values[0]).sum()))
        root = np.sqrt(values[:highest])
        left, right = left[:, :highest], right[:highest].conj().T
        shifted = left.conj().T @ h1 @ right / root / root[:, None]
        first_rows = left[:r] * root
        for order in range(1, highest + 1):
            discrete, states = np.linalg.eig(shifted[:order, :order])
            with np.errstate(divide="ignore"):
                exponents = np.log(discrete.astype(complex)) / step_s
            omega = 2.0 * np.pi * start_hz + np.mod(exponents.imag, 2.0 * np.pi / step_s)
            size = np.hypot(omega, exponents.real)
            f, dampings = size / (2.0 * np.pi), -exponents.real / size
            kept = (dampings > 1e-4) & (dampings < MOST_DAMPING) & (f >= self.low) & (f < self.high)
            shapes = first_rows[:, :order] @ states[:, kept]
            yield Resonances(f[kept], dampings[kept], shapes / np.linalg.norm(shapes, axis=0))

    def _correlations(self) -> tuple[ComplexArray, float, float]:
        """Correlations (lags, r, r), the step of lags, and the frequency from which they turn."""
        values, line = self.transforms.values, self.transforms.line_hz
        start, end = (
            round(2.0 * f / line) - self.transforms.first for f in (self.from_hz, self.to_hz)
        )
        centres = np.arange(max(start, 3), min(end, values.shape[1] - 4), 2)
        frequencies = 0.5 * line * (self.transforms.first + centres)
        below = (frequencies - frequencies[0]) / max(self.low - self.from_hz, line)
        above = (frequencies[-1] - frequencies) / max(self.to_hz - self.high, line)
        window = np.sin(0.5 * np.pi * np.minimum(np.minimum(below, above), 1.0)) ** 2
        projection = (self.leading / self.scales[:, None]).T
        pairs = [(values[:, centres - t], values[:, centres + t]) for t in (1, 2, 3)]
        tapered = (projection @ (lower - upper) for lower, upper in pairs)
        products = sum(np.einsum("ik,jk->kij", each, each.conj()) for each in tapered)
        correlations = np.fft.ifft(window[:, None, None] * products, axis=0)
        return correlations, 1.0 / (len(centres) * line), float(frequencies[0])
