"""Populations of many tests: likelihoods and evidences against closed forms and quadrature."""

import numpy as np
import pytest
from linear_tests import exact_log_evidence, linear_tests, log_normal

import bayes_ssi as bs
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.results.hierarchy.populations import (
    Population,
    PopulationLikelihood,
    PopulationPriors,
    PopulationSampler,
    coverage,
    failed_fits,
    fit_tests,
)

X = np.array([-1.2, -0.7, 0.1, 0.4, 1.4])
X = (X - X.mean()) / X.std()
Y = np.array([0.9, 0.3, 0.35, -0.1, -0.5])
VARIANCES = np.array([0.01, 0.02, 0.05, 0.01, 0.03])
OF_DATA = VARIANCES + 0.3**2
KINDS = [(varies, follows) for varies in (False, True) for follows in (False, True)]


@pytest.fixture(scope="module")
def tests():
    return linear_tests(Y, VARIANCES)


@pytest.fixture(scope="module")
def fits(tests):
    return fit_tests(tests, 0, lambda _: None)


def population(varies, follows):
    return Population("its name", ("a",), varies, follows, PopulationPriors())


def likelihood(fits, varies, follows):
    components = [fit.components.integrated_over(np.array([1])) for fit in fits]
    return PopulationLikelihood(population(varies, follows), components, X)


@pytest.mark.parametrize(("varies", "follows"), KINDS)
def test_the_likelihood_of_a_population_is_a_normal_density_of_the_data(fits, varies, follows):
    ours = likelihood(fits, varies, follows)
    values = np.abs(np.random.default_rng(1).normal(size=(6, len(ours.population.parameters))))
    means, slopes, spreads = ours.population.split(values)
    expected = log_normal(Y - means - slopes * X, OF_DATA + spreads**2)
    np.testing.assert_allclose(ours.of_tests(values), expected, atol=1e-8)
    np.testing.assert_array_equal(ours.of_tests(values[4:5])[0], ours.of_tests(values)[4])


@pytest.mark.parametrize(("varies", "follows"), KINDS)
def test_the_evidence_of_a_population(tests, fits, varies, follows):
    sampler = PopulationSampler(tests, fits, [0], X, 0, bs.SamplingSettings())
    sampled = sampler.sample(population(varies, follows), lambda *_: None)
    exact = exact_log_evidence(
        Y, OF_DATA, X, varies=varies, follows=follows, spread_prior=bs.HalfNormal(0.5), slope_sd=0.5
    )  # fmt: skip
    assert sampled.error < 0.02
    assert sampled.log_evidence == pytest.approx(exact, abs=4.0 * sampled.error)
    assert sampled.failed_checks == ()


def test_likelihoods_that_are_exact_need_no_correction(tests, fits):
    ours = likelihood(fits, True, False)
    z = [test.z[:, :1] for test in tests]
    near, far = (coverage(ours, ours, fits, z, np.array([[mean, 0.1]])) for mean in (0.2, 5.0))
    for covered in (near, far):
        np.testing.assert_allclose(covered.corrections, 0.0, atol=1e-8)
        assert covered.error < 1e-8
    assert near.effective_sample_sizes.min() > 50.0
    assert far.effective_sample_sizes.max() < 2.0


def test_draws_correct_components_that_are_wrong(tests, fits):
    """Components at other places than the likelihoods, and the closed form of the right ones."""
    ours = likelihood(fits, True, False)
    shifted = []
    for test, fit in zip(tests, fits, strict=True):
        moved = fit.components.in_coordinates(np.array([0.03, 0.0]), np.ones(2))
        ratios = test.log_likelihoods - moved.log_sum(test.z)
        shifted.append(type(fit)(moved, fit.components, ratios))
    z = [test.z[:, :1] for test in tests]
    values = np.array([[0.2, 0.4]])
    wrong = likelihood(shifted, True, False)
    covered = coverage(wrong, ours, shifted, z, values)
    off = wrong.of_tests(values) - ours.of_tests(values)
    left = off + covered.corrections
    assert np.abs(off).max() > 0.02
    np.testing.assert_array_less(np.abs(left), 4.0 * covered.errors)
    assert np.abs(left).max() < 0.2 * np.abs(off).max()


def test_a_posterior_whose_evidence_is_not_that_of_its_draws_fails(tests, fits):
    assert failed_fits(tests, fits) == []
    off = Estimate(tests[2].evidence.log_evidence + 1.0, 0.005)
    changed = [*tests[:2], type(tests[2])(**{**vars(tests[2]), "evidence": off}), *tests[3:]]
    (sentence,) = failed_fits(changed, fits)
    assert sentence.startswith("test 'test 2': its log evidence is ")
