"""Whose clock is late, and whose phases are damping's own: by evidence over all modes.

A sensor that is late by τ turns in every mode by -2π f τ; damping turns each mode's motion by an
angle of its own, a small one but where a damper is. Nobody knows the phase of a whole shape:

    arg φ_s = c - 2π f τ_s + α_s + noise, but for half turns.

All priors are normal, so that every explanation has its evidence in closed form. Sensors are given
a delay, or phases of their own, one after another while that is more probable than not. A sensor
with phases of its own in every mode may also be late: they take up any delay, and say nothing.
"""

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.band_search import explain, widened
from bayes_ssi.measurements.records.explained_band import Explained, complex_shapes
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.spectra import BandHz, Transforms

DELAY_SD_S = 0.02
PHASE_SDS = (0.2, 1.0)  # of sensors with phases of their own in every mode: small, or any
PRIOR_NATS = -4.6  # one sensor in a hundred is late, and as many have phases of their own
# What all sensors may have out of phase over the length of a shape, whatever the reason.
SPREADS = (0.003, 0.01, 0.03, 0.1)
WHOLE_PHASE_SD = 10.0
SURE = 0.99  # probability above which a delay is removed
SUSPECTED = 0.9  # above which a check fails
MOST_SEARCHES = 3  # delays are sought again where shapes still have phases


class Delay(NamedTuple):
    """Of one sensor against the others, in s."""

    sensor: int
    seconds: float
    deviation: float
    probability: float  # of a delay, rather than phases of the sensor's own or none

    @property
    def is_sure(self) -> bool:
        return self.probability > SURE


class OnTime(NamedTuple):
    """What is explained once sensors are on time."""

    possible: Candidates  # as they were before
    transforms: Transforms
    bands: list[Explained]
    delays_s: FloatArray  # (n,), that were removed
    removed: list[Delay]
    doubtful: list[Delay]  # that were not, since the evidence is too little


def explained_on_time(
    transforms: Transforms, possible: Candidates, band_hz: BandHz, fixed: bool, is_driven: bool
) -> OnTime:
    """Bands, without the delays that the phases of all modes show."""
    seconds = np.zeros(len(transforms.values))
    removed: dict[int, Delay] = {}
    for n_left in reversed(range(MOST_SEARCHES + 1)):
        on_time = transforms.turned(seconds)
        bands = explain(on_time, possible.turned(seconds), band_hz, fixed, is_driven)
        delays = _delays_of_bands(bands) if bands else []
        sure = [delay for delay in delays if delay.is_sure]
        if not (sure and n_left):
            break
        for delay in sure:
            seconds[delay.sensor] += delay.seconds
            removed[delay.sensor] = delay._replace(seconds=float(seconds[delay.sensor]))
    doubtful = [delay for delay in delays if not delay.is_sure]
    bands = widened(on_time, bands, band_hz)
    return OnTime(possible, on_time, bands, seconds, sorted(removed.values()), doubtful)


def _delays_of_bands(bands: Sequence[Explained]) -> list[Delay]:
    of_bands = (complex_shapes(each.fit) for each in bands)
    frequencies, shapes, covariances = zip(*of_bands, strict=True)
    return delays_of(
        np.concatenate(shapes, axis=1), np.concatenate(covariances), np.concatenate(frequencies)
    )


