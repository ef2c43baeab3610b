"""The bands of a record explained: what drives them, which modes, one or two at each peak.

Modes that share a peak are identified together, in a band of their own. The nearest modes outside a
band are known from their own, and every band is explained again with the neighbours that the first
pass left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayes_ssi.measurements.records.band_groups import Group, groups_of, in_directions, spectra_of
from bayes_ssi.measurements.records.explained_band import Explained, Odds
from bayes_ssi.measurements.records.local_fit import DAMPING, Fitter
from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.local_spectra import LocalSpectra
from bayes_ssi.measurements.records.mode_candidates import Candidates, no_resonances
from bayes_ssi.measurements.records.mode_selection import UNEXPECTED, with_others, without_needless
from bayes_ssi.measurements.records.spectra import Transforms
from bayes_ssi.measurements.records.two_modes import nats_of_a_pair, share_a_peak, two_in_place_of

# When modes are known, their bands reach so many bandwidths where that moves no frequency or
# damping by more claimed standard deviations than two estimates from much the same lines may.
SHARP_REACH, SAME = 6.0, 2.5
# Where a band's spectra are not explained, it reaches this share as far, on the same condition.
NARROWER = 0.6
# Nats that phases must gain: sensors are in step but for few records.
PHASES = 5.0
# Nats that a second mode of a peak must gain: one in a thousand peaks has one that shows as no
# peak of its own, and a false pair misleads more than a missed one.
RARE_PAIR = 7.0
# A pole that more than this share of the orders has is tried where there is no peak, too.
AGREED = 0.5
# Nats that a band may say at most of what drives all.
DECISIVE = (-8.0, 50.0)
# Below this a damping may be that of a spike of a wider resonance.
SUSPECT_DAMPING = 0.01


_Prepared = tuple[Group, LocalSpectra, Resonances]


def explain(
    transforms: Transforms,
    found: Candidates,
    band_hz: tuple[float, float],
    fixed: bool = False,
    is_driven: bool = False,
) -> list[Explained]:
    """The bands of all candidates' peaks, explained; those next to the search, too."""
    modes = found.of_peaks.beside(_between_bands(transforms, found, band_hz))
    bands: list[Explained] = []
    one_source = is_driven
    for is_first in (True, False):
        prepared: list[_Prepared] = []
        for group in groups_of(transforms, modes, band_hz):
            data = spectra_of(transforms, group, modes)
            if data is not None:
                prepared.append((group, *data))
        if is_first and not is_driven:
            # Where independent loads do not explain the spectra, one source may: as they stand, or
            # when more modes have been tried.
            one_source = _is_one_source(_plain(prepared, True), _plain(prepared, False))
        each = _all_explained(prepared, one_source, found, fixed)
        if is_first and not one_source and any(_doubtful(band) for band in each):
            others = _all_explained(prepared, True, found, fixed)
            if _fewer_doubts(others, each):
                one_source, each = True, others
        bands = [band for band in each if band is not None]
        modes = no_resonances(len(transforms.values))
        for band in bands:
            modes = modes.joined(band.modes)
    wide = groups_of(transforms, modes, band_hz, SHARP_REACH)
    narrow = groups_of(transforms, modes, band_hz, share=NARROWER)
    return [
        _of_other_reach(transforms, band, wide if band.doubt is None else narrow, modes)
        for band in bands
    ]


def _between_bands(
    transforms: Transforms, found: Candidates, band_hz: tuple[float, float]
) -> Resonances:
    """Poles that many orders agree on, where no peak's band reaches."""
    f = found.others.frequencies_hz
    free = (found.shares > AGREED) & (f > band_hz[0]) & (f < band_hz[1])
    for group in groups_of(transforms, found.of_peaks, band_hz):
        free &= (f < group.low) | (f > group.high)
    return found.others.at(np.flatnonzero(free).tolist())


def _of_other_reach(
    transforms: Transforms, band: Explained, groups: Sequence[Group], modes: Resonances
) -> Explained:
    """The band with another reach, where that says the same and is explained.

    Wider ones have smaller errors; narrower ones leave out what is farther off and unexplained.
    """
    f = band.fit.modes.frequencies_hz
    own = [g for g in groups if np.array_equal(g.modes.frequencies_hz, f)]
    if not own or not band.is_wanted:
        return band
    found = spectra_of(transforms, own[0], modes)
    if found is None:
        return band
    data, neighbours = found
    start = in_directions(data, own[0].modes)
    fit = Fitter(data, neighbours, band.fit.one_source).fit(start, band.fit.has_phases)
    m = len(f)
    moves = (
        np.log(fit.modes.frequencies_hz / f),
        np.log(fit.modes.dampings / band.fit.modes.dampings),
    )
    sds = np.sqrt(band.fit.covariance.diagonal()[: 2 * m])
    is_same = bool((np.abs(np.concatenate(moves)) < SAME * sds).all())
    other = replace(band, fit=fit)
    return other if is_same and fit.are_modes.all() and other.doubt is None else band


def _all_explained(
    prepared: Sequence[_Prepared], one_source: bool, found: Candidates, fixed: bool
) -> list[Explained | None]:
    """Bands, or None for those without a mode."""
    return [
        _explained(Fitter(data, neighbours, one_source), group, found, fixed)
        for group, data, neighbours in prepared
    ]


def _plain(prepared: Sequence[_Prepared], one_source: bool) -> list[Explained]:
    """Bands as the candidates have them, whose sensors may have phases: late ones are no source."""
    bands = []
    for group, data, neighbours in prepared:
        fitter = Fitter(data, neighbours, one_source)
        real = fitter.fit(in_directions(data, group.modes), has_phases=False)
        bands.append(Explained(fitter.fit(real, has_phases=True), (), group.is_wanted))
    return bands


def _is_one_source(one: Sequence[Explained], many: Sequence[Explained]) -> bool:
    """Whether one process drives everything: it explains more bands, or as many and better."""
    doubts = [sum(map(_doubtful, each)) for each in (one, many)]
    nats = [
        float(np.clip(a.fit.log_evidence - b.fit.log_evidence, *DECISIVE))
        for a, b in zip(one, many, strict=True)
        if a.excess < 1.0
    ]
    return doubts[0] < doubts[1] or (doubts[0] == doubts[1] and sum(nats) > UNEXPECTED)


def _doubtful(band: Explained | None) -> bool:
    return band is not None and band.is_wanted and band.doubt is not None


def _fewer_doubts(one: Sequence[Explained | None], other: Sequence[Explained | None]) -> bool:
    """Whether the first explain more bands."""
    return sum(map(_doubtful, one)) < sum(map(_doubtful, other))


def _explained(fitter: Fitter, group: Group, found: Candidates, fixed: bool) -> Explained | None:
    """A band, or None where it holds no mode; what is beside the search is only estimated."""
    data = fitter.data
    starts = [in_directions(data, group.modes)]
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
            fit = with_others(fitter, fit, found.poles)
        fit = without_needless(fitter, fit, clear)
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
        if i + 1 < len(best.modes.frequencies_hz) and share_a_peak(best.modes, i):
            peaks.append(((i, i + 1), Odds(0.0, by_phases, nats_of_a_pair(fitter, best, i))))
            i += 2
            continue
        gain, two = two_in_place_of(fitter, best, i)
        nats = Odds(0.0, by_phases, max(0.0, by_phases) + gain - RARE_PAIR)
        if two is not None and gain > RARE_PAIR and not fixed:
            best = two
            peaks.append(((i, i + 1), nats))
            i += 2
            continue
        peaks.append(((i,), nats))
        i += 1
    return Explained(best, tuple(peaks), group.is_wanted)
