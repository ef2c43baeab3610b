"""Populations of many tests, and components that stand for their likelihoods, where exact."""

import numpy as np
import pytest
from linear_tests import exact_log_evidence, linear_tests, log_normal
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.sampling.target import log_standard_normal
from bayes_ssi.results.hierarchy import populations
from bayes_ssi.results.hierarchy.likelihood_fit import (
    _least_squares,
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

X = np.array([-1.2, -0.7, 0.1, 0.4, 1.4])
X = (X - X.mean()) / X.std()
Y = np.array([0.9, 0.3, 0.35, -0.1, -0.5])
VARIANCES = np.array([0.01, 0.02, 0.05, 0.01, 0.03])
OF_DATA = VARIANCES + 0.3**2
KINDS = [(varies, follows) for varies in (False, True) for follows in (False, True)]


@pytest.fixture(scope="module")
def fits():
    return [fit.within([0]) for fit in linear_tests(Y, VARIANCES)]


def population(varies, follows):
    return populations.Population("its name", ("a",), varies, follows, bs.PopulationPriors())


def of_tests(fits, kind, values):
    return populations.log_likelihoods(kind, [fit.components for fit in fits], X, values)


@pytest.mark.parametrize(("varies", "follows"), KINDS)
def test_the_likelihood_of_a_population_is_a_normal_density_of_the_data(fits, varies, follows):
    kind = population(varies, follows)
    values = np.abs(np.random.default_rng(1).normal(size=(6, len(kind.parameters))))
    means, slopes, spreads = kind.split(values)
    expected = log_normal(Y - means - slopes * X, OF_DATA + spreads**2)
    ours = of_tests(fits, kind, values)
    np.testing.assert_allclose(ours, expected, atol=1e-8)
    np.testing.assert_array_equal(of_tests(fits, kind, values[4:5])[0], ours[4])
    # Where a prior ends the last parameter is infinite, and nothing else changes.
    values[2, -1] = np.inf
    expected[2] = -np.inf
    np.testing.assert_allclose(of_tests(fits, kind, values), expected, atol=1e-8)


@pytest.mark.parametrize(("varies", "follows"), KINDS)
def test_the_evidence_of_a_population(fits, varies, follows):
    kind, settings = population(varies, follows), bs.SamplingSettings()
    sampled = populations.sample_population(kind, fits, X, 0, settings, lambda *_: None)
    exact = exact_log_evidence(
        Y, OF_DATA, X, varies=varies, follows=follows, spread_prior=bs.HalfNormal(0.5), slope_sd=0.5
    )  # fmt: skip
    assert sampled.error < 0.02
    assert sampled.log_evidence == pytest.approx(exact, abs=4.0 * sampled.error)
    assert sampled.failed_checks == ()


def test_likelihoods_that_are_exact_need_no_correction(fits):
    for mean in (0.2, 5.0):
        logs, errors = populations.corrections(
            population(True, False), fits, X, np.array([[mean, 0.1]])
        )
        np.testing.assert_allclose(logs, 0.0, atol=1e-8)
        np.testing.assert_allclose(errors, 0.0, atol=1e-8)


def test_draws_correct_components_that_are_wrong(fits):
    """Components at other places than the likelihoods, and the closed form of the right ones."""
    kind, values = population(True, False), np.array([[0.2, 0.4]])
    shifted = []
    for fit in fits:
        moved = mapped(fit.components, np.array([-0.03]), np.ones(1))
        ratios = fit.log_ratios + log_sum(fit.components, fit.z) - log_sum(moved, fit.z)
        shifted.append(fit._replace(components=moved, second=fit.components, log_ratios=ratios))
    logs, errors = populations.corrections(kind, shifted, X, values)
    off = of_tests(shifted, kind, values) - of_tests(fits, kind, values)
    left = off + logs
    assert np.abs(off).max() > 0.02
    np.testing.assert_array_less(np.abs(left), 4.0 * errors)
    assert np.abs(left).max() < 0.2 * np.abs(off).max()


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


def test_a_search_goes_on_from_a_step_to_singular_precisions(monkeypatch):
    """To exp(-2 (x - 1)²), whose mean under N(0, 1) is exp(-0.4)/√5."""
    x, normal, steps = np.linspace(-2.0, 2.0, 9)[:, None], standard_form(1), []

    def singular_once(forms):
        if not steps and not np.array_equal(forms[0], 2.0 * normal):
            steps.append(forms)
            raise np.linalg.LinAlgError
        return log_integrals(forms)

    monkeypatch.setattr("bayes_ssi.results.hierarchy.likelihood_fit.log_integrals", singular_once)
    likelihoods, evidence = -2.0 * (x[:, 0] - 1.0) ** 2, -0.5 * np.log(5.0) - 0.4
    forms, _ = _least_squares(normal[None], x, likelihoods, normal, evidence)
    np.testing.assert_allclose(forms, [[[4.0, -4.0], [-4.0, 4.0]]], rtol=1e-6)
    assert len(steps) == 1
