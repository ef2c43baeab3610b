"""Compression of the prior on targets whose posterior and evidence are known."""

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from bayes_ssi.inference.sampling.compression import (
    Compression,
    _Climb,
    _correlation,
    compress_prior,
    compression_estimate,
)
from bayes_ssi.inference.sampling.maxima import find_maxima, no_maxima
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

OBSERVED, SD = np.array([1.0, -0.5, 2.0]), np.array([0.1, 0.3, 1.0])
# Prior N(0, I), one observation of each coordinate.
LOG_EVIDENCE = norm.logpdf(OBSERVED, 0.0, np.sqrt(1.0 + SD**2)).sum()
MEAN, POSTERIOR_SD = OBSERVED / (1.0 + SD**2), SD / np.sqrt(1.0 + SD**2)


def gaussian(z):
    return (-0.5 * ((OBSERVED - z) / SD) ** 2 - np.log(SD * math.sqrt(2.0 * math.pi))).sum(1)


def compressed(function=gaussian, d=3, seed=0, n_particles=256, climbers=None, **kwargs):
    target = Target(function, d)
    if climbers is None:
        climbers = np.random.default_rng(seed).standard_normal((32, d))
    return compress_prior(target, n_particles, find_maxima(target, climbers), seeds(seed), **kwargs)


def seeds(seed):
    return np.random.SeedSequence(seed).spawn(2)


