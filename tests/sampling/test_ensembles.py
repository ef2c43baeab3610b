"""emcee ensembles: their length, and what they sample."""

import math

import numpy as np
import pytest

from bayes_ssi.inference.sampling.ensembles import (
    BURN_IN,
    ChainStatistics,
    Walkers,
    run_ensembles,
    statistics_of,
    thinned_ensembles,
)
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.proposals import drawn_anew
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.sampling.target import Target

MEAN, COVARIANCE = np.array([0.5, -0.3]), np.array([[0.04, 0.015], [0.015, 0.09]])


def gaussian(z):
    """Likelihood times prior is N(MEAN, COVARIANCE) up to a constant."""
    away = z - MEAN
    prior = 0.5 * (z**2).sum(1)
    return prior - 0.5 * np.einsum("ni,ij,nj->n", away, np.linalg.inv(COVARIANCE), away)


# Of which parameter values are the coordinates.
TARGET = Target(gaussian, 2)


def component(mean, factor, dof=5.0):
    return StudentMixture(np.ones(1), mean[None], factor[None], np.full(1, dof))


def run(function=gaussian, mixture=None, seed=0, n_ensembles=2, share=0.7, **kwargs):
    target = Target(function, 2)
    mixture = mixture or component(MEAN + 0.1, 0.4 * np.eye(2))
    rngs = [np.random.default_rng([seed, i]) for i in range(n_ensembles)]
    walkers = []
    for rng in rngs:
        positions = rng.multivariate_normal(MEAN, COVARIANCE, 16)
        walkers.append(Walkers(positions, target.log_posterior(positions)))
    proposals = [drawn_anew(mixture, share, target.log_density, rng) for rng in rngs]
    return run_ensembles(target, walkers, proposals, SamplingSettings(**kwargs), rngs)[0]


@pytest.fixture(scope="module")
def slow():
    """Without independence proposals."""
    return run(share=0.0)


@pytest.mark.parametrize("with_proposals", [True, False])
def test_ensembles_sample_their_target(slow, with_proposals):
    ensembles = run() if with_proposals else slow
    statistics = statistics_of(TARGET, ensembles)
    assert statistics.smallest_size >= 2000
    assert statistics.r_hat <= 1.01
    draws = np.concatenate([ensemble.draws for ensemble in ensembles])
    for ensemble in ensembles:
        n = ensemble.n_steps
        assert ensemble.positions.shape == (n, 16, 2)
        assert ensemble.burn_in == math.floor(BURN_IN * (n + ensemble.burn_in)) > 0
    sd = np.sqrt(np.diag(COVARIANCE))
    size = statistics.bulk_sizes.min()
    np.testing.assert_array_less(np.abs(draws.mean(0) - MEAN) / sd, 4.0 / math.sqrt(size))
    scale, tolerance = np.outer(sd, sd), 6.0 / math.sqrt(size)
    np.testing.assert_allclose(np.cov(draws.T) / scale, COVARIANCE / scale, atol=tolerance)


def test_acceptance_of_independence_proposals_from_the_posterior_itself_is_one():
    ensembles = run(mixture=component(MEAN, np.linalg.cholesky(COVARIANCE), 1e9), share=1.0)
    assert [each.acceptance_fraction for each in ensembles] == pytest.approx([1.0, 1.0], abs=1e-4)
    assert [each.autocorrelation_time for each in ensembles] == pytest.approx([1.0, 1.0], abs=0.25)


def test_the_effective_sizes_are_those_that_were_asked_for():
    few, many = run(effective_sample_size=100), run(effective_sample_size=8000)
    assert few[0].n_steps < many[0].n_steps
    assert statistics_of(TARGET, many).smallest_size >= 8000


def test_thinned_chains_still_reach_what_was_asked_for(slow):
    """A step in half an autocorrelation time; no steps are left out of chains that fall short."""
    settings = SamplingSettings()
    whole = statistics_of(TARGET, slow)
    fewer, statistics = thinned_ensembles(TARGET, slow, whole, settings)
    by = fewer[0].thinned_by
    assert 1 < by <= whole.slowness / 2.0
    assert statistics.reach(settings)
    for before, thinned in zip(slow, fewer, strict=True):
        assert thinned.n_steps == before.n_steps // by
        np.testing.assert_array_equal(thinned.positions[0], before.positions[by - 1])
        np.testing.assert_array_equal(thinned.log_posteriors[1], before.log_posteriors[2 * by - 1])
    short = run(share=0.0, max_steps=400)
    whole = statistics_of(TARGET, short)
    same, statistics = thinned_ensembles(TARGET, short, whole, settings)
    assert not statistics.reach(settings)
    assert (same, statistics) == (short, whole)


def test_walkers_change_between_far_regions():
    """Three quarters of the posterior at +2, one quarter at -2, with nothing between."""

    def regions(z):
        parts = [-0.5 * (((z - c) / 0.1) ** 2).sum(1) + math.log(w) for c, w in ((2, 3), (-2, 1))]
        return np.logaddexp(*parts) + 0.5 * (z**2).sum(1)

    means, factors = np.array([[2.0, 2.0], [-2.0, -2.0]]), np.array([0.1 * np.eye(2)] * 2)
    ensembles = run(regions, StudentMixture(np.full(2, 0.5), means, factors, np.full(2, 5.0)))
    share = np.mean([ensemble.draws[:, 0] > 0 for ensemble in ensembles])
    size = statistics_of(TARGET, ensembles).bulk_sizes.min()
    assert share == pytest.approx(0.75, abs=4.0 * math.sqrt(0.75 * 0.25 / size))


@pytest.mark.parametrize("max_steps", [20, 70])
def test_the_longest_chain_is_kept_to(max_steps):
    ensembles = run(mixture=component(np.full(2, 9.0), np.eye(2)), max_steps=max_steps)
    assert [each.n_steps + each.burn_in for each in ensembles] == [max_steps] * 2
    assert not statistics_of(TARGET, ensembles).reach(SamplingSettings())


def test_walkers_that_never_move_fail_every_aim():
    """Two places without a way between: emcee has no time for them, and arviz's R-hat is high."""
    chains = np.repeat(np.array([[[0.0]], [[1.0]]]), 100, axis=1)
    assert not ChainStatistics(chains).reach(SamplingSettings())
    stuck = Target(lambda z: np.full(len(z), -np.inf), 1)
    walkers = Walkers(np.linspace(-1.0, 1.0, 4)[:, None], np.zeros(4))
    rng = np.random.default_rng(0)
    proposals = [drawn_anew(component(np.zeros(1), np.eye(1)), 0.5, stuck.log_density, rng)]
    settings = SamplingSettings(max_steps=50)
    (ensemble,), _ = run_ensembles(stuck, [walkers], proposals, settings, [rng])
    assert math.isnan(ensemble.autocorrelation_time)
    assert ensemble.acceptance_fraction == 0.0


def test_an_error_of_the_model_is_raised_as_it_is_and_nothing_printed(capsys):
    def broken(_):
        raise ArithmeticError("no equilibrium")

    mixture = component(MEAN, np.eye(2))
    walkers = Walkers(np.random.default_rng(1).standard_normal((8, 2)), np.zeros(8))
    target = Target(gaussian, 2)
    target.log_likelihood = broken
    rng = np.random.default_rng(0)
    proposals = [drawn_anew(mixture, 0.7, target.log_density, rng)]
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        run_ensembles(target, [walkers], proposals, SamplingSettings(), [rng])
    assert capsys.readouterr() == ("", "")
