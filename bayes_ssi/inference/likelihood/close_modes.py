"""Close modes turn together: which of them do, and how far.

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

Only neighbours turn, each mode with one other, the closest ones first, by their identified
frequencies where the pairing is given: of three close modes the two closest turn together, and the
third does not.
"""

import math
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray
from bayes_ssi.inference.likelihood.turning_shapes import TINY

# Beyond this κ' a turn has a standard deviation of less than 5e-4: nothing turns.
MOST_CONCENTRATION = 1e6


class ClosePairs(NamedTuple):
    """C pairs of neighbouring model modes that turn together, in rows of a batch."""

    rows: IntArray  # (C,)
    lower: IntArray  # (C,), the lower one's number from 0; the other is the next
    distances: FloatArray  # (C,), of the model's frequencies, relative to their mean
    variances: FloatArray  # (C, 2), squared prediction errors of frequencies and of shapes

    def concentrations(self, observed: FloatArray, which: IntArray) -> FloatArray:
        """κ' (E,) of some pairs for identified frequencies at these distances, NaN where there are
        not two; infinite where nothing turns.
        """
        distances, (of_frequencies, of_shapes) = self.distances[which], self.variances[which].T
        kappa = 0.5 * np.where(np.isnan(observed), distances, observed) * distances / of_frequencies
        left = 1.0 - 4.0 * of_shapes * kappa
        turns = np.maximum(kappa, TINY) / np.where(left > 0.0, left, 1.0)
        return np.where((left > 0.0) & (turns < MOST_CONCENTRATION), turns, np.inf)

    @property
    def turn_alone(self) -> BoolArray:
        """Whether each turns where not both of its modes were identified, (C,)."""
        every = np.arange(len(self.rows))
        return np.isfinite(self.concentrations(np.full(len(every), np.nan), every))


def relative_distances(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.abs(second - first) / (0.5 * (first + second)))


def close_pairs(
    frequencies_hz: FloatArray,
    observed: FloatArray,
    variances: FloatArray,
    order: FloatArray | float = math.nan,
) -> ClosePairs | None:
    """The pairs that turn together; None where none does.

    Args:
        frequencies_hz: (B, M), of the model.
        observed: (M - 1, 1 or B), distances of identified frequencies of neighbours; infinite for
            neighbours that are not compared, NaN where one of them was not identified.
        variances: (B or 1, 2), squared prediction errors of frequencies and of shapes.
        order: (M - 1, 1), distances by which the closest are chosen; the model's where NaN. Those
            of identified modes make the choice for all rows alike: where it would change from one
            row to the next, the likelihood would have a step.
    """
    distances = relative_distances(frequencies_hz.T[:-1], frequencies_hz.T[1:])
    others = np.where(np.isnan(observed), distances, observed)
    with np.errstate(all="ignore"):  # far out in priors, and equal ones that are not compared
        near = others * distances < 0.5 * variances[:, 0] / variances[:, 1]  # κ < 1/(4σ_φ²)
    if not np.count_nonzero(near):
        return None
    rows = np.flatnonzero(near.any(axis=0))
    places = np.where(near, np.where(np.isnan(order), distances, order), np.inf).T[rows]
    some, lower = np.nonzero(near.T[rows] & _are_closest(places))
    own = np.broadcast_to(variances, (len(frequencies_hz), 2))[rows[some]]
    return ClosePairs(rows[some], lower, distances[lower, rows[some]], own)


def _are_closest(distances: FloatArray) -> BoolArray:
    """Which of ``distances`` (n, m) are chosen if the least is, then the least of those left, …

    One that was chosen takes its neighbours away. Those that rise one after another from a local
    minimum, which is chosen, are by turns taken away and chosen; between two minima, the highest is
    chosen if neither side takes it away.
    """
    numbers = np.arange(distances.shape[1])
    falls = np.zeros((len(distances), len(numbers) + 1), dtype=bool)
    falls[:, 1:-1] = distances[:, 1:] < distances[:, :-1]
    rises = np.zeros_like(falls)
    rises[:, 1:-1] = distances[:, 1:] >= distances[:, :-1]
    first = np.maximum.accumulate(np.where(rises[:, :-1], 0, numbers), axis=1)
    last = np.where(falls[:, 1:], numbers[-1], numbers)[:, ::-1]
    last = np.minimum.accumulate(last, axis=1)[:, ::-1]
    return np.asarray(((numbers - first) % 2 == 0) & ((last - numbers) % 2 == 0))


class CloseCases(NamedTuple):
    """m identified shapes beside close pairs, in E cases."""

    pairs: IntArray  # (E,), which ones of the close pairs
    columns: IntArray  # (m, E), of the identified shapes; -1 for none
    is_upper: BoolArray  # (m, E or 1), whether the shape is that of the upper mode
    observed: FloatArray  # (E,), distances of the identified frequencies; NaN for one alone
    # (E,) or one for all, the exponent of densities of shapes below which no turn matters.
    least: FloatArray | float = -math.inf

    def modes(self, close: ClosePairs, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The modes identified and what they turn to, (n, m, E), of shapes (B, n, n_modes)."""
        rows, lower = close.rows[self.pairs], close.lower[self.pairs]
        low, high = (shapes[rows, :, lower + i].T[:, None] for i in (0, 1))
        return np.where(self.is_upper, high, low), np.where(self.is_upper, -low, high)

    def turned(self, close: ClosePairs, shapes: FloatArray, angles: FloatArray) -> FloatArray:
        """The modes identified, (n, m, E), turned by angles (E,)."""
        modes, partners = self.modes(close, shapes)
        return np.asarray(np.cos(angles) * modes + np.sin(angles) * partners)
