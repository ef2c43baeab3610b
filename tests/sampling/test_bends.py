"""Bent components: maps that undo one another, densities, and what fitting them recovers."""

import numpy as np
import pytest

from bayes_ssi.inference.sampling.bends import Bend, fit_bend, n_monomials
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.mixture_fitting import choose_mixture, fit_mixture


@pytest.fixture
def rng():
    return np.random.default_rng(21)


def bend_of(rng, d, degree, reach=4.0):
    coefficients = rng.standard_normal((d, n_monomials(d - 1, degree)))
    return Bend(coefficients, degree, np.full(1, reach))


@pytest.mark.parametrize(("d", "degree"), [(2, 2), (3, 4), (5, 3)])
def test_straightening_undoes_bending(rng, d, degree):
    bend = bend_of(rng, d, degree)
    v = 2.0 * rng.standard_normal((d, 40))
    np.testing.assert_allclose(bend.straightened(bend.bent(v)), v, atol=1e-8)
    two = Bend.stacked([bend, bend_of(rng, d, degree)])
    np.testing.assert_allclose(two.straightened(np.array([v, v]))[0], bend.straightened(v))


def test_polynomials_are_of_the_coordinates_before_and_end_at_the_reach():
    coefficients = np.zeros((3, 6))  # 1, a, a², b, ab, b²
    coefficients[1, :3] = [1.0, 2.0, 3.0]
    coefficients[2] = [0.0, 0.0, 0.0, 0.0, 1.0, 0.5]
    bend = Bend(coefficients, 2, np.full(1, 4.0))
    bent = bend.bent(np.array([[0.5, 9.0], [2.0, -1.0], [0.0, 0.0]]))
    np.testing.assert_allclose(bent[1], [2.0 + 1.0 + 1.0 + 0.75, -1.0 + 1.0 + 8.0 + 48.0])
    np.testing.assert_allclose(bent[2], [0.5 * 2.0 + 0.5 * 4.0, 4.0 * -1.0 + 0.5])


def test_a_widened_bend_follows_the_same_ridge(rng):
    bend = bend_of(rng, 3, 3)
    v = 5.0 * rng.standard_normal((3, 30))  # some are beyond the reach
    np.testing.assert_allclose(2.0 * bend.widened(2.0).bent(v / 2.0), bend.bent(v), rtol=1e-12)


def ridge(rng, n, width=0.003):
    """Draws of a thin ridge z2 = z1² / 2 + sin(z1) / 5."""
    z = rng.standard_normal((n, 2))
    z[:, 1] = 0.5 * z[:, 0] ** 2 + 0.2 * np.sin(z[:, 0]) + width * z[:, 1]
    return z


def test_fitting_a_bend_recovers_a_quadratic_ridge(rng):
    a, b = rng.standard_normal((2, 4000))
    bend, widths = fit_bend(
        np.array([a, 0.3 + 0.7 * a**2 + 0.01 * b]), np.ones(4000), 4000.0, 2, np.zeros(2)
    )
    assert widths == pytest.approx([1.0, 0.01], rel=0.05)
    np.testing.assert_allclose(widths[1] * bend.coefficients[1], [0.3, 0.0, 0.7], atol=1e-3)


def test_bent_mixtures_have_the_density_of_their_draws(rng):
    """The mean of a density over another's draws, divided by it, is 1; mixed, widened, too."""
    straight = StudentMixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None], np.full(1, 5.0))
    bent = fit_mixture(ridge(rng, 2000, 0.2), 2, 30.0, rng, degree=3)
    mixture = bent.mixed_with(straight, 0.3).widened().with_prior_component(0.1)
    assert [bend is not None for bend in mixture.bends] == [True, True, False] * 2
    z = mixture.draw(rng.multinomial(40_000, mixture.all_weights), rng)
    ratios = np.exp(bent.log_pdf(z) - mixture.log_pdf(z))
    assert ratios.mean() == pytest.approx(1.0, abs=4.0 * ratios.std() / 200.0)
    x, y = np.meshgrid(np.linspace(-6, 6, 601), np.linspace(-6, 12, 901))
    density = np.exp(bent.log_pdf(np.column_stack([x.ravel(), y.ravel()])))
    assert density.sum() * 0.02**2 == pytest.approx(1.0, abs=0.01)


def test_components_bend_along_a_thin_ridge(rng):
    """The mean log density of held-out draws comes within 0.1 nats of the best, the exact one."""
    mixture = choose_mixture(ridge(rng, 3000), ridge(rng, 3000), rng)
    assert mixture.bends
    z = ridge(rng, 3000)
    exact = -np.log(2.0 * np.pi * 0.003) - 1.0
    assert exact - mixture.log_pdf(z).mean() < 0.1


def test_straight_components_stay_where_they_do(rng):
    assert not choose_mixture(*rng.standard_normal((2, 2000, 3)), rng).bends
