"""Shear buildings and tall buildings against closed forms."""

import math

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.structures.modal import BATCHED_UP_TO

NO_VALUES = np.empty((1, 0))


@pytest.mark.parametrize(("mass", "stiffness"), [(1.0, 1.0), (2.0e4, 3.0e7)])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 40])
def test_frequencies_of_a_uniform_building(n, mass, stiffness):
    j = np.arange(1, n + 1)
    expected = np.sqrt(stiffness / mass) / np.pi * np.sin((2 * j - 1) * np.pi / (2 * (2 * n + 1)))
    frequencies = bs.ShearBuilding([mass] * n, [stiffness] * n).modes(NO_VALUES).frequencies_hz[0]
    np.testing.assert_allclose(frequencies, expected, rtol=1e-10)


def test_parameters_in_masses_and_stiffnesses():
    m = bs.Parameter("m", bs.LogNormal(2.0, 0.1))
    k = bs.Parameter("k", bs.LogNormal(3.0, 0.1))
    building = bs.ShearBuilding(masses=(m, m), stiffnesses=(10.0 * k, 10.0 * k))
    assert building.parameters == (k, m)
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    frequencies = building.modes(np.array([[3.0, 2.0], [5.0, 0.5]])).frequencies_hz
    expected = np.sqrt([30.0 / 2.0, 50.0 / 0.5])[:, None] * [golden, golden + 1.0] / math.tau
    np.testing.assert_allclose(frequencies, expected, rtol=1e-12)


CAN_BE_NEGATIVE = 10.0 * bs.Parameter("k", bs.Normal(1.0, 0.5))


@pytest.mark.parametrize(
    ("masses", "stiffnesses", "message"),
    [
        ((1.0, 1.0), (1.0,), "needs one of each per storey, .* got 2 masses, 1 stiffnesses"),
        ((), (), "needs .* got 0 masses, 0 stiffnesses"),
        ((1.0, -2.0), (1.0, 1.0), "masses, number 2 from below, must be positive .* got -2.0"),
        ((1.0, 1.0), (0.0, 1.0), "stiffnesses, number 1 from below, must be .* got 0.0"),
        ((1.0,), (math.nan,), "stiffnesses, number 1 from below, must be .* got nan"),
        ((1.0, 1.0), (1.0, CAN_BE_NEGATIVE), "stiffnesses, number 2 .* must be positive, but .*k"),
        (("1",), (1.0,), "masses, number 1 from below, must be a number, .* '1'"),
    ],
)
def test_impossible_buildings_are_refused(masses, stiffnesses, message):
    with pytest.raises((ValueError, TypeError), match=f"ShearBuilding: {message}"):
        bs.ShearBuilding(masses, stiffnesses)


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
