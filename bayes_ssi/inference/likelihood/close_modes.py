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
    """How means over turns are computed.

    By the trapezoidal rule, whose error falls with exp(-2π² (width/step)²) for a periodic
    integrand: to 5e-9 of it where steps are one width, the standard deviation at the maximum.
    """

    # Steps all around, at which the maximum is sought; finer ones are halves, quarters, ...
    n_steps: int = 32
    # Rate at which a shape at the sensors may turn, for one of all degrees of freedom, where they
    # are fine enough; and a share of the longest shape below which its sensors see no direction.
    rate: float = 3.0
    unseen: float = 0.03
    most_halvings: int = 8  # two at once; to 4e-4, a hundredth of a shape error of a few per cent
    disagree: float = 0.03  # sums over all nodes and over every other: twice that at two widths
    reach: float = 6.5  # widths from the maximum, beyond which the integrand is below e^(-21)
    # Where the maximum is narrow: how many steps are made to it, how long they are, how many nodes
    # taken about it, of which width, and the window beyond which the integrand is negligible.
    n_ascents: int = 2
    longest_ascent: float = 0.3
    n_hermite: int = 7
    narrow: float = 0.12
    window: float = 0.9
    most_concentration: float = 1e6  # a standard deviation of 5e-4, beyond which nothing turns
    least_concentration: float = 1e-9  # from which it cannot be told from none
    batch: int = 1024  # pairs at a time, for arrays that stay in the processor's cache


