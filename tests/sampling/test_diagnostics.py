"""Autocorrelation times, R-hat and the tail of weights, against closed forms and arviz."""

import math
import warnings

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from bayes_ssi.inference.sampling.diagnostics import autocorrelation_times, pareto_tail, r_hat


def autoregressive(rho, n_steps=20_000, n_walkers=16, seed=1):
    """A stationary chain of unit variance with correlation ``rho`` between steps."""
    rng = np.random.default_rng(seed)
    noise = math.sqrt(1.0 - rho**2) * rng.standard_normal((n_steps + 500, n_walkers))
    return lfilter([1.0], [1.0, -rho], noise, axis=0)[500:, :, None]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.95])
def test_autocorrelation_time_of_an_autoregressive_chain(rho):
    times = autocorrelation_times(autoregressive(rho))
    assert times.shape == (1,)
    assert times[0] == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.06)


def test_each_coordinate_has_its_own_time():
    chain = np.concatenate([autoregressive(0.9), autoregressive(0.3, seed=2)], axis=-1)
    times = autocorrelation_times(chain)
    np.testing.assert_allclose(times, [19.0, 13.0 / 7.0], rtol=0.06)


def test_an_alternating_chain_counts_as_independent_at_best():
    assert autocorrelation_times(autoregressive(-0.9))[0] == 1.0


@pytest.mark.parametrize("value", [3.0, 0.1, 7.7])  # of some, the mean is rounded
def test_a_coordinate_that_does_not_move(value):
    chain = np.concatenate([autoregressive(0.5), np.full((20_000, 16, 1), value)], axis=-1)
    times = autocorrelation_times(chain)
    assert times[0] == pytest.approx(3.0, rel=0.06)
    assert times[1] == 1.0


def test_a_walker_that_never_moves_leaves_the_times_finite():
    chain = autoregressive(0.5, n_steps=200)
    chain[:, 0] = 2.5
    assert np.isfinite(autocorrelation_times(chain)).all()


def test_r_hat_of_equal_chains_is_one():
    draws = np.random.default_rng(3).standard_normal((2, 16_000, 3))
    np.testing.assert_allclose(r_hat(draws), 1.0, atol=1e-3)


@pytest.mark.parametrize(("shift", "scale"), [(0.0, 1.0), (3.0, 1.0), (0.0, 9.0)])
@pytest.mark.parametrize("kind", ["standard_normal", "standard_cauchy"])
def test_r_hat_is_that_of_arviz(kind, shift, scale):
    """Chains that differ in location or in spread, with and without a mean; of an odd length."""
    draws = getattr(np.random.default_rng(5), kind)((4, 101, 2))
    draws[1] = shift + scale * draws[1]
    expected = [r_hat_by_arviz(draws[..., i]) for i in range(2)]
    np.testing.assert_allclose(r_hat(draws), expected, rtol=1e-12)


