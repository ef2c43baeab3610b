"""Importance sampling of posteriors whose evidence is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from targets import peaks

from bayes_ssi.inference.sampling.ensembles import Ensemble
from bayes_ssi.inference.sampling.importance import (
    PARETO_K_LIMIT,
    ImportanceSample,
    ImportanceSampler,
    bridge_sampling,
)
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

BATCH, PRIOR_SHARE = ImportanceSampler.batch, ImportanceSampler.prior_share
LOG_EVIDENCE = -3.25
MEAN, SD = np.array([0.4, -0.2]), np.array([0.3, 0.5])


def gaussian(z):
    """Likelihood times prior is e^LOG_EVIDENCE times N(MEAN, SD²)."""
    log_density = -0.5 * (((z - MEAN) / SD) ** 2).sum(1) - np.log(2.0 * math.pi * SD.prod())
    return log_density + LOG_EVIDENCE - log_standard_normal(z)


@pytest.fixture
def target():
    return Target(gaussian, 2)


@pytest.fixture
def mixture():
    """Two components around the posterior, neither of which is it."""
    return StudentMixture(
        np.array([0.6, 0.4]),
        np.array([MEAN + 0.1, MEAN - 0.2]),
        np.array([np.diag(SD * 1.2), np.diag(SD * 0.9)]),
        np.array([5.0, 30.0]),
    )


def sampler_of(target, seed=0):
    return ImportanceSampler(target, np.random.default_rng(seed))


def importance(target, mixture, seed, wanted_error=0.01):
    sampler = sampler_of(target, seed)
    return sampler.refined(sampler.sample(mixture), wanted_error)


def checked(estimates, least=0.7):
    """Errors of log evidences and the claimed ones, which they scatter by."""
    errors = np.array([estimate.error for estimate in estimates])
    off = np.array([estimate.log_evidence for estimate in estimates]) - LOG_EVIDENCE
    assert (np.abs(off) < 4.0 * errors).all()
    assert least < off.std(ddof=1) / errors.mean() < 1.5
    return off, errors


def weighted(log_weights, strata=None, log_likelihoods=0.0):
    """A hand-made importance sample of the given log weights."""
    z = np.zeros((len(log_weights), 1))
    log_likelihoods = np.zeros(len(z)) + log_likelihoods
    log_proposals = log_likelihoods + log_standard_normal(z) - np.array(log_weights)
    strata = np.array(strata or [0] * len(z))
    return ImportanceSample(None, z, log_likelihoods, log_proposals, strata)


@pytest.mark.parametrize(
    ("weights", "strata", "mean", "error"),
    [
        # Variance of three draws with ddof 1 is 7, of their mean 7/3.
        ([1.0, 2.0, 6.0], [0] * 3, 3.0, math.sqrt(7.0 / 3.0)),
        # Stratum 0 has variance 20/19 and stratum 1 none.
        ([1.0, 3.0] * 10 + [10.0] * 20, [0] * 20 + [1] * 20, 6.0, 20.0 / math.sqrt(19.0) / 40.0),
        # The three that are alone in theirs are one stratum of variance 25/3.
        ([1.0] * 40 + [0.0, 0.0, 5.0], [0] * 40 + [1, 2, 3], 45.0 / 43.0, 5.0 / 43.0),
    ],
)
def test_the_estimate_is_the_log_of_the_mean_weight(weights, strata, mean, error):
    """Only the spread within strata counts for its error."""
    with np.errstate(divide="ignore"):
        sample = weighted(np.log(weights), strata)
    assert sample.estimate.log_evidence == pytest.approx(math.log(mean), rel=1e-12)
    assert sample.estimate.error == pytest.approx(error / mean, rel=1e-12)
    np.testing.assert_allclose(sample.weights, np.array(weights) / sum(weights))
    kish = sum(weights) ** 2 / np.square(weights).sum()
    assert sample.effective_sample_size == pytest.approx(kish, rel=1e-12)


def test_the_mean_log_likelihood_is_weighted_without_draws_of_likelihood_zero():
    weighed = weighted(np.log([1.0, 3.0]), log_likelihoods=[-5.0, -1.0])
    assert weighed.log_likelihood_mean == pytest.approx(-2.0)
    with np.errstate(divide="ignore"):
        sample = ImportanceSample(
            None, np.zeros((2, 1)), np.array([-1.0, -np.inf]), np.zeros(2), np.zeros(2, dtype=int)
        )
    assert sample.log_likelihood_mean == -1.0
    assert sample.weights.tolist() == [1.0, 0.0]


def test_errors_of_shares_with_equal_weights_are_binomial():
    errors = weighted(np.zeros(400)).share_errors(np.repeat([0, 1], [100, 300]), 2)
    # 400 / 399 as the variance is estimated from the draws.
    np.testing.assert_allclose(errors, math.sqrt(0.25 * 0.75 / 400 * 400 / 399), rtol=1e-12)


def test_posterior_draws_beyond_the_heaviest_importance_draw_are_counted(target):
    """Weights under a narrower mixture grow outwards: what is beyond its last draw is missed."""
    narrow = StudentMixture(np.ones(1), MEAN[None], np.diag(0.5 * SD)[None], np.full(1, 1e9))
    sampler = replace(sampler_of(target), prior_share=0.0)
    sample = sampler.sample(narrow)
    radius = np.linalg.norm((sample.z - MEAN) / SD, axis=1).max()
    draws = MEAN + SD * np.random.default_rng(1).standard_normal((500, 40, 2))
    log_posteriors = target.log_posterior(draws.reshape(-1, 2)).reshape(500, 40)
    ensemble = Ensemble(draws, log_posteriors, 0, 1.0, 1.0)
    expected = math.exp(-0.5 * radius**2)
    missed = sample.share_beyond([ensemble])
    assert missed == pytest.approx(expected, abs=4.0 * math.sqrt(expected / 20_000))
    assert missed > 0.05
    wide = replace(narrow, factors=2.4 * narrow.factors)
    assert sampler.sample(wide).share_beyond([ensemble]) < 2e-3


def test_importance_sampling_reaches_the_wanted_error(target, mixture):
    result = [importance(target, mixture, seed, wanted_error=0.004) for seed in range(20)]
    _, errors = checked([sample.estimate for sample in result], least=0.6)
    assert errors.max() <= 0.004
    assert errors.min() > 0.002  # no more draws than it takes


def test_importance_sampling_from_the_posterior_itself_has_no_error(target):
    exact = StudentMixture(np.ones(1), MEAN[None], np.diag(SD)[None], np.array([1e9]))
    sample = importance(target, exact, 0)
    assert sample.estimate.log_evidence == pytest.approx(LOG_EVIDENCE, abs=0.005)
    assert sample.effective_sample_size > 0.95 * len(sample.z)
    assert len(sample.z) == BATCH  # one is enough
    assert sample.mixture.n_components == 1


SHARE_MISSED, AT, WIDTH = 0.3, np.array([[1.0, 1.0], [-1.0, -1.0]]), 0.3
two_bumps = peaks(AT, WIDTH, math.exp(LOG_EVIDENCE) * np.array([1.0 - SHARE_MISSED, SHARE_MISSED]))


@pytest.fixture
def first_bump():
    """A mixture that knows nothing of the second bump: only the prior's draws get there."""
    return StudentMixture(np.ones(1), AT[:1], 1.1 * WIDTH * np.eye(2)[None], np.full(1, 5.0))


