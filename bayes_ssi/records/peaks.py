"""How many modes a peak of the spectra holds, one or two, by evidence.

Two modes under one peak are a model class of their own: modes of the peak's place, whose prior is
as wide as the peak. How close two modes may be and still be told apart follows from the record's
length: two equal modes with the same shape, d half-power bandwidths apart, fit better than one by

    (π/4) d⁴ ζ f T   nats

to leading order in d, whether their forces are coherent or not, since the best single mode takes up
all else. A second mode costs half the logarithm of the lines in the bandwidth for each unknown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from bayes_ssi.records.bayesian_fft import BandFit, fit_band
from bayes_ssi.records.modal_estimates import Poles
from bayes_ssi.records.spectra import Lines

# Modes closer than this, in half-power bandwidths, share a peak: they meet where each has fallen to
# a tenth of its power.
SHARED = 3.0
# A mode whose forces are this many nats from zero is not tried without: priors weigh far less.
BEYOND_DOUBT = 200.0
# Where the two modes of a peak are at first, in dampings from its middle. One mode that stands for
# two has more damping than they have.
SPLITS, NARROWER = (0.5, 1.0), 0.7
# Where a second mode would show first, in dampings from the one that is there.
FLANKS = (-1.0, 1.0)
# The probability that leaves no doubt, in words.
SURE = 0.95


class Peak(NamedTuple):
    """A peak of the spectra, and how many modes it holds.

    Attributes:
        frequencies_hz: of its modes, one or two.
        probability_of_two: that it holds two modes rather than one, each equally probable before;
            None where the spectra around it are explained by neither.
        resolution_hz: two modes of one shape that are closer could not be told from one.
        resolution: the same in half-power bandwidths.
    """

    frequencies_hz: tuple[float, ...]
    probability_of_two: float | None
    resolution_hz: float
    resolution: float

    def __str__(self) -> str:
        at = " and ".join(f"{f:.4g}" for f in self.frequencies_hz)
        p = self.probability_of_two
        if p is None:
            return f"peak at {at} Hz: one mode or two, no model explains the spectra around it"
        chance = "above 0.999" if p > 0.999 else "below 0.001" if p < 0.001 else f"{p:.3f}"
        text = f"peak at {at} Hz: two modes with a probability {chance}"
        if p > SURE:
            return text
        closer = f"{self.resolution_hz:.2g} Hz ({self.resolution:.2g} bandwidths)"
        if p < 1.0 - SURE:
            return f"{text}; modes closer than about {closer} could not be told apart"
        return f"{text}: the record cannot tell"


def with_shapes_exchanged(fit: BandFit, lines: Lines) -> BandFit:
    """The fit with the more probable shapes of modes that share a peak.

    Either shape can be that of the lower frequency, which are two local optima.
    """
    for members in _peaks_of(fit.poles):
        for pair in pairwise(members):
            fit = _exchanged(fit, list(pair), lines)
    return fit


def split_peaks(fit: BandFit, lines: Lines, *, fixed: bool) -> tuple[BandFit, tuple[Peak, ...]]:
    """Fit two modes to the peaks that hold two, and say of every peak how probable that is.

    Args:
        fit: modes of the band.
        lines: of the record.
        fixed: whether the number of modes stays as it is.

    Returns:
        The fit with the modes that are more probable, and its peaks in ascending order.
    """
    if not fit.settled:  # what it would gain by a mode more says nothing
        return fit, tuple(_described(fit, members, None, lines) for members in _peaks_of(fit.poles))
    log_odds: dict[float, float | None] = {}
    alone = [members[0] for members in _peaks_of(fit.poles) if len(members) == 1]
    for frequency in fit.poles.frequencies_hz[alone].tolist():
        now = int(np.abs(fit.poles.frequencies_hz - frequency).argmin())
        odds, two = _of_a_second_mode(fit, now, lines)
        log_odds[frequency] = odds
        if odds is not None and odds > 0.0 and two is not None and not fixed:
            fit = two
    peaks = []
    for members in _peaks_of(fit.poles):
        inside = [f for f in log_odds if _spans(fit.poles.at(members), f)]
        if inside:
            odds = log_odds[inside[0]]
        elif len(members) == 1:  # moved by a mode more in another peak
            odds, _ = _of_a_second_mode(fit, members[0], lines)
        else:
            odds = _of_a_pair(fit, members, lines)
        peaks.append(_described(fit, members, odds, lines))
    return fit, tuple(peaks)


def _peaks_of(poles: Poles) -> list[list[int]]:
    """Modes that share each peak, all in ascending order."""
    groups: list[list[int]] = []
    for i in np.argsort(poles.frequencies_hz).tolist():
        if groups:
            pair = poles.at([groups[-1][-1], i])
            apart = float(np.diff(pair.frequencies_hz)[0])
            if apart < SHARED * float((pair.dampings * pair.frequencies_hz).sum()):
                groups[-1].append(i)
                continue
        groups.append([i])
    return groups


def _share_a_peak(poles: Poles, frequency_hz: float) -> bool:
    """Whether the two modes nearest to a frequency share a peak."""
    nearest = set(_nearest_two(poles, frequency_hz))
    return any(nearest <= set(members) for members in _peaks_of(poles))


def _spans(members: Poles, frequency_hz: float) -> bool:
    """Whether a frequency is within half a bandwidth of the modes of a peak, or between them."""
    widths = members.dampings * members.frequencies_hz
    low, high = members.frequencies_hz - widths, members.frequencies_hz + widths
    return bool(low.min() <= frequency_hz <= high.max())


def _if_explained(log_odds: float, more_probable: BandFit, members: Sequence[int]) -> float | None:
    """The log odds, if the more probable modes explain the spectra as far as they reach."""
    poles = more_probable.poles.at(members)
    reach = SHARED * poles.dampings * poles.frequencies_hz
    low, high = (poles.frequencies_hz - reach).min(), (poles.frequencies_hz + reach).max()
    return log_odds if more_probable.explains(float(low), float(high)) else None


def _of_a_second_mode(fit: BandFit, i: int, lines: Lines) -> tuple[float | None, BandFit | None]:
    """Log odds of two modes in place of one, and the fit with two where one was tried."""
    poles, one = fit.poles, fit.poles.at([i])
    frequency = float(one.frequencies_hz[0])
    flanks = [
        one._replace(frequencies_hz=one.frequencies_hz * (1 + s * one.dampings)) for s in FLANKS
    ]
    gain = max(fit.gain_of(flank) for flank in flanks)
    bandwidth = 2.0 * float((one.dampings * one.frequencies_hz)[0])
    unlikely = gain - _cost(fit, bandwidth, lines)
    # Noise gains about half a nat for each unknown.
    if gain < fit.n_unknowns_of_a_mode:
        return _if_explained(min(unlikely, 0.0), fit, [i]), None
    others = poles.at([j for j in range(fit.model.n_modes) if j != i])
    fits = [
        fit_band(lines, others.joined(_pair(fit, i, split)), fit.q, fit.loads) for split in SPLITS
    ]
    arrived = [
        each for each in fits if each.is_most_probable and _share_a_peak(each.poles, frequency)
    ]
    if not arrived:
        return _if_explained(min(unlikely, 0.0), fit, [i]), None
    two = max(arrived, key=lambda each: each.log_evidence)
    two = _exchanged(two, _nearest_two(two.poles, frequency), lines)
    log_odds = two.log_evidence - fit.log_evidence + _by_place(two, frequency)
    if log_odds > 0.0:
        return _if_explained(log_odds, two, _nearest_two(two.poles, frequency)), two
    return _if_explained(log_odds, fit, [i]), two


def _pair(fit: BandFit, i: int, split: float) -> Poles:
    """Two modes about one, with shapes that differ in the direction of second most motion."""
    frequency, damping = fit.poles.frequencies_hz[i], fit.poles.dampings[i]
    nearest = np.abs(fit.data.frequencies_hz - frequency).argmin()
    second = np.linalg.eigh(fit.data.matrices[nearest].real)[1][:, -2]
    shapes = fit.poles.shapes[:, [i]] + 0.1 * second[:, None] * [1.0, -1.0]
    return Poles(
        frequency * (1.0 + split * damping * np.array([-1.0, 1.0])),
        np.full(2, NARROWER * damping),
        shapes / np.sqrt((shapes**2).sum(0)),
    )


def _by_place(two: BandFit, frequency_hz: float) -> float:
    """ln of the prior of a second mode in its peak over that in the whole band.

    Given that the peak holds two modes, the logarithms of their frequencies differ by a normal
    number whose standard deviation is the relative half-power bandwidth.
    """
    pair = _nearest_two(two.poles, frequency_hz)
    width = 2.0 * float(two.poles.dampings[pair].mean())
    apart = float(np.diff(np.log(two.poles.frequencies_hz[pair]))[0])
    low, high = np.log(two.data.frequencies_hz[[0, -1]])
    half = 0.5 * (high - low)
    off = math.log(frequency_hz) - 0.5 * (high + low)
    in_peak = -0.5 * (apart / width) ** 2 - math.log(width)
    return in_peak + 0.5 * (off / half) ** 2 + math.log(half)


def _exchanged(fit: BandFit, pair: Sequence[int], lines: Lines) -> BandFit:
    """The fit, or that from the pair's shapes exchanged where it is the more probable."""
    shapes = fit.poles.shapes.copy()
    shapes[:, pair] = shapes[:, pair[::-1]]
    other = fit_band(lines, fit.poles._replace(shapes=shapes), fit.q, fit.loads)
    return other if other.is_most_probable and other.log_evidence > fit.log_evidence else fit


