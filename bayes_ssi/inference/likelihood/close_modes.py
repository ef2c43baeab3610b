"""Close modes turn together: which of them do, how far, and the mean of their shapes' densities.

Errors of a model in the plane of two of its modes, at unit modal mass and with λ = (2πf)²,

    A = diag(λ_i, λ_k) + 2 σ_f λ̄ W,    W_ii ~ N(0, 1), W_ik ~ N(0, ½),

are the ones by which modes of equal frequency have no direction of their own. The frequencies are
those of the model with the error σ_f, and both shapes turn by an angle t in their plane,

    φ_i(t) = cos t φ_i + sin t φ_k,    φ_k(t) = -sin t φ_i + cos t φ_k,
    p(t) = exp(κ cos 2t) / (π I₀(κ)),    κ = d Δ/(2σ_f²),

with Δ and d the relative distances of the two frequencies in the model and as identified (d = Δ
where one of them was not). Far modes turn by σ_f/(√2 Δ), as perturbation theory has it. A shape
error σ_φ contains turns of its own size already: nothing turns where 1/(2√κ) < σ_φ, and elsewhere
κ' takes the place of κ, with 1/κ' = 1/κ - 4σ_φ². The likelihood is the mean over t of the product
of both shapes' densities.

Where the pairing is inferred, the sum over pairings has both orders of the two, each with its own
frequencies and with turns about it: the density of two modes, whichever is whichever. With a given
pairing it is that of these two and of their order.

Only neighbours turn, each mode with one other, the closest ones first: of three close modes the two
closest turn together, and the third does not.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

from bayes_ssi.foundations.arrays import FloatArray, row_sums


@dataclass(frozen=True)
class TurnSettings:
    """How means over turns are computed, to 0.01."""

    # Nodes about the middle of the density of turns and about the nearest turn of each shape, and
    # about the maximum; the next ones until sums over every other one agree.
    nodes: tuple[tuple[int, int], ...] = ((0, 16), (32, 64), (128, 256), (512, 1024))
    disagree: float = 3e-3
    negligible: float = -9.0  # exponent below the maximum
    n_scanned: int = 12  # turns at which the maximum is sought, besides the nearest ones
    spread: float = 2.0  # of nodes, in standard deviations of what they are about
    n_ascents: int = 2  # to the maximum
    longest_ascent: float = 0.3
    most_concentration: float = 1e6  # a standard deviation of 5e-4, beyond which nothing turns
    least_concentration: float = 1e-9  # from which it cannot be told from none
    numbers: int = 2**13  # at a time, for arrays that stay in the processor's cache


TURNS = TurnSettings()
_SCANNED = 2.0 * math.pi * (np.arange(TURNS.n_scanned)[:, None] + 0.5) / TURNS.n_scanned


class ClosePairs(NamedTuple):
    """C pairs of neighbouring model modes that turn together, in rows of a batch."""

    rows: NDArray[np.intp]  # (C,)
    lower: NDArray[np.intp]  # (C,), the lower one's number from 0; the other is the next
    distances: FloatArray  # (C,), of the model's frequencies, relative to their mean
    variances: FloatArray  # (C, 2), squared prediction errors of frequencies and of shapes

    def cases(self, which: NDArray[Any]) -> "ClosePairs":
        return ClosePairs(*(each[which] for each in self))

    def concentrations(self, observed: FloatArray) -> FloatArray:
        """κ' (C,) for identified frequencies at these distances; infinite where nothing turns."""
        distances = np.where(np.isnan(observed), self.distances, observed)
        kappa = 0.5 * distances * self.distances / self.variances[:, 0]
        left = 1.0 - 4.0 * self.variances[:, 1] * kappa
        turns = np.maximum(kappa, TURNS.least_concentration) / np.where(left > 0.0, left, 1.0)
        return np.where((left > 0.0) & (turns < TURNS.most_concentration), turns, np.inf)