def r_hat_by_arviz(chains):
    """Of chains (n_chains, n_steps)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz
    return float(arviz.rhat(chains))


def test_r_hat_sees_a_drift_within_every_chain():
    draws = np.random.default_rng(3).standard_normal((2, 16_000, 1))
    draws[:, 8000:] += 1.0
    assert r_hat(draws)[0] > 1.1


def test_r_hat_of_short_chains_exceeds_one_by_their_length():
    """Means of n/2 draws with autocorrelation time τ scatter: R² - 1 = (τ - 1)/(n/2)."""
    chains = autoregressive(0.8, n_steps=400, n_walkers=400).transpose(1, 0, 2)
    assert r_hat(chains)[0] ** 2 - 1.0 == pytest.approx((9.0 - 1.0) / 200.0, rel=0.1)


def test_r_hat_of_chains_of_unlike_length():
    draws = np.random.default_rng(3).standard_normal((19_200, 1))
    result = r_hat([draws, draws[:9631]])
    assert result[0] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("n", [15, 22, 800])  # for some, the mean of their ranks is rounded
@pytest.mark.parametrize(("other", "expected"), [(0.0, 1.0), (1.0, np.inf)])
def test_r_hat_of_chains_that_do_not_move(n, other, expected):
    stuck = [np.full((n, 1), value) for value in (0.0, other)]
    assert r_hat(stuck)[0] == expected


N_TAIL = 164  # of 3000 weights: 3 √3000


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_the_tail_of_pareto_distributed_weights(k):
    """Maximum likelihood has a standard error of (1 + k)/√n; a prior of ten draws is at 1/2."""
    rng = np.random.default_rng(1)
    result = [pareto_tail(stats.genpareto(k).rvs(3000, random_state=rng)).k for _ in range(200)]
    shrunk = N_TAIL / (N_TAIL + 10.0)
    assert np.mean(result) == pytest.approx(shrunk * k + (1.0 - shrunk) * 0.5, abs=0.05)
    assert 0.75 < np.std(result) / (shrunk * (1.0 + k) / math.sqrt(N_TAIL)) < 1.25


@pytest.mark.parametrize("k", [-0.3, 0.2, 0.9])
@pytest.mark.parametrize("n", [30, 100, 400, 2500, 10_000])
def test_the_tail_is_that_of_arviz(n, k):
    weights = 1.0 + stats.genpareto(k).rvs(n, random_state=np.random.default_rng(n))
    assert pareto_tail(weights).k == pytest.approx(shape_by_arviz(np.log(weights)), rel=1e-7)


def shape_by_arviz(log_weights):
    """The same shape by arviz's Pareto-smoothed importance sampling."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz
    if hasattr(arviz, "psislw"):
        return float(arviz.psislw(log_weights)[1])
    stats_of_arviz = pytest.importorskip("arviz_stats.base")
    return float(stats_of_arviz.array_stats.psislw(-log_weights)[1])


@pytest.mark.parametrize("factor", [1e-200, 0.3, 1e200])
def test_scale_and_order_of_weights_do_not_matter_to_their_tail(factor):
    weights = stats.genpareto(0.4).rvs(3000, random_state=np.random.default_rng(3))
    assert pareto_tail(factor * weights[::-1]).k == pytest.approx(pareto_tail(weights).k, rel=1e-9)


@pytest.mark.parametrize(("n", "has_tail"), [(1, False), (5, False), (24, False), (25, True)])
def test_a_few_weights_have_no_tail(n, has_tail):
    assert math.isfinite(pareto_tail(np.arange(1.0, n + 1.0)).k) is has_tail


@pytest.mark.parametrize("size", [0.0, 3e-16, 1e-15, 1e-14])
def test_constant_weights_have_a_flat_tail_though_they_are_rounded(size):
    rng = np.random.default_rng(0)
    weights = np.full(3000, 1.0 / 3000.0) * (1.0 + size * rng.standard_normal(3000))
    assert pareto_tail(weights).k == -math.inf


@pytest.mark.parametrize("others", [0.0, 1e-300, 1e-307, 1e-310, 1e-323])
@pytest.mark.parametrize("spread", [False, True])
def test_one_huge_weight_is_a_heavy_tail(others, spread):
    rng = np.random.default_rng(0)
    weights = others * (rng.random(3000) if spread else np.ones(3000))
    weights[7] = 1.0
    assert pareto_tail(weights).k > 5.0


@pytest.mark.parametrize("k", [0.3, 0.6])
def test_a_tail_adds_beyond_the_largest_weight_what_a_pareto_distribution_does(k):
    """P(w > x) = x^(-1/k) for weights above 1, whose mean beyond q is q^(1 - 1/k) / (1 - k)."""
    quantiles = ((np.arange(100_000) + 0.5) / 100_000) ** -k
    tail = pareto_tail(quantiles)
    n = 4000.0
    expected = (n**k) ** (1.0 - 1.0 / k) / (1.0 - k)
    assert tail.beyond_the_largest(n) == pytest.approx(expected, rel=0.1)


def test_a_flat_tail_adds_nothing_and_one_without_a_mean_everything():
    assert pareto_tail(np.ones(1000)).beyond_the_largest(1000.0) == 0.0
    heavy = pareto_tail(np.random.default_rng(8).pareto(0.5, 2000) + 1.0)
    assert heavy.beyond_the_largest(2000.0) == math.inf
