"""Separate regions of a posterior: two far bumps are two, a ring or a banana is one."""

import math

import numpy as np
import pytest
from scipy import stats

from bayes_ssi.mixture import StudentMixture, fit_mixture
from bayes_ssi.regions import Regions, find_regions
from bayes_ssi.target import Target, log_standard_normal


def regions_of(log_density, draws, n_components, seed=0):
    """Regions of a posterior of that density, with components fitted to its draws."""
    target = Target(lambda z: log_density(z) - log_standard_normal(z), draws.shape[1])
    mixture = fit_mixture(draws, n_components, 30.0, np.random.default_rng(seed))
    return find_regions(mixture, target, draws, log_density(draws))


def bumps(distance, share=0.25, n=2000):
    """Two unit normals ``distance`` apart: their log density and draws."""
    rng = np.random.default_rng(5)
    centres = np.array([[0.0, 0.0], [distance, 0.0]])
    second = rng.random(n) < share
    draws = centres[second.astype(int)] + rng.standard_normal((n, 2))

    def log_density(z):
        parts = [log_standard_normal(z - centre) for centre in centres]
        return np.logaddexp(parts[0] + math.log(1.0 - share), parts[1] + math.log(share))

    return log_density, draws


def ring(n=2000):
    rng = np.random.default_rng(6)
    angle, radius = 2.0 * math.pi * rng.random(n), 2.0 + 0.1 * rng.standard_normal(n)

    def log_density(z):
        return -0.5 * ((np.linalg.norm(z, axis=1) - 2.0) / 0.1) ** 2

    return log_density, radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def banana(n=2000):
    rng = np.random.default_rng(7)
    x = 1.5 * rng.standard_normal(n)
    y = x**2 + 0.2 * rng.standard_normal(n)

    def log_density(z):
        return -0.5 * (z[:, 0] / 1.5) ** 2 - 0.5 * ((z[:, 1] - z[:, 0] ** 2) / 0.2) ** 2

    return log_density, np.column_stack([x, y])


@pytest.mark.parametrize("n_components", [2, 3, 6])
def test_two_far_bumps_are_two_regions(n_components):
    log_density, draws = bumps(12.0)
    found = regions_of(log_density, draws, n_components)
    assert found.n_regions == 2
    right = draws[:, 0] > 6.0
    labels = found.assign(draws)
    assert len(set(labels[right])) == len(set(labels[~right])) == 1
    assert sorted(found.shares(draws)) == pytest.approx([right.mean(), 1.0 - right.mean()])


@pytest.mark.parametrize("n_components", [1, 2, 4])
def test_overlapping_bumps_are_one_region(n_components):
    log_density, draws = bumps(3.0)  # the valley is less than one nat deep
    assert regions_of(log_density, draws, n_components).n_regions == 1


@pytest.mark.parametrize("make", [ring, banana])
@pytest.mark.parametrize("n_components", [1, 4, 8])
def test_a_bent_region_is_one(make, n_components):
    log_density, draws = make()
    found = regions_of(log_density, draws, n_components)
    assert found.n_regions == 1
    np.testing.assert_array_equal(found.assign(draws), 0)


def test_three_regions_in_four_dimensions():
    rng = np.random.default_rng(9)
    centres = np.array([[0.0] * 4, [8.0] * 4, [8.0, -8.0, 8.0, -8.0]])
    draws = np.concatenate([c + rng.standard_normal((500, 4)) for c in centres])

    def log_density(z):
        return np.logaddexp.reduce([log_standard_normal(z - c) for c in centres])

    found = regions_of(log_density, draws, 5)
    assert found.n_regions == 3
    np.testing.assert_allclose(found.shares(draws), 1.0 / 3.0)


def test_a_component_without_draws_belongs_to_one_that_has_some():
    log_density, draws = bumps(12.0)
    fitted = fit_mixture(draws, 2, 30.0, np.random.default_rng(0))
    order = np.argsort(fitted.means[:, 0])
    # A weak component in the middle of the right-hand bump is nowhere the most probable.
    mixture = StudentMixture(
        np.append(0.999 * fitted.weights[order], 1e-3),
        np.vstack([fitted.means[order], [[12.0, 0.0]]]),
        np.concatenate([fitted.choleskys[order], [3.0 * np.eye(2)]]),
        np.full(3, 30.0),
    )
    target = Target(lambda z: log_density(z) - log_standard_normal(z), 2)
    found = find_regions(mixture, target, draws[np.abs(draws[:, 0] - 12.0) < 15.0],
                         log_density(draws[np.abs(draws[:, 0] - 12.0) < 15.0]))  # fmt: skip
    assert found.n_regions == 2
    assert found.of_component[2] == found.of_component[1] != found.of_component[0]


def test_shares_of_weighted_draws():
    mixture = StudentMixture(
        np.array([0.5, 0.3, 0.2]),
        np.array([[0.0], [10.0], [20.0]]),
        np.ones((3, 1, 1)),
        np.full(3, 30.0),
    )
    regions = Regions(mixture, np.array([0, 1, 1]))
    z = np.array([[0.1], [9.5], [20.3], [-0.2]])
    np.testing.assert_array_equal(regions.assign(z), [0, 1, 1, 0])
    np.testing.assert_allclose(regions.shares(z), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z, np.array([1.0, 2.0, 3.0, 4.0])), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z[:3], np.array([1.0, 2.0, 5.0])), [0.125, 0.875])
    assert regions.shares(z[:1]).tolist() == [1.0, 0.0]  # a region without draws has share 0


def test_assignment_is_that_of_the_most_probable_component():
    mixture = StudentMixture(
        np.array([0.9, 0.1]), np.array([[0.0], [4.0]]), np.ones((2, 1, 1)), np.full(2, 8.0)
    )
    z = np.linspace(-2.0, 6.0, 81)[:, None]
    parts = [0.9 * stats.t(8.0).pdf(z[:, 0]), 0.1 * stats.t(8.0, loc=4.0).pdf(z[:, 0])]
    expected = (parts[1] > parts[0]).astype(int)
    np.testing.assert_array_equal(Regions(mixture, np.array([0, 1])).assign(z), expected)
