"""Bent components: maps that undo one another, densities, and what fitting them recovers."""

import math

import numpy as np
import pytest

from bayes_ssi.inference.sampling.maxima import bend_along
from bayes_ssi.inference.sampling.mixture import (
    REACH,
    Bend,
    StudentMixture,
    choose_mixture,
    monomials,
)


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def bend_of(rng, n_wide, n_thin, degree):
    coefficients = rng.standard_normal((n_thin, math.comb(n_wide + degree, degree)))
    return Bend(coefficients, n_wide, degree)


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
    coefficients = np.array([[0.0, 1.0, 0.0, 0.0, 1.0, 0.5]])  # of 1, a, b, a², ab, b²
    bend, reach = Bend(coefficients, 2, 2), REACH
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