@pytest.mark.parametrize("seed", range(5))
def test_a_bump_that_the_mixture_misses_gets_a_component(first_bump, seed):
    target = Target(two_bumps, 2)
    assert sampler_of(target, seed).sample(first_bump).pareto_k > PARETO_K_LIMIT
    sample = importance(target, first_bump, seed)
    assert sample.pareto_k < PARETO_K_LIMIT
    assert sample.mixture.n_components > 1
    assert np.linalg.norm(sample.mixture.means[1] - AT[1]) < 4.0 * WIDTH
    assert len(sample.z) >= BATCH + BATCH // 6
    result = sample.estimate
    assert result.error <= 0.01
    assert result.log_evidence == pytest.approx(LOG_EVIDENCE, abs=4.0 * result.error)
    assert sample.weights @ (sample.z[:, 0] < 0) == pytest.approx(SHARE_MISSED, abs=0.03)


def test_draws_densities_and_strata_are_of_one_mixture(first_bump):
    """Also of the components added later, and of the prior, whose stratum stays the last."""
    sample = importance(Target(two_bumps, 2), first_bump, 0)
    mixture = sample.mixture
    np.testing.assert_allclose(sample.log_proposals, mixture.log_pdf(sample.z), rtol=1e-12)
    np.testing.assert_allclose(sample.log_likelihoods, two_bumps(sample.z), rtol=1e-12)
    assert mixture.all_weights.sum() == pytest.approx(1.0, rel=1e-12)
    assert 0.5 * PRIOR_SHARE < mixture.prior_share < PRIOR_SHARE
    # Every batch gives each component its share of draws to within one.
    counts = np.bincount(sample.strata, minlength=mixture.n_components + 1)
    np.testing.assert_allclose(counts, len(sample.z) * mixture.all_weights, atol=3.0)
    distances = mixture.squared_distances(sample.z) / 2.0
    for k in range(mixture.n_components):
        of_component = stats.f(2, mixture.dof[k]).cdf
        assert stats.kstest(distances[k][sample.strata == k], of_component).pvalue > 1e-3
    of_prior = sample.z[sample.strata == mixture.n_components]
    assert stats.kstest(of_prior.ravel(), stats.norm.cdf).pvalue > 1e-3


