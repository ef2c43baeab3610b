"""The bands of a record explained: what drives them, which modes, one or two at each peak.

Modes that share a peak are identified together, in a band of their own. The nearest modes outside a
band are known from their own, and every band is explained again with the neighbours that the first
pass left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayes_ssi.measurements.records.band_groups import Group, groups_of, spectra_of
from bayes_ssi.measurements.records.explained_band import Explained, ExplainedPeak
from bayes_ssi.measurements.records.identification_settings import BANDS, FIT, SELECTION
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.mode_selection import (
    nats_of_a_pair,
    share_a_peak,
    two_in_place_of,
    with_others,
    without_needless,
)
from bayes_ssi.measurements.records.resonances import Resonances
from bayes_ssi.measurements.records.spectra import LocalSpectra, Transforms

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
    prepared = _prepared(transforms, modes, band_hz)
    if is_driven:
        one_source, bands = True, _all_explained(prepared, True, found, fixed)
    else:
        # Where independent loads do not explain the spectra, one source may: as they stand, or when
        # more modes have been tried.
        one_source = _is_one_source(_plain(prepared, True), _plain(prepared, False))
        bands = _all_explained(prepared, one_source, found, fixed)
        if not one_source and _n_doubtful(bands):
            of_one_source = _all_explained(prepared, True, found, fixed)
            if _n_doubtful(of_one_source) < _n_doubtful(bands):
                one_source, bands = True, of_one_source
    # Again, with the neighbours that are known now.
    modes = _modes_of(bands, len(transforms.values))
    prepared = _prepared(transforms, modes, band_hz)
    bands = _all_explained(prepared, one_source, found, fixed)
    modes = _modes_of(bands, len(transforms.values))
    wide = groups_of(transforms, modes, band_hz, BANDS.least_bandwidths_of_known_modes)
    narrow = groups_of(transforms, modes, band_hz, share=BANDS.unexplained_reach)
    return [
        _of_other_reach(transforms, band, wide if band.doubt is None else narrow, modes)
        for band in bands
    ]


def _between_bands(
    transforms: Transforms, found: Candidates, band_hz: tuple[float, float]
) -> Resonances:
    """Poles that many orders agree on, where no peak's band reaches."""
    f = found.others.frequencies_hz
    free = (found.shares > SELECTION.share_of_orders) & (f > band_hz[0]) & (f < band_hz[1])
    for group in groups_of(transforms, found.of_peaks, band_hz):
        free &= (f < group.low) | (f > group.high)
    return found.others.at(np.flatnonzero(free).tolist())


def _prepared(
    transforms: Transforms, modes: Resonances, band_hz: tuple[float, float]
) -> list[_Prepared]:
    """Bands with their spectra and neighbours."""
    groups = groups_of(transforms, modes, band_hz)
    spectra = [(group, spectra_of(transforms, group, modes)) for group in groups]
    return [(group, *data) for group, data in spectra if data is not None]


def _modes_of(bands: Sequence[Explained], n_channels: int) -> Resonances:
    modes = Resonances.none(n_channels)
    for band in bands:
        modes = modes.joined(band.modes)
    return modes


def _of_other_reach(
    transforms: Transforms, band: Explained, groups: Sequence[Group], modes: Resonances
) -> Explained:
    """The band with another reach, where that says the same and is explained.

    Wider ones have smaller errors; narrower ones leave out what is farther off and unexplained.
    """
    f = band.fit.modes.frequencies_hz
    same = [group for group in groups if np.array_equal(group.modes.frequencies_hz, f)]
    if not same or not band.is_wanted:
        return band
    found = spectra_of(transforms, same[0], modes)
    if found is None:
        return band
    data, neighbours = found
    start = same[0].modes.in_directions(data)
    fit = Fitter(data, neighbours, band.fit.one_source).fit(start, band.fit.has_phases)
    moves = (
        np.log(fit.modes.frequencies_hz / f),
        np.log(fit.modes.dampings / band.fit.modes.dampings),
    )
    sds = np.sqrt(band.fit.covariance.diagonal()[: 2 * len(f)])
    is_same = bool((np.abs(np.concatenate(moves)) < BANDS.most_sds_by_reach * sds).all())
    other = replace(band, fit=fit)
    return other if is_same and fit.are_modes.all() and other.doubt is None else band


