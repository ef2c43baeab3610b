"""emcee ensembles: their length, and what they sample."""

import math

import numpy as np
import pytest

from bayes_ssi.inference.sampling.ensembles import Ensemble, Walkers, run_ensemble
from bayes_ssi.inference.sampling.mixture import Proposal, StudentMixture
from bayes_ssi.inference.sampling.target import Target


def ensemble(positions, times=None):
    d = positions.shape[-1]
    return Ensemble(
        positions, np.zeros(positions.shape[:2]), np.ones(d) if times is None else times, 0.5
    )


def test_effective_sample_sizes():
    sizes = ensemble(np.zeros((100, 10, 2)), np.array([4.0, 2.0])).effective_sample_sizes
    np.testing.assert_allclose(sizes, [1000 / 4, 1000 / 2])


@pytest.mark.parametrize(("times", "enough"), [([2.0, 1.0], True), ([2.1, 1.0], False)])
def test_long_enough_is_fifty_times_the_longest(times, enough):
    assert bool(ensemble(np.zeros((100, 4, 2)), np.array(times)).is_long_enough) is enough


MEAN, COVARIANCE = np.array([0.5, -0.3]), np.array([[0.04, 0.015], [0.015, 0.09]])


def gaussian(z):
    """Likelihood times prior is N(MEAN, COVARIANCE) up to a constant."""
    away = z - MEAN
    prior = 0.5 * (z**2).sum(1)
    return prior - 0.5 * np.einsum("ni,ij,nj->n", away, np.linalg.inv(COVARIANCE), away)


def run(function=gaussian, proposal=None, seed=0, max_steps=5000, n_walkers=32, **kwargs):
    target = Target(function, 2)
    if proposal is None:
        proposal = StudentMixture(
            np.ones(1), MEAN[None] + 0.1, 0.4 * np.eye(2)[None], np.full(1, 5.0)
        )
    positions = np.random.default_rng([seed, 9]).multivariate_normal(MEAN, COVARIANCE, n_walkers)
    walkers = Walkers(positions, target.log_posterior(positions))
    return run_ensemble(
        target, walkers, Proposal(proposal, 0.7), max_steps, np.random.SeedSequence(seed), **kwargs
    )


def test_an_ensemble_samples_its_target():
    result = run()
    assert result.is_long_enough
    assert result.positions.shape == (result.n_steps, 32, 2)
    size = result.effective_sample_sizes.min()
    assert size > 500
    sd = np.sqrt(np.diag(COVARIANCE))
    np.testing.assert_array_less(np.abs(result.draws.mean(0) - MEAN) / sd, 4.0 / math.sqrt(size))
    tolerance = 6.0 / math.sqrt(size)
    np.testing.assert_allclose(np.cov(result.draws.T) / np.outer(sd, sd),
                               COVARIANCE / np.outer(sd, sd), atol=tolerance)  # fmt: skip
    assert 0.2 < result.acceptance < 0.9


def test_the_densities_stored_are_those_of_the_positions():
    result = run(max_steps=60)
    expected = Target(gaussian, 2).log_posterior(result.draws)
    np.testing.assert_allclose(result.log_posteriors.ravel(), expected, rtol=1e-10, atol=1e-10)


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
    result = run(regions, proposal)
    share = np.mean(result.draws[:, 0] > 0)
    size = result.effective_sample_sizes.min()
    assert share == pytest.approx(0.75, abs=4.0 * math.sqrt(0.75 * 0.25 / size))


@pytest.mark.parametrize("max_steps", [20, 70])
def test_the_longest_chain_is_kept_to(max_steps):
    proposal = StudentMixture(np.ones(1), np.full((1, 2), 9.0), np.eye(2)[None], np.full(1, 5.0))
    result = run(proposal=proposal, max_steps=max_steps)
    assert result.n_steps == max_steps
    assert not result.is_long_enough


def test_an_error_of_the_model_is_raised_as_it_is_and_nothing_printed(capsys):
    def broken(_):
        raise ArithmeticError("no equilibrium")

    proposal = Proposal(StudentMixture(np.ones(1), MEAN[None], np.eye(2)[None], np.full(1, 5.0)))
    walkers = Walkers(np.random.default_rng(1).standard_normal((8, 2)), np.zeros(8))
    target = Target(gaussian, 2)
    target.log_likelihood = broken
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        run_ensemble(target, walkers, proposal, 20, np.random.SeedSequence(0))
    assert capsys.readouterr() == ("", "")
