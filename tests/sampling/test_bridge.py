"""Bridge sampling between exact draws of a normal posterior and importance draws."""

import math

import numpy as np
import pytest

from bayes_ssi.inference.sampling.bridge import bridge_sampling
from bayes_ssi.inference.sampling.ensembles import Ensemble
from bayes_ssi.inference.sampling.importance import ImportanceSampler
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

LOG_EVIDENCE = -3.25
MEAN, SD = np.array([0.4, -0.2]), np.array([0.3, 0.5])


def gaussian(z):
    """Likelihood times prior is e^LOG_EVIDENCE times N(MEAN, SD²)."""
    away = (z - MEAN) / SD
    log_density = -0.5 * (away**2).sum(1) - np.log(2.0 * math.pi * SD.prod())
    return log_density + LOG_EVIDENCE - log_standard_normal(z)


def importance_draws(mean, sd, seed):
    """A batch of draws from one component that is not quite the posterior."""
    mixture = StudentMixture(np.ones(1), mean[None], np.diag(sd)[None], np.full(1, 30.0))
    return ImportanceSampler(Target(gaussian, 2), np.random.default_rng(seed)).sample(mixture)


def exact_ensemble(seed, n_steps=200, n_walkers=32):
    """Independent draws of the posterior in the form of an ensemble."""
    rng = np.random.default_rng(seed)
    z = MEAN + SD * rng.standard_normal((n_steps, n_walkers, 2))
    heights = Target(gaussian, 2).log_posterior(z.reshape(-1, 2)).reshape(n_steps, n_walkers)
    return Ensemble(z, heights, np.ones(2), 0.5)


def test_bridge_sampling_recovers_the_evidence_within_its_error():
    result = []
    for seed in range(30):
        sample = importance_draws(MEAN + 0.1, 1.2 * SD, 100 + seed)
        result.append(bridge_sampling(exact_ensemble(seed), sample))
    errors = np.array([estimate.error for estimate in result])
    off = np.array([estimate.log_evidence for estimate in result]) - LOG_EVIDENCE
    assert errors.max() < 0.02
    assert (np.abs(off) < 4.0 * errors).all()
    assert 0.7 < off.std(ddof=1) / errors.mean() < 1.5


def test_the_bridge_gets_by_with_a_proposal_that_misses_the_tails():
    """Importance sampling from half the posterior's width is poor; the bridge repairs it."""
    sample = importance_draws(MEAN + 0.2, 0.5 * SD, 4)
    result = bridge_sampling(exact_ensemble(4), sample)
    assert result.error < sample.estimate.error
    assert result.log_evidence == pytest.approx(LOG_EVIDENCE, abs=4.0 * result.error)


def test_correlated_chains_widen_the_error_of_the_bridge():
    sample = importance_draws(MEAN + 0.1, 1.2 * SD, 5)
    ensemble = exact_ensemble(6)
    repeated = Ensemble(
        ensemble.positions.repeat(10, axis=0),
        ensemble.log_posteriors.repeat(10, axis=0),
        np.full(2, 10.0),
        0.5,
    )
    a, b = bridge_sampling(ensemble, sample), bridge_sampling(repeated, sample)
    assert b.log_evidence == pytest.approx(a.log_evidence, abs=1e-6)
    assert b.error == pytest.approx(a.error, rel=0.1)