def _plain(prepared: Sequence[_Prepared], one_source: bool) -> list[Explained]:
    """Bands as the candidates have them, whose sensors may have phases: late ones are no source."""
    bands = []
    for group, data, neighbours in prepared:
        fitter = Fitter(data, neighbours, one_source)
        real = fitter.fit(group.modes.in_directions(data), has_phases=False)
        bands.append(Explained(fitter.fit(real, has_phases=True), (), group.is_wanted))
    return bands


def _is_one_source(one: Sequence[Explained], many: Sequence[Explained]) -> bool:
    """Whether one process drives everything: it explains more bands, or as many and better."""
    if _n_doubtful(one) != _n_doubtful(many):
        return _n_doubtful(one) < _n_doubtful(many)
    nats = [
        float(np.clip(a.fit.log_evidence - b.fit.log_evidence, *SELECTION.nats_of_one_band))
        for a, b in zip(one, many, strict=True)
        if a.excess < 1.0
    ]
    return sum(nats) > SELECTION.nats_of_a_mode


def _n_doubtful(bands: Sequence[Explained]) -> int:
    return sum(band.is_wanted and band.doubt is not None for band in bands)


def _all_explained(
    prepared: Sequence[_Prepared], one_source: bool, found: Candidates, fixed: bool
) -> list[Explained]:
    """Bands with their modes and peaks; without those that hold no mode.

    What is beside the search is only estimated.
    """
    bands = []
    for group, data, neighbours in prepared:
        fitter = Fitter(data, neighbours, one_source)
        real, turned = _fits(fitter, group.modes.in_directions(data))
        fit = _with_phases_if_needed(real, turned)
        if not fixed:
            if group.is_wanted:
                fit = with_others(fitter, fit, found.poles)
            fit = without_needless(fitter, fit, [peak for peak in found.peaks if peak.is_clear])
            if not fit.modes.n_modes:
                continue
        if fit is not real and fit is not turned:
            real = fitter.fit(fit.modes, has_phases=False)
            turned = fitter.fit(real, has_phases=True)
        best = _with_phases_if_needed(real, turned)
        peaks: list[ExplainedPeak] = []
        if group.is_wanted:
            by_phases = turned.log_evidence - real.log_evidence - SELECTION.nats_of_phases
            best, peaks = _peaks(fitter, best, by_phases, fixed)
        bands.append(Explained(best, tuple(peaks), group.is_wanted))
    return bands


def _fits(fitter: Fitter, start: Resonances) -> tuple[LocalFit, LocalFit]:
    """The most probable modes with real shapes, and whose sensors have phases."""
    starts = [start]
    if (start.dampings < SELECTION.damping_of_spikes).any():
        # Perhaps a spike of a wider resonance.
        starts.append(start._replace(dampings=start.dampings.clip(1.3 * FIT.damping)))
    fits = [fitter.fit(modes, has_phases=False) for modes in starts]
    real = max(fits, key=lambda fit: fit.log_evidence)
    return real, fitter.fit(real, has_phases=True)


def _with_phases_if_needed(real: LocalFit, turned: LocalFit) -> LocalFit:
    needed = real.log_evidence + SELECTION.nats_of_phases
    return real if needed > turned.log_evidence else turned


def _peaks(
    fitter: Fitter, best: LocalFit, by_phases: float, fixed: bool
) -> tuple[LocalFit, list[ExplainedPeak]]:
    """The fit with two modes at the peaks that ask for them, and all peaks."""
    peaks: list[ExplainedPeak] = []
    i = 0
    while i < best.modes.n_modes:
        if share_a_peak(best.modes, i):
            peaks.append(ExplainedPeak((i, i + 1), by_phases, nats_of_a_pair(fitter, best, i)))
        else:
            gain, two = two_in_place_of(fitter, best, i)
            by_two = max(0.0, by_phases) + gain - SELECTION.nats_of_a_pair
            is_pair = two is not None and gain > SELECTION.nats_of_a_pair and not fixed
            peaks.append(ExplainedPeak((i, i + 1) if is_pair else (i,), by_phases, by_two))
            best = two if two is not None and is_pair else best
        i += len(peaks[-1].modes)
    return best, peaks
