"""Modes of small matrices against closed forms and a dense solver, and the MAC."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

from bayes_ssi.structures.modal import (
    BATCHED_UP_TO,
    NoModesError,
    lowest_eigenpairs,
    mac,
    scaled_shapes,
    shape_signs,
    solve_modes,
)

CHAIN = np.array([[2.0, -1.0], [-1.0, 1.0]])
# Two equal masses on two equal springs: (2 pi f)^2 = (3 -+ sqrt 5)/2.
CHAIN_HZ = np.sqrt([(3.0 - math.sqrt(5.0)) / 2.0, (3.0 + math.sqrt(5.0)) / 2.0]) / (2.0 * math.pi)


def random_structures(batch, n):
    rng = np.random.default_rng(5)
    factor = rng.standard_normal((batch, n, n))
    return factor @ factor.transpose(0, 2, 1) + n * np.eye(n), rng.uniform(0.5, 3.0, (batch, n))


@pytest.mark.parametrize("n", [2, 5, 9])
def test_dense_generalised_eigenproblem(n):
    stiffness, mass = random_structures(4, n)
    modes = solve_modes(stiffness, mass)
    for row in range(4):
        squares, vectors = eigh(stiffness[row], np.diag(mass[row]))
        np.testing.assert_allclose(modes.frequencies_hz[row], np.sqrt(squares) / math.tau)
        np.testing.assert_allclose(np.abs(modes.shapes[row]), np.abs(vectors), atol=1e-12)


@pytest.mark.parametrize(
    ("stiffness", "mass"),
    [
        ([[-2.0, 0.0], [0.0, 1.0]], [1.0, 1.0]), ([[1.0, 2.0], [2.0, 1.0]], [1.0, 1.0]),
        ([[0.0, 0.0], [0.0, 1.0]], [1.0, 1.0]), ([[2.0, -1.0], [-1.0, 1.0]], [-1.0, 1.0]),
        ([[2.0, -1.0], [-1.0, 1.0]], [1.0, 0.0]), ([[np.nan, -1.0], [-1.0, 1.0]], [1.0, 1.0]),
        ([[np.inf, -1.0], [-1.0, 1.0]], [1.0, 1.0]), ([[2.0, -1.0], [-1.0, 1.0]], [np.nan, 1.0]),
    ],
)  # fmt: skip
def test_a_row_without_modes_is_nan_and_leaves_the_others_alone(stiffness, mass):
    batch = np.array([CHAIN, stiffness, 4.0 * CHAIN])
    modes = solve_modes(batch, np.array([[1.0, 1.0], mass, [1.0, 1.0]]))
    assert np.isnan(modes.frequencies_hz[1]).all()
    np.testing.assert_allclose(modes.frequencies_hz[[0, 2]], [CHAIN_HZ, 2 * CHAIN_HZ], rtol=1e-13)
    np.testing.assert_allclose(modes.shapes[0].T @ modes.shapes[0], np.eye(2), atol=1e-13)
    np.testing.assert_allclose(modes.shapes[2].T @ modes.shapes[2], np.eye(2), atol=1e-13)


@pytest.mark.parametrize("n", [7, BATCHED_UP_TO + 1])
def test_full_mass_matrices_singular_ones_too(n):
    """Against scipy's generalised problem; and every row is the same without the others."""
    rng = np.random.default_rng(2)
    stiffness, mass = (a @ a.transpose(0, 2, 1) for a in rng.standard_normal((2, 6, n, n)))
    stiffness[2] -= 5.0 * np.eye(n)
    mass[3] = np.diag(np.r_[1.0, 0.0, 2.0, 3.0, np.zeros(n - 4)])
    mass[4] = np.diag(np.r_[1.0, 0.0, 2.0, np.zeros(n - 3)])
    frequencies, shapes = solve_modes(stiffness, mass, 3)
    for i in (0, 1, 3, 5):
        inverses = eigh(mass[i], stiffness[i], eigvals_only=True)[::-1][:3]
        np.testing.assert_allclose((math.tau * frequencies[i]) ** 2, 1.0 / inverses, rtol=1e-8)
        np.testing.assert_allclose(shapes[i].T @ mass[i] @ shapes[i], np.eye(3), atol=1e-9)
        alone = solve_modes(stiffness[[i]], mass[[i]], 3)
        np.testing.assert_array_equal(alone.frequencies_hz[0], frequencies[i])
        np.testing.assert_array_equal(alone.shapes[0], shapes[i])
    for i in (2, 4):  # K is not positive definite; M gives two modes
        assert np.isnan(frequencies[i]).all()
        with pytest.raises(NoModesError):
            lowest_eigenpairs(stiffness[i], mass[i], 3)


