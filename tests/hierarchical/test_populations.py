"""Populations of many tests: likelihoods and evidences against closed forms and quadrature."""

import numpy as np
import pytest
from linear_tests import exact_log_evidence, linear_tests, log_normal

import bayes_ssi as bs
from bayes_ssi.results.hierarchy.likelihood_fit import log_sum, mapped
from bayes_ssi.results.hierarchy.populations import (
    Population,
    PopulationPriors,
    corrections,
    log_likelihoods,
    sample_population,
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
    return Population("its name", ("a",), varies, follows, PopulationPriors())


def of_tests(fits, kind, values):
    return log_likelihoods(kind, [fit.components for fit in fits], X, values)


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
    sampled = sample_population(kind, fits, X, 0, settings, lambda *_: None)
    exact = exact_log_evidence(
        Y, OF_DATA, X, varies=varies, follows=follows, spread_prior=bs.HalfNormal(0.5), slope_sd=0.5
    )  # fmt: skip
    assert sampled.error < 0.02
    assert sampled.log_evidence == pytest.approx(exact, abs=4.0 * sampled.error)
    assert sampled.failed_checks == ()


def test_likelihoods_that_are_exact_need_no_correction(fits):
    for mean in (0.2, 5.0):
        logs, errors = corrections(population(True, False), fits, X, np.array([[mean, 0.1]]))
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
    logs, errors = corrections(kind, shifted, X, values)
    off = of_tests(shifted, kind, values) - of_tests(fits, kind, values)
    left = off + logs
    assert np.abs(off).max() > 0.02
    np.testing.assert_array_less(np.abs(left), 4.0 * errors)
    assert np.abs(left).max() < 0.2 * np.abs(off).max()
