"""All pairings of identified modes with model modes: their sum and their probabilities.

An identified mode is one model mode or spurious; a model mode is one identified mode or missed.
There are 13 327 such pairings of 6 by 6 modes, 2·10⁸ of 10 by 10. Their weights are products, so
they are summed by dynamic programming: model mode after model mode, keeping track only of which
identified modes are taken, which is exact.

The states to keep double with every identified mode, or with every model mode where these are
fewer and the other way round. Where there are more than a window holds of both, a model mode may
only be one of the nearest in frequency. A pair that this leaves out would have added at most its
ratio times the whole sum.

Two model modes that turn together are one step, of one or both of them at once: the weight of both
is not a product.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, row_sums

_FLOAT = np.finfo(float)
# Pairs of less weight relative to leaving both unpaired change the sum by less than rounding.
NEGLIGIBLE_LOG_WEIGHT = math.log(_FLOAT.eps)
# Below this the terms of a sum lose digits, as numbers near the smallest that a float holds.
SMALLEST_LOG = math.log(_FLOAT.tiny / _FLOAT.eps)
MOST_ROWS = 4096  # at a time: with the states of ten modes, 32 MB


@dataclass(frozen=True, eq=False)
class PairingWeights:
    """Weights of pairs for a batch of B models, relative to pairing nothing."""

    # (B, J, I), log of the density of identified mode j as model mode i over that of j being
    # spurious and i missed.
    log_ratios: FloatArray
    frequencies_hz: FloatArray  # (J,), of the identified modes
    # (B, I); only for the nearest ones where there are more than ``window`` of both.
    model_hz: FloatArray
    # Number of identified modes that a model mode may then be; time and memory double with each.
    window: int = 10

    # (B, I - 1, J, J), log of the weight of j as model mode i and k as the next one, over the
    # product of both, where these turn together; 0 elsewhere, and (B, 0, 0, 0) where none do.
    log_gains: FloatArray = field(default_factory=lambda: np.zeros((1, 0, 0, 0)))

    def given(self, j: int, numbers: NDArray[np.intp] | int = -1) -> "PairingWeights":
        """These weights without identified mode ``j`` and its model mode (B,); -1 if none."""
        log_ratios, gains = self.log_ratios.copy(), self.log_gains.copy()
        for i, gain in enumerate(gains.swapaxes(0, 1)):
            # The other of two modes that turn together is weighed given the one.
            is_lower, is_upper = np.broadcast_arrays(numbers == i, numbers == i + 1, gain[:, 0, 0])[
                :2
            ]
            log_ratios[is_lower, :, i + 1] += gain[is_lower, j]
            log_ratios[is_upper, :, i] += gain[is_upper, :, j]
            gain[is_lower | is_upper] = 0.0
        paired = np.arange(log_ratios.shape[2]) == np.asarray(numbers).reshape(-1, 1)
        log_ratios[np.broadcast_to(paired[:, None], log_ratios.shape)] = -np.inf
        return replace(
            self,
            log_ratios=np.delete(log_ratios, j, axis=1),
            frequencies_hz=np.delete(self.frequencies_hz, j),
            log_gains=np.delete(np.delete(gains, j, axis=2), j, axis=3) if gains.size else gains,
        )

    @property
    def matter(self) -> NDArray[np.bool_]:
        """Which pairs (J, I) matter in any row, alone or as they turn with another."""
        matter = np.asarray((self.log_ratios > NEGLIGIBLE_LOG_WEIGHT).any(axis=0))
        for i, gain in enumerate(self.log_gains.swapaxes(0, 1)):
            both = self.log_ratios[:, :, None, i] + self.log_ratios[:, None, :, i + 1] + gain
            of_both = ((both > NEGLIGIBLE_LOG_WEIGHT) & (gain != 0.0)).any(axis=0)
            matter[:, i] |= of_both.any(axis=1)
            matter[:, i + 1] |= of_both.any(axis=0)
        return matter

    def log_weight(self, pairing: NDArray[np.intp]) -> FloatArray:
        """Log of the weight (B,) of one pairing: the model mode (J,) of each mode, or -1."""
        paired = np.flatnonzero(pairing >= 0)
        total = self.log_ratios[:, paired, pairing[paired]].sum(axis=1)
        for i, gain in enumerate(self.log_gains.swapaxes(0, 1)):
            both = np.flatnonzero(pairing == i), np.flatnonzero(pairing == i + 1)
            total += gain[:, *np.ix_(*both)].sum(axis=(1, 2))
        return total


def log_sum(weights: PairingWeights) -> FloatArray:
    """Log of the sum (B,) over all pairings of the product of their pairs' ratios.

    The pairing of nothing counts one, so it is never below zero. NaN where a ratio is NaN.
    """
    n = len(weights.log_ratios)
    together = np.asarray(weights.log_gains.any(axis=(2, 3)))
    groups = np.zeros(n, dtype=np.intp)  # of rows in which the same model modes turn together
    if together.size:
        groups = np.unique(together, axis=0, return_inverse=True)[1].ravel()
    total = np.empty(n)
    for group in range(groups.max(initial=-1) + 1):
        rows = np.flatnonzero(groups == group)
        for some in np.split(rows, range(MOST_ROWS, len(rows), MOST_ROWS)):
            log_ratios, hz = weights.log_ratios[some], weights.model_hz[some]
            turning = np.flatnonzero(together[some[0]]) if together.size else ()
            gains = {int(i): weights.log_gains[some, i] for i in turning}
            total[some] = _log_sum(replace(weights, log_ratios=log_ratios, model_hz=hz), gains)
    return total


def _log_sum(weights: PairingWeights, gains: Mapping[int, FloatArray]) -> FloatArray:
    """The same, where gains (B, J, J) of the same pairs of model modes count in all rows."""
    if not weights.log_ratios.size:
        return np.zeros(len(weights.log_ratios))
    order = np.argsort(weights.frequencies_hz, kind="stable")
    # (I, J, B): whole rows of the batch are next to each other.
    if min(weights.log_ratios.shape[1:]) > weights.window:  # windows only move up
        ascending = np.argsort(weights.model_hz, axis=1)
        weights = replace(
            weights,
            log_ratios=np.take_along_axis(weights.log_ratios, ascending[:, None], axis=2),
            model_hz=np.take_along_axis(weights.model_hz, ascending, axis=1),
        )
    log_ratios = np.ascontiguousarray(weights.log_ratios[:, order].transpose(2, 1, 0))
    both = {}
    for i, gain in gains.items():
        both[i] = (
            log_ratios[i][:, None]
            + log_ratios[i + 1]
            + gain.transpose(1, 2, 0)[np.ix_(order, order)]
        )
        both[i][np.diag_indices(len(order))] = -np.inf
    for each in (log_ratios, *both.values()):
        each[each < NEGLIGIBLE_LOG_WEIGHT] = -np.inf
    starts = _window_starts(weights, bool(both))
    if starts is not None:
        j, first = np.arange(len(order))[:, None], starts.T[:, None]
        log_ratios[(j < first) | (j >= first + weights.window)] = -np.inf
    elif len(log_ratios) < len(order) and not both:
        log_ratios = np.ascontiguousarray(log_ratios.transpose(1, 0, 2))
    # Every mode kept track of is scaled by its best pair, so that nothing overflows.
    scales = np.maximum(log_ratios.max(axis=0), 0.0)
    width = len(scales) if starts is None else weights.window
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = {i: np.exp(each - scales[:, None] - scales) for i, each in both.items()}
        pairs = np.exp(log_ratios - scales)
        total = np.log(_sum(pairs, scaled, np.exp(-scales), starts, width, _LINEAR))
    # Several identified modes near one model mode: too unlikely for plain numbers.
    lost = total < SMALLEST_LOG
    total = total + row_sums(scales.T)
    if lost.any():
        kept = None if starts is None else starts[lost]
        of_lost = {i: each[:, :, lost] for i, each in both.items()}
        alone = np.zeros((len(scales), lost.sum()))
        total[lost] = _sum(log_ratios[:, :, lost], of_lost, alone, kept, width, _LOG)
    return total


def pair_probabilities(weights: PairingWeights) -> FloatArray:
    """Probability (B, J, I) that identified mode j is model mode i; or else spurious."""
    total = log_sum(weights)
    probabilities = np.zeros(weights.log_ratios.shape)
    for j, i in np.argwhere(weights.matter):
        rest = log_sum(weights.given(j, i))
        probabilities[:, j, i] = np.exp(weights.log_ratios[:, j, i] + rest - total)
    return probabilities


def sample_pairings(weights: PairingWeights, rng: np.random.Generator) -> NDArray[np.intp]:
    """A random pairing for each row: the model mode (B, J) of each mode, -1 if spurious."""
    n_rows, n_data, n_model = weights.log_ratios.shape
    chosen = np.full((n_rows, n_data), -1, dtype=np.intp)
    left = weights
    for j in range(n_data):  # those before j are paired already
        log_shares = np.full((n_rows, n_model + 1), -np.inf)
        log_shares[:, n_model] = log_sum(left.given(0))
        for i in np.flatnonzero(left.matter[0]):
            log_shares[:, i] = left.log_ratios[:, 0, i] + log_sum(left.given(0, int(i)))
        # The greatest of Gumbel-shifted logarithms is a draw in proportion to their exponentials.
        picked = (log_shares + rng.gumbel(size=log_shares.shape)).argmax(axis=1)
        paired = np.flatnonzero(picked < n_model)
        chosen[paired, j] = picked[paired]
        left = left.given(0, chosen[:, j])
    return chosen


MOST_DRAWS = 1000  # at which probabilities of pairings are computed
MOST_LISTED = 10  # pairings with their probability
LEAST_PROBABILITY = 0.1 / MOST_DRAWS  # a tenth of one draw; less probable ones are not listed


@dataclass(frozen=True)
class PairingShare:
    """One pairing and its posterior probability."""

    # Label of an identified mode → number of the model mode, from 1; modes that are left out are
    # spurious.
    pairing: Mapping[str, int]
    probability: float


@dataclass(frozen=True)
class InferredPairing:
    """Posterior probabilities of pairings of identified with model modes."""

    pairings: tuple[PairingShare, ...]
    # Label of an identified mode → number of a model mode, from 1, or 0 for spurious → probability.
    # Probabilities below 0.0001 are left out.
    of_modes: Mapping[str, Mapping[int, float]]

    @property
    def best(self) -> Mapping[str, int]:
        """The most probable pairing."""
        return self.pairings[0].pairing


def inferred_pairing(labels: Sequence[str], weights: PairingWeights) -> InferredPairing:
    """Pairings of identified modes by their probability, averaged over posterior draws."""
    # Random pairings show which ones matter; the probability of each is exact at every draw.
    drawn = np.unique(sample_pairings(weights, np.random.default_rng(0)), axis=0)
    total = log_sum(weights)
    shares = []
    for pairing in drawn:
        paired = np.flatnonzero(pairing >= 0)
        log_weight = weights.log_weight(pairing)
        numbers = {labels[j]: int(pairing[j]) + 1 for j in paired.tolist()}
        shares.append(PairingShare(numbers, float(np.exp(log_weight - total).mean())))
    shares.sort(key=lambda share: -share.probability)
    kept = [share for share in shares if share.probability >= LEAST_PROBABILITY][:MOST_LISTED]
    of_pairs = pair_probabilities(weights).mean(axis=0)
    with_spurious = np.column_stack([1.0 - of_pairs.sum(axis=1), of_pairs])
    return InferredPairing(
        tuple(kept or shares[:1]),
        {
            label: {
                number: float(probability)
                for number, probability in enumerate(row)
                if probability >= LEAST_PROBABILITY
            }
            for label, row in zip(labels, with_spurious, strict=True)
        },
    )


class _Arithmetic(NamedTuple):
    """Sums and products of numbers, or of numbers given by their logarithms."""

    add: np.ufunc
    multiply: np.ufunc
    zero: float
    one: float


_LINEAR = _Arithmetic(np.add, np.multiply, 0.0, 1.0)
_LOG = _Arithmetic(np.logaddexp, np.add, -np.inf, 0.0)


def _window_starts(weights: PairingWeights, with_pairs: bool = False) -> NDArray[np.intp] | None:
    """The first identified mode (B, I) that each model mode may be; None without a window.

    Identified modes are counted in the order of their frequencies. With pairs of model modes that
    turn together, they are the ones to keep track of.
    """
    _, n, n_model = weights.log_ratios.shape
    if (n if with_pairs else min(n, n_model)) <= weights.window:
        return None
    middle = np.searchsorted(np.sort(weights.frequencies_hz), np.nan_to_num(weights.model_hz))
    first = np.clip(middle - weights.window // 2, 0, n - weights.window)
    # Model modes ascend, so windows only move up.
    return np.maximum.accumulate(first, axis=1)


def _sum(
    pairs: FloatArray,
    both: Mapping[int, FloatArray],
    alone: FloatArray,
    starts: NDArray[np.intp] | None,
    width: int,
    by: _Arithmetic,
) -> FloatArray:
    """Sum (B,) over pairings, for weights of pairs (I, J, B) and of unpaired modes (J, B).

    ``both`` has the number of a model mode that turns together with the next, and the weights
    (J, J, B) of pairing both.

    ``state[S, b]`` is the sum over pairings of the modes i so far that take exactly the modes j
    of the window in S, a set given by bits. States that no pairing reaches yet are left out.
    """
    if starts is None and not both:  # model modes that can be no identified mode change nothing
        pairs = pairs[(pairs != by.zero).any(axis=(1, 2))]
    n_rows = pairs.shape[2]
    state = np.full((2**width, n_rows), by.zero)
    state[0] = by.one
    rows = np.arange(n_rows)
    start = np.zeros(n_rows, dtype=np.intp)
    n_taken = 0  # only the first of the window are part of a pair so far
    for i, of_mode in enumerate(pairs):
        if i - 1 in both:
            continue  # it is part of the step before
        if starts is not None:
            while (behind := np.flatnonzero(start < starts[:, i])).size:
                state[:, behind] = _moved_on(state[:, behind], alone[start[behind], behind], by)
                start[behind] += 1
        window = start + np.arange(width)[:, None]
        if starts is not None:
            of_mode = of_mode[window, rows]
        of_both = np.empty((0, width, n_rows))
        if i in both:
            of_mode = by.add(of_mode, pairs[i + 1][window, rows])
            of_both = both[i][window[:, None], window, rows]
            of_both = by.add(of_both, of_both.swapaxes(0, 1))
        is_possible = np.concatenate([of_mode[None], of_both]) != by.zero  # also where NaN
        possible = np.flatnonzero(is_possible.any(axis=(0, 2))).tolist()
        if not possible:
            continue
        n_taken = max(n_taken, possible[-1] + 1)
        reached = state[: 2**n_taken]
        before = reached.copy()
        for k in possible:
            with_k = reached.reshape(-1, 2, 2**k, n_rows)[:, 1]
            without_k = before.reshape(-1, 2, 2**k, n_rows)[:, 0]
            by.add(with_k, by.multiply(without_k, of_mode[k]), out=with_k)
        for j, k in combinations(possible if i in both else (), 2):
            cells = (-1, 2, 2 ** (k - j - 1), 2, 2**j, n_rows)
            with_both = reached.reshape(cells)[:, 1, :, 1]
            without = before.reshape(cells)[:, 0, :, 0]
            by.add(with_both, by.multiply(without, of_both[j, k]), out=with_both)
    state = state[: 2**n_taken]
    for k in range(width):
        unpaired = by.multiply(state[::2], alone[start + k, rows])
        state = by.add(unpaired, state[1::2]) if len(state) > 1 else unpaired
    return state[0]


def _moved_on(state: FloatArray, alone: FloatArray, by: _Arithmetic) -> FloatArray:
    """The state once the window leaves its lowest identified mode and takes in the next one."""
    moved = np.full(state.shape, by.zero)
    moved[: len(state) // 2] = by.add(by.multiply(state[::2], alone), state[1::2])
    return moved
