"""The tempered start on targets whose posterior and evidence are known in closed form."""

import math

import numpy as np
import pytest

from bayes_ssi.sampling.maxima import find_maxima
from bayes_ssi.sampling.target import Target
from bayes_ssi.sampling.tempering import TemperedStart, tempered_estimate, tempered_start

OBSERVED, SD = np.array([1.0, -0.5, 2.0]), np.array([0.1, 0.3, 1.0])
# Prior N(0, I), one observation of each coordinate.
LOG_EVIDENCE = float(
    np.sum(-0.5 * OBSERVED**2 / (1.0 + SD**2) - 0.5 * np.log(2.0 * math.pi * (1.0 + SD**2)))
)
MEAN, POSTERIOR_SD = OBSERVED / (1.0 + SD**2), SD / np.sqrt(1.0 + SD**2)


def gaussian(z):
    return (-0.5 * ((OBSERVED - z) / SD) ** 2 - np.log(SD * math.sqrt(2.0 * math.pi))).sum(1)


def start(function=gaussian, d=3, seed=0, n_particles=500, **kwargs):
    target = Target(function, d)
    climbers = np.random.default_rng(seed).standard_normal((32, d))
    return tempered_start(
        target,
        n_particles=n_particles,
        maxima=find_maxima(target, climbers),
        seed=np.random.SeedSequence(seed),
        **kwargs,
    )


def test_the_evidence_is_within_its_error():
    starts = [start(seed=seed) for seed in range(20)]
    errors = np.array([s.log_evidence_error for s in starts])
    off = np.array([s.log_evidence for s in starts]) - LOG_EVIDENCE
    assert (np.abs(off) < 4.0 * errors).all()
    assert abs(off.mean()) < 4.0 * off.std(ddof=1) / math.sqrt(len(off))
    assert 0.5 < off.std(ddof=1) / errors.mean() < 2.0
    assert errors.max() < 0.2


def test_the_particles_are_distributed_as_the_posterior():
    particles = start(n_particles=2000)
    tolerance = 6.0 / math.sqrt(2000)  # they are correlated a little
    np.testing.assert_array_less(
        np.abs(particles.positions.mean(0) - MEAN) / POSTERIOR_SD, tolerance
    )
    np.testing.assert_allclose(particles.positions.std(0), POSTERIOR_SD, rtol=tolerance)
    np.testing.assert_allclose(
        particles.log_likelihoods, gaussian(particles.positions), rtol=1e-9, atol=1e-9
    )


def test_temperatures_rise_from_prior_to_posterior():
    temperatures = [0.0]
    start(progress=temperatures.append)
    assert np.all(np.diff(temperatures) > 0)
    assert len(temperatures) > 2
    assert temperatures[-1] == 1.0


def test_the_first_step_halves_the_effective_sample_size():
    n, temperatures = 400, []
    start(seed=5, n_particles=n, progress=temperatures.append)
    # Its first particles are the first draws of the seed's generator.
    z = np.random.default_rng(np.random.SeedSequence(5)).standard_normal((n, 3))
    log_weights = temperatures[0] * gaussian(z)
    weights = np.exp(log_weights - log_weights.max())
    assert weights.sum() ** 2 / (weights**2).sum() == pytest.approx(n / 2.0, rel=1e-6)


def test_a_weak_likelihood_needs_one_step():
    temperatures = []
    particles = start(lambda z: 0.1 * z[:, 0], d=2, progress=temperatures.append)
    assert temperatures == [1.0]
    assert particles.log_evidence == pytest.approx(0.005, abs=0.02)


def test_regions_keep_their_shares():
    """A ninth of the posterior far from the rest is neither lost nor inflated."""

    def two_regions(z):
        near = -0.5 * (((z - 1.0) / 0.1) ** 2).sum(1) + math.log(8.0)
        far = -0.5 * (((z + 1.0) / 0.1) ** 2).sum(1)
        return np.logaddexp(near, far)

    shares = [np.mean(start(two_regions, 2, seed).positions[:, 0] < 0) for seed in range(8)]
    assert np.mean(shares) == pytest.approx(1.0 / 9.0, abs=0.02)
    assert min(shares) > 0.05


@pytest.mark.parametrize("value", [-np.inf, np.nan])
def test_an_impossible_likelihood_is_refused(value):
    maxima = find_maxima(Target(gaussian, 3), np.zeros((1, 3)))
    nowhere = Target(lambda z: np.full(len(z), value), 3)
    with pytest.raises(ValueError, match="likelihood is zero at all of 25000 draws from the prior"):
        tempered_start(nowhere, 500, maxima, np.random.SeedSequence(0))


def test_a_likelihood_that_is_zero_in_places():
    particles = start(lambda z: np.where(z[:, 0] > 0, -z[:, 0], -np.inf), d=2, n_particles=1000)
    exact = 0.5 + math.log(0.5 * math.erfc(math.sqrt(0.5)))  # e^(1/2) P(normal > 1)
    assert particles.positions[:, 0].min() > 0
    assert particles.log_evidence == pytest.approx(exact, abs=4.0 * particles.log_evidence_error)


def tempered(log_evidence, error):
    return TemperedStart(np.zeros((4, 1)), np.zeros(4), log_evidence, error)


@pytest.mark.parametrize(
    ("starts", "log_evidence", "error"),
    [
        ([(2.0, 0.3), (2.0, 0.4)], 2.0, 0.25),  # √(0.09 + 0.16) / 2
        ([(math.log(1.0), 0.01), (math.log(3.0), 0.01)], math.log(2.0), math.log(3.0) / 2.0),
    ],
)
def test_tempered_estimates_are_averaged_with_the_larger_error(starts, log_evidence, error):
    result = tempered_estimate([tempered(*start) for start in starts])
    assert (result.log_evidence, result.error) == pytest.approx((log_evidence, error))