def delays_of(
    shapes: ComplexArray, covariances: FloatArray, frequencies_hz: FloatArray
) -> list[Delay]:
    """Of sensors that are late or have phases of their own, by unit shapes (n, m) of modes (m,).

    Covariances (m, n, n) are those of the imaginary parts of turned shapes, and as large as those
    of the real parts.
    """
    n, omega = len(shapes), 2.0 * np.pi * frequencies_hz
    angles, covariances, scatter = _phases(shapes.T, covariances, omega[:, None])
    spreads, phase_sds = np.array([*product(SPREADS, PHASE_SDS)]).T[..., None, None]
    noise = covariances + spreads[..., None] ** 2 * scatter  # (priors, m, n, n)
    steps = -DELAY_SD_S * omega

    @cache
    def explained(chosen: tuple[int, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """ln p of each prior, if some sensors s are late (s) or have phases of their own (n + s).

        And delays and their covariances, in standard deviations of their prior.
        """
        late, own = [c for c in chosen if c < n], [c - n for c in chosen if c >= n]
        matrices = noise.copy()
        matrices[..., own, own] += phase_sds**2
        inverse = np.linalg.inv(matrices)
        solved = (inverse @ angles[..., None])[..., 0]
        slope = np.einsum("j,pjs->ps", steps, solved)[:, late]
        precision = np.einsum("j,pjst->pst", steps**2, inverse)[:, late][:, :, late]
        precision += np.eye(len(late))
        covariance = np.linalg.inv(precision)
        means = (covariance @ slope[..., None])[..., 0]
        values = (slope * means).sum(1) - (angles * solved).sum((1, 2))
        values -= np.linalg.slogdet(matrices)[1].sum(1) + np.linalg.slogdet(precision)[1]
        return 0.5 * values + PRIOR_NATS * len(chosen), means, covariance

    def log_evidence(chosen: tuple[int, ...]) -> float:
        return float(logsumexp(explained(chosen)[0]))

    def with_one_more(chosen: tuple[int, ...]) -> list[tuple[int, ...]]:
        every = ({g, *(c for c in chosen if c % n != g % n)} for g in range(2 * n))
        return [tuple(sorted(each)) for each in every if each != {*chosen}]

    # One sensor alone may explain too little beside another: two steps are tried at once.
    chosen, likeliest = tuple[int, ...]([-1]), tuple[int, ...]()
    while chosen != likeliest:
        chosen = likeliest
        first = max(with_one_more(chosen), key=log_evidence)
        likeliest = max([chosen, first, *with_one_more(first)], key=log_evidence)
    delays = []
    for s in sorted(c % n for c in chosen):
        others = tuple(c for c in chosen if c % n != s)
        rivals = [log_evidence(others + one) for one in ((s,), (n + s,), ())]
        values, means, covariances = explained((*others, s))
        best, place = values.argmax(), sum(c < n for c in others)
        deviation = DELAY_SD_S * covariances[best, place, place] ** 0.5
        seconds = DELAY_SD_S * means[best, place]
        delays.append(Delay(s, float(seconds), float(deviation), float(softmax(rivals)[0])))
    return delays


def _phases(
    shapes: ComplexArray, covariances: FloatArray, omega: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Phases (m, n) of shapes (m, n) less a mode's own, their covariances, and those of a spread.

    Half turns are those next to delays that all modes have in common; the median sensor is on time:
    least squares of the phases of modes and of sensors, in turn, of the shapes' squares. Delays are
    tried over half a period of the root mean square of the frequencies ``omega`` (m, 1) in rad/s.
    """
    n = shapes.shape[1]
    powers = np.maximum(np.abs(shapes) ** 2, 1e-12)
    # Large motion tells its phase no better than the spread lets it: a damper's is one of many.
    squares = shapes**2 / (powers + SPREADS[-1] ** 2 / n)
    sought = np.linspace(-0.5, 0.5, 2001) * np.pi / np.sqrt((omega**2).mean())
    waves = np.exp(2j * omega * sought)
    seconds = np.zeros(n)
    for _ in range(20):
        modes = (squares * np.exp(2j * omega * seconds)).sum(1, keepdims=True)
        of_sensors = squares * np.conj(modes / np.abs(modes))
        seconds = sought[(of_sensors.T @ waves).real.argmax(1)]
        seconds = seconds - np.median(seconds)
    angles = 0.5 * np.angle(of_sensors * np.exp(2j * omega * seconds)) - omega * seconds
    inverse = shapes / powers
    noise = covariances * (inverse[:, :, None] * inverse[:, None].conj()).real
    return angles, noise + WHOLE_PHASE_SD**2, np.eye(n) / (n * powers[:, None])
