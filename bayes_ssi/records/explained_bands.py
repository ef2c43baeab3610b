"""Which modes each part of a spectrum holds: one real mode, one with phases, or two, by evidence.

Modes that share a peak are identified together, in a band of their own; bands do not share lines,
so that errors of different bands are independent. The nearest modes outside a band are known from
their own, and every band is explained again with the neighbours that the first pass left.

How close two modes may be and still be told apart follows from the record's length: two equal modes
with the same shape, d half-power bandwidths apart, fit better than one by (π/4) d⁴ ζ f T nats to
leading order in d, whether their forces are coherent or not, since the best single mode takes up
all else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import ComplexArray, FloatArray
from bayes_ssi.records.local_fit import DAMPING, Fitter, LocalFit, gain_of
from bayes_ssi.records.local_model import Resonances
from bayes_ssi.records.local_spectra import LocalSpectra, local_spectra
from bayes_ssi.records.mode_candidates import Candidates, Prominence, no_resonances
from bayes_ssi.records.spectra import Transforms

# A band reaches so many half-power bandwidths beyond its modes, but no farther than a share of the
# frequency, or so few bandwidths, and no less than a smaller share, or so many lines.
REACH, WIDEST, LEAST_REACH, NARROWEST, FEWEST_LINES = 7.0, 0.12, 2.5, 0.05, 40
# Modes closer than this times the sum of their half-power bandwidths share a band.
TOGETHER = 1.0
# When modes are known, their bands reach so many bandwidths where that moves no frequency or
# damping by more claimed standard deviations than two estimates from much the same lines may.
SHARP_REACH, SAME = 6.0, 2.5
# Dampings of candidates may be far off; modes are grouped, and bands made, as for these.
GROUP_DAMPINGS, REACH_DAMPINGS = (0.004, 0.04), (0.01, 0.04)
# Blocks of lines are this share of a damping wide, relative to their frequency.
BLOCK_OVER_DAMPING, MOST_BLOCK_DAMPING = 0.25, 0.03
# Directions of the channels: those of modes and neighbours, and a few for the rest; not more than
# this, unless modes are, and each for so many lines.
SPARE_DIRECTIONS, MOST_DIRECTIONS, LINES_OF_A_DIRECTION = 2, 6, 10.0
# Nats that a mode without a clear peak must gain: one in e³ is there.
UNEXPECTED = 3.0
# Nats that phases must gain: sensors are in step but for few records.
PHASES = 5.0
# Nats by which one source fits loads of one mode better, and what a band may say at most.
USUAL_GAIN, DECISIVE = 8.0, (-8.0, 50.0)
# Modes closer than this times the sum of half their bandwidths share a peak.
SHARED = 3.0
# Two modes differ in frequency by more than this share of their mean half-power bandwidth.
SEPARATE = 0.2
SUSPECT_DAMPING = 0.01
# Where the two modes of a peak are at first, in dampings from its middle, and their damping.
SPLITS, NARROWER = (0.5, 1.0), 0.7
# Their shapes: shares of the one mode's shape, and of what it leaves unexplained.
PAIRS = (
    (np.array([1.0, 1.0]), np.array([0.3, -0.3])),
    (np.array([1.0, 1.0]), np.array([-0.3, 0.3])),
    (np.array([1.0, 0.3]), np.array([0.0, 1.0])),
    (np.array([0.3, 1.0]), np.array([1.0, 0.0])),
)
# Modes more of a peak or of a band than this are not looked for.
MOST_MODES = 8


class Odds(NamedTuple):
    """How one peak is explained: nats of each explanation, -inf where it fits nothing.

    Attributes:
        one: a mode with a real shape.
        phases: a mode whose sensors have phases.
        two: two modes.
    """

    one: float
    phases: float
    two: float

    @property
    def probabilities(self) -> tuple[float, float, float]:
        """Of the three, each equally probable before."""
        nats = np.array(self)
        highest = nats.max()
        if not math.isfinite(highest):
            return (1.0, 0.0, 0.0)
        shares = np.exp(np.maximum(nats - highest, -700.0))
        return tuple((shares / shares.sum()).tolist())


class Estimates(NamedTuple):
    """Modes in channels, and their covariance, as of :class:`ModalEstimates`."""

    frequencies_hz: FloatArray
    dampings: FloatArray
    shapes: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Explained:
    """A band and its modes.

    Attributes:
        fit: the most probable modes.
        peaks: places of the modes of each peak, and how it is explained.
        is_wanted: whether it is in the search, not beside it.
    """

    fit: LocalFit
    peaks: tuple[tuple[tuple[int, ...], Odds], ...]
    is_wanted: bool

    def distance_to(self, frequency_hz: float) -> float:
        """How far a frequency is from the middle of the band, in half bands."""
        low, high = self.band_hz
        return abs(2.0 * frequency_hz - low - high) / (high - low)

    def singular_values(self) -> FloatArray:
        """Of the fitted spectral matrices of all channels (K, r), descending."""
        data = self.fit.data
        squares = data.to_channels.T @ data.to_channels
        factors = np.linalg.cholesky(self.fit.covariances)
        turned: ComplexArray = factors.conj().swapaxes(1, 2) @ squares @ factors
        return np.asarray(np.linalg.eigvalsh(turned)[:, ::-1], dtype=np.float64)

    @property
    def excess(self) -> float:
        """Chi-square over what is allowed."""
        return self.fit.whiteness / self.fit.allowed_whiteness

    @property
    def doubt(self) -> str | None:
        """Why errors that are claimed may be wrong; None if all is well."""
        low, high = self.band_hz
        where = f"from {low:.4g} to {high:.4g} Hz"
        if not self.fit.converged:
            return f"{where} the most probable modes were not reached"
        if self.excess > 1.0:
            return (
                f"{where} the modes do not explain the spectra (chi-square over degrees of freedom "
                f"{self.fit.whiteness:.2f}, allowed {self.fit.allowed_whiteness:.2f}); errors "
                f"are {math.sqrt(self.fit.whiteness):.2g} times as large as otherwise"
            )
        return None

    def estimates(self, places: Sequence[int]) -> Estimates:
        """Some of its modes in channels, with real shapes at unit length and their errors.

        Errors grow by the root of chi-square where that is more than is allowed.
        """
        fit, data = self.fit, self.fit.data
        rest, variances = rest_of_shapes(fit)
        m, r = fit.modes.shapes.shape[1], fit.modes.shapes.shape[0]
        shapes, jacobians, extra = [], [], []
        for i in places:
            full = data.to_channels @ fit.modes.shapes[:, i] + data.rest_to_channels @ rest[:, i]
            turn = np.exp(-0.5j * np.angle((full**2).sum()))
            real = (turn * full).real
            length = np.linalg.norm(real)
            shape = real / length
            across = (np.eye(len(shape)) - np.outer(shape, shape)) / length
            own = np.zeros((len(shape), 2 * m + 2 * m * r))
            at = 2 * m + i * r
            own[:, at : at + r] = turn.real * (across @ data.to_channels)
            at += m * r
            own[:, at : at + r] = -turn.imag * (across @ data.to_channels)
            outside = across @ data.rest_to_channels
            shapes.append(shape)
            jacobians.append(own)
            extra.append(variances[i] * outside @ outside.T)
        of_poles = np.zeros((2 * len(places), 2 * m + 2 * m * r))
        for k, i in enumerate(places):
            of_poles[k, i] = of_poles[len(places) + k, m + i] = 1.0
        jacobian = np.concatenate([of_poles, *jacobians])
        covariance = jacobian @ fit.covariance @ jacobian.T
        n = len(data.to_channels)
        for k, block in enumerate(extra):
            own_places = slice(2 * len(places) + k * n, 2 * len(places) + (k + 1) * n)
            covariance[own_places, own_places] += block
        if self.excess > 1.0:
            covariance *= fit.whiteness
        chosen = list(places)
        return Estimates(
            fit.modes.frequencies_hz[chosen], fit.modes.dampings[chosen], np.array(shapes).T,
            covariance,
        )  # fmt: skip

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        return self.fit.data.band_hz

    @property
    def modes(self) -> Resonances:
        """In channels; all that the leading directions show."""
        shapes = self.fit.data.to_channels @ self.fit.modes.shapes
        return self.fit.modes._replace(shapes=shapes / np.linalg.norm(shapes, axis=0))


class _Group(NamedTuple):
    """Modes that share a band, from ``low`` to ``high``, whether each is known to be there, and
    whether one is in the band of the search."""

    low: float
    high: float
    modes: Resonances
    sure: list[bool]
    is_wanted: bool


_Prepared = tuple[_Group, LocalSpectra, Resonances]


def explain(
    transforms: Transforms,
    found: Candidates,
    band_hz: tuple[float, float],
    n_passes: int = 2,
    fixed: bool = False,
) -> list[Explained]:
    """The bands of all candidates' peaks, explained; those next to the search, too.

    Args:
        transforms: the lines of all channels.
        found: candidates.
        band_hz: of the search.
        n_passes: how often.
        fixed: whether modes are as many as the candidates' peaks.
    """
    modes = found.of_peaks
    sure = [peak.is_clear or fixed for peak in found.peaks]
    bands: list[Explained] = []
    one_source = False
    for number in range(n_passes):
        prepared: list[_Prepared] = []
        for group in _groups(transforms, modes, sure, band_hz):
            data = _spectra_of(transforms, group, modes)
            if data is not None:
                prepared.append((group, *data))
        if number == 0:
            # Where independent loads do not explain the spectra, one source may: as they stand, or
            # when more modes have been tried.
            one_source = _is_one_source(_plain(prepared, True), _plain(prepared, False))
        each = _all_explained(prepared, one_source, found, fixed)
        if number == 0 and not one_source and any(_doubtful(band) for band in each):
            others = _all_explained(prepared, True, found, fixed)
            if _fewer_doubts(others, each):
                one_source, each = True, others
        bands = [band for band in each if band is not None]
        modes = no_resonances(len(transforms.values))
        for band in bands:
            modes = modes.joined(band.modes)
        sure = [True] * len(modes.frequencies_hz)
    wide = _groups(transforms, modes, sure, band_hz, SHARP_REACH)
    return [_sharper(transforms, band, wide, modes) for band in bands]


def _sharper(
    transforms: Transforms, band: Explained, wide: Sequence[_Group], modes: Resonances
) -> Explained:
    """The band with the errors of a wider one, where that says the same and is explained, too."""
    f = band.fit.modes.frequencies_hz
    groups = [g for g in wide if np.array_equal(g.modes.frequencies_hz, f)]
    if not groups or not band.is_wanted or band.doubt is not None:
        return band
    found = _spectra_of(transforms, groups[0], modes)
    if found is None:
        return band
    data, neighbours = found
    start = _in_directions(data, groups[0].modes)
    fit = Fitter(data, neighbours, band.fit.one_source).fit(start, band.fit.has_phases)
    m = len(f)
    moves = (
        np.log(fit.modes.frequencies_hz / f),
        np.log(fit.modes.dampings / band.fit.modes.dampings),
    )
    sds = np.sqrt(band.fit.covariance.diagonal()[: 2 * m])
    is_same = bool((np.abs(np.concatenate(moves)) < SAME * sds).all())
    wider = replace(band, fit=fit)
    return wider if is_same and fit.are_modes.all() and wider.doubt is None else band


def _all_explained(
    prepared: Sequence[_Prepared], one_source: bool, found: Candidates, fixed: bool
) -> list[Explained | None]:
    """Bands, or None for those without a mode."""
    return [
        _explained(Fitter(data, neighbours, one_source), group, found, fixed)
        for group, data, neighbours in prepared
    ]


def _plain(prepared: Sequence[_Prepared], one_source: bool) -> list[Explained | None]:
    """Bands as the candidates have them."""
    return [
        Explained(
            Fitter(data, neighbours, one_source).fit(_in_directions(data, group.modes), False),
            (), group.is_wanted,
        )
        for group, data, neighbours in prepared
    ]  # fmt: skip


def _is_one_source(one: Sequence[Explained | None], many: Sequence[Explained | None]) -> bool:
    """Whether one process drives everything: it explains more bands, or as many and better."""
    doubts = [sum(map(_doubtful, each)) for each in (one, many)]
    nats = [
        float(np.clip(a.fit.log_likelihood - b.fit.log_likelihood - USUAL_GAIN, *DECISIVE))
        for a, b in zip(one, many, strict=True)
        if a is not None and b is not None and a.excess < 1.0
    ]
    return doubts[0] < doubts[1] or (doubts[0] == doubts[1] and sum(nats) > UNEXPECTED)


def _doubtful(band: Explained | None) -> bool:
    return band is not None and band.is_wanted and band.doubt is not None


def _fewer_doubts(one: Sequence[Explained | None], other: Sequence[Explained | None]) -> bool:
    """Whether the first explain more bands."""
    return sum(map(_doubtful, one)) < sum(map(_doubtful, other))


def _at_clear_peak(f: float, half_width: float, found: Candidates) -> bool:
    return any(
        peak.is_clear and abs(peak.frequency_hz - f) < half_width + peak.width_hz
        for peak in found.peaks
    )


def _groups(
    transforms: Transforms,
    modes: Resonances,
    sure: Sequence[bool],
    band_hz: tuple[float, float],
    least_reach: float = LEAST_REACH,
) -> list[_Group]:
    """Modes by band, in ascending order: those in the search, and the next to either side."""
    order = np.argsort(modes.frequencies_hz, kind="stable").tolist()
    members: list[list[int]] = []
    f = modes.frequencies_hz
    widths = 2.0 * modes.dampings.clip(*GROUP_DAMPINGS) * f
    for i in order:
        if members:
            last = members[-1][-1]
            if f[i] - f[last] < TOGETHER * (widths[i] + widths[last]):
                members[-1].append(i)
                continue
        members.append([i])
    usual = 2.0 * modes.dampings.clip(*REACH_DAMPINGS) * f
    reach = np.minimum(REACH * usual, np.maximum(WIDEST * f, least_reach * usual))
    reach = np.maximum(reach, np.maximum(NARROWEST * f, FEWEST_LINES * transforms.line_hz))
    lowest, highest = transforms.band_hz
    groups = []
    for k, group in enumerate(members):
        low = max(lowest, min(f[i] - reach[i] for i in group))
        high = min(highest, max(f[i] + reach[i] for i in group))
        if k:
            low = max(low, _between(modes, members[k - 1][-1], group[0]))
        if k + 1 < len(members):
            high = min(high, _between(modes, group[-1], members[k + 1][0]))
        # Where a mode is known but for half a bandwidth, it may be inside.
        inside = any(band_hz[0] - widths[i] <= f[i] <= band_hz[1] + widths[i] for i in group)
        groups.append(_Group(low, high, modes.at(group), [sure[i] for i in group], inside))
    wanted = [k for k, group in enumerate(groups) if group.is_wanted]
    return groups[max(0, wanted[0] - 1) : wanted[-1] + 2] if wanted else []


def _between(modes: Resonances, i: int, j: int) -> float:
    """Where two modes are as many of their own bandwidths away."""
    f, w = modes.frequencies_hz, modes.half_widths_hz
    return float((f[i] * w[j] + f[j] * w[i]) / (w[i] + w[j]))


def _spectra_of(
    transforms: Transforms, group: _Group, known: Resonances
) -> tuple[LocalSpectra, Resonances] | None:
    """Spectra of a band in its directions, and its neighbours there; None if it has no lines."""
    outside = [_nearest_outside(known, group, side) for side in (-1, 1)]
    neighbours = known.at([i for i in outside if i is not None])
    damping = min(float(np.median(group.modes.dampings)), MOST_BLOCK_DAMPING)
    try:
        spectra = transforms.spectra(group.low, group.high, BLOCK_OVER_DAMPING * damping)
    except ValueError:
        return None
    if spectra.weights.sum() < LINES_OF_A_DIRECTION:
        return None
    n_modes = len(group.sure) + len(neighbours.frequencies_hz)
    n_directions = min(
        n_modes + SPARE_DIRECTIONS,
        max(MOST_DIRECTIONS, len(group.sure) + SPARE_DIRECTIONS),
        max(2, int(spectra.weights.sum() / LINES_OF_A_DIRECTION)),
    )
    data = local_spectra(spectra, n_directions)
    return data, _in_directions(data, neighbours)


def _explained(fitter: Fitter, group: _Group, found: Candidates, fixed: bool) -> Explained | None:
    """A band, or None where it holds no mode; what is beside the search is only estimated."""
    data = fitter.data
    starts = [_in_directions(data, group.modes)]
    if (starts[0].dampings < SUSPECT_DAMPING).any():  # perhaps a spike of a wider resonance
        starts.append(starts[0]._replace(dampings=starts[0].dampings.clip(1.3 * DAMPING)))
    real = max(
        (fitter.fit(start, has_phases=False) for start in starts),
        key=lambda each: each.log_evidence,
    )
    turned = fitter.fit(real, has_phases=True)
    fit = real if real.log_evidence + PHASES > turned.log_evidence else turned
    if not fixed:
        clear = [peak for peak in found.peaks if peak.is_clear]
        if group.is_wanted:
            fit = _with_others(fitter, fit, found.poles)
        fit = _without_needless(fitter, fit, clear)
        if not len(fit.modes.frequencies_hz):
            return None
    if fit is not real and fit is not turned:
        real = fitter.fit(fit.modes, has_phases=False)
        turned = fitter.fit(real, has_phases=True)
    peaks: list[tuple[tuple[int, ...], Odds]] = []
    best = real if real.log_evidence + PHASES > turned.log_evidence else turned
    by_phases = turned.log_evidence - real.log_evidence - PHASES
    i = 0
    while i < len(best.modes.frequencies_hz) and group.is_wanted:
        if i + 1 < len(best.modes.frequencies_hz) and _share_a_peak(best.modes, i):
            peaks.append(((i, i + 1), Odds(0.0, by_phases, _nats_of_a_pair(fitter, best, i))))
            i += 2
            continue
        gain, two = _two_in_place_of(fitter, best, i)
        nats = Odds(0.0, by_phases, max(0.0, by_phases) + gain)
        if two is not None and gain > 0.0 and not fixed:
            best = two
            peaks.append(((i, i + 1), nats))
            i += 2
            continue
        peaks.append(((i,), nats))
        i += 1
    return Explained(best, tuple(peaks), group.is_wanted)


def _nearest_outside(known: Resonances, group: _Group, side: int) -> int | None:
    own = group.modes.frequencies_hz
    f = known.frequencies_hz
    outside = np.flatnonzero(f > own.max() * 1.0001 if side > 0 else f < own.min() * 0.9999)
    if not len(outside):
        return None
    return int(outside[np.abs(f[outside] - (own.max() if side > 0 else own.min())).argmin()])


def _in_directions(data: LocalSpectra, modes: Resonances) -> Resonances:
    shapes = data.from_channels @ modes.shapes
    lengths = np.maximum(np.linalg.norm(shapes, axis=0), np.finfo(float).tiny)
    shapes = shapes / lengths
    turned = shapes * np.exp(-0.5j * np.angle((shapes**2).sum(0)))
    return modes._replace(shapes=turned)


def _with_others(fitter: Fitter, fit: LocalFit, poles: Resonances) -> LocalFit:
    """The fit with those other poles that the evidence asks for, the strongest first."""
    f, known = poles.frequencies_hz, fit.modes
    low, high = fitter.data.band_hz
    apart = np.abs(f[:, None] - known.frequencies_hz)
    new = (apart > SEPARATE * (poles.half_widths_hz[:, None] + known.half_widths_hz)).all(1)
    inside = np.flatnonzero((f > low) & (f < high) & new).tolist()
    others = _in_directions(fitter.data, poles.at(inside))
    left = list(range(len(inside)))
    unknowns = 2 + 2 * (fitter.r - 1) + 2 * fitter.r
    while left and len(fit.modes.frequencies_hz) < MOST_MODES:
        gains = [gain_of(fitter, fit, others.at([i]))[0] for i in left]
        best = left[int(np.argmax(gains))]
        if max(gains) < 0.5 * unknowns:
            break
        left.remove(best)
        wider = fitter.fit(fit.modes.joined(others.at([best])), fit.has_phases)
        if wider.are_modes.all() and wider.log_evidence > fit.log_evidence + UNEXPECTED:
            fit = wider
    return fit


def _without_needless(fitter: Fitter, fit: LocalFit, clear: Sequence[Prominence]) -> LocalFit:
    """The fit without modes whose absence is more probable, the weakest first.

    What has left the band, or has more damping than structures have, is no mode of it; a clear peak
    keeps its mode.
    """
    kept: set[float] = set()
    while (m := len(fit.modes.frequencies_hz)) > 0:
        wrong = np.flatnonzero(~fit.are_modes).tolist() or _coinciding(fit)
        nats = fit.model.drive.sizes(fit.modes) / fit.modes.dampings**2
        order = wrong + [int(i) for i in np.argsort(nats) if i not in wrong]
        for i in order:
            f = float(fit.modes.frequencies_hz[i])
            others = [j for j in range(m) if j != i]
            if i not in wrong:
                if any(abs(f / each - 1.0) < 1e-3 for each in kept):
                    continue
                if _only_mode_at_a_peak(fit.modes, i, clear):
                    kept.add(f)
                    continue
            without = fitter.fit(fit.modes.at(others), fit.has_phases)
            if i in wrong or without.log_evidence > fit.log_evidence - UNEXPECTED:
                fit = without
                break
            kept.add(f)
        else:
            break
    return fit


def _coinciding(fit: LocalFit) -> list[int]:
    """The weaker one of the first two modes that are one."""
    f, half = fit.modes.frequencies_hz, fit.modes.half_widths_hz
    sizes = fit.model.drive.sizes(fit.modes)
    order = np.argsort(f)
    for i, j in pairwise(order.tolist()):
        if f[j] - f[i] < SEPARATE * (half[i] + half[j]):
            return [i if sizes[i] < sizes[j] else j]
    return []


def _only_mode_at_a_peak(modes: Resonances, i: int, clear: Sequence[Prominence]) -> bool:
    f, half = modes.frequencies_hz, modes.half_widths_hz
    for peak in clear:
        near = np.abs(f - peak.frequency_hz) < half + peak.width_hz
        if near[i] and near.sum() == 1:
            return True
    return False


def _two_in_place_of(fitter: Fitter, fit: LocalFit, i: int) -> tuple[float, LocalFit | None]:
    """Nats by which two modes explain a peak better than one, and the fit with two."""
    one = fit.modes.at([i])
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    direction = _unexplained(fit, frequency, damping)
    gain = 0.0
    for sign in (-1.0, 1.0):
        for shape in (_unexplained(fit, frequency, damping), one.shapes[:, 0]):
            flank = Resonances(
                np.array([frequency * (1.0 + sign * damping)]), one.dampings, shape[:, None]
            )
            own, its_shape = gain_of(fitter, fit, flank)
            if own > gain:
                gain = own
                if fitter.one_source:
                    direction = its_shape
    n_unknowns = 2 + (fitter.r - 1) * (1 + fit.has_phases) + 2 * fitter.r
    line_hz = float(fit.data.widths_hz.sum() / fit.data.weights.sum())
    n_lines = max(math.e, 2.0 * damping * frequency / line_hz)
    if gain < 0.8 * n_unknowns:
        return gain - 0.5 * n_unknowns * math.log(n_lines), None
    others = fit.modes.at([j for j in range(len(fit.modes.frequencies_hz)) if j != i])
    best: LocalFit | None = None
    for split in SPLITS:
        for mix in PAIRS:
            shapes = one.shapes * mix[0] + direction[:, None] * mix[1]
            pair = Resonances(
                frequency * (1.0 + split * damping * np.array([-1.0, 1.0])),
                np.full(2, NARROWER * damping),
                shapes / np.linalg.norm(shapes, axis=0),
            )
            two = fitter.fit(others.joined(pair), fit.has_phases)
            if not (two.converged and two.are_modes.all()):
                continue
            nearest = np.argsort(np.abs(two.modes.frequencies_hz - frequency))[:2]
            reach = 3.0 * two.modes.half_widths_hz[nearest].max()
            if (np.abs(two.modes.frequencies_hz[nearest] - frequency) > reach).any():
                continue
            apart = abs(float(np.diff(two.modes.frequencies_hz[nearest])[0]))
            if apart < SEPARATE * two.modes.half_widths_hz[nearest].sum():
                continue
            if best is None or two.log_evidence > best.log_evidence:
                best = two
    if best is None:
        return -0.5 * n_unknowns, None
    order = np.argsort(best.modes.frequencies_hz)
    if (np.diff(order) < 0).any():
        best = fitter.fit(best.modes.at(order.tolist()), fit.has_phases)
    nearest = np.sort(np.argsort(np.abs(best.modes.frequencies_hz - frequency))[:2])
    # Given that the peak holds two modes, the second is within a bandwidth, not anywhere.
    low, high = fit.data.band_hz
    width = 2.0 * float(best.modes.dampings[nearest].mean())
    apart = float(np.diff(np.log(best.modes.frequencies_hz[nearest]))[0])
    place = math.log(math.log(high / low) / (width * math.sqrt(2.0 * math.pi)))
    by_place = place - 0.5 * (apart / (2.0 * width)) ** 2
    return best.log_evidence - fit.log_evidence + by_place, best


def _share_a_peak(modes: Resonances, i: int) -> bool:
    """Whether a mode and the next meet before either has fallen to a tenth of its power."""
    apart = modes.frequencies_hz[i + 1] - modes.frequencies_hz[i]
    return bool(apart < SHARED * modes.half_widths_hz[i : i + 2].sum())


def _nats_of_a_pair(fitter: Fitter, fit: LocalFit, i: int) -> float:
    """Nats by which two modes of a peak explain it better than one in their place."""
    pair, m = [i, i + 1], len(fit.modes.frequencies_hz)
    sizes = fit.model.drive.sizes(fit.modes)
    strongest = i + int(sizes[pair].argmax())
    one = fit.modes.at([strongest])
    others = fit.modes.at([j for j in range(m) if j not in pair])
    middle = np.exp(np.log(fit.modes.frequencies_hz[pair]).mean(keepdims=True))
    merged = max(
        fitter.fit(others.joined(one._replace(frequencies_hz=f)), fit.has_phases).log_evidence
        for f in (middle, one.frequencies_hz)
    )
    return fit.log_evidence - merged


def _unexplained(fit: LocalFit, frequency: float, damping: float) -> ComplexArray:
    """The direction (r,) that has most power beyond the fit around a frequency."""
    data = fit.data
    near = np.abs(data.frequencies_hz - frequency) <= 2.0 * damping * frequency
    near[np.abs(data.frequencies_hz - frequency).argmin()] = True
    beyond = data.matrices[near] - fit.covariances[near]
    mean = np.einsum("k,kij->ij", data.weights[near], beyond)
    shape = fit.modes.shapes[:, np.abs(fit.modes.frequencies_hz - frequency).argmin()]
    across = np.eye(len(shape)) - np.outer(shape, shape.conj())
    direction: ComplexArray = np.linalg.eigh(across @ mean @ across)[1][:, -1]
    if not fit.has_phases:
        turned = direction * np.exp(-0.5j * np.angle((direction**2).sum()))
        direction = (turned.real / np.linalg.norm(turned.real)).astype(complex)
    return direction


def resolution(fit: LocalFit, i: int) -> float:
    """Half-power bandwidths by which two modes of one shape must differ to be told from one."""
    width = 2.0 * float(fit.modes.half_widths_hz[i])
    line_hz = float(fit.data.widths_hz.sum() / fit.data.weights.sum())
    n_lines = max(math.e, width / line_hz)
    r = fit.modes.shapes.shape[0]
    cost = 0.5 * (3 * r + 1) * math.log(n_lines)
    return float((8.0 * cost / (math.pi * n_lines)) ** 0.25)


def rest_of_shapes(fit: LocalFit) -> tuple[ComplexArray, FloatArray]:
    """Shapes in all other directions (n - r, m), and the variance of each component (m,).

    Cross spectra of these with the leading directions are linear in them.
    """
    data, m = fit.data, fit.modes.shapes.shape[1]
    if not data.rest.shape[1]:
        return np.zeros((0, m), dtype=complex), np.zeros(m)
    factors = np.linalg.inv(np.linalg.cholesky(fit.covariances)).conj().swapaxes(1, 2)
    factors = factors * np.sqrt(data.weights)[:, None, None]
    at = fit.scene
    h = fit.model.h(at)
    forces = fit.model.drive.forces(at, fit.modes, h)
    r = data.matrices.shape[1]
    smooth = at.powers[:2].T[:, :, None, None] * np.eye(r)
    rows = np.concatenate(
        [
            (h[:, None] * forces.conj()).swapaxes(1, 2),
            fit.model.drive.crosses(at, fit.modes, h),
            smooth.reshape(len(h), 2 * r, r),
        ],
        axis=1,
    )
    regressors = (rows @ factors).swapaxes(1, 2).reshape(-1, rows.shape[1])
    targets = (data.rest @ factors).transpose(0, 2, 1).reshape(-1, data.rest.shape[1])
    products = regressors.conj().T @ regressors
    products += 1e-9 * np.diag(products.diagonal())
    solution = np.linalg.solve(products, regressors.conj().T @ targets)
    variances = 0.5 * np.linalg.inv(products).diagonal().real[:m]
    return solution[:m].T, np.asarray(variances, dtype=np.float64)
