"""Maxima of posteriors that are known in closed form, and Laplace's approximation at them."""

import math

import numpy as np
import pytest
from targets import peaks

from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.maxima import find_maxima, first_ascent
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

PEAKS = np.array([[2.0, 0.0], [-2.0, 0.5], [0.0, 2.5], [0.5, -2.5]])
SHARES = np.array([0.4, 0.3, 0.2, 0.1])
PEAK_SD = 0.15


class Linear:
    """y = A z + noise of standard deviation s, prior N(0, I): everything in closed form."""

    def __init__(self, d=3, sd=0.3):
        rng = np.random.default_rng(d)
        self.a, self.y, self.sd = rng.standard_normal((2 * d, d)), rng.standard_normal(2 * d), sd
        self.precision_of_data = self.a.T @ self.a / sd**2
        self.slope = self.a.T @ self.y / sd**2
        self.covariance = np.linalg.inv(np.eye(d) + self.precision_of_data)
        self.mean = self.covariance @ self.slope
        total = sd**2 * np.eye(2 * d) + self.a @ self.a.T
        self.log_evidence = -0.5 * (
            self.y @ np.linalg.solve(total, self.y)
            + np.linalg.slogdet(2.0 * math.pi * total).logabsdet
        )
        self.target = Target(self.log_likelihood, d)

    def log_likelihood(self, z):
        residuals = (self.y - z @ self.a.T) / self.sd
        return (-0.5 * residuals**2 - math.log(self.sd * math.sqrt(2.0 * math.pi))).sum(1)


@pytest.fixture
def starts():
    return np.random.default_rng(8).standard_normal((64, 2))


@pytest.fixture
def linear():
    return Linear()


def test_all_four_peaks_are_found(starts):
    target = Target(peaks(PEAKS, PEAK_SD, SHARES), 2)
    maxima = find_maxima(target, 2.0 * starts)
    np.testing.assert_allclose(maxima.log_posteriors, target.log_posterior(maxima.z), rtol=1e-12)
    np.testing.assert_allclose(maxima.z, PEAKS, atol=2e-3)  # the highest first
    for covariance in maxima.covariances:
        np.testing.assert_allclose(covariance, PEAK_SD**2 * np.eye(2), rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(np.exp(maxima.log_masses), SHARES, rtol=2e-3)
    assert maxima.laplace_estimate.log_evidence == pytest.approx(0.0, abs=1e-3)
    mixture = maxima.as_mixture()
    np.testing.assert_allclose(mixture.weights, SHARES, atol=1e-3)
    np.testing.assert_allclose(mixture.means, PEAKS, atol=2e-3)


def test_laplace_is_exact_for_a_linear_model(linear):
    maxima = find_maxima(linear.target, np.random.default_rng(1).standard_normal((8, 3)))
    assert len(maxima.z) == 1
    sd = np.sqrt(np.diag(linear.covariance))
    # A top 0.05 standard deviations away is 0.001 nats lower: that is when ascents stop.
    np.testing.assert_array_less(np.abs(maxima.z[0] - linear.mean) / sd, 0.1)
    np.testing.assert_allclose(maxima.covariances[0], linear.covariance, rtol=1e-3, atol=1e-6)
    assert maxima.laplace_estimate.log_evidence == pytest.approx(linear.log_evidence, abs=3e-3)


def test_the_end_of_a_curved_ridge_is_reached(starts):
    """Rosenbrock's valley, ten times longer than wide; prior taken out."""

    def rosenbrock(z):
        return (
            -100.0 * (z[:, 1] - z[:, 0] ** 2) ** 2 - (1.0 - z[:, 0]) ** 2 - log_standard_normal(z)
        )

    maxima = find_maxima(Target(rosenbrock, 2), starts)
    np.testing.assert_allclose(maxima.z[0], [1.0, 1.0], atol=0.1)
    assert maxima.log_posteriors[0] == pytest.approx(0.0, abs=2e-3)


def test_a_maximum_at_the_edge_of_the_support(starts):
    target = Target(lambda z: np.where(z[:, 0] > 0.0, -3.0 * z[:, 0], np.nan), 2)
    maxima = find_maxima(target, starts)
    assert np.isfinite(maxima.covariances).all()
    np.testing.assert_allclose(maxima.z[0], [0.0, 0.0], atol=0.05)


def test_maxima_at_the_edges_of_stripes_are_not_one(starts):
    """At an edge there is no curvature: only the gap between two stripes tells them apart."""

    def in_stripes(z):
        return np.where(np.abs(np.abs(z[:, 0]) - 0.45) < 0.3, 0.0, -np.inf)

    maxima = find_maxima(Target(in_stripes, 2), starts)
    assert maxima.are_at(maxima.z).all()
    assert sorted(maxima.z[:, 0]) == pytest.approx([-0.15, 0.15], abs=0.01)


def test_no_start_is_possible(starts):
    with pytest.raises(ValueError, match="the likelihood is zero at every start"):
        find_maxima(Target(lambda z: np.full(len(z), -np.inf), 2), starts)


def test_an_ascent_ends_where_a_step_gains_less_than_is_asked():
    """Of a quartic, whose steps gain less and less."""
    heights, evaluations = [], []
    for least_rise in (1e-3, 1.0):
        target = Target(lambda z: -5.0 * ((z - 3.0) ** 4).sum(1), 3)
        heights.append(first_ascent(target, np.zeros((1, 3)), least_rise)[1][0])
        evaluations.append(target.n_evaluations)
    assert evaluations[1] < evaluations[0]
    assert heights[0] - 5.0 < heights[1] < heights[0]


def test_an_ascent_that_creeps_up_to_an_edge_ends(monkeypatch):
    """The posterior rises to a curved edge, over which it falls: no step of usual length rises."""
    batches = []

    def log_likelihood(z):
        batches.append(len(z))
        return z[:, 0] - np.where(z[:, 0] > 0.5 - (z[:, 1] - 0.5) ** 2, 20.0, 0.0)

    start = Target(log_likelihood, 2), np.zeros((1, 2)), np.eye(2)[None]
    _, (height,) = ascend(*start)
    n_batches = len(batches)
    monkeypatch.setattr("bayes_ssi.inference.sampling.ascents.MOST_CREEPING", 1000)
    _, (of_all_steps,) = ascend(*start)
    assert height == pytest.approx(of_all_steps, abs=1e-3)
    assert n_batches < 60 < len(batches) - n_batches


def test_the_precision_of_a_narrow_maximum():
    """Steps that suit one of a thousandth of the prior fall too far, and become shorter."""
    precision = np.array([[4.0e8, 1.0e8], [1.0e8, 1.0e8]])

    def log_likelihood(z):
        return -0.5 * np.einsum("ni,ij,nj->n", z - 0.3, precision, z - 0.3)

    (found,) = find_maxima(Target(log_likelihood, 2), np.full((1, 2), 0.31)).precisions
    np.testing.assert_allclose(found, precision + np.eye(2), rtol=1e-3)