def test_evidence_is_unbiased_and_its_error_honest_where_components_were_added(first_bump):
    result = [importance(Target(two_bumps, 2), first_bump, seed).estimate for seed in range(100)]
    ratios = np.exp(checked(result)[0])
    assert ratios.mean() == pytest.approx(1.0, abs=3.0 * ratios.std(ddof=1) / 10.0)


@pytest.mark.parametrize("share_there", [0.0, 0.03])
def test_importance_draws_decide_what_a_walker_stands_for(share_there):
    """One of 32 walkers stays far out: stuck in the tail of N(0, I), or in a bump there.

    The mixture is too narrow to reach the place.
    """
    place, width = np.array([5.0, 0.0]), 0.2

    def log_likelihood(z):
        if not share_there:
            return np.zeros(len(z))
        bump = -0.5 * ((z - place) ** 2).sum(1) / width**2 - math.log(2.0 * math.pi * width**2)
        return np.logaddexp(0.0, math.log(share_there) + bump - log_standard_normal(z))

    target = Target(log_likelihood, 2)
    sampler = replace(sampler_of(target), prior_share=0.0)
    narrow = StudentMixture(np.ones(1), np.zeros((1, 2)), 0.8 * np.eye(2)[None], np.full(1, 1e9))
    sample = sampler.sample(narrow)
    draws = 0.5 * np.random.default_rng(1).standard_normal((100, 32, 2))
    draws[:, 0] = place
    log_posteriors = target.log_posterior(draws.reshape(-1, 2)).reshape(100, 32)
    ensemble = Ensemble(draws, log_posteriors, 0, 1.0, 1.0)
    assert sample.share_beyond([ensemble]) == pytest.approx(1 / 32)
    refined = sampler.refined(sample, 0.01, [ensemble])
    assert refined.share_beyond([ensemble]) <= 0.01
    assert refined.mixture.n_components > 1
    estimate = refined.estimate
    assert estimate.error <= 0.01
    assert estimate.log_evidence == pytest.approx(math.log1p(share_there), abs=4.0 * estimate.error)