TURNS = TurnSettings()
_HERMITE = np.polynomial.hermite.hermgauss(TURNS.n_hermite)
_HERMITE[1][:] *= np.exp(_HERMITE[0] ** 2)


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
    lower, upper = frequencies_hz.T[:-1], frequencies_hz.T[1:]
    distances = (upper - lower) / (0.5 * (upper + lower))
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
    # (m, E), the turn at which a model shape is nearest to the identified one, |φ_e·φ(t)| then,
    # and the rate at which it turns, over that of all degrees of freedom; NaN where there is none.
    nearest: FloatArray
    largest: FloatArray
    rates: FloatArray

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
        # Both shapes with a little more in directions of their own.
        ii, kk = ii + TURNS.unseen**2 * below[0], kk + TURNS.unseen**2 * below[0]
        first, second = kk * p - ik * q, ii * q - ik * p  # det G · G⁻¹ of the projections
        length, area = np.abs(p * first + q * second), ii * kk - ik * ik
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = (first * first + second * second) / (length * np.sqrt(area))
            largest = np.fmin(np.sqrt(length / area), 1.0)
        nearest = np.where(upper > 0.0, np.arctan2(second, first), np.arctan2(-first, second))
        variances = np.broadcast_to(variances, p.shape)
        return cls(above, below, variances, nearest, largest, rates)

    def distances(self, turns: FloatArray) -> FloatArray:
        """1 - |φ_e·φ(t)| (m, E)."""
        return 1.0 - self.cosines(np.cos(2.0 * turns), np.sin(2.0 * turns))

    def cosines(self, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """|φ_e·φ(t)| (m, E) at turns (E,), or (m, n, E) at turns (n, E or 1)."""
        more = (slice(None), *[None] * (cos2.ndim - 1))
        above, below = (each[2][more] * sin2 for each in (self.numerators, self.denominators))
        for total, each in ((above, self.numerators), (below, self.denominators)):
            total += each[1][more] * cos2
            total += each[0][more]
        above /= below
        return np.sqrt(np.clip(above, 0.0, 1.0, out=above), out=above)

    def slopes(self, kappa: FloatArray, turns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First derivatives, and second ones with the other sign, of exponents at turns (E,)."""
        cos2, sin2 = np.cos(2.0 * turns), np.sin(2.0 * turns)
        logs = []  # of squares: half of their first derivatives, and a quarter of the second ones
        for constant, of_cos, of_sin in (self.numerators, self.denominators):
            whole = constant + of_cos * cos2 + of_sin * sin2
            slope = (of_sin * cos2 - of_cos * sin2) / whole
            logs.append((whole, slope, constant / whole - 1.0 - slope * slope))
        (above, slope, bend), (below, of_length, bend_of_length) = logs
        cosines = np.sqrt(np.clip(above / below, 0.0, 1.0)) / self.variances
        slope = slope - of_length
        bends = row_sums((cosines * (slope**2 + 2.0 * (bend - bend_of_length))).T)
        return row_sums((cosines * slope).T) - 2.0 * kappa * sin2, 4.0 * kappa * cos2 - bends

    def exponents(self, kappa: FloatArray, cos2: FloatArray, sin2: FloatArray) -> FloatArray:
        """κ' (cos 2t - 1) - Σ (1 - |φ_e·φ(t)|)/σ², of shape (n, E)."""
        terms = self.cosines(cos2, sin2)
        terms -= 1.0
        terms /= self.variances[:, None]
        terms[0] += kappa * (cos2 - 1.0)
        return row_sums(terms.swapaxes(0, 1))

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
        turning = np.isfinite(concentrations)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
            for cases in _parts(np.flatnonzero(turning)):
                log_means[cases], angles[cases], turning[cases] = _by_hermite(
                    concentrations[cases], shapes.cases(cases)
                )
            left = np.flatnonzero(turning)
            rates = np.fmax.reduce(shapes.rates[:, left]) / TURNS.rate
            doublings = np.clip(2.0 * np.ceil(0.5 * np.log2(np.fmax(rates, 1.0))), 0, 4)
            for doubling in np.unique(doublings).astype(int):
                n = TURNS.n_steps << doubling
                for cases in _parts(left[doublings == doubling]):
                    log_means[cases], angles[cases] = _by_trapezoids(
                        n, concentrations[cases], shapes.cases(cases)
                    )
            distances = shapes.distances(angles)
            exponents = row_sums((distances / shapes.variances).T)
        log_means = np.where(np.isfinite(concentrations), log_means, -exponents)
        return cls(log_means, log_means + exponents, angles, distances)


def _nodes(n: int) -> FloatArray:
    """The middles of n steps around, which meet neither t = 0 nor t = π/2."""
    return math.pi * ((np.arange(n) + 0.5) / n - 0.5)


def _parts(cases: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    return [cases[i : i + TURNS.batch] for i in range(0, len(cases), TURNS.batch)]


def _by_hermite(
    kappa: FloatArray, shapes: TurningShapes
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Log means and mean turns by Gauss and Hermite's rule, and where that will not do.

    It does where the maximum is narrow, and all beyond a window about it negligible: shapes whose
    nearest turns lie well inside the window only become less alike outside.
    """
    weights = np.nan_to_num(shapes.largest * shapes.rates**2 / shapes.variances) / 4.0
    sines, cosines = (row_sums((weights * f(2.0 * shapes.nearest)).T) for f in (np.sin, np.cos))
    turns = 0.5 * np.arctan2(sines, kappa + cosines)
    for _ in range(TURNS.n_ascents):
        slopes, bends = shapes.slopes(kappa, turns)
        steps = slopes / np.maximum(bends, kappa)
        turns = turns + np.clip(steps, -TURNS.longest_ascent, TURNS.longest_ascent)
    widths = 1.0 / np.sqrt(np.maximum(bends, kappa))
    moved = math.sqrt(2.0) * widths * _HERMITE[0][:, None]
    ends = np.broadcast_to([[-TURNS.window], [TURNS.window]], (2, len(kappa)))
    fine = turns + np.concatenate([moved, ends])
    cos2 = np.cos(2.0 * fine)
    exponents = shapes.exponents(kappa, cos2, np.sin(2.0 * fine))
    inside, beyond = exponents[:-2], (exponents - kappa * (cos2 - 1.0))[-2:].max(axis=0)
    highest = inside.max(axis=0)
    terms = np.exp(inside - highest) * _HERMITE[1][:, None]
    integrals = row_sums(terms.T)
    log_means = np.log(integrals * widths * (math.sqrt(2.0) / math.pi) / ive(0, kappa)) + highest
    off = np.abs(shapes.nearest - turns)
    off = np.fmax.reduce(np.abs(off - math.pi * np.rint(off / math.pi)))
    most = row_sums(np.nan_to_num((shapes.largest - 1.0) / shapes.variances).T)
    beyond = np.where(off < TURNS.window - TURNS.longest_ascent, beyond, most)
    beyond -= 2.0 * kappa * np.sin(np.maximum(TURNS.window - np.abs(turns), 0.0)) ** 2
    does = widths * np.fmax(np.fmax.reduce(shapes.rates), 1.0) < TURNS.narrow
    does &= (np.abs(steps) < 0.1 * widths) & (beyond < highest - 0.5 * TURNS.reach**2)
    return log_means, turns + row_sums((terms * moved).T) / integrals, ~does


def _by_trapezoids(
    n: int, kappa: FloatArray, shapes: TurningShapes
) -> tuple[FloatArray, FloatArray]:
    """Log means and mean turns, with n steps all around, or finer ones.

    A parabola through the highest of some values and its neighbours gives the maximum of the
    exponent and its width. Steps are halved until they are one width, but only near the maximum.
    """
    every, nodes = np.arange(len(kappa)), _nodes(n)[:, None]
    coarse = shapes.exponents(kappa, np.cos(2.0 * nodes), np.sin(2.0 * nodes))
    top = coarse.argmax(axis=0)
    before, highest, after = (coarse[(top + i) % n, every] for i in (-1, 0, 1))
    bend = np.maximum(2.0 * highest - before - after, np.finfo(float).tiny)
    ahead = np.clip(0.5 * (after - before) / bend, -0.5, 0.5)
    highest += 0.5 * bend * ahead**2
    peaks = nodes[top, 0] + ahead * math.pi / n
    halvings = np.clip(2.0 * np.ceil(0.25 * np.log2(bend)), 0, TURNS.most_halvings)
    # How far below the maximum a step may be, in widths, for a node of it to be within reach.
    reach = 0.5 * (TURNS.reach + 0.5 * np.sqrt(bend)) ** 2
    is_near = coarse > highest - reach
    logs, turns = np.full((2, len(kappa)), np.nan)
    for halving in range(0, TURNS.most_halvings + 1, 2):
        cases = np.flatnonzero(halvings == halving)
        if not len(cases):
            continue
        case, of_step = np.nonzero(is_near[:, cases].T)
        own = cases[case]
        fine = _nodes(n << halving)
        at = (of_step << halving) + np.arange(1 << halving)[:, None]
        cos2, sin2, moved = np.cos(2.0 * fine)[at], np.sin(2.0 * fine)[at], fine[at] - peaks[own]
        exponents = shapes.cases(own).exponents(kappa[own], cos2, sin2)
        starts = np.searchsorted(case, np.arange(len(cases)))
        most = np.maximum.reduceat(exponents.max(axis=0), starts)
        weights = np.exp(np.subtract(exponents, most[case], out=exponents), out=exponents)
        moved -= math.pi * np.rint(moved / math.pi)
        halved: FloatArray = weights[::2] if halving else weights * (of_step % 2)
        integral, half, moment = (
            np.bincount(case, row_sums(terms[None])[0], len(cases))
            for terms in (weights, halved, weights * moved)
        )
        logs[cases] = np.log(integral / (n << halving)) + most
        turns[cases] = peaks[cases] + moment / integral
        # Twice the sum over every other node is as much, or steps are too long still.
        halvings[cases[np.abs(2.0 * half / integral - 1.0) > TURNS.disagree]] += 2
    return logs - np.log(ive(0, kappa)), turns - math.pi * np.rint(turns / math.pi)
