"""Which candidates are modes of a band, by evidence."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from bayes_ssi.measurements.records.band_groups import in_directions
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit, gain_of
from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.mode_candidates import Prominence

# Nats that a mode without a clear peak must gain: one in e³ is there.
UNEXPECTED = 3.0
# Two modes differ in frequency by more than this share of their mean half-power bandwidth.
SEPARATE = 0.2
# Modes more of a band than this are not looked for.
MOST_MODES = 8


def with_others(fitter: Fitter, fit: LocalFit, poles: Resonances) -> LocalFit:
    """The fit with those other poles that the evidence asks for, the strongest first."""
    f, known = poles.frequencies_hz, fit.modes
    low, high = fitter.data.band_hz
    apart = np.abs(f[:, None] - known.frequencies_hz)
    new = (apart > SEPARATE * (poles.half_widths_hz[:, None] + known.half_widths_hz)).all(1)
    inside = np.flatnonzero((f > low) & (f < high) & new).tolist()
    others = in_directions(fitter.data, poles.at(inside))
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


def without_needless(fitter: Fitter, fit: LocalFit, clear: Sequence[Prominence]) -> LocalFit:
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
