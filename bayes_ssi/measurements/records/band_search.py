"""The bands of a record explained: what drives them, which modes, one or two at each peak.

Modes that share a peak are identified together, in a band of their own. The nearest modes outside a
band are known from their own, and every band is explained again with the neighbours that the first
pass left. Bands do not share lines, so that errors of different bands are independent.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.measurements.records.explained_band import (
    NATS_OF_A_MODE,
    Explained,
    ExplainedPeak,
    one_in_place_of,
    share_a_peak,
    two_in_place_of,
    with_others,
    without_needless,
)
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit, allowed_whiteness
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.spectra import (
    DAMPING,
    BandHz,
    LocalSpectra,
    Resonances,
    Transforms,
    local_spectra,
)

NATS_OF_PHASES = 5.0  # sensors are in step but for few records
NATS_OF_ONE_BAND = (-8.0, 50.0)  # at most, of what drives all
NATS_TO_GIVE_UP = -14.0  # of the bands that were compared
SHARE_OF_ORDERS = 0.5  # beyond which a pole is tried where there is no peak, too
BROAD = 0.03  # dampings from which a peak may be hidden by those of its noise
DAMPING_OF_SPIKES = 0.01  # below: perhaps of a spike of a wider resonance

# Reach beyond the modes: a share of the frequency, and no fewer bandwidths or lines.
REACH = 0.12
LEAST_BANDWIDTHS = 4.0, 6.0, 12.0  # at first, once modes are known, and in the end
FEWEST_LINES_OF_REACH = 40
UNEXPLAINED_REACH = 0.6  # share to which a band is cut that is not explained
MOST_SDS = 2.5  # between two estimates from much the same lines, or with real shapes and phases
# Times the sum of bandwidths: modes that are closer share a band. It grows with their mean damping
# over the usual one: what is broad reaches farther than a background follows.
SHARED_BAND = (1.25, 2.5)
# Dampings of candidates may be far off, most of all below a share of the median of all: modes
# are grouped, and bands made, as for dampings within these.
DAMPINGS_OF_GROUPS = (0.004, 0.06)
DAMPINGS_OF_REACH = (0.01, 0.04)
LEAST_SHARE_OF_MEDIAN_DAMPING = 0.7
BLOCK_OVER_DAMPING = 0.25  # width of blocks of lines
MOST_DAMPING_OF_BLOCKS = 0.03
# A step takes time in proportion to blocks, and to about the fourth power of modes.
MOST_BLOCKS = 250
MOST_MODES_AT_FIRST = 5
SPARE_DIRECTIONS = 2  # besides those of modes and neighbours
MOST_DIRECTIONS = 6  # unless there are more modes
LINES_OF_A_DIRECTION = 10.0  # at least


class Group(NamedTuple):
    """Modes that share a band."""

    low: float  # lowest frequency in Hz
    high: float  # highest frequency in Hz
    modes: Resonances
    is_wanted: bool


class _Band:
    """The spectra of a group of modes, and the group's fits under independent loads or one source.

    A fit is made once: of the same band it may be needed twice.
    """

    def __init__(self, group: Group, at: LocalSpectra) -> None:
        self.group = group
        self.start = group.modes.in_directions(at)
        self.fitters = {one: Fitter(at, one_source=one) for one in (False, True)}
        self.fits = cache(self._fits)

    def _fits(self, one_source: bool) -> tuple[LocalFit, LocalFit]:
        """The most probable modes with real shapes, and whose sensors have phases."""
        fitter = self.fitters[one_source]
        real = fitter.fit(self.start, has_phases=False)
        turned = fitter.fit(real, has_phases=True)
        if turned.whiteness > turned.allowed_whiteness:
            other = fitter.fit(self.start, has_phases=True)
            turned = max(turned, other, key=lambda fit: fit.log_evidence)
        return real, turned


def explain(
    transforms: Transforms, possible: Candidates, band_hz: BandHz, fixed: bool, is_driven: bool
) -> list[Explained]:
    """The bands of all candidates' peaks, explained; those next to the search, too."""
    others, one_source = possible.others, is_driven

    def explained(
        groups: Sequence[Group], modes: Resonances, is_first: bool = False
    ) -> tuple[list[Explained], Resonances]:
        nonlocal one_source
        spectra = [(group, spectra_of_group(transforms, group, modes)) for group in groups]
        parts = [_Band(group, at) for group, at in spectra if at is not None]
        if is_first and not is_driven:
            one_source = _is_one_source(parts)
        bands = _all_explained(parts, one_source, possible, fixed)
        # Where one does not explain the spectra, the other may, now that more modes are tried.
        if not is_driven and _n_doubtful(bands):
            otherwise = _all_explained(parts, not one_source, possible, fixed)
            if _n_doubtful(otherwise) < _n_doubtful(bands):
                one_source, bands = not one_source, otherwise
        return bands, modes_of(bands, len(transforms.values))

    # Poles that many orders agree on, where no peak's band reaches, are tried, too.
    often = others.at(possible.shares > SHARE_OF_ORDERS)
    modes = possible.of_peaks.beside(_far(transforms, possible.of_peaks, often, band_hz))
    for is_first in (True, False):  # again, with the neighbours that are known then
        bands, modes = explained(groups_of(transforms, modes, band_hz), modes, is_first)
    # Noise breaks broad peaks into narrow ones, which backgrounds explain: try broad poles, too.
    tried = _far(transforms, modes, others.at(others.dampings > BROAD), band_hz)
    if tried.n_modes:
        more = modes.beside(tried)
        groups = [
            each._replace(is_wanted=bool(np.isin(tried[0], each.modes.frequencies_hz).any()))
            for each in groups_of(transforms, more, band_hz)
        ]
        more = explained(groups, more)[1]
        if more.n_modes > modes.n_modes:
            bands, modes = explained(groups_of(transforms, more, band_hz), more)
    wide = groups_of(transforms, modes, band_hz, LEAST_BANDWIDTHS[1])
    narrow = groups_of(transforms, modes, band_hz, share=UNEXPLAINED_REACH)
    return [
        _of_other_reach(transforms, band, narrow if band.doubt else wide, modes, possible, fixed)
        for band in bands
    ]


