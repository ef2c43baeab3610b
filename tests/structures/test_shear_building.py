"""The shear building against its closed forms."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

import bayes_ssi as bs

NO_VALUES = np.empty((1, 0))


def uniform(n, mass=1.0, stiffness=1.0):
    return bs.ShearBuilding(masses=[mass] * n, stiffnesses=[stiffness] * n)


@pytest.mark.parametrize(("mass", "stiffness"), [(1.0, 1.0), (2.0e4, 3.0e7)])
@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 40])
def test_frequencies_of_a_uniform_building(n, mass, stiffness):
    j = np.arange(1, n + 1)
    expected = np.sqrt(stiffness / mass) / np.pi * np.sin((2 * j - 1) * np.pi / (2 * (2 * n + 1)))
    frequencies = uniform(n, mass, stiffness).modes(NO_VALUES).frequencies_hz[0]
    np.testing.assert_allclose(frequencies, expected, rtol=1e-10)


def test_storey_i_stands_below_floor_i():
    building = bs.ShearBuilding(masses=(1.0, 2.0, 3.0), stiffnesses=(10.0, 20.0, 40.0))
    stiffness = [[30.0, -20.0, 0.0], [-20.0, 60.0, -40.0], [0.0, -40.0, 40.0]]
    squares, vectors = eigh(stiffness, np.diag([1.0, 2.0, 3.0]))
    modes = building.modes(NO_VALUES)
    np.testing.assert_allclose(modes.frequencies_hz[0], np.sqrt(squares) / math.tau, rtol=1e-12)
    np.testing.assert_allclose(np.abs(modes.shapes[0]), np.abs(vectors), rtol=1e-10)


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
