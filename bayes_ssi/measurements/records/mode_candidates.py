"""Candidates for modes: poles that orders agree on, and peaks of the first singular value.

Each octave is a complex signal of its own: its lines, with flanks to either side, in the leading
directions of channels scaled to equal noise, so that strong motion elsewhere and quiet sensors are
no matter. Correlations of that signal are free decays (James, Carne and Lauffer 1993), whose block
Hankel matrices give poles at every order (Juang and Pappa 1985); a mode has one pole, not two.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.local_fit import DAMPING, HEAVIEST
from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.local_spectra import noise_scales
from bayes_ssi.measurements.records.spectra import Spectra, Transforms

# The probability that leaves no doubt, in words.
SURE = 0.95


class Peak(NamedTuple):
    """A peak of the spectra, and how many modes it holds.

    Attributes:
        modes: their places among those quoted, from 0.
        probability_of_two: that it holds two modes rather than one, with real shapes or with
            phases, each explanation equally probable before; None where the spectra around it are
            explained by none.
    """

    frequencies_hz: tuple[float, ...]
    modes: tuple[int, ...]
    probability_of_two: float | None
    probability_of_phases: float | None
    resolution_hz: float
    resolution: float

    def __str__(self) -> str:
        at = " and ".join(f"{f:.4g}" for f in self.frequencies_hz)
        p, phases = self.probability_of_two, self.probability_of_phases
        if p is None or phases is None:
            return f"peak at {at} Hz: the spectra around it are not explained"
        text = f"peak at {at} Hz: two modes with a probability {_chance(p)}"
        if phases > 0.5:
            text += f", one mode whose sensors have phases with {_chance(phases)}"
        if p > SURE:
            return text
        closer = f"{self.resolution_hz:.2g} Hz ({self.resolution:.2g} bandwidths)"
        if p < 1.0 - SURE:
            return f"{text}; modes closer than about {closer} could not be told apart"
        return f"{text}: the record cannot tell"


def _chance(p: float) -> str:
    return "above 0.999" if p > 0.999 else "below 0.001" if p < 0.001 else f"{p:.3f}"


# Sections of the search reach from one frequency to this multiple; data reach farther by the flank.
SECTION, FLANK = 2.0, 1.25
MOST_DIRECTIONS, BLOCK_ROWS, HIGHEST_ORDER = 8, 24, 24
# Poles of two orders are one mode within these.
SAME_FREQUENCY, SAME_SHAPE = 0.015, 0.8
# Share of the orders from which a pole may be a mode.
POSSIBLE = 0.3
# Peaks stand out by so many dB, and by so many standard deviations of the spectrum; clear ones by
# more.
PEAK_DB, PEAK_SDS = 3.0, 2.5
CLEAR_DB, CLEAR_SDS = 6.0, 4.5
# Blocks of lines for peaks: relative width, and fewest lines, for wide and for narrow peaks.
RELATIVE_WIDTH, FEWEST_LINES = 0.006, (8, 4)
# Poles at peaks are damped as structures are.
USUAL_DAMPINGS = (0.004, 0.06)


class Prominence(NamedTuple):
    """A peak of the first singular value."""

    frequency_hz: float
    width_hz: float
    prominence_db: float
    is_clear: bool


class Candidates(NamedTuple):
    """Candidates of a range of frequencies.

    Attributes:
        of_peaks: the pole at each peak, with shapes (n, p) in channels.
        shares: (o,), of the orders that have each of the others.
        stabilisation: (2, a), frequency and order of every pole of every order.
    """

    peaks: tuple[Prominence, ...]
    of_peaks: Resonances
    others: Resonances
    shares: FloatArray
    stabilisation: FloatArray

    @property
    def poles(self) -> Resonances:
        """All poles."""
        return self.of_peaks.beside(self.others)

    def turned(self, delays_s: FloatArray) -> Candidates:
        """Candidates of sensors that are no longer late by ``delays_s`` (n,)."""

        def on_time(modes: Resonances) -> Resonances:
            turns = np.exp(2j * np.pi * delays_s[:, None] * modes.frequencies_hz)
            return modes._replace(shapes=modes.shapes * turns)

        return self._replace(of_peaks=on_time(self.of_peaks), others=on_time(self.others))


def no_resonances(n: int) -> Resonances:
    """None, of n channels."""
    return Resonances(np.empty(0), np.empty(0), np.empty((n, 0), dtype=complex))


def candidates(transforms: Transforms, low_hz: float, high_hz: float) -> Candidates:
    """Candidates of a range, section by section."""
    n = len(transforms.values)
    n_sections = max(1, round(math.log(high_hz / low_hz) / math.log(SECTION)))
    edges = np.geomspace(low_hz, high_hz, n_sections + 1)
    peaks: list[Prominence] = []
    of_peaks, others, shares = no_resonances(n), no_resonances(n), np.empty(0)
    orders: list[FloatArray] = []
    for low, high in pairwise(edges):
        section = _Section(transforms, float(low), float(high))
        poles, own_shares, of_orders = section.poles()
        orders.append(of_orders)
        own_peaks, vectors = section.peaks()
        free = np.ones(len(own_shares), dtype=bool)
        for peak, vector in zip(own_peaks, vectors, strict=True):
            reach = np.maximum(poles.half_widths_hz, 1.5 * peak.width_hz)
            apart = np.abs(poles.frequencies_hz - peak.frequency_hz) / reach
            at = free & (apart < 1.0)
            if at.any():
                best = int(np.where(at, own_shares * np.exp(-(apart**2)), -1.0).argmax())
                free[best] = False
                own = poles.at([best])
                own = own._replace(dampings=own.dampings.clip(*USUAL_DAMPINGS))
            else:
                own = Resonances(
                    np.array([peak.frequency_hz]), np.array([DAMPING / 1.5]), vector[:, None]
                )
            peaks.append(peak)
            of_peaks = of_peaks.beside(own)
        places = np.flatnonzero(free)
        others = others.beside(poles.at(places.tolist()))
        shares = np.concatenate([shares, own_shares[places]])
    return Candidates(tuple(peaks), of_peaks, others, shares, np.concatenate(orders, axis=1))


class _Section:
    """Lines from below ``low`` to above ``high``, in leading directions."""

    def __init__(self, transforms: Transforms, low: float, high: float) -> None:
        self.transforms, self.low, self.high = transforms, low, high
        first, last = transforms.band_hz
        line = transforms.line_hz
        self.from_hz, self.to_hz = max(first, low / FLANK), min(last, high * FLANK)
        width = max(RELATIVE_WIDTH, FEWEST_LINES[0] * line / math.sqrt(low * high))
        spectra = transforms.spectra(self.from_hz, self.to_hz, width)
        self.scales = noise_scales(spectra)
        scaled = spectra.matrices / self.scales / self.scales[:, None]
        mean = np.einsum("k,kij->ij", spectra.weights, scaled.real)
        vectors = np.linalg.eigh(mean)[1][:, ::-1]
        self.leading = vectors[:, :MOST_DIRECTIONS]

    def peaks(self) -> tuple[list[Prominence], list[ComplexArray]]:
        """Peaks, and their singular vectors in channels."""
        found: list[tuple[Prominence, ComplexArray]] = []
        for n_lines in FEWEST_LINES:
            width = max(RELATIVE_WIDTH, n_lines * self.transforms.line_hz / self.low)
            spectra = self.transforms.spectra(self.from_hz, self.to_hz, width)
            powers = np.einsum("k,kii->i", spectra.weights, spectra.matrices).real
            for scales in (self.scales, np.sqrt((powers / powers.mean()).clip(1e-12))):
                for peak, vector in self._peaks_of(spectra, scales):
                    apart = [
                        abs(peak.frequency_hz - other.frequency_hz)
                        < max(peak.width_hz, other.width_hz)
                        for other, _ in found
                    ]
                    if not any(apart):
                        found.append((peak, vector))
                    elif peak.is_clear and not (at := found[apart.index(True)])[0].is_clear:
                        found[apart.index(True)] = at[0]._replace(is_clear=True), at[1]
        found.sort(key=lambda each: each[0].frequency_hz)
        return [peak for peak, _ in found], [vector for _, vector in found]

    def _peaks_of(
        self, spectra: Spectra, scales: FloatArray
    ) -> list[tuple[Prominence, ComplexArray]]:
        from scipy.signal import peak_prominences

        values, vectors = np.linalg.eigh(spectra.matrices / scales / scales[:, None])
        levels = 10.0 * np.log10(np.maximum(values[:, -1], np.finfo(float).tiny))
        inner = np.arange(1, len(levels) - 1)
        tops = inner[(levels[inner] > levels[inner - 1]) & (levels[inner] >= levels[inner + 1])]
        found = []
        for top, prominence in zip(tops, peak_prominences(levels, tops)[0], strict=True):
            f = float(spectra.frequencies_hz[top])
            sds = prominence / (4.34 * math.sqrt(2.0 / spectra.weights[top]))
            if prominence < PEAK_DB or sds < PEAK_SDS or not self.low <= f < self.high:
                continue
            clear = prominence > CLEAR_DB and sds > CLEAR_SDS
            shape = scales * vectors[top, :, -1]
            width = float(spectra.widths_hz[top])
            found.append(
                (
                    Prominence(f, width, float(prominence), bool(clear)),
                    shape / np.linalg.norm(shape),
                )
            )
        return found

    def poles(self) -> tuple[Resonances, FloatArray, FloatArray]:
        """Poles of clusters of orders, the share of orders that have each, and poles of orders."""
        from scipy.cluster.hierarchy import fcluster, linkage
        from scipy.linalg import svd
        from scipy.spatial.distance import squareform

        correlations, step_s, start_hz = self._correlations()
        n_rows = min(BLOCK_ROWS, (len(correlations) - 2) // 3)
        r = correlations.shape[1]
        at = np.arange(n_rows)[:, None] + np.arange(n_rows)

        def hankel(first: int) -> ComplexArray:
            blocks = correlations[at + first].transpose(0, 2, 1, 3)
            return blocks.reshape(n_rows * r, n_rows * r)

        left, values, right = svd(hankel(1), check_finite=False)
        highest = min(HIGHEST_ORDER, int((values > 1e-10 * values[0]).sum()))
        root = np.sqrt(values[:highest])
        left, right = left[:, :highest], right[:highest].conj().T
        shifted = left.conj().T @ hankel(2) @ right / root / root[:, None]
        first_rows = left[:r] * root
        found: list[Resonances] = []
        orders: list[int] = []
        for order in range(1, highest + 1):
            discrete, states = np.linalg.eig(shifted[:order, :order])
            with np.errstate(divide="ignore"):
                exponents = np.log(discrete) / step_s
            omega = 2.0 * np.pi * start_hz + np.mod(exponents.imag, 2.0 * np.pi / step_s)
            size = np.hypot(omega, exponents.real)
            dampings = -exponents.real / size
            frequencies = size / (2.0 * np.pi)
            kept = (dampings > 1e-4) & (dampings < HEAVIEST)
            kept &= (frequencies >= self.low) & (frequencies < self.high)
            shapes = first_rows[:, :order] @ states[:, kept]
            shapes = shapes / np.linalg.norm(shapes, axis=0)
            found.append(Resonances(frequencies[kept], dampings[kept], shapes))
            orders += [order] * int(kept.sum())
        f, zeta, shapes = (np.concatenate(parts, axis=-1) for parts in zip(*found, strict=True))
        if len(f) < 2:
            return no_resonances(len(self.scales)), np.empty(0), np.array([f, orders], dtype=float)
        distances = np.abs(np.log(f[:, None] / f)) / SAME_FREQUENCY
        distances += (1.0 - np.abs(shapes.conj().T @ shapes) ** 2).clip(0.0) / (1.0 - SAME_SHAPE)
        distances[np.equal.outer(orders, orders)] += 10.0
        np.fill_diagonal(distances, 0.0)
        labels = fcluster(linkage(squareform(distances, checks=False), "average"), 1.0, "distance")
        chosen, shares = [], []
        for label in range(1, labels.max() + 1):
            members = np.flatnonzero(labels == label)
            share = len(members) / highest
            if share >= POSSIBLE:
                middle = np.abs(zeta[members] - np.median(zeta[members])).argmin()
                chosen.append(int(members[middle]))
                shares.append(share)
        in_channels = self.scales[:, None] * (self.leading @ shapes[:, chosen])
        in_channels /= np.linalg.norm(in_channels, axis=0)
        ascending = np.argsort(f[chosen])
        return (
            Resonances(f[chosen], zeta[chosen], in_channels).at(ascending.tolist()),
            np.array(shares)[ascending],
            np.array([f, orders]),
        )

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
        products = 0.0
        for t in (1, 2, 3):
            tapered = projection @ (values[:, centres - t] - values[:, centres + t])
            products = products + np.einsum("ik,jk->kij", tapered, tapered.conj())
        correlations = np.fft.ifft(window[:, None, None] * products, axis=0)
        return correlations, 1.0 / (len(centres) * line), float(frequencies[0])
