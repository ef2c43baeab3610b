"""Sums over pairings against brute force: every partial matching, written out."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from bayes_ssi.inference.likelihood import pairings
from bayes_ssi.inference.likelihood.pairings import PairingWeights, log_sum, sample_pairings


def left_out(some):
    """Bound (B,) on the share of the sum that the window leaves out; zero where it is exact.

    A pair that is left out would have added at most its ratio times the whole sum.
    """
    starts = pairings._window_starts(some)
    if starts is None:
        return np.zeros(len(some.log_ratios))
    order = np.argsort(some.frequencies_hz, kind="stable")
    ratios = np.exp(some.log_ratios[:, order])
    j, first = np.arange(len(order))[:, None], starts[:, None]
    return np.where((j < first) | (j >= first + some.window), ratios, 0.0).sum(axis=(1, 2))


def weights(log_ratios, frequencies_hz=None, model_hz=None):
    """Identified modes at 1, 2, 3, ... Hz and model modes too, if nothing else is said."""
    log_ratios = np.array(log_ratios, dtype=float)
    n_rows, n_data, n_model = log_ratios.shape
    if frequencies_hz is None:
        frequencies_hz = np.arange(1.0, n_data + 1.0)
    if model_hz is None:
        model_hz = np.tile(np.arange(1.0, n_model + 1.0), (n_rows, 1))
    return PairingWeights(log_ratios, np.array(frequencies_hz), np.array(model_hz))


def random_weights(seed, n_rows, n_data, n_model, spread=3.0):
    return weights(np.random.default_rng(seed).normal(0.0, spread, (n_rows, n_data, n_model)))


def matchings(n_data, n_model):
    """Every pairing: the model mode of each identified mode, -1 for none."""
    return [
        pairing
        for pairing in itertools.product(range(-1, n_model), repeat=n_data)
        if all(pairing.count(i) <= 1 for i in range(n_model))
    ]


def log_weights(log_ratios):
    """(B, n_pairings), the log weight of every pairing."""
    pairings_of = matchings(*log_ratios.shape[1:])
    paired = [[(j, i) for j, i in enumerate(pairing) if i >= 0] for pairing in pairings_of]
    none = np.zeros(len(log_ratios))
    return np.array([sum((log_ratios[:, j, i] for j, i in each), none) for each in paired]).T


def brute_force(log_ratios):
    return logsumexp(log_weights(np.asarray(log_ratios)), axis=1)


def hard_rows(n_data, n_model):
    """Ordinary rows, certain ones, conflicts, impossible pairs and NaN."""
    ratios = np.random.default_rng(6).normal(0.0, 5.0, (14, n_data, n_model))
    ratios[3] *= 60.0
    ratios[5, :, :1] = 800.0
    ratios[6, :1] = np.nan
    ratios[7, -1:, -1:] = np.nan
    ratios[8] = -np.inf
    ratios[9, :, 1:2] = ratios[9, 2:3] = -np.inf
    model_hz = np.sort(np.random.default_rng(7).uniform(0.5, max(n_data, 1), (14, n_model)), axis=1)
    return weights(ratios, model_hz=model_hz)


@pytest.mark.parametrize("n_data", range(6))
@pytest.mark.parametrize("n_model", range(6))
def test_the_sum_is_that_over_every_matching(n_data, n_model):
    some = hard_rows(n_data, n_model)
    np.testing.assert_allclose(log_sum(some), brute_force(some.log_ratios), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("log_weight", [-20.0, -1.0, 0.0, 2.0, 50.0, 900.0])
def test_ten_by_ten_modes_of_equal_weights(log_weight):
    ways = [math.comb(10, k) ** 2 * math.factorial(k) for k in range(11)]
    terms = np.log(ways) + log_weight * np.arange(11)
    computed = log_sum(weights(np.full((1, 10, 10), log_weight)))[0]
    assert computed == pytest.approx(logsumexp(terms), rel=1e-13)


@pytest.mark.parametrize("n_data", [2, 3, 5])
@pytest.mark.parametrize(
    "log_ratio", [1.0, 36.0, 300.0, 700.0, 720.0, 735.0, 744.0, 745.0, 746.0, 900.0, 1e5]
)
def test_modes_that_all_want_the_same_one(n_data, log_ratio):
    """All but one stay unpaired, however much each would gain."""
    expected = np.logaddexp(0.0, log_ratio + math.log(n_data))
    computed = log_sum(weights(np.full((1, n_data, 1), log_ratio)))[0]
    assert computed == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("log_ratio", [250.0, 368.0, 372.0, 400.0])
def test_conflicts_that_only_together_are_too_unlikely_for_plain_numbers(log_ratio):
    ratios = np.full((1, 5, 3), -np.inf)
    ratios[0, :, 1] = log_ratio
    assert log_sum(weights(ratios))[0] == pytest.approx(log_ratio + math.log(5.0), rel=1e-13)


@pytest.mark.parametrize("size", [1, 2, 7])
@pytest.mark.parametrize("shape", [(4, 5), (1, 3), (3, 1), (13, 4), (13, 12)])
def test_a_row_is_the_same_to_the_last_bit_in_any_batch(shape, size):
    whole = hard_rows(*shape)
    rows = [slice(first, first + size) for first in range(0, 14, size)]
    parts = [
        log_sum(PairingWeights(whole.log_ratios[i], whole.frequencies_hz, whole.model_hz[i]))
        for i in rows
    ]
    # Equal but for the sign of NaN, which has no meaning and hangs on numpy's version.
    np.testing.assert_array_equal(np.concatenate(parts), log_sum(whole))


@pytest.mark.parametrize(("n_data", "n_model"), [(5, 4), (13, 4), (12, 11)])
def test_the_order_of_identified_modes_does_not_matter(n_data, n_model):
    some = random_weights(8, 6, n_data, n_model)
    order = np.random.default_rng(9).permutation(n_data)
    shuffled = PairingWeights(some.log_ratios[:, order], some.frequencies_hz[order], some.model_hz)
    assert log_sum(shuffled).tolist() == log_sum(some).tolist()
    assert left_out(shuffled) == pytest.approx(left_out(some), rel=1e-13)


@pytest.mark.parametrize("shape", [(13, 2), (2, 13)])
def test_no_window_is_needed_where_there_are_few_of_either(shape):
    """Any one or two of 13 identified modes are the two model modes, or the other way round."""
    some = weights(np.full((1, *shape), 1.0), model_hz=[np.arange(1.0, shape[1] + 1.0)])
    expected = math.log(1.0 + 26.0 * math.e + 13.0 * 12.0 * math.e**2)
    assert log_sum(some)[0] == pytest.approx(expected, rel=1e-13)
    assert left_out(some)[0] == 0.0


def with_far_model_modes(log_ratios, frequencies_hz, model_hz):
    """Weights of these modes and of as many others, which pair with nothing, as need a window."""
    n_rows, n_data, _ = log_ratios.shape
    further = np.arange(100.0, 101.0 + PairingWeights.window)
    return weights(
        np.append(log_ratios, np.full((n_rows, n_data, len(further)), -np.inf), axis=2),
        frequencies_hz,
        np.append(model_hz, np.tile(further, (n_rows, 1)), axis=1),
    )


@pytest.mark.parametrize("steepness", [0.05, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("shape", [(5, 5), (4, 4), (6, 4), (5, 2)])
def test_what_the_window_loses_is_within_its_bound(shape, steepness):
    """Of ratios that fall off with the distance of the frequencies, as real ones do."""
    rng, (n_data, n_model) = np.random.default_rng(12), shape
    data_hz = np.sort(rng.uniform(0.0, 10.0, n_data))
    model_hz = np.sort(rng.uniform(0.0, 10.0, (6, n_model)), axis=1)
    distances = data_hz[None, :, None] - model_hz[:, None, :]
    some = replace(weights(3.0 - steepness * distances**2, data_hz, model_hz), window=3)
    lost = -np.expm1(log_sum(some) - brute_force(some.log_ratios))
    assert (lost > -1e-12).all()
    assert (lost <= left_out(some) + 1e-12).all()


@pytest.mark.parametrize(("near", "far", "model_hz"), [(0, 11, 1.0), (11, 0, 12.0)])
def test_identified_modes_beyond_every_window_are_spurious(near, far, model_hz):
    """However good their pairs are."""
    ratios = np.full((1, 12, 1), -50.0)
    ratios[0, near, 0], ratios[0, far, 0] = 1.0, 5.0
    some = with_far_model_modes(ratios, None, [[model_hz]])
    assert log_sum(some)[0] == pytest.approx(np.logaddexp(0.0, 1.0), rel=1e-12)
    assert left_out(some)[0] == pytest.approx(math.exp(5.0), rel=1e-12)


def test_many_identified_modes_one_by_one():
    """Thirty modes that each want their own: a product of independent sums."""
    ratios = np.full((2, 30, 30), -np.inf)
    own = np.random.default_rng(13).normal(0.0, 4.0, (2, 30))
    ratios[:, np.arange(30), np.arange(30)] = own
    some = weights(ratios)
    assert left_out(some).tolist() == [0.0, 0.0]
    np.testing.assert_allclose(log_sum(some), np.logaddexp(0.0, own).sum(axis=1), rtol=1e-13)


def test_rows_whose_windows_move_differently():
    """Each row as if it were alone, though one has its model modes low and the other high."""
    frequencies_hz = np.arange(1.0, 15.0)
    model_hz = np.array([[1.0, 2.0, 3.0], [12.0, 13.0, 14.0], [1.0, 8.0, 14.0]])
    ratios = 4.0 - 6.0 * (frequencies_hz[None, :, None] - model_hz[:, None, :]) ** 2
    expected = [np.logaddexp(0.0, 4.0) * 3] * 3
    computed = log_sum(with_far_model_modes(ratios, frequencies_hz, model_hz))
    assert computed == pytest.approx(expected, abs=0.15)  # neighbours add a little
    assert computed[0] == pytest.approx(computed[1], rel=1e-12)


@pytest.mark.parametrize("shape", [(3, 4), (4, 2), (1, 1), (5, 4)])
def test_probabilities_of_pairs_are_those_of_the_matchings(shape):
    some = random_weights(14, 3, *shape)
    shares = np.exp(log_weights(some.log_ratios) - log_sum(some)[:, None])
    expected = np.zeros(some.log_ratios.shape)
    for share, pairing in zip(shares.T, matchings(*shape), strict=True):
        for j, i in enumerate(pairing):
            if i >= 0:
                expected[:, j, i] += share
    np.testing.assert_allclose(pairings.pair_probabilities(some), expected, rtol=1e-11)
    # A row of which one ratio is NaN has none, and the others keep theirs.
    some.log_ratios[1, 0, 0], expected[1] = np.nan, np.nan
    np.testing.assert_allclose(pairings.pair_probabilities(some), expected, rtol=1e-11)


def test_probabilities_of_pairs_in_conflict():
    computed = pairings.pair_probabilities(weights([[[900.0], [900.0 + math.log(3.0)]]]))
    np.testing.assert_allclose(computed[0, :, 0], [0.25, 0.75], rtol=1e-10)


@pytest.mark.parametrize("shape", [(2, 3), (3, 2)])
def test_drawn_pairings_come_as_often_as_they_are_probable(shape):
    n = 20_000
    ratios = np.random.default_rng(16).normal(0.0, 1.0, (1, *shape))
    drawn = sample_pairings(weights(np.repeat(ratios, n, axis=0)), np.random.default_rng(17))
    expected = np.exp(log_weights(ratios) - brute_force(ratios))[0]
    assert expected.sum() == pytest.approx(1.0)
    for share, pairing in zip(expected, matchings(*shape), strict=True):
        computed = (drawn == pairing).all(axis=1).mean()
        assert abs(computed - share) < 4.5 * math.sqrt(share * (1.0 - share) / n) + 1.0 / n


def test_every_row_is_drawn_by_its_own_weights():
    ratios = np.full((3, 2, 2), -np.inf)
    ratios[0, 0, 0] = ratios[0, 1, 1] = 40.0
    ratios[1, 0, 1] = ratios[1, 1, 0] = 40.0
    drawn = sample_pairings(weights(ratios), np.random.default_rng(20))
    assert drawn.tolist() == [[0, 1], [1, 0], [-1, -1]]


@pytest.mark.parametrize(("n_data", "n_model"), [(0, 3), (3, 0)])
def test_with_nothing_to_pair_all_drawn_modes_are_spurious(n_data, n_model):
    some = weights(np.zeros((2, n_data, n_model)))
    drawn = sample_pairings(some, np.random.default_rng(23))
    assert drawn.shape == (2, n_data)
    assert (drawn == -1).all()
    assert pairings.pair_probabilities(some).shape == (2, n_data, n_model)