def thin_ridge(z):
    """Likelihood times prior is N(0, 1) of z₁ times N(0.3 z₁², 0.003²) of z₂."""
    across = (z[:, 1] - 0.3 * z[:, 0] ** 2) / 0.003
    log_density = -0.5 * (z[:, 0] ** 2 + across**2) - math.log(2.0 * math.pi * 0.003)
    return log_density - log_standard_normal(z)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_ends_of_a_ridge_are_reached_from_its_middle(seed):
    """A tenth of the posterior lies where no component of the mixture leads to."""
    x = np.linspace(-1.3, 1.3, 27)
    tangents = np.column_stack([np.ones_like(x), 0.6 * x])
    across = np.column_stack([-0.6 * x, np.ones_like(x)])
    factors = np.stack([0.1 * tangents, 0.003 * across], axis=2)
    mixture = StudentMixture(
        np.full(27, 1 / 27), np.column_stack([x, 0.3 * x**2]), factors, np.full(27, 30.0)
    )
    sampler = sampler_of(Target(thin_ridge, 2), seed)
    trial = sampler.sample(mixture)
    assert trial.weights @ (np.abs(trial.z[:, 0]) > 1.7) < 0.03
    reached = sampler.refined(sampler.beyond_ends(trial, 0.01), 0.01)
    assert abs(reached.estimate.log_evidence) < 4.0 * reached.estimate.error
    beyond = reached.weights @ (np.abs(reached.z[:, 0]) > 1.7)
    assert beyond == pytest.approx(2.0 * stats.norm.sf(1.7), abs=0.01)


def test_new_draws_owe_nothing_to_those_that_components_were_added_at():
    """In twelve dimensions the latter make log evidences too low by more than their error."""
    d = 12
    mixture = StudentMixture(np.ones(1), np.zeros((1, d)), 0.55 * np.eye(d)[None], np.full(1, 30.0))
    pulls = []
    for seed in range(12):
        sampler = sampler_of(Target(lambda z: -1.5 * (z**2).sum(1), d), seed)  # N(0, 1/4)
        sample = sampler.sample(mixture)
        for _ in range(3):
            sample = sampler._with_component(sample, sample.z[sample.weights.argmax()])
        both = (sample.estimate, sampler.renewed(sample, BATCH).estimate)
        pulls.append([(each.log_evidence + 0.5 * d * math.log(4.0)) / each.error for each in both])
    old, new = np.mean(pulls, axis=0) * math.sqrt(len(pulls))
    assert old < -4.0
    assert abs(new) < 4.0


def importance_draws(mean, sd, seed):
    """A batch of draws from one component that is not quite the posterior."""
    mixture = StudentMixture(np.ones(1), mean[None], np.diag(sd)[None], np.full(1, 30.0))
    return ImportanceSampler(Target(gaussian, 2), np.random.default_rng(seed)).sample(mixture)


def exact_ensemble(seed, n_steps=200, n_walkers=32):
    """Independent draws of the posterior in the form of an ensemble."""
    z = MEAN + SD * np.random.default_rng(seed).standard_normal((n_steps, n_walkers, 2))
    heights = Target(gaussian, 2).log_posterior(z.reshape(-1, 2)).reshape(n_steps, n_walkers)
    return Ensemble(z, heights, 0, 1.0, 0.5)


@pytest.mark.parametrize(("wider", "most"), [(1.2, 0.02), (8.0, 0.08)])
def test_bridge_sampling_recovers_the_evidence_within_its_error(wider, most):
    """Also from a proposal so wide that almost all of the error is that of its draws."""
    result = []
    for seed in range(30):
        sample = importance_draws(MEAN + 0.1, wider * SD, 100 + seed)
        result.append(bridge_sampling(exact_ensemble(seed), sample))
    assert checked(result)[1].max() < most


def test_the_bridge_gets_by_with_a_proposal_that_misses_the_tails():
    """Importance sampling from half the posterior's width is poor; the bridge repairs it."""
    sample = importance_draws(MEAN + 0.2, 0.5 * SD, 4)
    result = bridge_sampling(exact_ensemble(4), sample)
    assert result.error < sample.estimate.error
    assert result.log_evidence == pytest.approx(LOG_EVIDENCE, abs=4.0 * result.error)


def test_correlated_chains_widen_the_error_of_the_bridge():
    sample = importance_draws(MEAN + 0.1, 1.2 * SD, 5)
    ensemble = exact_ensemble(6)
    ten_times = [x.repeat(10, axis=0) for x in (ensemble.positions, ensemble.log_posteriors)]
    repeated = Ensemble(*ten_times, 0, 10.0, 0.5)
    a, b = bridge_sampling(ensemble, sample), bridge_sampling(repeated, sample)
    assert b.log_evidence == pytest.approx(a.log_evidence, abs=0.01 * a.error)
    assert b.error == pytest.approx(a.error, rel=0.1)
