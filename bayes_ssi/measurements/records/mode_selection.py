"""Which modes a band has, by evidence: those of candidates, and one or two at each peak."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray
from bayes_ssi.measurements.records.identification_settings import SELECTION
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit
from bayes_ssi.measurements.records.mode_candidates import Prominence
from bayes_ssi.measurements.records.resonances import Resonances, turned

# The shapes of a pair at first: shares of the one mode's shape, and of what it leaves unexplained.
SHARES_OF_PAIRS = (
    ((1.0, 1.0), (0.3, -0.3)),
    ((1.0, 1.0), (-0.3, 0.3)),
    ((1.0, 0.3), (0.0, 1.0)),
    ((0.3, 1.0), (1.0, 0.0)),
)


def with_others(fitter: Fitter, fit: LocalFit, poles: Resonances) -> LocalFit:
    """The fit with those other poles that the evidence asks for, the strongest first."""
    f, known = poles.frequencies_hz, fit.modes
    low, high = fitter.data.band_hz
    apart = np.abs(f[:, None] - known.frequencies_hz)
    widths = poles.half_widths_hz[:, None] + known.half_widths_hz
    new = (apart > SELECTION.least_separation * widths).all(1)
    inside = np.flatnonzero((f > low) & (f < high) & new).tolist()
    others = poles.at(inside).in_directions(fitter.data)
    left = list(range(len(inside)))
    unknowns = 2 + 2 * (fitter.r - 1) + 2 * fitter.r
    while left and fit.modes.n_modes < SELECTION.most_modes:
        gains = [fitter.gain_of(fit, others.at([i]))[0] for i in left]
        best = left[int(np.argmax(gains))]
        if max(gains) < 0.5 * unknowns:
            break
        left.remove(best)
        wider = fitter.fit(fit.modes.joined(others.at([best])), fit.has_phases)
        if (
            wider.are_modes.all()
            and wider.log_evidence > fit.log_evidence + SELECTION.nats_of_a_mode
        ):
            fit = wider
    return fit


def without_needless(fitter: Fitter, fit: LocalFit, clear: Sequence[Prominence]) -> LocalFit:
    """The fit without modes whose absence is more probable, the weakest first.

    What has left the band, or has more damping than structures have, is no mode of it; a clear peak
    keeps its mode.
    """
    kept: set[float] = set()
    while fit.modes.n_modes:
        wrong = np.flatnonzero(~fit.are_modes).tolist() or _coinciding(fit)
        nats = fit.model.drive.sizes(fit.modes) / fit.modes.dampings**2
        order = wrong + [int(i) for i in np.argsort(nats) if i not in wrong]
        for i in order:
            f = float(fit.modes.frequencies_hz[i])
            if i not in wrong:
                if any(abs(f / other - 1.0) < 1e-3 for other in kept):
                    continue
                if _is_only_mode_at_a_peak(fit.modes, i, clear):
                    kept.add(f)
                    continue
            without = fitter.fit(fit.modes.without(i), fit.has_phases)
            needed = fit.log_evidence - SELECTION.nats_of_a_mode
            if i in wrong or without.log_evidence > needed:
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
    for i, j in pairwise(np.argsort(f).tolist()):
        if f[j] - f[i] < SELECTION.least_separation * (half[i] + half[j]):
            return [i if sizes[i] < sizes[j] else j]
    return []


def _is_only_mode_at_a_peak(modes: Resonances, i: int, clear: Sequence[Prominence]) -> bool:
    f, half = modes.frequencies_hz, modes.half_widths_hz
    for peak in clear:
        near = np.abs(f - peak.frequency_hz) < half + peak.width_hz
        if near[i] and near.sum() == 1:
            return True
    return False


def share_a_peak(modes: Resonances, i: int) -> bool:
    """Whether there is a next mode, and the two meet before either has a tenth of its power."""
    if i + 1 >= modes.n_modes:
        return False
    apart = modes.frequencies_hz[i + 1] - modes.frequencies_hz[i]
    return bool(apart < SELECTION.shared_peak * modes.half_widths_hz[i : i + 2].sum())


def nats_of_a_pair(fitter: Fitter, fit: LocalFit, i: int) -> float:
    """Nats by which modes i and i + 1 of a peak explain it better than one in their place."""
    pair = [i, i + 1]
    strongest = i + int(fit.model.drive.sizes(fit.modes)[pair].argmax())
    one = fit.modes.at([strongest])
    others = fit.modes.without(*pair)
    middle = np.exp(np.log(fit.modes.frequencies_hz[pair]).mean(keepdims=True))
    merged = max(
        fitter.fit(others.joined(one._replace(frequencies_hz=f)), fit.has_phases).log_evidence
        for f in (middle, one.frequencies_hz)
    )
    return fit.log_evidence - merged


def two_in_place_of(fitter: Fitter, fit: LocalFit, i: int) -> tuple[float, LocalFit | None]:
    """Nats by which two modes explain a peak better than one, and the fit with two."""
    one = fit.modes.at([i])
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    gain, direction = _gain_on_flanks(fitter, fit, one)
    n_unknowns = 2 + (fitter.r - 1) * (1 + fit.has_phases) + 2 * fitter.r
    n_lines = max(math.e, 2.0 * damping * frequency / fit.data.line_hz)
    if gain < 0.8 * n_unknowns:
        return gain - 0.5 * n_unknowns * math.log(n_lines), None
    others = fit.modes.without(i)
    begun = []
    for split in SELECTION.pair_splits:
        for of_one, of_rest in SHARES_OF_PAIRS:
            shapes = one.shapes * np.array(of_one) + direction[:, None] * np.array(of_rest)
            pair = Resonances(
                frequency * (1.0 + split * damping * np.array([-1.0, 1.0])),
                np.full(2, SELECTION.pair_damping * damping),
                shapes / np.linalg.norm(shapes, axis=0),
            )
            start = others.joined(pair)
            begun.append(fitter.fit(start, fit.has_phases, SELECTION.first_steps_of_pairs))
    begun.sort(key=lambda started: started.log_likelihood, reverse=True)
    climbed = (fitter.fit(s, fit.has_phases) for s in begun[: SELECTION.pairs_to_the_top])
    best = max(
        (two for two in climbed if _is_a_pair(two, frequency, damping)),
        key=lambda two: two.log_evidence,
        default=None,
    )
    if best is None:
        return -0.5 * n_unknowns, None
    order = np.argsort(best.modes.frequencies_hz)
    if (np.diff(order) < 0).any():
        best = fitter.fit(best.modes.at(order.tolist()), fit.has_phases)
    nearest = np.sort(_two_nearest(best.modes, frequency))
    # Given that the peak holds two modes, the second is within a bandwidth, not anywhere.
    low, high = fit.data.band_hz
    width = 2.0 * float(best.modes.dampings[nearest].mean())
    apart = float(np.diff(np.log(best.modes.frequencies_hz[nearest]))[0])
    place = math.log(math.log(high / low) / (width * math.sqrt(2.0 * math.pi)))
    by_place = place - 0.5 * (apart / (2.0 * width)) ** 2
    return best.log_evidence - fit.log_evidence + by_place, best


def _gain_on_flanks(fitter: Fitter, fit: LocalFit, one: Resonances) -> tuple[float, ComplexArray]:
    """What a second mode on a flank of one would gain at most, and in which direction (r,)."""
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    unexplained = direction = _unexplained(fit, frequency, damping)
    gain = 0.0
    for sign in (-1.0, 1.0):
        for shape in (unexplained, one.shapes[:, 0]):
            hz = np.array([frequency * (1.0 + sign * damping)])
            flank = Resonances(hz, one.dampings, shape[:, None])
            gain_of_flank, its_shape = fitter.gain_of(fit, flank)
            if gain_of_flank > gain:
                gain = gain_of_flank
                if fitter.one_source:
                    direction = its_shape
    return gain, direction


def _is_a_pair(two: LocalFit, frequency: float, damping: float) -> bool:
    """Whether the two modes nearest to one that they replace are modes, at its peak, and apart."""
    if not (two.converged and two.are_modes.all()):
        return False
    nearest = _two_nearest(two.modes, frequency)
    f, half = two.modes.frequencies_hz[nearest], two.modes.half_widths_hz[nearest]
    if (np.abs(f - frequency) > SELECTION.pair_reach * max(half.max(), damping * frequency)).any():
        return False
    return bool(abs(float(np.diff(f)[0])) >= SELECTION.least_separation * half.sum())


def _two_nearest(modes: Resonances, frequency: float) -> np.ndarray:
    return np.argsort(np.abs(modes.frequencies_hz - frequency))[:2]


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
        real = turned(direction).real
        direction = (real / np.linalg.norm(real)).astype(complex)
    return direction