def test_soft_and_stiff_members_leave_low_frequencies_accurate():
    """Three masses in a chain with springs 1, 1e11 and 1: the stiff one joins two masses."""
    links = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    stiffness = links.T @ np.diag([1.0, 1e11, 1.0]) @ links
    frequencies = solve_modes(stiffness[None], np.ones((1, 3)), 2).frequencies_hz[0]
    joined = eigh([[2.0, -1.0], [-1.0, 1.0]], np.diag([2.0, 1.0]), eigvals_only=True)
    np.testing.assert_allclose(frequencies, np.sqrt(joined) / math.tau, rtol=1e-4)


def test_mac_of_known_angles():
    angles = np.radians([0.0, 30.0, 60.0, 90.0, 180.0])
    shapes = np.array([np.cos(angles), np.sin(angles)])
    table = mac(shapes[:, :1], shapes)
    np.testing.assert_allclose(table, [[1.0, 0.75, 0.25, 0.0, 1.0]], atol=1e-15)
    scaled = shapes * [-3.0, 1e-3, 250.0, 1.0, -1.0]
    np.testing.assert_allclose(mac(shapes, scaled), mac(shapes, shapes), rtol=1e-12, atol=1e-15)
    # Missing sensors are left out.
    first = np.array([[1.0], [np.nan], [1.0]])
    other = np.array([[1.0, np.nan, np.nan], [5.0, 2.0, 1.0], [0.0, 3.0, np.nan]])
    # Common sensors 1 and 3, (1, 1) and (1, 0): a half. Sensor 3 alone: one. None.
    np.testing.assert_allclose(mac(first, other), [[0.5, 1.0, np.nan]], rtol=1e-15)


def test_shapes_are_scaled_by_the_main_structure():
    shapes = np.array([[0.1, -0.2, 5.0], [0.0, 0.0, 3.0]])
    scaled = scaled_shapes(shapes, shapes[:, :2])
    np.testing.assert_allclose(scaled, [[0.5, -1.0, 25.0], [0.0, 0.0, 3.0]])
    measured = np.array([[0.1, np.nan, -0.4]])
    np.testing.assert_allclose(scaled_shapes(measured, measured), [[0.25, np.nan, -1.0]])


@pytest.mark.parametrize("off", [-1e-15, 0.0, 1e-15])
def test_the_first_of_equally_large_components_is_positive(off):
    shapes = np.array([[1.0, 0.5, -1.0 + off], [-1.0 + off, -0.5, 1.0]])
    signs = shape_signs(shapes, np.empty((2, 0)), None)
    np.testing.assert_array_equal(signs, [1.0, -1.0])


def test_shapes_are_turned_with_their_own_kind():
    """Bending in x and in y at nearly one frequency: draws differ in which of them comes first."""
    x, y = np.array([0.5, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, -0.5, -1.0])
    rng = np.random.default_rng(3)
    first, flips = rng.random(40) < 0.7, np.where(rng.random(40) < 0.5, -1.0, 1.0)
    shapes = np.where(first[:, None], x, y) + 0.02 * rng.standard_normal((40, 4))
    flipped = shapes * flips[:, None]
    turned = flipped * shape_signs(flipped, np.empty((40, 0)), None)[:, None]
    np.testing.assert_allclose(turned, np.where(first[:, None], shapes, -shapes), atol=1e-12)
    # An identified shape decides, at the sensors that measured it.
    signs = shape_signs(shapes, shapes, np.array([np.nan, -1.0, np.nan, 1.0]))
    np.testing.assert_array_equal(signs, -1.0)


def test_modes_without_components_have_no_sign_to_turn():
    np.testing.assert_array_equal(shape_signs(np.empty((3, 0)), np.empty((3, 0)), None), 1.0)
