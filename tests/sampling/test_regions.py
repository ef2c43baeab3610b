"""Separate regions of a posterior: two far bumps are two, a ring or a banana is one."""

import math

import numpy as np
import pytest

from bayes_ssi.inference.sampling.regions import MOST_DRAWS, Regions, find_regions
from bayes_ssi.inference.sampling.target import Target, log_standard_normal


def regions_of(log_density, draws):
    """Regions of a posterior of that density, found from its draws."""
    target = Target(lambda z: log_density(z) - log_standard_normal(z), draws.shape[1])
    return find_regions(target, draws, log_density(draws))


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


def test_two_far_bumps_are_two_regions():
    log_density, draws = bumps(12.0, n=20_000)
    result = regions_of(log_density, draws)
    assert result.n_regions == 2
    assert len(result.draws) == MOST_DRAWS, "thinned"
    right = draws[:, 0] > 6.0
    labels = result.assign(draws)
    assert len(set(labels[right])) == len(set(labels[~right])) == 1
    assert sorted(result.shares(draws)) == pytest.approx([1.0 - right.mean(), right.mean()][::-1])


@pytest.mark.parametrize(("distance", "n_regions"), [(3.0, 1), (4.5, 1), (6.0, 2), (8.0, 2)])
def test_a_valley_of_two_nats_divides(distance, n_regions):
    """Between two equal normals the density falls by distance²/8 - ln 2 nats.

    The typical draw of either is ln 2 nats below its top.
    """
    log_density, draws = bumps(distance, share=0.5)
    assert (distance**2 / 8.0 - 2.0 * math.log(2.0) > 2.0) == (n_regions == 2)
    assert regions_of(log_density, draws).n_regions == n_regions


@pytest.mark.parametrize("make", [ring, banana])
def test_a_bent_region_is_one(make):
    log_density, draws = make()
    result = regions_of(log_density, draws)
    assert result.n_regions == 1
    np.testing.assert_array_equal(result.assign(draws), 0)


@pytest.mark.parametrize("sd", [1.0, 1e-3])
def test_a_sheared_and_narrow_region_is_one(sd):
    rng = np.random.default_rng(8)
    draws = rng.standard_normal((800, 3)) * [1.0, sd, sd]
    draws[:, 1] += draws[:, 0]

    def log_density(z):
        return -0.5 * (z[:, 0] ** 2 + ((z[:, 1] - z[:, 0]) / sd) ** 2 + (z[:, 2] / sd) ** 2)

    assert regions_of(log_density, draws).n_regions == 1


@pytest.mark.parametrize("d", [2, 3, 5])
def test_two_shells_are_two_regions(d):
    """Hollow regions that are closer to one another than they are wide."""
    rng = np.random.default_rng(d)
    directions = rng.standard_normal((2000, d))
    draws = (2.0 + 0.1 * rng.standard_normal((2000, 1))) * directions
    draws /= np.linalg.norm(directions, axis=1, keepdims=True)
    centre = 3.5 * np.eye(d)[0]
    right = np.arange(2000) % 2 == 0
    draws += np.where(right[:, None], centre, -centre)

    def log_density(z):
        off = (np.linalg.norm(z - c, axis=1) - 2.0 for c in (centre, -centre))
        return np.logaddexp(*(-50.0 * each**2 for each in off))

    result = regions_of(log_density, draws)
    assert result.n_regions == 2
    np.testing.assert_array_equal(result.assign(draws) == result.assign(centre[None])[0], right)


def test_three_regions_in_four_dimensions():
    rng = np.random.default_rng(9)
    centres = np.array([[0.0] * 4, [8.0] * 4, [8.0, -8.0, 8.0, -8.0]])
    draws = np.concatenate([c + rng.standard_normal((500, 4)) for c in centres])

    def log_density(z):
        return np.logaddexp.reduce([log_standard_normal(z - c) for c in centres])

    result = regions_of(log_density, draws)
    assert result.n_regions == 3
    np.testing.assert_allclose(result.shares(draws), 1.0 / 3.0)


def test_a_few_draws_and_a_few_stray_draws_are_no_region():
    for n in (1, 2, 3, 8, 9):
        log_density, draws = bumps(0.0, n=n)
        assert regions_of(log_density, draws).n_regions == 1
    log_density, draws = bumps(0.0, n=500)
    stray = np.array([[9.0, 9.0], [9.1, 9.0], [-9.0, 9.0]])
    assert regions_of(log_density, np.concatenate([draws, stray])).n_regions == 1


def test_shares_of_weighted_draws():
    regions = Regions(np.array([[0.0], [10.0], [20.0]]), np.array([0, 1, 1]))
    z = np.array([[0.1], [9.5], [20.3], [-0.2]])
    np.testing.assert_array_equal(regions.assign(z), [0, 1, 1, 0])
    np.testing.assert_allclose(regions.shares(z), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z, np.array([1.0, 2.0, 3.0, 4.0])), [0.5, 0.5])
    np.testing.assert_allclose(regions.shares(z[:3], np.array([1.0, 2.0, 5.0])), [0.125, 0.875])
    assert regions.shares(z[:1]).tolist() == [1.0, 0.0]  # a region without draws has share 0
