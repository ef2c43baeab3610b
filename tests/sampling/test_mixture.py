"""Student-t mixtures against scipy, what fits of them recover, and regions of a posterior."""

import math

import numpy as np
import pytest
from scipy import stats

from bayes_ssi.inference.sampling.mixture import StudentMixture, choose_mixture, fit_mixture
from bayes_ssi.inference.sampling.regions import (
    MOST_DRAWS,
    Regions,
    _neighbouring_pairs,
    _Paths,
    find_regions,
)
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

MEANS = np.array([[0.5, -1.0], [3.0, 2.0]])
SCALES = np.array([[[0.5, 0.2], [0.2, 0.4]], [[1.0, -0.3], [-0.3, 0.3]]])
DOF = np.array([5.0, 30.0])


@pytest.fixture
def mixture():
    return StudentMixture(np.array([0.3, 0.7]), MEANS, np.linalg.cholesky(SCALES), DOF)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def two_clusters(rng, n):
    """Draws of 0.3 N(MEANS[0], SCALES[0]) + 0.7 N(MEANS[1] + 5, SCALES[1])."""
    of_first = rng.multivariate_normal(MEANS[0], SCALES[0], int(0.3 * n))
    of_second = rng.multivariate_normal(MEANS[1] + 5.0, SCALES[1], n - len(of_first))
    return np.concatenate([of_first, of_second])


@pytest.mark.parametrize("prior_share", [0.0, 0.2])
def test_density_is_that_of_scipy(mixture, rng, prior_share):
    z = 4.0 * rng.standard_normal((50, 2))
    parts = [stats.multivariate_t(MEANS[k], SCALES[k], df=DOF[k]).pdf(z) for k in range(2)]
    expected = (1.0 - prior_share) * (0.3 * parts[0] + 0.7 * parts[1])
    expected += prior_share * stats.multivariate_normal(np.zeros(2)).pdf(z)
    mixture = mixture.with_prior_component(prior_share)
    np.testing.assert_allclose(mixture.log_pdf(z), np.log(expected), rtol=1e-11)
    assert np.isfinite(mixture.log_pdf(np.full((1, 2), 1e8))).all(), "far away"
    own = 1.0 - prior_share
    assert mixture.all_weights == pytest.approx([0.3 * own, 0.7 * own, prior_share])


def test_draws_have_the_moments_and_tails_of_their_component(mixture, rng):
    counts = np.array([40_000, 60_000, 50_000])
    parts = np.split(mixture.draw(counts, rng), np.cumsum(counts)[:2])
    covariances = [SCALES[k] * DOF[k] / (DOF[k] - 2.0) for k in range(2)] + [np.eye(2)]
    for part, mean, covariance in zip(parts, [*MEANS, np.zeros(2)], covariances, strict=True):
        np.testing.assert_allclose(part.mean(0), mean, atol=0.02)
        np.testing.assert_allclose(np.cov(part.T), covariance, atol=0.05)
    distances = mixture.squared_distances(parts[0])[0] / 2.0
    # Mahalanobis distance squared over d is F-distributed with d and ν degrees of freedom.
    assert stats.kstest(distances, stats.f(2, DOF[0]).cdf).pvalue > 1e-3


def test_joined_mixtures(mixture, rng):
    other = StudentMixture(np.ones(1), MEANS[:1] - 4.0, np.linalg.cholesky(SCALES[:1]), DOF[:1])
    joined = mixture.mixed_with(other, 0.1)
    z = 4.0 * rng.standard_normal((20, 2))
    expected = np.logaddexp(
        np.log(0.9) + mixture.log_pdf(z),
        np.log(0.1) + stats.multivariate_t(MEANS[0] - 4.0, SCALES[0], df=5.0).logpdf(z),
    )
    np.testing.assert_allclose(joined.log_pdf(z), expected, rtol=1e-11)
    assert joined.n_components == 3


def test_widened_mixtures(mixture, rng):
    """Nine tenths as before, a tenth with scale matrices four times as large and heavy tails."""
    z = 4.0 * rng.standard_normal((50, 2))
    expected = sum(
        share * stats.multivariate_t(MEANS[k], factor**2 * SCALES[k], df=dof).pdf(z)
        for k, weight in enumerate((0.3, 0.7))
        for factor, share, dof in ((1.0, 0.9 * weight, DOF[k]), (2.0, 0.1 * weight, 2.0))
    )
    widened = mixture.widened()
    np.testing.assert_allclose(widened.log_pdf(z), np.log(expected), rtol=1e-11)
    assert widened.weights == pytest.approx([0.27, 0.63, 0.03, 0.07])
    assert widened.n_components == 4
    assert widened.prior_share == 0.0