def widened(transforms: Transforms, bands: Sequence[Explained], band_hz: BandHz) -> list[Explained]:
    """Bands that reach farther still, where that changes nothing but errors, of modes alone."""
    modes = modes_of(bands, len(transforms.values))
    groups = groups_of(transforms, modes, band_hz, LEAST_BANDWIDTHS[2])
    return [_of_other_reach(transforms, band, groups, modes) for band in bands]


def _far(transforms: Transforms, modes: Resonances, poles: Resonances, band: BandHz) -> Resonances:
    """The poles in the search that no band of the modes reaches."""
    f = poles.frequencies_hz
    are_apart = (f > band[0]) & (f < band[1])
    for group in groups_of(transforms, modes, band):
        are_apart &= (f < group.low) | (f > group.high)
    return poles.at(are_apart)


def modes_of(bands: Sequence[Explained], n_channels: int) -> Resonances:
    return joined([Resonances.none(n_channels), *(band.modes for band in bands)], axis=-1)


def _of_other_reach(
    transforms: Transforms, band: Explained, groups: Sequence[Group], modes: Resonances,
    possible: Candidates | None = None, fixed: bool = True,
) -> Explained:  # fmt: skip
    """The band with another reach, where that says the same and is explained.

    Wider ones have smaller errors; narrower ones leave out what is farther off and unexplained.
    Where a wider one says otherwise, a background may have taken what a broad mode does: explained
    anew, it is undecided unless it has a mode more, and none that is a flank at its ends. Without
    ``possible`` it is left, also where what a wider one adds is not explained.
    """
    f = band.fit.modes.frequencies_hz
    same = [group for group in groups if np.array_equal(group.modes.frequencies_hz, f)]
    at = spectra_of_group(transforms, same[0], modes) if same and band.is_wanted else None
    if at is None:
        return band
    fit = Fitter(at, band.fit.one_source).fit(same[0].modes.in_directions(at), band.fit.has_phases)
    if _largest_move(fit, band.fit) < MOST_SDS:
        other = replace(band, fit=fit)
        is_right = fit.are_modes.all() and other.doubt is None
        return other if is_right and (possible or _explains_more(other, band.fit)) else band
    if band.doubt is not None or possible is None:
        return band
    for anew in _all_explained([_Band(same[0], at)], band.fit.one_source, possible, fixed):
        ends_hz = anew.fit.modes.frequencies_hz + np.outer([-1, 1], anew.fit.modes.half_widths_hz)
        is_whole = bool((np.abs(ends_hz - sum(at.band_hz) / 2.0) < np.ptp(at.band_hz) / 2.0).all())
        if is_whole and anew.fit.modes.n_modes > len(f):
            return anew
        if anew.excess < 1.0:
            return replace(band, peaks=tuple(p._replace(is_undecided=True) for p in band.peaks))
    return band


def _largest_move(fit: LocalFit, before: LocalFit) -> float:
    """Of frequencies and dampings, in standard deviations of those before."""
    moves = np.log(np.concatenate(fit.modes[:2]) / np.concatenate(before.modes[:2]))
    return float((np.abs(moves) / np.sqrt(before.covariance.diagonal()[: len(moves)])).max())


