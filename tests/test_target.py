"""The target: what it counts, and what it refuses."""

import numpy as np
import pytest
from scipy import stats

from bayes_ssi.target import Target, log_standard_normal


def test_log_standard_normal():
    z = np.random.default_rng(1).standard_normal((6, 3))
    expected = stats.multivariate_normal(np.zeros(3)).logpdf(z)
    np.testing.assert_allclose(log_standard_normal(z), expected, rtol=1e-13)


def test_log_posterior_adds_the_prior():
    target = Target(lambda z: 2.0 * z[:, 0], 2)
    assert target.log_posterior(np.array([[3.0, 4.0]]))[0] == pytest.approx(
        6.0 - 12.5 - np.log(2.0 * np.pi), rel=1e-14
    )


def test_evaluations_and_failures_are_counted():
    target = Target(lambda z: np.where(z[:, 0] > 0, z[:, 0], np.nan), 1)
    values = target.log_likelihood(np.array([[1.0], [-1.0], [2.0], [-2.0], [-3.0]]))
    np.testing.assert_array_equal(values, [1.0, -np.inf, 2.0, -np.inf, -np.inf])
    target.log_likelihood(np.array([[1.0]]))
    assert (target.n_evaluations, target.n_failed) == (6, 3)


def test_likelihood_zero_is_no_failure():
    target = Target(lambda z: np.full(len(z), -np.inf), 1)
    target.log_likelihood(np.zeros((4, 1)))
    assert target.n_failed == 0


def test_an_empty_batch_does_not_reach_the_function():
    target = Target(lambda _: 1 / 0, 2)
    assert target.log_likelihood(np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda z: z, r"expected one value for each of 3 points, got shape \(3, 2\)"),
        (lambda z: z.sum(), r"expected one value for each of 3 points, got shape \(\)"),
        (lambda z: np.where(z[:, 0] > 1, np.inf, 0.0), r"\+inf at coordinates \[2\. 0\.\]"),
    ],
)
def test_wrong_likelihoods_are_refused(function, message):
    with pytest.raises(ValueError, match=message):
        Target(function, 2).log_likelihood(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 1.0]]))
