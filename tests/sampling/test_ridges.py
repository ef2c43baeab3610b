"""Bent components and the ridges that they follow: maps, densities, fits and evidences."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm

from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.importance import ImportanceSampler
from bayes_ssi.inference.sampling.maxima import _ridge, along_ridges, bend_along, find_maxima
from bayes_ssi.inference.sampling.mixture import (
    REACH,
    Bend,
    StudentMixture,
    choose_mixture,
    monomials,
    tails_within,
)
from bayes_ssi.inference.sampling.regions import find_regions
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target

N_WIDE, WIDTH, CURVATURE = 7, 0.01, 0.1


def bowl(z):
    """The last coordinate is known to be a tenth of the squared distance of seven others."""
    return norm.logpdf(z[:, -1] - CURVATURE * (z[:, :-1] ** 2).sum(1), 0.0, WIDTH)


def density(r2):
    """Of the posterior in the squared distance, but for the evidence, which is its integral."""
    return chi2.pdf(r2, N_WIDE) * norm.pdf(CURVATURE * r2, 0.0, math.hypot(1.0, WIDTH))


def exact_evidence():
    return math.log(quad(density, 0.0, 80.0, points=[2.0, 10.0])[0])


def bowl_target():
    nothing = SuggestedStarts(np.zeros((1, N_WIDE + 1)), 1)
    return Target(bowl, N_WIDE + 1, suggest_starts=lambda _rng: nothing)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_ascents_along_axes_leave_other_directions_alone():
    target = Target(lambda z: -50.0 * (z[:, 0] - z[:, 1] ** 2) ** 2, 3)
    starts = np.array([[2.0, 1.5, -0.3], [-1.0, 0.2, 0.7]])
    ends, heights = ascend(target, starts, np.full((2, 1, 1), 0.01), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(ends[:, 1:], starts[:, 1:])
    # Of -50 (x - y²)² - x²/2 the maximum is 100 y² / 101.
    np.testing.assert_allclose(ends[:, 0], starts[:, 1] ** 2 * 100.0 / 101.0, atol=5e-3)
    np.testing.assert_allclose(heights, target.log_posterior(ends))


def test_a_spike_is_no_ridge_however_wide_its_component_is(rng):
    """Nothing beside it weighs e^-1000 of what the component expects there."""
    target = Target(lambda z: np.where(np.abs(z).max(axis=1) < 1e-3, 1000.0, 0.0), 2)
    assert _ridge(target, np.zeros(2), np.diag([1.0, 0.01]), rng) is None


def test_the_component_of_a_sheet_is_nearly_the_posterior_and_one_region_in_its_chart(rng):
    target = bowl_target()
    maxima = find_maxima(target, np.zeros((1, N_WIDE + 1)))
    ridges = along_ridges(target, maxima, rng)
    sampler = ImportanceSampler(target, rng)
    straight, bent = (sampler.sample(each) for each in (maxima.as_mixture(), ridges))
    assert straight.efficiency < 0.02
    assert bent.efficiency > 0.5
    estimate = bent.estimate
    assert abs(estimate.log_evidence - exact_evidence()) < 4.0 * estimate.error < 0.1
    draws, heights = (values[:300] for values in bent.typical_draws)
    chart = bent.mixture.chart(draws)
    np.testing.assert_allclose(chart.curved(chart.straight(draws)), draws, atol=1e-9)
    before = target.n_evaluations
    assert find_regions(target, draws, heights, chart).n_regions == 1
    in_chart = target.n_evaluations - before
    find_regions(target, draws, heights)  # of many groups there are many paths
    assert target.n_evaluations - before > 3 * in_chart


def test_a_ridge_bends_to_its_own_side(rng):
    """By a third power, which is not the same on both sides."""
    target = Target(lambda z: norm.logpdf(z[:, 1] - 0.2 * z[:, 0] ** 3, 0.0, WIDTH), 2)
    ridges = along_ridges(target, find_maxima(target, np.zeros((1, 2))), rng)
    assert ImportanceSampler(target, rng).sample(ridges).efficiency > 0.5


def test_without_thin_or_wide_directions_there_is_no_ridge(rng):
    for width in (0.01, 3.0):
        target = Target(lambda z, width=width: -0.5 * ((z / width) ** 2).sum(1), 3)
        assert along_ridges(target, find_maxima(target, np.ones((1, 3))), rng) is None


def test_a_sheet_of_many_parameters_is_sampled_well():
    result = sample_target(bowl_target(), np.random.SeedSequence(1))
    assert result.failed_checks == []
    assert not result.compressions
    assert abs(result.evidence.log_evidence - exact_evidence()) < 4.0 * result.evidence.error
    assert result.n_evaluations < 100_000
    squares = np.concatenate([part.draws for part in result.ensembles])[:, -1] / CURVATURE
    # The posterior of the squared distance, by quadrature.
    mean = quad(lambda r2: r2 * density(r2), 0.0, 80.0)[0] / quad(density, 0.0, 80.0)[0]
    assert squares.mean() == pytest.approx(mean, abs=0.2)


def bend_of(rng, n_wide, n_thin, degree):
    return Bend(rng.standard_normal((n_thin, math.comb(n_wide + degree, degree))), n_wide, degree)


@pytest.mark.parametrize(("m", "degree"), [(1, 2), (2, 4), (4, 3)])
def test_monomials_are_all_products_up_to_the_degree(rng, m, degree):
    variables = 0.5 + rng.random((m, 1))
    terms = monomials(variables, degree)
    exponents = [e for e in np.ndindex(*(degree + 1,) * m) if sum(e) <= degree]
    products = [float(np.prod(variables[:, 0] ** np.array(e))) for e in exponents]
    np.testing.assert_allclose(np.sort(terms[:, 0]), np.sort(products))
    assert len(terms) == math.comb(m + degree, degree)
    degrees = np.log2(monomials(2.0 * variables, degree) / terms)
    np.testing.assert_allclose(degrees[:, 0], np.sort([sum(e) for e in exponents]), atol=1e-12)


@pytest.mark.parametrize(("m", "k", "degree"), [(1, 1, 2), (2, 1, 4), (3, 2, 3)])
def test_straightening_undoes_bending(rng, m, k, degree):
    bend = bend_of(rng, m, k, degree)
    v = 2.0 * rng.standard_normal((m + k, 40))
    np.testing.assert_allclose(bend.straightened(bend.bent(v)), v, atol=1e-8)


def test_polynomials_are_of_the_wide_coordinates_and_end_at_the_reach():
    # Coefficients of 1, a, b, a², ab, b².
    bend, reach = Bend(np.array([[0.0, 1.0, 0.0, 0.0, 1.0, 0.5]]), 2, 2), REACH
    bent = bend.bent(np.array([[0.5, 2.0 * reach], [2.0, -1.0], [0.3, 0.0]]))
    np.testing.assert_allclose(bent[:2], [[0.5, 2.0 * reach], [2.0, -1.0]])
    np.testing.assert_allclose(bent[2], [0.3 + 0.5 + 1.0 + 2.0, reach - reach + 0.5])


def test_a_widened_bend_follows_the_same_ridge(rng):
    bend = bend_of(rng, 2, 1, 3)
    v = REACH * rng.standard_normal((3, 30))  # some are beyond the reach
    np.testing.assert_allclose(2.0 * bend.widened(2.0).bent(v / 2.0), bend.bent(v), rtol=1e-12)


def test_a_bend_along_points_without_noise_has_their_polynomials(rng):
    wide = rng.standard_normal((2, 12))
    thin = np.array([3.0 + wide[0] * wide[1] - 2.0 * wide[1] ** 2])
    bend, widths = bend_along(wide, thin, np.ones(12), 2)
    np.testing.assert_allclose(widths, 1.0, atol=1e-6)
    np.testing.assert_allclose(bend.coefficients[0], [3.0, 0.0, 0.0, 0.0, 1.0, -2.0], atol=1e-5)


def test_points_that_polynomials_miss_widen_the_component(rng):
    wide = rng.standard_normal((1, 4000))
    _, widths = bend_along(wide, np.abs(wide), np.ones(4000), 2)
    # |x| less its least-squares quadratic has the variance 1 - 2/π - 1/π of a normal x.
    assert widths[1] == pytest.approx(math.sqrt(1.0 + 1.0 - 3.0 / math.pi), rel=0.01)


def test_tails_are_light_within_a_level_and_lighter_in_many_dimensions():
    assert (tails_within(5), tails_within(20)) == (30.0, 120.0)


def test_bent_mixtures_have_the_density_of_their_draws(rng):
    """The mean of a density over another's draws, divided by it, is 1; mixed, widened, too."""
    straight = StudentMixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None], np.full(1, 5.0))
    bends = tuple(Bend(np.array([[0.0, 0.5, 1.0, -0.1]]), 1, 3) for _ in range(2))
    factors = np.array([[[1.0, 0.0], [0.3, 0.2]], [[0.8, 0.1], [0.0, 0.4]]])
    means, tails = np.array([[0.0, 0.5], [1.0, -1.0]]), np.full(2, 30.0)
    bent = StudentMixture(np.array([0.4, 0.6]), means, factors, tails, bends=bends)
    mixture = bent.mixed_with(straight, 0.3).widened().with_prior_component(0.1)
    assert [bend is not None for bend in mixture.bends] == [True, True, False] * 2
    z = mixture.draw(rng.multinomial(40_000, mixture.all_weights), rng)
    ratios = np.exp(bent.log_pdf(z) - mixture.log_pdf(z))
    assert ratios.mean() == pytest.approx(1.0, abs=4.0 * ratios.std() / 200.0)
    x, y = np.meshgrid(np.linspace(-7, 7, 701), np.linspace(-12, 18, 1501))
    density = np.exp(bent.log_pdf(np.column_stack([x.ravel(), y.ravel()])))
    assert density.sum() * 0.02**2 == pytest.approx(1.0, abs=0.01)


def test_a_chart_straightens_the_component_that_most_draws_belong_to(rng):
    bend = Bend(np.array([[0.0, 0.0, 1.0]]), 1, 2)
    factors, means = np.array([np.diag([1.0, 0.1])] * 2), np.array([[0.0, 0.0], [30.0, 0.0]])
    mixture = StudentMixture(np.ones(2) / 2, means, factors, np.full(2, 30.0), bends=(bend, None))
    z = mixture.draw(np.array([600, 400, 0]), rng)
    straight = mixture.chart(z).straight(z[:600])
    assert np.abs(straight.mean(axis=0)).max() < 0.2
    np.testing.assert_allclose(straight.std(axis=0), 1.0, rtol=0.15)
    assert mixture.chart(z[400:]) is None, "of the other one"
    assert choose_mixture(z[:600], z[:600], rng).chart(z) is None, "without bends"