def _explains_more(band: Explained, narrower: LocalFit) -> bool:
    """Whether modes alone explain all lines that their band adds to those of a narrower one."""
    at, left = band.fit.residuals()
    added = (at < narrower.data.band_hz[0]) | (at > narrower.data.band_hz[1])
    sizes = np.full(int(added.sum()), band.fit.data.matrices.shape[1])
    most = allowed_whiteness(band.fit.data.weights[added], sizes, max(1, (sizes**2).sum()))
    is_alone = len(band.peaks) == band.fit.modes.n_modes
    return is_alone and bool(added.any()) and float(left[added].mean()) < most


def _is_one_source(bands: Sequence[_Band]) -> bool:
    """Whether one process drives everything: it explains more bands, or as many and better.

    As the candidates have them; sensors may have phases: late ones are no source.
    """
    many = [Explained(band.fits(False)[1], (), band.group.is_wanted) for band in bands]
    one, nats = [], 0.0
    for band, independent in zip(bands, many, strict=True):
        one.append(Explained(band.fits(True)[1], (), band.group.is_wanted))
        if one[-1].excess < 1.0:
            gain = one[-1].fit.log_evidence - independent.fit.log_evidence
            nats += float(np.clip(gain, *NATS_OF_ONE_BAND))
        # A source is of all bands: what some contradict is not sought in others.
        if not _n_doubtful(many) and (_n_doubtful(one) or nats < NATS_TO_GIVE_UP):
            return False
    if _n_doubtful(one) != _n_doubtful(many):
        return _n_doubtful(one) < _n_doubtful(many)
    return nats > NATS_OF_A_MODE


def _n_doubtful(bands: Sequence[Explained]) -> int:
    return sum(band.is_wanted and band.doubt is not None for band in bands)


def _all_explained(
    bands: Sequence[_Band], one_source: bool, possible: Candidates, fixed: bool
) -> list[Explained]:
    """Bands with their modes and peaks; without those that hold no mode.

    What is beside the search is only estimated.
    """
    all_explained = []
    for band in bands:
        fitter, is_wanted = band.fitters[one_source], band.group.is_wanted
        real, turned = band.fits(one_source)
        if (band.start.dampings < DAMPING_OF_SPIKES).any():
            # Perhaps a spike of a wider resonance.
            wider = band.start._replace(dampings=band.start.dampings.clip(1.3 * DAMPING))
            other = fitter.fit(wider, has_phases=False)
            if other.log_evidence > real.log_evidence:
                real, turned = other, fitter.fit(other, has_phases=True)
        fit = _with_phases_if_needed(real, turned)
        if not fixed:
            if is_wanted:
                fit = with_others(fitter, fit, possible.poles)
            fit = without_needless(fitter, fit, [peak for peak in possible.peaks if peak.is_clear])
            if not fit.modes.n_modes:
                continue
        if fit is not real and fit is not turned:
            # Of late sensors real shapes may go astray, and phases that begin from these with them.
            other = fitter.fit(fit.modes if fit.has_phases else fit, not fit.has_phases)
            real, turned = (other, fit) if fit.has_phases else (fit, other)
        best = _with_phases_if_needed(real, turned)
        peaks: list[ExplainedPeak] = []
        if is_wanted:
            by_phases = turned.log_evidence - real.log_evidence - NATS_OF_PHASES
            best, peaks = _peaks(fitter, best, by_phases, fixed)
        all_explained.append(Explained(best, tuple(peaks), is_wanted))
    return all_explained


def _with_phases_if_needed(real: LocalFit, turned: LocalFit) -> LocalFit:
    """The fit with phases where the evidence asks for it, or real shapes move the poles.

    Phases that are too small to be seen may still be what the damping of a broad mode turns on:
    real shapes then claim to know it far too well. Where the model holds, the variance of the
    difference of both estimates is the difference of their variances (Hausman 1978).
    """
    if turned.log_evidence > real.log_evidence + NATS_OF_PHASES:
        return turned
    m = real.modes.n_modes
    moves = np.log(np.concatenate(turned.modes[:2]) / np.concatenate(real.modes[:2]))
    variances = [fit.covariance.diagonal()[: 2 * m] for fit in (turned, real)]
    apart = moves**2 > MOST_SDS**2 * (variances[0] - variances[1]).clip(0.0)
    is_suspect = apart & (np.abs(moves) > np.sqrt(variances[1]))
    return turned if is_suspect.any() and turned.converged and turned.are_modes.all() else real