def test_reweighting_finds_the_shares_of_weighted_draws(mixture, rng):
    far_apart = StudentMixture(mixture.weights, MEANS * 20.0, mixture.factors, DOF)
    draws = far_apart.draw(np.array([500, 500, 0]), rng)
    # A tenth is shared equally.
    reweighted = far_apart.reweighted(draws, np.repeat([0.9, 0.1], 500) / 500.0).weights
    np.testing.assert_allclose(reweighted, [0.86, 0.14], atol=1e-6)


def test_fitting_recovers_a_mixture(rng):
    fitted = fit_mixture(two_clusters(rng, 4000), 2, 100.0, rng)
    order = np.argsort(fitted.means[:, 0])
    np.testing.assert_allclose(fitted.weights[order], [0.3, 0.7], atol=1e-3)
    np.testing.assert_allclose(fitted.means[order], [MEANS[0], MEANS[1] + 5.0], atol=0.06)
    scales = fitted.factors @ fitted.factors.transpose(0, 2, 1)
    np.testing.assert_allclose(scales[order], SCALES, atol=0.08)


def test_fitting_recovers_the_scale_under_heavy_tails(rng):
    draws = stats.multivariate_t(MEANS[0], SCALES[0], df=5.0, seed=1).rvs(20_000)
    fitted = fit_mixture(draws, 1, 5.0, rng)
    np.testing.assert_allclose(fitted.means[0], MEANS[0], atol=0.03)
    np.testing.assert_allclose(fitted.factors[0] @ fitted.factors[0].T, SCALES[0], atol=0.03)


def test_components_without_draws_are_dropped(rng):
    draws = np.repeat(rng.standard_normal((2, 2)), 50, axis=0)  # two points only
    fitted = fit_mixture(draws + 1e-9 * rng.standard_normal(draws.shape), 5, 5.0, rng)
    assert 1 <= fitted.n_components <= 5
    assert fitted.weights.sum() == pytest.approx(1.0)
    assert np.isfinite(fitted.log_pdf(draws)).all()


@pytest.mark.parametrize("value", [0.0, 1e-9, 1.0 / 3.0, 1.0, 1e6 * np.pi])
@pytest.mark.parametrize("n", [7, 50, 1000])
def test_identical_draws_can_be_fitted(rng, value, n):
    # Their mean differs from them by its rounding, which depends on the processor; for one of
    # these values and numbers at least it does on every processor.
    fitted = fit_mixture(np.full((n, 2), value), 3, 5.0, rng)
    np.testing.assert_allclose(fitted.means, value, rtol=1e-12)
    assert np.isfinite(fitted.log_pdf(np.full((1, 2), value))).all()


def test_the_number_of_components_follows_the_draws(rng):
    draws, held_out = rng.standard_normal((2, 2000, 3))
    assert choose_mixture(draws, held_out, rng).n_components == 1
    assert choose_mixture(*(two_clusters(rng, 2000) for _ in "ab"), rng).n_components == 2
    draws = two_clusters(rng, 39)  # below 2 components x 2 dimensions x 10
    assert choose_mixture(draws, draws, rng).n_components == 1


@pytest.mark.parametrize(("dof", "chosen"), [(1.0, 2.0), (4.0, 5.0), (np.inf, 30.0)])
def test_the_tails_follow_the_draws(rng, dof, chosen):
    of_scipy = stats.multivariate_t(np.zeros(10), np.eye(10), df=dof, seed=2)
    mixture = choose_mixture(of_scipy.rvs(199), of_scipy.rvs(3000), rng)  # too few for two
    assert mixture.dof.tolist() == [chosen]


def regions_of(log_density, draws):
    """Regions of a posterior of that density, found from its draws."""
    target = Target(lambda z: log_density(z) - log_standard_normal(z), draws.shape[1])
    return find_regions(target, draws, log_density(draws))


def bumps(distance, share=0.25, n=2000):
    """Two unit normals ``distance`` apart: their log density and draws."""
    rng = np.random.default_rng(5)
    centres = np.array([[0.0, 0.0], [distance, 0.0]])
    draws = centres[(rng.random(n) < share).astype(int)] + rng.standard_normal((n, 2))

    def log_density(z):
        parts = [log_standard_normal(z - centre) for centre in centres]
        return np.logaddexp(parts[0] + math.log(1.0 - share), parts[1] + math.log(share))

    return log_density, draws


def ring(n=2000):
    rng = np.random.default_rng(6)
    angle, radius = 2.0 * math.pi * rng.random(n), 2.0 + 0.1 * rng.standard_normal(n)

    def log_density(z):
        return -0.5 * ((np.linalg.norm(z, axis=1) - 2.0) / 0.1) ** 2

    return log_density, radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def banana(n=2000):
    rng = np.random.default_rng(7)
    x = 1.5 * rng.standard_normal(n)
    y = x**2 + 0.2 * rng.standard_normal(n)

    def log_density(z):
        return -0.5 * (z[:, 0] / 1.5) ** 2 - 0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.2) ** 2

    return log_density, np.column_stack([x, y])


