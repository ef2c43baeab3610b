"""Tall buildings against closed forms."""

import math

import numpy as np

import bayes_ssi as bs
from bayes_ssi.structures.modal import BATCHED_UP_TO

N = 2 * BATCHED_UP_TO


def test_close_modes_of_two_parts_that_hardly_touch():
    """Those of the upper part alone and of the lower one alone, tuned to the same frequency."""
    m, n = 30, 60
    tuned = (math.sin(math.pi / (4 * m + 2)) / math.sin(math.pi / (2 * n))) ** 2
    stiffnesses = np.array([1.0] * m + [1e-6] + [tuned] * (n - 1))
    size = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    building = bs.ShearBuilding((1.0,) * (m + n), tuple(k * size for k in stiffnesses))
    frequencies, shapes = building.modes(np.ones((1, 1)))
    shapes = shapes[:, :, :5]
    squares = (math.tau * frequencies[0, :5]) ** 2
    assert 0.0 < squares[2] / squares[1] - 1.0 < 1e-4
    (stiffness,), _ = building.matrices(np.ones((1, 1)))
    np.testing.assert_allclose(shapes[0].T @ shapes[0], np.eye(5), atol=1e-11)
    np.testing.assert_allclose(stiffness @ shapes[0], shapes[0] * squares, atol=3e-11)


def test_a_building_on_a_very_soft_storey_is_solved_as_accurately():
    factor = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    building = bs.ShearBuilding((1.0,) * N, (1e-8 * factor, *[1.0] * (N - 1)))
    frequencies, _ = building.modes(np.array([[1.0], [4.0]]))
    rigid = np.sqrt(1e-8 * np.array([1.0, 4.0]) / N) / math.tau
    np.testing.assert_allclose(frequencies[:, 0], rigid, rtol=1e-6)
    free = 2.0 * math.sin(math.pi / (2 * N)) / math.tau
    np.testing.assert_allclose(frequencies[:, 1], free, rtol=1e-6)
