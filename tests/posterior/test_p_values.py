"""Combinations of p-values: distributions, closed forms, and values far out."""

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm

from bayes_ssi.inference.criticism.misfit import (
    log_combined,
    log_harmonic_mean,
    log_joint,
    log_two_sided,
    standard_deviations,
)


def test_two_sided():
    residuals = np.array([-1.959964, 0.0, 3.0])
    np.testing.assert_allclose(np.exp(log_two_sided(residuals)), 2.0 * norm.sf(abs(residuals)))
    # The tail of a normal distribution: φ(x)/x.
    (far,) = log_two_sided(np.array([100.0]))
    assert far == pytest.approx(-5000 + math.log(2) - 5.524, abs=1e-3)


def test_fishers_combination_of_those_that_count():
    p = np.array([[0.1, 0.2, 0.9], [0.03, 0.5, 0.01]])
    counted = np.array([[True, True, False], [True, True, True]])
    expected = [chi2.sf(-2.0 * math.log(0.02), 4), chi2.sf(-2.0 * math.log(0.00015), 6)]
    np.testing.assert_allclose(np.exp(log_joint(np.log(p), counted)), expected)
    none = log_joint(np.full((1, 2), np.nan), np.zeros((1, 2), dtype=bool))
    assert none.tolist() == [0.0]
    far = log_joint(np.array([[-5000.0, -3000.0], [-np.inf, 0.0]]), np.ones((2, 2), dtype=bool))
    assert far[0] == pytest.approx(-8000.0 + math.log(8001.0))
    assert far[1] < -1e299


@pytest.mark.parametrize("n", [1, 3, 30])
def test_combined_p_values_are_p_values(n):
    """Independent ones: the harmonic mean makes little of 0.01 more than 0.01."""
    n_sets = 200_000 // max(n, 3)
    log_p = np.log(np.random.default_rng(5).random((n_sets, n)))
    error = 3.0 * math.sqrt(0.01 * 0.99 / n_sets)
    for combined in (log_harmonic_mean(log_p, axis=1), log_combined(log_p)):
        assert (combined < math.log(0.01)).mean() < 0.012 + error


def test_the_harmonic_mean():
    assert np.exp(log_harmonic_mean(np.log([0.1, 0.2, 0.4]), axis=0)) == pytest.approx(3.0 / 17.5)
    # Equal ones, as of draws that all say the same, stay what they are.
    assert log_harmonic_mean(np.full(400, -7.0), axis=0) == pytest.approx(-7.0)
    assert log_harmonic_mean(np.array([-np.inf, 0.0]), axis=0) < -1e299


@pytest.mark.parametrize("sds", [0.0, 0.5, 2.5758, 8.0, 30.0])
def test_standard_deviations(sds):
    assert standard_deviations(math.log(2.0) + norm.logsf(sds)) == pytest.approx(sds, abs=1e-9)