def _nearest_two(poles: Poles, frequency_hz: float) -> list[int]:
    return np.argsort(np.abs(np.log(poles.frequencies_hz / frequency_hz)))[:2].tolist()


def _of_a_pair(fit: BandFit, members: Sequence[int], lines: Lines) -> float | None:
    """Log odds of the two closest modes of a peak against one in their place."""
    frequencies = fit.poles.frequencies_hz
    first = int(np.diff(frequencies[list(members)]).argmin())
    pair = list(members[first : first + 2])
    nats = float(fit.nats_of_forces()[pair].min())
    if nats > BEYOND_DOUBT:
        return _if_explained(nats, fit, pair)
    poles = fit.poles.at(pair)
    strongest = int(fit.nats_of_forces()[pair].argmax())
    middle = float(np.exp(np.log(poles.frequencies_hz).mean()))
    one = Poles(np.array([middle]), poles.dampings[[strongest]], poles.shapes[:, [strongest]])
    others = fit.poles.at([j for j in range(fit.model.n_modes) if j not in pair])
    merged = fit_band(lines, others.joined(one), fit.q, fit.loads)
    log_odds = fit.log_evidence - merged.log_evidence + _by_place(fit, middle)
    if log_odds > 0.0:
        return _if_explained(log_odds, fit, pair)
    return _if_explained(log_odds, merged, _nearest_two(merged.poles, middle)[:1])


def _described(fit: BandFit, members: Sequence[int], log_odds: float | None, lines: Lines) -> Peak:
    poles = fit.poles.at(members)
    width = 2.0 * float((poles.dampings * poles.frequencies_hz).mean())
    closest = (8.0 * _cost(fit, width, lines) / (math.pi * _lines_in(width, lines))) ** 0.25
    probability = None
    if log_odds is not None:
        probability = 1.0 / (1.0 + math.exp(min(700.0, -log_odds)))
    return Peak(tuple(poles.frequencies_hz.tolist()), probability, closest * width, closest)


def _cost(fit: BandFit, width_hz: float, lines: Lines) -> float:
    """Nats that a second mode must gain in a peak of that width."""
    return 0.5 * fit.n_unknowns_of_a_mode * math.log(_lines_in(width_hz, lines))


def _lines_in(width_hz: float, lines: Lines) -> float:
    """Lines of the record in a width, not fewer than have a logarithm of one."""
    return max(math.e, 0.5 * width_hz / float(lines.frequencies_hz[1] - lines.frequencies_hz[0]))
