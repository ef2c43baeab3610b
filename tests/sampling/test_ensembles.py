"""emcee ensembles: their length, and the diagnostics against closed forms."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_ssi.sampling.ensembles import (
    Ensemble,
    Proposal,
    autocorrelation_times,
    effective_sample_size,
    first_walkers,
    r_hat,
    run_ensemble,
)
from bayes_ssi.sampling.maxima import find_maxima
from bayes_ssi.sampling.mixture import StudentMixture
from bayes_ssi.sampling.target import Target
from bayes_ssi.sampling.tempering import tempered_start


def ensemble(positions, times=None):
    d = positions.shape[-1]
    return Ensemble(
        positions, np.zeros(positions.shape[:2]), np.ones(d) if times is None else times, 0.5
    )


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


def test_a_coordinate_that_does_not_move():
    chain = np.concatenate([autoregressive(0.5), np.full((20_000, 16, 1), 3.0)], axis=-1)
    times = autocorrelation_times(chain)
    assert times[0] == pytest.approx(3.0, rel=0.06)
    assert times[1] == 1.0


def test_effective_sample_sizes_add_up():
    draws = np.zeros((100, 10, 2))
    sizes = effective_sample_size(
        [ensemble(draws, np.array([4.0, 2.0])), ensemble(draws[:50], np.array([1.0, 5.0]))]
    )
    np.testing.assert_allclose(sizes, [1000 / 4 + 500, 1000 / 2 + 500 / 5])


@pytest.mark.parametrize(("times", "enough"), [([2.0, 1.0], True), ([2.1, 1.0], False)])
def test_long_enough_is_fifty_times_the_longest(times, enough):
    assert bool(ensemble(np.zeros((100, 4, 2)), np.array(times)).is_long_enough) is enough


def test_r_hat_of_equal_ensembles_is_one():
    draws = np.random.default_rng(3).standard_normal((2, 500, 32, 3))
    np.testing.assert_allclose(r_hat([ensemble(d) for d in draws]), 1.0, atol=1e-3)


@pytest.mark.parametrize("shift", [0.5, 3.0])
def test_r_hat_of_shifted_ensembles(shift):
    """Four chains with means 0, 0, δ, δ and unit variance: √(1 + δ²/3)."""
    draws = np.random.default_rng(3).standard_normal((2, 500, 32, 2))
    draws[1, ..., 0] += shift
    found = r_hat([ensemble(d) for d in draws])
    assert found[0] == pytest.approx(math.sqrt(1.0 + shift**2 / 3.0), rel=0.02)
    assert found[1] == pytest.approx(1.0, abs=1e-3)


def test_r_hat_sees_a_drift_within_every_ensemble():
    draws = np.random.default_rng(3).standard_normal((2, 500, 32, 1))
    draws[:, 250:] += 1.0
    assert r_hat([ensemble(d) for d in draws])[0] > 1.1


def test_r_hat_of_ensembles_of_unlike_length():
    draws = np.random.default_rng(3).standard_normal((600, 32, 1))
    found = r_hat([ensemble(draws), ensemble(draws[:301])])
    assert found[0] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(("other", "expected"), [(0.0, 1.0), (1.0, np.inf)])
def test_r_hat_of_ensembles_that_do_not_move(other, expected):
    stuck = [ensemble(np.full((100, 8, 1), value)) for value in (0.0, other)]
    assert r_hat(stuck)[0] == expected


MEAN, COVARIANCE = np.array([0.5, -0.3]), np.array([[0.04, 0.015], [0.015, 0.09]])


def gaussian(z):
    """Likelihood times prior is N(MEAN, COVARIANCE) up to a constant."""
    away = z - MEAN
    prior = 0.5 * (z**2).sum(1)
    return prior - 0.5 * np.einsum("ni,ij,nj->n", away, np.linalg.inv(COVARIANCE), away)


def run(function=gaussian, proposal=None, seed=0, max_steps=5000, n_walkers=32, **kwargs):
    target = Target(function, 2)
    maxima = find_maxima(target, np.zeros((1, 2)))
    start = tempered_start(target, 300, maxima, np.random.SeedSequence(9))
    if proposal is None:
        proposal = StudentMixture(
            np.ones(1), MEAN[None] + 0.1, 0.4 * np.eye(2)[None], np.full(1, 5.0)
        )
    walkers = first_walkers(start, n_walkers, np.random.default_rng(seed))
    return run_ensemble(
        target, walkers, Proposal(proposal, 0.7), max_steps, np.random.SeedSequence(seed), **kwargs
    )


def test_an_ensemble_samples_its_target():
    found = run()
    assert found.is_long_enough
    assert found.positions.shape == (found.n_steps, 32, 2)
    size = effective_sample_size([found]).min()
    assert size > 500
    sd = np.sqrt(np.diag(COVARIANCE))
    np.testing.assert_array_less(np.abs(found.draws.mean(0) - MEAN) / sd, 4.0 / math.sqrt(size))
    tolerance = 6.0 / math.sqrt(size)
    np.testing.assert_allclose(np.cov(found.draws.T) / np.outer(sd, sd),
                               COVARIANCE / np.outer(sd, sd), atol=tolerance)  # fmt: skip
    assert 0.2 < found.acceptance < 0.9


def test_the_densities_stored_are_those_of_the_positions():
    found = run(max_steps=60)
    expected = Target(gaussian, 2).log_posterior(found.draws)
    np.testing.assert_allclose(found.log_posteriors.ravel(), expected, rtol=1e-10, atol=1e-10)


def test_walkers_change_between_far_regions():
    """Three quarters of the posterior at +2, one quarter at -2, with nothing between."""

    def regions(z):
        parts = [-0.5 * (((z - c) / 0.1) ** 2).sum(1) + math.log(w) for c, w in ((2, 3), (-2, 1))]
        return np.logaddexp(*parts) + 0.5 * (z**2).sum(1)

    proposal = StudentMixture(
        np.array([0.5, 0.5]),
        np.array([[2.0, 2.0], [-2.0, -2.0]]),
        np.array([0.1 * np.eye(2)] * 2),
        np.full(2, 5.0),
    )
    found = run(regions, proposal)
    share = np.mean(found.draws[:, 0] > 0)
    size = effective_sample_size([found]).min()
    assert share == pytest.approx(0.75, abs=4.0 * math.sqrt(0.75 * 0.25 / size))


@pytest.mark.parametrize("max_steps", [20, 70])
def test_the_longest_chain_is_kept_to(max_steps):
    proposal = StudentMixture(np.ones(1), np.full((1, 2), 9.0), np.eye(2)[None], np.full(1, 5.0))
    found = run(proposal=proposal, max_steps=max_steps)
    assert found.n_steps == max_steps
    assert not found.is_long_enough


def test_the_seed_decides():
    a, b, c = run(seed=1), run(seed=1), run(seed=2)
    np.testing.assert_array_equal(a.positions, b.positions)
    assert not np.array_equal(a.positions[:50], c.positions[:50])


def test_progress_ends_at_one():
    seen = []
    run(progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_walker_that_never_moves_leaves_the_times_finite():
    chain = autoregressive(0.5, n_steps=200)
    chain[:, 0] = 2.5
    assert np.isfinite(autocorrelation_times(chain)).all()
