"""R-hat, effective sample sizes, Monte Carlo errors and tails of weights, against closed forms."""

import builtins
import math
import os

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from bayes_ssi.foundations.arviz_functions import (
    arviz,
    bulk_ess,
    mcse_mean,
    mcse_sd,
    pareto_k,
    r_hat,
    tail_ess,
)

# What each measure is where nothing can be said: none of these values passes a check.
UNDEFINED = [
    (r_hat, math.inf), (bulk_ess, 0.0), (tail_ess, 0.0), (mcse_mean, math.inf), (mcse_sd, math.inf),
]  # fmt: skip


def autoregressive(*rhos, n_chains=16, n_steps=20_000, seed=1):
    """Stationary chains of unit variance, one coordinate for each correlation between steps."""
    rng = np.random.default_rng(seed)
    columns = []
    for rho in rhos:
        noise = math.sqrt(1.0 - rho**2) * rng.standard_normal((n_chains, n_steps + 500))
        columns.append(lfilter([1.0], [1.0, -rho], noise, axis=1)[:, 500:])
    return np.stack(columns, axis=-1)


def autocorrelation_time_in_tail(rho, share=0.05):
    """Of the indicator of a normal variable's lowest ``share``, from bivariate normal orthants."""
    quantile, lags = stats.norm.ppf(share), np.arange(1, int(math.log(1e-4) / math.log(rho)))
    both = [
        stats.multivariate_normal.cdf([quantile] * 2, cov=[[1.0, rho**lag], [rho**lag, 1.0]])
        for lag in lags
    ]
    return 1.0 + 2.0 * float(np.sum(np.array(both) - share**2)) / (share * (1.0 - share))


RHOS = np.array([0.5, 0.8, 0.95])
TIMES = (1.0 + RHOS) / (1.0 - RHOS)


def test_effective_sample_sizes_and_errors_of_autoregressive_chains():
    """Of the mean, τ = (1 + ρ)/(1 - ρ); of the variance, the same of ρ²."""
    chains = autoregressive(*RHOS)
    n = chains[..., 0].size
    np.testing.assert_allclose(bulk_ess(chains), n / TIMES, rtol=0.06)
    np.testing.assert_allclose(mcse_mean(chains), np.sqrt(TIMES / n), rtol=0.03)
    times_of_squares = (1.0 + RHOS**2) / (1.0 - RHOS**2)
    np.testing.assert_allclose(mcse_sd(chains), np.sqrt(0.5 * times_of_squares / n), rtol=0.05)
    in_tail = [autocorrelation_time_in_tail(rho) for rho in RHOS]
    np.testing.assert_allclose(tail_ess(chains), n / np.array(in_tail), rtol=0.08)


@pytest.mark.parametrize("scale", [1e-200, 1e-18, 1e150])
def test_units_do_not_matter(scale):
    chains = autoregressive(0.8, n_steps=500)
    for measure in (bulk_ess, tail_ess, r_hat):
        np.testing.assert_allclose(measure(scale * chains), measure(chains), rtol=1e-9)
    with np.errstate(all="raise"):
        for measure in (mcse_mean, mcse_sd):
            np.testing.assert_allclose(measure(scale * chains), scale * measure(chains), rtol=1e-9)


def test_r_hat_of_chains_at_two_places():
    """Half of the chains δ from the others: R² - 1 = (δ/2)² · n_chains/(n_chains - 1).

    Ranks turn the two normal distributions into almost the same where δ is small.
    """
    chains = np.random.default_rng(5).standard_normal((20, 20_000, 1))
    chains[::2] += 0.2
    # Split, 40 half chains.
    assert r_hat(chains)[0] ** 2 - 1.0 == pytest.approx(0.01 * 40.0 / 39.0, rel=0.05)
    wide = np.random.default_rng(5).standard_normal((4, 4000, 1))
    wide[1] *= 4.0  # at the same place
    assert r_hat(wide)[0] > 1.05


@pytest.mark.parametrize("value", [0.0, 3.0, 0.1, 7.7, math.nan, math.inf])
@pytest.mark.parametrize(("measure", "undefined"), UNDEFINED)
def test_a_coordinate_that_never_moves_or_is_no_number_passes_nothing(measure, undefined, value):
    chains = autoregressive(0.5, 0.5, n_steps=200)
    chains[..., 0] = value
    values = measure(chains)
    assert values[0] == undefined
    assert math.isfinite(values[1])
    assert values[1] > 0.0