def _peaks(
    fitter: Fitter, best: LocalFit, by_phases: float, fixed: bool
) -> tuple[LocalFit, list[ExplainedPeak]]:
    """The fit with two modes at the peaks that ask for them, and all peaks."""
    peaks: list[ExplainedPeak] = []
    i = 0
    while i < best.modes.n_modes:
        is_pair = share_a_peak(best.modes, i)
        compared = (one_in_place_of if is_pair else two_in_place_of)(fitter, best, i)
        nats = compared.nats
        if nats is not None:
            if (nats > 0.0) != is_pair and compared.other is not None and not fixed:
                best, is_pair = compared.other, not is_pair
            nats += max(0.0, by_phases)
        places = (i, i + 1) if is_pair else (i,)
        peaks.append(ExplainedPeak(places, by_phases, nats, compared.is_undecided))
        i += len(peaks[-1].modes)
    return best, peaks


def groups_of(
    transforms: Transforms,
    modes: Resonances,
    band_hz: BandHz,
    least_bandwidths: float = LEAST_BANDWIDTHS[0],
    share: float = 1.0,
) -> list[Group]:
    """Modes by band, in ascending order: those in the search, and the next to either side."""
    if not modes.n_modes:
        return []
    modes = modes.at(np.argsort(modes.frequencies_hz, kind="stable"))
    f = modes.frequencies_hz
    least = LEAST_SHARE_OF_MEDIAN_DAMPING * float(np.median(modes.dampings))
    widths = 2.0 * np.maximum(modes.dampings, least).clip(*DAMPINGS_OF_GROUPS) * f
    gaps, sums = np.diff(f), widths[1:] + widths[:-1]
    mean_dampings = 0.5 * sums / (f[1:] + f[:-1])
    shared = (SHARED_BAND[0] * mean_dampings / DAMPING).clip(*SHARED_BAND)
    wholes = np.split(np.arange(len(f)), np.flatnonzero(gaps >= shared * sums) + 1)
    members = [part for whole in wholes for part in _divided(whole.tolist(), gaps / sums)]
    usual = 2.0 * modes.dampings.clip(*DAMPINGS_OF_REACH) * f
    reach = share * np.maximum(REACH * f, least_bandwidths * usual)
    reach = reach.clip(FEWEST_LINES_OF_REACH * transforms.line_hz)
    # Bands meet where the modes to either side are as many of their own bandwidths away.
    w = modes.half_widths_hz
    beside = [(one[-1], other[0]) for one, other in pairwise(members)]
    meeting = [float((f[i] * w[j] + f[j] * w[i]) / (w[i] + w[j])) for i, j in beside]
    lowest, highest = transforms.band_hz
    groups = []
    for group, least, most in zip(members, [0.0, *meeting], [*meeting, np.inf], strict=True):
        low = max(lowest, least, float((f - reach)[group].min()))
        high = min(highest, most, float((f + reach)[group].max()))
        # Where a mode is known but for half a bandwidth, it may be inside.
        inside = any(band_hz[0] - widths[i] <= f[i] <= band_hz[1] + widths[i] for i in group)
        groups.append(Group(low, high, modes.at(group), inside))
    wanted = [k for k, group in enumerate(groups) if group.is_wanted]
    return groups[max(0, wanted[0] - 1) : wanted[-1] + 2] if wanted else []


def _divided(part: list[int], apart: FloatArray) -> list[list[int]]:
    """Parts of no more modes than a band can have, cut where the next is farthest ``apart``."""
    if len(part) <= MOST_MODES_AT_FIRST:
        return [part]
    cut = 1 + int(apart[part[:-1]].argmax())
    return _divided(part[:cut], apart) + _divided(part[cut:], apart)


def spectra_of_group(
    transforms: Transforms, group: Group, known: Resonances
) -> LocalSpectra | None:
    """Spectra of a band beside the nearest known modes, in its directions; None without lines."""
    f, own_f = known.frequencies_hz, group.modes.frequencies_hz
    order = np.argsort(f, kind="stable")
    # Those of the group are among the known ones, but for rounding.
    below, above = order[f[order] < 0.9999 * own_f.min()], order[f[order] > 1.0001 * own_f.max()]
    neighbours = known.at([*below[-1:], *above[:1]])
    damping = min(float(np.median(group.modes.dampings)), MOST_DAMPING_OF_BLOCKS)
    width = max(BLOCK_OVER_DAMPING * damping, float(np.log(group.high / group.low)) / MOST_BLOCKS)
    try:
        spectra = transforms.spectra(group.low, group.high, width)
    except ValueError:
        return None
    n_lines = spectra.weights.sum()
    if n_lines < LINES_OF_A_DIRECTION:
        return None
    m = group.modes.n_modes
    n_directions = min(
        m + neighbours.n_modes + SPARE_DIRECTIONS,
        max(MOST_DIRECTIONS, m + SPARE_DIRECTIONS),
        max(2, int(n_lines / LINES_OF_A_DIRECTION)),
    )
    data = local_spectra(spectra, n_directions)
    return data.beside(neighbours.in_directions(data))
