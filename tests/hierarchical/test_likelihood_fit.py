"""Components that stand for likelihoods: exact where they are normal, close where they are not."""

import numpy as np
import pytest
from scipy.special import logsumexp

from bayes_ssi.inference.sampling.target import log_standard_normal
from bayes_ssi.results.hierarchy.likelihood_fit import (
    averaged,
    fit_likelihood,
    forms_of,
    integral_by_numbers,
    log_integrals,
    log_sum,
    mapped,
    standard_form,
    sum_by_numbers,
)

RNG = np.random.default_rng(5)
NUMBERS = RNG.normal(size=20)  # of two components in three coordinates
COMPONENTS, ROOTS = forms_of(NUMBERS, 3)
PRIOR = standard_form(3)


def differences(function, numbers, step=1e-6):
    steps = step * np.eye(len(numbers))
    return np.array([(function(numbers + s) - function(numbers - s)) / (2.0 * step) for s in steps])


def test_derivatives():
    z = RNG.normal(size=(4, 3))
    np.testing.assert_allclose(
        sum_by_numbers(COMPONENTS, ROOTS, z).T,
        differences(lambda numbers: log_sum(forms_of(numbers, 3)[0], z), NUMBERS),
        atol=1e-7,
    )
    np.testing.assert_allclose(
        integral_by_numbers(COMPONENTS, ROOTS, PRIOR)[0],
        differences(lambda n: logsumexp(log_integrals(forms_of(n, 3)[0] + PRIOR)), NUMBERS),
        atol=1e-7,
    )


def test_integrals_agree_with_draws_from_the_prior():
    others = RNG.standard_normal((200_000, 2))
    for first in (-1.0, 0.5):
        z = np.insert(others, 1, first, axis=1)
        values = np.exp(log_sum(COMPONENTS, z))
        exact = np.exp(log_sum(averaged(COMPONENTS, np.array([0, 2])), np.array([[first]])))
        assert exact[0] == pytest.approx(values.mean(), abs=4.0 * values.std() / len(z) ** 0.5)
    total = logsumexp(log_sum(averaged(COMPONENTS, np.arange(3)), np.empty((1, 0))))
    assert total == pytest.approx(logsumexp(log_integrals(COMPONENTS + PRIOR)), abs=1e-10)


def test_other_coordinates():
    origin, unit = RNG.normal(size=3), RNG.uniform(0.1, 2.0, size=3)
    z = RNG.normal(size=(5, 3))
    moved = mapped(COMPONENTS, origin, unit)
    np.testing.assert_allclose(log_sum(moved, z), log_sum(COMPONENTS, origin + unit * z))


def curved(z):
    """Unknown error size exp(z_1), as in most studies, and a curved model of z_0."""
    residual = (np.exp(0.3 * z[:, 0]) - 1.1) * np.exp(-0.5 * z[:, 1]) / 0.05
    return -1.5 * residual**2 - 1.5 * z[:, 1]


def grid(n=801, far=6.0):
    axis = np.linspace(-far, far, n)
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2), axis


def curved_fit(seed):
    """The fit at 1000 draws of the posterior, its error, and the posterior on a grid."""
    z, axis = grid()
    log_densities, cell = curved(z) + log_standard_normal(z), (axis[1] - axis[0]) ** 2
    log_evidence = float(logsumexp(log_densities)) + np.log(cell)
    shares = np.exp(log_densities - logsumexp(log_densities))
    draws = z[np.random.default_rng(seed).choice(len(z), 1000, p=shares)]
    fit = fit_likelihood(draws, curved(draws), log_evidence, np.random.default_rng(0))
    return fit, np.sqrt(np.mean(fit.log_ratios**2)), (z, log_densities, log_evidence, shares, cell)


@pytest.mark.parametrize("seed", [5, 11, 12, 14])
def test_more_components_lead_out_of_poor_minima(seed):
    """Of draws of which one or two components have errors of 0.4 to 0.8."""
    assert curved_fit(seed)[1] < 0.1


def test_a_likelihood_that_is_not_normal_is_matched_where_its_posterior_lies():
    fit, error, (z, log_densities, log_evidence, shares, cell) = curved_fit(0)
    assert len(fit.components) > 1
    assert error < 0.1
    # Everywhere, not only at the draws: Kullback-Leibler and the evidence.
    by_components = log_sum(fit.components, z) + log_standard_normal(z)
    assert shares @ (by_components - log_densities) == pytest.approx(0.0, abs=3.0 * error**2)
    assert float(logsumexp(by_components)) + np.log(cell) == pytest.approx(log_evidence, abs=error)


def test_a_normal_likelihood_is_matched_exactly_even_where_it_says_nothing():
    draws = RNG.standard_normal((300, 3)) * [0.05, 1.0, 0.3] + [2.0, 0.0, -1.0]

    def likelihood(z):
        return -0.5 * ((z[:, 0] - 2.0) / 0.05) ** 2 - 2.0 * (z[:, 2] + z[:, 0]) ** 2

    # The stored evidence is never exact, and must not disturb what is.
    fit = fit_likelihood(draws, likelihood(draws), 0.3, np.random.default_rng(0))
    far = draws + RNG.standard_normal(draws.shape)
    assert np.abs(fit.log_ratios).max() < 1e-9
    np.testing.assert_allclose(log_sum(fit.components, far), likelihood(far), atol=1e-7)