@pytest.mark.parametrize("n", [15, 22, 800])  # of some, the mean of their ranks is rounded
def test_chains_that_stay_where_they_are_pass_nothing(n):
    stuck = np.tile(np.random.default_rng(0).standard_normal((8, 1, 1)), (1, n, 1))
    assert r_hat(stuck)[0] > 1e3
    assert bulk_ess(stuck)[0] <= 16.0  # the halves count at most


@pytest.mark.parametrize(("measure", "undefined"), UNDEFINED)
def test_chains_of_three_steps_or_with_one_draw_that_is_no_number_pass_nothing(measure, undefined):
    assert measure(autoregressive(0.5, n_steps=3))[0] == undefined
    assert math.isfinite(measure(autoregressive(0.5, n_steps=4))[0])
    for value in (math.nan, math.inf, -math.inf):
        chains = autoregressive(0.5, n_steps=200)
        chains[3, 70] = value
        assert measure(chains)[0] == undefined


def test_r_hat_is_of_two_chains_at_least():
    one = autoregressive(0.5, 0.5, n_chains=1, n_steps=100)
    np.testing.assert_array_equal(r_hat(one), [math.inf, math.inf])
    assert 10.0 < bulk_ess(one)[0] < 100.0


N_TAIL = 164  # of 3000 weights: 3 √3000


@pytest.mark.parametrize("k", [0.2, 0.5, 0.9])
def test_the_tail_of_pareto_distributed_weights(k):
    """Maximum likelihood has a standard error of (1 + k)/√n; a prior of ten draws is at 1/2."""
    weights = stats.genpareto(k).rvs((200, 3000), random_state=np.random.default_rng(1))
    log_weights = np.log(weights)
    result = [pareto_k(row) for row in log_weights]
    np.testing.assert_array_equal(log_weights, np.log(weights), "and stay as they are")
    for other in (log_weights[0] + 1e4, log_weights[0] - 1e4, log_weights[0, ::-1]):
        assert pareto_k(other) == pytest.approx(result[0], rel=1e-8)
    shrunk = N_TAIL / (N_TAIL + 10.0)
    assert np.mean(result) == pytest.approx(shrunk * k + (1.0 - shrunk) * 0.5, abs=0.05)
    assert 0.75 < np.std(result) / (shrunk * (1.0 + k) / math.sqrt(N_TAIL)) < 1.25


def test_fewer_than_thirty_weights_have_no_tail():
    for n in (0, 1, 29):
        assert pareto_k(np.log(np.arange(1.0, n + 1.0))) == math.inf
    assert math.isfinite(pareto_k(np.log(np.arange(1.0, 31.0))))


@pytest.mark.parametrize("size", [0.0, 3e-16, 1e-15, 1e-14])
def test_constant_weights_have_a_flat_tail_though_they_are_rounded(size):
    weights = 1.0 + size * np.random.default_rng(0).standard_normal(3000)
    weights[:1000] *= 0.5
    assert pareto_k(np.log(weights)) == -math.inf


@pytest.mark.parametrize("others", [-math.inf, -1e5, -720.0, -710.0, -700.0, -100.0])
@pytest.mark.parametrize("spread", [0.0, 1.0])
@pytest.mark.parametrize("large", [1, 4])
def test_a_few_huge_weights_are_a_heavy_tail(others, spread, large):
    rng = np.random.default_rng(0)
    log_weights = others + spread * rng.standard_normal(3000)
    log_weights[7 : 7 + large] = -rng.random(large)
    assert pareto_k(log_weights) > 1.5


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_weight_that_is_no_number_passes_nothing(value):
    log_weights = np.random.default_rng(0).standard_normal(3000)
    log_weights[5] = value
    assert pareto_k(log_weights) == math.inf
    assert pareto_k(np.full(3000, -math.inf)) == math.inf


def test_arviz_is_imported_where_no_cache_can_be_written(monkeypatch):
    usual, found = os.environ.get("XDG_CACHE_HOME"), builtins.__import__

    def importing(name, *others):
        if name == "arviz" and os.environ.get("XDG_CACHE_HOME") == usual:
            raise OSError("read-only file system")
        return found(name, *others)

    monkeypatch.setattr(builtins, "__import__", importing)
    assert arviz.__wrapped__().__name__ == "arviz"
    assert os.environ.get("XDG_CACHE_HOME") == usual