def test_two_far_bumps_are_two_regions():
    log_density, draws = bumps(12.0, n=20_000)
    result = regions_of(log_density, draws)
    assert result.n_regions == 2
    assert len(result.draws) == MOST_DRAWS, "thinned"
    right = draws[:, 0] > 6.0
    labels = result.assign(draws)
    assert len(set(labels[right])) == len(set(labels[~right])) == 1
    assert sorted(result.shares(draws)) == pytest.approx([1.0 - right.mean(), right.mean()][::-1])


@pytest.mark.parametrize(("distance", "n_regions"), [(3.0, 1), (4.5, 1), (6.0, 2), (8.0, 2)])
def test_a_valley_of_two_nats_divides(distance, n_regions):
    """Between two equal normals the density falls by distance²/8 - ln 2 nats.

    The typical draw of either is ln 2 nats below its top.
    """
    log_density, draws = bumps(distance, share=0.5)
    assert (distance**2 / 8.0 - 2.0 * math.log(2.0) > 2.0) == (n_regions == 2)
    assert regions_of(log_density, draws).n_regions == n_regions


@pytest.mark.parametrize("make", [ring, banana])
def test_a_bent_region_is_one(make):
    log_density, draws = make()
    result = regions_of(log_density, draws)
    assert result.n_regions == 1
    np.testing.assert_array_equal(result.assign(draws), 0)


@pytest.mark.parametrize("sd", [1.0, 1e-3])
def test_a_sheared_and_narrow_region_is_one(sd):
    draws = np.random.default_rng(8).standard_normal((800, 3)) * [1.0, sd, sd]
    draws[:, 1] += draws[:, 0]

    def log_density(z):
        return -0.5 * (z[:, 0] ** 2 + ((z[:, 1] - z[:, 0]) / sd) ** 2 + (z[:, 2] / sd) ** 2)

    assert regions_of(log_density, draws).n_regions == 1


@pytest.mark.parametrize("d", [2, 3, 5])
def test_two_shells_are_two_regions(d):
    """Hollow regions that are closer to one another than they are wide."""
    rng = np.random.default_rng(d)
    directions = rng.standard_normal((2000, d))
    draws = (2.0 + 0.1 * rng.standard_normal((2000, 1))) * directions
    draws /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre = 3.5 * np.eye(d)[0]
    right = np.arange(2000) % 2 == 0
    draws += np.where(right[:, None], centre, -centre)

    def log_density(z):
        off = (np.linalg.norm(z - c, axis=1) - 2.0 for c in (centre, -centre))
        return np.logaddexp(*(-50.0 * each**2 for each in off))

    result = regions_of(log_density, draws)
    assert result.n_regions == 2
    np.testing.assert_array_equal(result.assign(draws) == result.assign(centre[None])[0], right)


def test_three_regions_in_four_dimensions():
    rng = np.random.default_rng(9)
    centres = np.array([[0.0] * 4, [8.0] * 4, [8.0, -8.0, 8.0, -8.0]])
    draws = np.concatenate([c + rng.standard_normal((500, 4)) for c in centres])

    def log_density(z):
        return np.logaddexp.reduce([log_standard_normal(z - c) for c in centres])

    result = regions_of(log_density, draws)
    assert result.n_regions == 3
    np.testing.assert_allclose(result.shares(draws), 1.0 / 3.0)


def test_a_few_draws_and_a_few_stray_draws_are_no_region():
    for n in (1, 2, 3, 8, 9):
        log_density, draws = bumps(0.0, n=n)
        assert regions_of(log_density, draws).n_regions == 1
    log_density, draws = bumps(0.0, n=500)
    stray = np.array([[9.0, 9.0], [9.1, 9.0], [-9.0, 9.0]])
    assert regions_of(log_density, np.concatenate([draws, stray])).n_regions == 1


def test_groups_meet_at_their_highest_draws_and_at_the_four_highest_pairs_of_neighbours():
    """Draws as high as their number, from 0 to 5 and from 6 to 11, each next to one opposite."""
    draws = np.arange(12)
    nearest = np.column_stack([draws, draws[::-1]])
    pairs = _neighbouring_pairs(draws // 6, nearest, _Paths(None, None, 1.0 * draws))
    assert pairs.tolist() == [[5, 11], [5, 6], [4, 7], [3, 8], [2, 9]]


def test_shares_of_weighted_draws():
    regions = Regions(np.array([[0.0], [10.0], [20.0]]), np.array([0, 1, 1]))
    z = np.array([[0.1], [9.5], [20.3], [-0.2]])
    np.testing.assert_array_equal(regions.assign(z), [0, 1, 1, 0])
    np.testing.assert_allclose(regions.shares(z), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z, np.array([1.0, 2.0, 3.0, 4.0])), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z[:3], np.array([1.0, 2.0, 5.0])), [0.125, 0.875])
    assert regions.shares(z[:1]).tolist() == [1.0, 0.0]  # a region without draws has share 0
