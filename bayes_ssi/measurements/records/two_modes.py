"""Two modes in place of one at a peak of the spectra, or one in place of two."""

from __future__ import annotations

import math

import numpy as np

from bayes_ssi.foundations.arrays import ComplexArray
from bayes_ssi.measurements.records.local_fit import Fitter, LocalFit, gain_of
from bayes_ssi.measurements.records.local_model import Resonances
from bayes_ssi.measurements.records.mode_selection import SEPARATE

# Modes closer than this times the sum of half their bandwidths share a peak.
SHARED = 3.0
# Both are within so many half bandwidths of the one mode: farther off there would be a peak.
NEAR = 1.25
# Where the two modes of a peak are at first, in dampings from its middle, and their damping.
SPLITS, NARROWER = (0.5, 1.0), 0.7
# All starts climb so many steps, and the best of them to the top.
FIRST_STEPS, BEST_STARTS = 8, 3
# Their shapes: shares of the one mode's shape, and of what it leaves unexplained.
PAIRS = (
    (np.array([1.0, 1.0]), np.array([0.3, -0.3])),
    (np.array([1.0, 1.0]), np.array([-0.3, 0.3])),
    (np.array([1.0, 0.3]), np.array([0.0, 1.0])),
    (np.array([0.3, 1.0]), np.array([1.0, 0.0])),
)


def two_in_place_of(fitter: Fitter, fit: LocalFit, i: int) -> tuple[float, LocalFit | None]:
    """Nats by which two modes explain a peak better than one, and the fit with two."""
    one = fit.modes.at([i])
    frequency, damping = float(one.frequencies_hz[0]), float(one.dampings[0])
    unexplained = direction = _unexplained(fit, frequency, damping)
    gain = 0.0
    for sign in (-1.0, 1.0):
        for shape in (unexplained, one.shapes[:, 0]):
            flank = Resonances(
                np.array([frequency * (1.0 + sign * damping)]), one.dampings, shape[:, None]
            )
            own, its_shape = gain_of(fitter, fit, flank)
            if own > gain:
                gain = own
                if fitter.one_source:
                    direction = its_shape
    n_unknowns = 2 + (fitter.r - 1) * (1 + fit.has_phases) + 2 * fitter.r
    n_lines = max(math.e, 2.0 * damping * frequency / fit.data.line_hz)
    if gain < 0.8 * n_unknowns:
        return gain - 0.5 * n_unknowns * math.log(n_lines), None
    others = fit.modes.at([j for j in range(len(fit.modes.frequencies_hz)) if j != i])
    begun = []
    for split in SPLITS:
        for mix in PAIRS:
            shapes = one.shapes * mix[0] + direction[:, None] * mix[1]
            pair = Resonances(
                frequency * (1.0 + split * damping * np.array([-1.0, 1.0])),
                np.full(2, NARROWER * damping),
                shapes / np.linalg.norm(shapes, axis=0),
            )
            begun.append(fitter.fit(others.joined(pair), fit.has_phases, FIRST_STEPS))
    begun.sort(key=lambda each: each.log_likelihood, reverse=True)
    best: LocalFit | None = None
    for each in begun[:BEST_STARTS]:
        two = fitter.fit(each, fit.has_phases)
        if not (two.converged and two.are_modes.all()):
            continue
        nearest = np.argsort(np.abs(two.modes.frequencies_hz - frequency))[:2]
        reach = NEAR * max(two.modes.half_widths_hz[nearest].max(), damping * frequency)
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


def share_a_peak(modes: Resonances, i: int) -> bool:
    """Whether a mode and the next meet before either has fallen to a tenth of its power."""
    apart = modes.frequencies_hz[i + 1] - modes.frequencies_hz[i]
    return bool(apart < SHARED * modes.half_widths_hz[i : i + 2].sum())


def nats_of_a_pair(fitter: Fitter, fit: LocalFit, i: int) -> float:
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