def neighbours(frequencies_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lower and the upper ones (M - 1, B) of neighbouring frequencies (B, M)."""
    return frequencies_hz.T[:-1], frequencies_hz.T[1:]


def relative_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.abs(second - first) / (0.5 * (first + second)))


def close_pairs(
    frequencies_hz: FloatArray, observed: FloatArray, variances: FloatArray
) -> ClosePairs | None:
    """The pairs that turn together; None where none does.

    Args:
        frequencies_hz: (B, M), of the model.
        observed: (M - 1, 1 or B), distances of identified frequencies of neighbours; infinite for
            neighbours that are not compared, NaN where one of them was not identified.
        variances: (B or 1, 2), squared prediction errors of frequencies and of shapes.
    """
    distances = relative_distances(*neighbours(frequencies_hz))
    others = np.where(np.isnan(observed), distances, observed)
    # As κ < 1/(4σ_φ²).
    near = 2.0 * others * distances * variances[:, 1] < variances[:, 0]
    rows = np.flatnonzero(near.any(axis=0))
    if not len(rows):
        return None
    left = np.where(near, distances, np.inf).T[rows]
    found = []
    while np.isfinite(left).any():
        closest = left.argmin(axis=1)
        some = np.flatnonzero(np.isfinite(left[np.arange(len(rows)), closest]))
        closest = closest[some]
        found.append(np.array([rows[some], closest]))
        for neighbour in (-1, 0, 1):
            column = np.clip(closest + neighbour, 0, left.shape[1] - 1)
            left[some, column] = np.inf
    row, number = np.concatenate(found, axis=1)
    own = np.broadcast_to(variances, (len(frequencies_hz), 2))[row]
    return ClosePairs(row, number, distances[number, row], own)


class CloseCases(NamedTuple):
    """m identified shapes beside close pairs, in E cases."""

    pairs: NDArray[np.intp]  # (E,), which ones of the close pairs
    columns: NDArray[np.intp]  # (m, E), of the identified shapes; -1 for none
    is_upper: NDArray[np.bool_]  # (m, E or 1), whether the shape is that of the upper mode
    observed: FloatArray  # (E,), distances of the identified frequencies; NaN for one alone

    def modes(self, close: ClosePairs, shapes: FloatArray) -> FloatArray:
        """Shapes (2, n, E) of the lower and upper modes, from those (B, n, n_modes) of a batch."""
        rows, lower = close.rows[self.pairs], close.lower[self.pairs]
        return np.array([shapes[rows, :, lower + i].T for i in (0, 1)])

    def turned(
        self, close: ClosePairs, shapes: FloatArray, angles: FloatArray, i: int
    ) -> FloatArray:
        """Shapes (n, E) of the modes that the i-th are identified as, turned by angles (E,)."""
        cosine, sine = np.cos(angles), np.sin(angles)
        lower, upper = self.modes(close, shapes)
        of_upper, of_lower = cosine * upper - sine * lower, cosine * lower + sine * upper
        return np.where(self.is_upper[i], of_upper, of_lower)

    def cases(self, which: NDArray[np.intp]) -> "CloseCases":
        columns, is_upper = np.broadcast_arrays(self.columns, self.is_upper)
        own = columns[:, which], is_upper[:, which], self.observed[which]
        return CloseCases(self.pairs[which], *own)


class TurningShapes(NamedTuple):
    """m identified shapes beside two modes that turn together, in E cases.

    ``(φ_e·φ(t))²`` is a ratio of two sums, each a constant and multiples of cos 2t and of sin 2t.
    """

    numerators: FloatArray  # (3, m, E)
    denominators: FloatArray  # (3, m, E)
    variances: FloatArray  # (m, E), squared errors of the shapes; infinite where there is none
    nearest: FloatArray  # (m, E), the turn at which a model shape is nearest to the identified one

    @classmethod
    def of(
        cls,
        model: FloatArray,
        units: FloatArray,
        measured: FloatArray | None,
        upper: FloatArray,
        variances: FloatArray,
    ) -> "TurningShapes":
        """From the shapes of both modes at the sensors.

        Args:
            model: (2, s, E), of the lower and the upper mode.
            units: (m, s, E or 1), the identified ones, 0 where not measured.
            measured: the same, 1 where measured and 0 elsewhere; None for all.
            upper: (m, E or 1), -1 for a shape that is identified as the upper mode, 1 otherwise.
        """
        low, high = model
        products = np.array([low * low, low * high, high * high])[:, None]
        if measured is not None:
            products = products * measured
        p, q = (_over_sensors(units * mode) for mode in model)  # (m, E)
        ii, ik, kk = np.broadcast_to(_over_sensors(products), (3, *p.shape))

        def sums(ii: FloatArray, ik: FloatArray, kk: FloatArray) -> FloatArray:
            return np.array([0.5 * (ii + kk), 0.5 * upper * (ii - kk), upper * ik])

        above, below = sums(p * p, p * q, q * q), sums(ii, ik, kk)
        # Not zero by rounding; and of one that no sensor sees, any number.
        below[0] = np.where(below[0] > 0.0, (1.0 + 4.0 * np.finfo(float).eps) * below[0], 1.0)
        above[0] = np.maximum(above[0], np.finfo(float).tiny)
        first, second = kk * p - ik * q, ii * q - ik * p  # along the projection in the plane
        nearest = np.where(upper > 0.0, np.arctan2(second, first), np.arctan2(-first, second))
        return cls(above, below, np.broadcast_to(variances, p.shape), nearest)

    def distances(self, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """1 - |φ_e·φ(t)|, (m, E) at turns (E,)."""
        sums = (each[0] + each[1] * cos2 + each[2] * sin2 for each in self[:2])
        above, below = sums
        return np.asarray(1.0 - np.sqrt(np.clip(above / below, 0.0, 1.0)))

    def exponents(self, kappa: FloatArray, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """κ' (cos 2t - 1) - Σ (1 - |φ_e·φ(t)|)/σ², (n, E) at turns (n, E)."""
        total = kappa * (cos2 - 1.0)
        below, more = np.empty((2, *total.shape))
        for i, variance in enumerate(self.variances):
            above = self.numerators[2, i] * sin2
            np.multiply(self.denominators[2, i], sin2, out=below)
            for sums, terms in ((above, self.numerators), (below, self.denominators)):
                sums += np.multiply(terms[1, i], cos2, out=more)
                sums += terms[0, i]
            above /= below
            above = np.sqrt(np.maximum(above, 0.0, out=above), out=above)
            above -= 1.0
            above /= variance
            total += above
        return total

    def slopes(self, cos2: FloatArray, sin2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First derivatives, and second ones with the other sign, of |φ_e·φ(t)|/σ², (m, E)."""
        logs = []  # of squares: half of their first derivatives, and a quarter of the second ones
        for constant, of_cos, of_sin in (self.numerators, self.denominators):
            whole = constant + of_cos * cos2 + of_sin * sin2
            slope = (of_sin * cos2 - of_cos * sin2) / whole
            logs.append((whole, slope, constant / whole - 1.0 - slope * slope))
        (above, slope, bend), (below, of_length, bend_of_length) = logs
        cosines = np.sqrt(np.maximum(above / below, 0.0)) / self.variances
        slope = slope - of_length
        return cosines * slope, -cosines * (slope**2 + 2.0 * (bend - bend_of_length))

    def maximum(self, kappa: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Turns (E,) of the maximum of the exponent near ``turns``, and its bend close to it."""
        for _ in range(TURNS.n_ascents):
            cos2, sin2 = np.cos(2.0 * turns), np.sin(2.0 * turns)
            slopes, bends = (row_sums(each.T) for each in self.slopes(cos2, sin2))
            bends = bends + 4.0 * kappa * cos2
            steps = (slopes - 2.0 * kappa * sin2) / np.maximum(abs(bends), 1e-9)
            turns = turns + np.clip(steps, -TURNS.longest_ascent, TURNS.longest_ascent)
        return turns, bends

    def unevenness(self) -> FloatArray:
        """Smallest over largest length (E,) of a turned shape at the sensors."""
        middle, *of_turns = self.denominators[:, 0]
        change = np.hypot(*of_turns)
        return np.asarray(np.sqrt(np.maximum(middle - change, 0.0) / (middle + change)))

    def cases(self, which: NDArray[np.intp]) -> "TurningShapes":
        return TurningShapes(*(each[..., which] for each in self))


def _over_sensors(terms: FloatArray) -> FloatArray:
    """The sum over the second last axis, of which a row is the same in any batch."""
    return row_sums(np.moveaxis(terms, -2, 1))


class Turned(NamedTuple):
    """Close modes as their identified shapes see them, in E cases."""

    log_means: FloatArray  # (E,), of exp(-Σ (1 - |φ_e·φ(t)|)/σ²) over turns
    log_gains: FloatArray  # (E,), the same over that at the mean turn
    angles: FloatArray  # (E,), the mean turn under it
    distances: FloatArray  # (m, E), 1 - |φ_e·φ(t)| at that turn

    @classmethod
    def of(cls, concentrations: FloatArray, shapes: TurningShapes) -> "Turned":
        """From κ' (E,), infinite where nothing turns."""
        log_means, angles = np.zeros((2, len(concentrations)))
        left = np.flatnonzero(np.isfinite(concentrations))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for n in TURNS.nodes:
                accurate = np.empty(len(left), dtype=bool)
                step = max(TURNS.numbers // sum(n), 1)
                for first in range(0, len(left), step):
                    part = slice(first, first + step)
                    cases = left[part]
                    log_means[cases], angles[cases], accurate[part] = _mean_over_turns(
                        *n, concentrations[cases], shapes.cases(cases)
                    )
                left = left[~accurate]
            distances = shapes.distances(np.cos(2.0 * angles), np.sin(2.0 * angles))
            exponents = row_sums((distances / shapes.variances).T)
        log_means = np.where(np.isfinite(concentrations), log_means, -exponents)
        return cls(log_means, log_means + exponents, angles, distances)


def _mean_over_turns(
    n: int, n_about: int, kappa: FloatArray, shapes: TurningShapes
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Log means and mean turns (E,), and whether they are accurate.

    Nodes have Cauchy densities q_k in tan(t - c_k), about the middle of the density of turns, the
    nearest turn of each shape, and the maximum: midpoints of equal steps of their distribution
    functions, which converges exponentially for periodic integrands. Each set integrates its part
    (n_k q_k)²/Σ (n_l q_l)² of the integrand.
    """
    centres = np.vstack([np.zeros(len(kappa)), shapes.nearest])
    tried = [
        np.vstack([of(2.0 * centres), np.broadcast_to(of(_SCANNED), (len(_SCANNED), len(kappa)))])
        for of in (np.cos, np.sin)
    ]
    of_tried = shapes.exponents(kappa, *tried)
    best = of_tried.argmax(axis=0), np.arange(len(kappa))
    turns = 0.5 * np.arctan2(tried[1][best], tried[0][best])
    turns, bends = shapes.maximum(kappa, turns)
    widths = _widths(bends)[None]
    shares = [(np.arange(n_about) + 0.5) / n_about]
    if n:
        _, of_shapes = shapes.slopes(np.cos(2.0 * shapes.nearest), np.sin(2.0 * shapes.nearest))
        bends = np.vstack([4.0 * kappa, of_shapes])
        widths = np.vstack([widths, _widths(np.nan_to_num(bends))])
        shares += [(np.arange(n) + (i + 0.5) / len(bends)) / n for i in range(len(bends))]
    centres = np.vstack([turns, centres])[: len(widths)]
    sets = list(zip(centres, widths, shares, strict=True))
    cos2, sin2 = (
        np.concatenate(each) for each in zip(*(_placed(*each) for each in sets), strict=True)
    )
    exponents = shapes.exponents(kappa, cos2, sin2)
    highest = exponents.max(axis=0)
    terms = np.exp(exponents - highest)
    total, first = np.zeros(exponents.shape), 0
    for centre, width, share in sets:
        along = cos2 * np.cos(2.0 * centre) + sin2 * np.sin(2.0 * centre)
        density = 2.0 * len(share) * width / (1.0 + width**2 - (1.0 - width**2) * along)
        own = slice(first, first + len(share))
        terms[own] *= density[own]
        total += density * density
        first += len(share)
    terms /= total
    even, odd = row_sums(terms[::2].T), row_sums(terms[1::2].T)
    integrals = even + odd
    angles = 0.5 * np.arctan2(*(row_sums((terms * each).T) for each in (sin2, cos2)))
    accurate = np.abs(even - odd) < TURNS.disagree * integrals
    accurate &= max(n, 3) * np.sqrt(shapes.unevenness()) > 1.0
    if not n:  # there may be another maximum
        along = tried[0] * np.cos(2.0 * turns) + tried[1] * np.sin(2.0 * turns)
        is_far = 1.0 - along > 2.0 * (4.0 * widths[0]) ** 2
        accurate &= ~(is_far & (of_tried > highest + TURNS.negligible)).any(axis=0)
    return np.log(integrals) + highest - np.log(ive(0, kappa)), angles, accurate


def _widths(bends: FloatArray) -> FloatArray:
    """Widths of nodes about a maximum with minus this second derivative."""
    return np.clip(TURNS.spread / np.sqrt(np.maximum(bends, 1e-9)), 1e-8, 1.0)


def _placed(
    centre: FloatArray, width: FloatArray, shares: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """cos 2t and sin 2t (n, E) of nodes of widths (E,) about centres (E,).

    ``shares`` (n,) of the set are on one side of a node.
    """
    tangents = width * np.tan(math.pi * (shares - 0.5))[:, None]
    twice = 2.0 / (1.0 + tangents * tangents)
    cosine, sine = twice - 1.0, twice * tangents
    cosines, sines = np.cos(2.0 * centre), np.sin(2.0 * centre)
    return cosines * cosine - sines * sine, sines * cosine + cosines * sine
