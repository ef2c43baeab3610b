"""Whose clock is late, and whose phases are damping's own: by evidence over all modes.

A sensor that is late by τ turns in every mode by -2π f τ; damping turns each mode's motion by an
angle of its own. The imaginary parts of turned shapes are linear in both, and in the phase of the
whole shape, which nobody knows:

    Im φ_s = Re φ_s (c - 2π f τ_s + α_s) + noise.

All priors are normal, so that every explanation has its evidence in closed form. Sensors are given
a delay, or phases of their own, one after another while that is more probable than not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_ssi.foundations.arrays import ComplexArray, FloatArray
from bayes_ssi.measurements.records.band_search import explain
from bayes_ssi.measurements.records.explained_band import Explained, complex_shapes
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.spectra import BandHz, Transforms, turned

DELAY_SD_S = 0.02
PHASE_SD = 0.2  # of a sensor with phases of its own in every mode
PRIOR_NATS = -4.6  # one sensor in a hundred is late, and as many have phases of their own
# Imaginary parts that all sensors may have over the length of a shape, whatever the reason.
SPREADS = (0.003, 0.01, 0.03, 0.1)
WHOLE_PHASE_SD = 10.0
SURE = 0.99  # probability above which a delay is removed
SUSPECTED = 0.9  # above which it is said
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
    suspected: list[Delay]  # that were not, since the evidence is too little


def explained_on_time(
    transforms: Transforms, possible: Candidates, band_hz: BandHz, fixed: bool, is_driven: bool
) -> OnTime:
    """Bands, without the delays that the phases of all modes show."""
    seconds = np.zeros(len(transforms.values))
    removed: dict[int, Delay] = {}
    for n_left in reversed(range(MOST_SEARCHES + 1)):
        on_time = transforms.turned(seconds)
        bands = explain(on_time, possible.turned(seconds), band_hz, fixed, is_driven)
        delays = _delays_of_bands(bands)
        sure = [delay for delay in delays if delay.is_sure]
        if not (sure and n_left):
            break
        for delay in sure:
            seconds[delay.sensor] += delay.seconds
            removed[delay.sensor] = delay._replace(seconds=float(seconds[delay.sensor]))
    suspected = [delay for delay in delays if not delay.is_sure]
    return OnTime(possible, on_time, bands, seconds, sorted(removed.values()), suspected)


def _delays_of_bands(bands: Sequence[Explained]) -> list[Delay]:
    of_bands = [complex_shapes(each.fit) for each in bands if each.is_wanted]
    if not of_bands:
        return []
    frequencies, shapes, covariances = zip(*of_bands, strict=True)
    return delays_of(
        np.concatenate(shapes, axis=1), np.concatenate(covariances), np.concatenate(frequencies)
    )


def delays_of(
    shapes: ComplexArray, covariances: FloatArray, frequencies_hz: FloatArray
) -> list[Delay]:
    """Delays that are sure or suspected, by shapes (n, m) at unit length of modes (m,).

    Covariances (m, n, n) are those of the imaginary parts of turned shapes.
    """
    n, m = shapes.shape
    omega = 2.0 * np.pi * frequencies_hz
    near = _common_delays((shapes**2).T, omega[:, None])
    on_time = turned(shapes * np.exp(1j * near[:, None] * omega))
    terms = [_Terms.of(on_time, near, covariances, omega, spread) for spread in SPREADS]
    # Columns: the delays of all sensors, then the phases of each sensor, mode by mode.
    columns = [[s] for s in range(n)] + [[n + s * m + j for j in range(m)] for s in range(n)]

    def of_each_spread(*chosen: int) -> list[float]:
        places = [place for c in chosen for place in columns[c]]
        return [each.log_likelihood(places) for each in terms]

    def log_evidence(*chosen: int) -> float:
        return float(logsumexp(of_each_spread(*chosen))) + PRIOR_NATS * len(chosen)

    chosen: list[int] = []
    best = log_evidence()
    while len(chosen) < n:
        left = [g for g in range(2 * n) if g % n not in {c % n for c in chosen}]
        tried = [log_evidence(*chosen, g) for g in left]
        if max(tried) <= best:
            break
        best = max(tried)
        chosen.append(left[int(np.argmax(tried))])
    delays = []
    for g in (g for g in chosen if g < n):
        others = [c for c in chosen if c != g]
        rivals = [log_evidence(*others, g), log_evidence(*others, n + g), log_evidence(*others)]
        probability = float(softmax(rivals)[0])
        if probability > SUSPECTED:
            likeliest = terms[int(np.argmax(of_each_spread(g, *others)))]
            slope, precision = likeliest.part([g, *(p for c in others for p in columns[c])])
            covariance = np.linalg.inv(precision)
            mean, deviation = covariance[0] @ slope, np.sqrt(covariance[0, 0])
            delays.append(
                Delay(g, DELAY_SD_S * float(mean), DELAY_SD_S * float(deviation), probability)
            )
    return delays


class _Terms(NamedTuple):
    """ln likelihood = constant + b·x - ½ x·F x, x in units of prior standard deviations."""

    constant: float
    slope: FloatArray
    information: FloatArray

    @classmethod
    def of(
        cls, on_time: ComplexArray, near: FloatArray, covariances: FloatArray, omega: FloatArray,
        spread: float,
    ) -> "_Terms":  # fmt: skip
        n, m = on_time.shape
        constant, slope = 0.0, np.zeros(n + n * m)
        information = np.zeros((n + n * m, n + n * m))
        for j in range(m):
            real = on_time[:, j].real
            imaginary = on_time[:, j].imag - real * omega[j] * near  # as before turning
            noise = covariances[j] + spread**2 / n * np.eye(n)
            noise = noise + WHOLE_PHASE_SD**2 * np.outer(real, real)
            places = np.r_[:n, n + np.arange(n) * m + j]
            rows = np.vstack([np.diag(-omega[j] * DELAY_SD_S * real), np.diag(PHASE_SD * real)])
            solved = np.linalg.solve(noise, np.column_stack([imaginary, rows.T]))
            constant -= 0.5 * float(imaginary @ solved[:, 0] + np.linalg.slogdet(noise)[1])
            slope[places] += rows @ solved[:, 0]
            information[np.ix_(places, places)] += rows @ solved[:, 1:]
        return cls(constant, slope, information)

    def part(self, places: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Slope and precision, with the prior's, of some columns."""
        return self.slope[places], self.information[np.ix_(places, places)] + np.eye(len(places))

    def log_likelihood(self, places: Sequence[int]) -> float:
        """The mean over the prior of some columns, where the others are zero, as a logarithm."""
        slope, precision = self.part(places)
        gain = slope @ np.linalg.solve(precision, slope) - np.linalg.slogdet(precision)[1]
        return self.constant + 0.5 * float(gain)


def _common_delays(squares: ComplexArray, omega: FloatArray) -> FloatArray:
    """Delays (n,) in s that the phases of modes have in common; the median sensor is on time.

    Least squares of the phases of modes and of sensors, in turn, from the squares (m, n) of the
    shapes' components, whose phases are twice theirs; ``omega`` are the modes' frequencies (m, 1)
    in rad/s. Delays are tried over half a period of their root mean square.
    """
    sought = np.linspace(-0.5, 0.5, 2001) * np.pi / np.sqrt((omega**2).mean())
    seconds = np.zeros(squares.shape[1])
    for _ in range(20):
        modes = (squares * np.exp(2j * omega * seconds)).sum(1, keepdims=True)
        of_sensors = squares * np.conj(modes / np.abs(modes))
        seconds = sought[(of_sensors.T @ np.exp(2j * omega * sought)).real.argmax(1)]
        seconds = seconds - np.median(seconds)
    return seconds