def off_and_errors(log_evidence, n, **kwargs):
    """Errors of ``n`` pairs of estimates, and those that they claim."""
    each = [c for seed in range(n // 2) for c in compressed(seed=seed, **kwargs)]
    off = np.array([c.log_evidence for c in each]) - log_evidence
    return off, np.array([c.log_evidence_error for c in each])


def test_the_evidence_is_within_its_error():
    off, errors = off_and_errors(LOG_EVIDENCE, 20)
    assert (np.abs(off) < 4.0 * errors).all()
    assert abs(off.mean()) < 4.0 * off.std(ddof=1) / math.sqrt(len(off))
    assert 0.5 < off.std(ddof=1) / errors.mean() < 2.0
    assert errors.max() < 0.5


def test_the_particles_are_distributed_as_the_posterior():
    particles, _ = compressed(n_particles=2000)
    tolerance = 6.0 / math.sqrt(2000)  # they are correlated a little
    np.testing.assert_array_less(np.abs(particles.draws.mean(0) - MEAN) / POSTERIOR_SD, tolerance)
    np.testing.assert_allclose(particles.draws.std(0), POSTERIOR_SD, rtol=tolerance)
    likelihood_times_prior = gaussian(particles.draws) + log_standard_normal(particles.draws)
    np.testing.assert_array_equal(particles.log_posteriors, likelihood_times_prior)


def test_levels_rise_as_the_mass_of_balls_in_twelve_dimensions_falls():
    """Moves with respect to copies of a particle itself would draw it to the middle."""
    d, sd = 12, 0.2
    off, errors = off_and_errors(
        -0.5 * d * math.log1p(1.0 / sd**2),
        8,
        function=lambda z: -0.5 * (z**2).sum(1) / sd**2,
        d=d,
        n_particles=120,
        climbers=np.zeros((1, d)),
    )
    assert abs(off.mean()) < 3.0 * errors.mean() / math.sqrt(len(off)) < 1.0
    assert off.std(ddof=1) < 2.0 * errors.mean()


def test_the_first_level_keeps_the_highest_quarter_of_the_prior():
    climb = _Climb(Target(gaussian, 3), no_maxima(3), 400, np.random.default_rng(5))
    z = climb.positions
    np.testing.assert_array_equal(z, np.random.default_rng(5).standard_normal((400, 3)))
    climb.leave_lowest()
    highest = np.sort(gaussian(z))[-100:]
    np.testing.assert_array_equal(climb.log_likelihoods, highest)
    np.testing.assert_array_equal(gaussian(climb.positions), highest)
    climb.move(climb.positions)
    assert len(climb.positions) == 400
    assert gaussian(climb.positions).min() >= highest[0]


def test_plateaus():
    """Rings of equal likelihood e^0, e^1, … around the origin, the highest a disc."""
    radii = np.array([2.0, 1.5, 1.0, 0.5, 0.1])
    off, errors = off_and_errors(
        math.log(1.0 + np.sum(chi2.cdf(radii**2, 2) * np.exp(np.arange(1, 6)) * (1 - 1 / math.e))),
        20,
        function=lambda z: (np.linalg.norm(z, axis=1)[:, None] < radii).sum(1).astype(float),
        d=2,
    )
    assert (np.abs(off) < 4.0 * errors).all()
    # Were all that equal a level to pass it, the mean would be eight of these errors too low.
    assert abs(off.mean()) < 4.0 * off.std(ddof=1) / math.sqrt(len(off))


def test_a_likelihood_that_is_positive_in_a_ten_thousandth_of_the_prior():
    """None of the first particles is possible; one possible point is known."""
    radius = math.sqrt(chi2.ppf(1e-4, 3))
    off, errors = off_and_errors(
        math.log(1e-4),
        10,
        function=lambda z: np.where(np.linalg.norm(z, axis=1) < radius, 0.0, -np.inf),
        climbers=np.zeros((1, 3)),
    )
    assert (np.abs(off) < 4.0 * errors).all()
    assert errors.max() < 1.0


def test_an_impossible_likelihood_is_refused():
    maxima = find_maxima(Target(gaussian, 3), np.zeros((1, 3)))
    nowhere = Target(lambda z: np.full(len(z), -np.inf), 3)
    with pytest.raises(ValueError, match="positive at 0 of 128000 draws from the prior, too few"):
        compress_prior(nowhere, 256, maxima, seeds(0))


def test_regions_keep_their_shares():
    """A ninth of the posterior far from the rest is neither lost nor inflated."""

    def two_regions(z):
        near = -0.5 * (((z - 1.0) / 0.1) ** 2).sum(1) + math.log(8.0)
        return np.logaddexp(near, -0.5 * (((z + 1.0) / 0.1) ** 2).sum(1))

    each = [c for seed in range(4) for c in compressed(two_regions, 2, seed)]
    shares = [np.mean(c.draws[:, 0] < 0) for c in each]
    assert np.mean(shares) == pytest.approx(1.0 / 9.0, abs=0.04)
    assert min(shares) > 0.02


def spike_in_slab(z):
    """Likelihood times prior in 8 dimensions: N(0, 0.01²) with 99 %, N(0, 0.3²) with the rest."""
    squares = (z**2).sum(1)
    parts = [
        math.log(share) - 8.0 * math.log(sd * math.sqrt(2.0 * math.pi)) - 0.5 * squares / sd**2
        for share, sd in ((0.99, 0.01), (0.01, 0.3))
    ]
    return np.logaddexp(*parts) + 0.5 * squares + 4.0 * math.log(2.0 * math.pi)


def test_a_spike_within_a_slab_is_passed_into():
    """Powers of the likelihood never lead from the slab into the spike in its midst."""
    for seed in range(2):
        particles, _ = compressed(spike_in_slab, 8, seed, 400, climbers=np.full((1, 8), 0.01))
        assert abs(particles.log_evidence) < 4.0 * particles.log_evidence_error
        assert particles.log_evidence_error < 1.0
        assert np.mean(np.abs(particles.draws).max(1) < 0.05) > 0.9


def compression(log_evidence, error, behind=0.0):
    return Compression(np.zeros((4, 1)), np.zeros(4), log_evidence, error, behind)


@pytest.mark.parametrize(
    ("each", "log_evidence", "error"),
    [
        ([(2.0, 0.3), (2.0, 0.4)], 2.0, 0.25),  # √(0.09 + 0.16) / 2
        ([(math.log(1.0), 0.01), (math.log(3.0), 0.01)], math.log(2.0), math.log(3.0) / 2.0),
        ([(2.0, 0.3, 0.8), (2.0, 0.4, 0.4)], 2.0, 0.65),  # √(0.25² + 0.6²)
    ],
)
def test_estimates_are_averaged_with_the_larger_error(each, log_evidence, error):
    result = compression_estimate([compression(*one) for one in each])
    assert (result.log_evidence, result.error) == pytest.approx((log_evidence, error))


def test_the_correlation_is_the_mean_over_dimensions():
    before = np.random.default_rng(1).standard_normal((50, 2))
    after = np.column_stack([before[:, 0], -2.0 * before[:, 1]])
    assert _correlation(before, after) == pytest.approx(0.0, abs=1e-12)
    for n in (5, 7, 50):  # copies are where they began; for some, their mean is rounded
        assert _correlation(np.full((n, 2), 0.1), before[:n]) == 1.0


def far_normals(d, sd, at, n_particles, n_seeds):
    """Estimates of the evidence of a normal around ``at``, climbed to from its top; exact value."""
    target = Target(lambda z: norm.logpdf(z, at, sd).sum(1), d)
    maxima = find_maxima(target, np.full((1, d), at / (1.0 + sd**2)))
    estimates = [
        compression_estimate(compress_prior(target, n_particles, maxima, seeds(seed)))
        for seed in range(n_seeds)
    ]
    exact = d * norm.logpdf(at, 0.0, math.hypot(1.0, sd))
    assert all(abs(each.log_evidence - exact) < 4.0 * each.error for each in estimates)
    return estimates


def test_particles_that_fall_behind_enlarge_the_error():
    """A normal of width 0.3 eight prior deviations away in either coordinate."""
    far_normals(2, 0.3, 8.0 * 1.09, 120, 1)


def test_particles_keep_their_width_on_a_long_way_from_the_prior():
    """A Gaussian 13 standard deviations away: in four dimensions, some eighty nats.

    Within a level, moves proposed from particles alone make these narrower, level after level. One
    claimed error is known to a half: over 32 seeds their mean is 1.2, their scatter 0.5.
    """
    errors = [estimate.error for estimate in far_normals(4, 0.3, 6.0 * 1.09, 500, 2)]
    assert np.mean(errors) < 1.2 + 2.8 * 0.5 / math.sqrt(2.0)
