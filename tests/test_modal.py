"""Modes of small matrices in closed form, those of equal frequency in one basis, and the MAC."""

import math

import numpy as np
import pytest
import scipy.sparse as sp
from chains import membrane
from scipy.linalg import eigh
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.structures import modal
from bayes_ssi.structures.finite_elements.sparse_modes import lowest_modes

CHAIN = np.array([[2.0, -1.0], [-1.0, 1.0]])
# Two equal masses on two equal springs: (2 pi f)^2 = (3 -+ sqrt 5)/2.
CHAIN_HZ = np.sqrt([(3.0 - math.sqrt(5.0)) / 2.0, (3.0 + math.sqrt(5.0)) / 2.0]) / (2.0 * math.pi)


@pytest.mark.parametrize("n", [2, 5, 9])
def test_dense_generalised_eigenproblem(n):
    rng = np.random.default_rng(5)
    factor, mass = rng.standard_normal((4, n, n)), rng.uniform(0.5, 3.0, (4, n))
    stiffness = factor @ factor.transpose(0, 2, 1) + n * np.eye(n)
    modes = modal.solve_modes(stiffness, mass)
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
    modes = modal.solve_modes(batch, np.array([[1.0, 1.0], mass, [1.0, 1.0]]))
    assert np.isnan(modes.frequencies_hz[1]).all()
    np.testing.assert_allclose(modes.frequencies_hz[[0, 2]], [CHAIN_HZ, 2 * CHAIN_HZ], rtol=1e-13)
    np.testing.assert_allclose(modes.shapes[0].T @ modes.shapes[0], np.eye(2), atol=1e-13)
    np.testing.assert_allclose(modes.shapes[2].T @ modes.shapes[2], np.eye(2), atol=1e-13)


@pytest.mark.parametrize("n", [7, modal.BATCHED_UP_TO + 1])
def test_full_mass_matrices_singular_ones_too(n):
    """Against scipy's generalised problem; and every row is the same without the others."""
    rng = np.random.default_rng(2)
    stiffness, mass = (a @ a.transpose(0, 2, 1) for a in rng.standard_normal((2, 6, n, n)))
    stiffness[2] -= 5.0 * np.eye(n)
    mass[3] = np.diag(np.r_[1.0, 0.0, 2.0, 3.0, np.zeros(n - 4)])
    mass[4] = np.diag(np.r_[1.0, 0.0, 2.0, np.zeros(n - 3)])
    frequencies, shapes = modal.solve_modes(stiffness, mass, 3)
    for i in (0, 1, 3, 5):
        inverses = eigh(mass[i], stiffness[i], eigvals_only=True)[::-1][:3]
        np.testing.assert_allclose((math.tau * frequencies[i]) ** 2, 1.0 / inverses, rtol=1e-8)
        np.testing.assert_allclose(shapes[i].T @ mass[i] @ shapes[i], np.eye(3), atol=1e-9)
        alone = modal.solve_modes(stiffness[[i]], mass[[i]], 3)
        np.testing.assert_array_equal(alone.frequencies_hz[0], frequencies[i])
        np.testing.assert_array_equal(alone.shapes[0], shapes[i])
    for i in (2, 4):  # K is not positive definite; M gives two modes
        assert np.isnan(frequencies[i]).all()
        with pytest.raises(modal.NoModesError):
            modal.lowest_eigenpairs(stiffness[i], mass[i], 3)


def test_soft_and_stiff_members_leave_low_frequencies_accurate():
    """Three masses in a chain with springs 1, 1e11 and 1: the stiff one joins two masses."""
    links = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    stiffness = links.T @ np.diag([1.0, 1e11, 1.0]) @ links
    frequencies = modal.solve_modes(stiffness[None], np.ones((1, 3)), 2).frequencies_hz[0]
    joined = eigh([[2.0, -1.0], [-1.0, 1.0]], np.diag([2.0, 1.0]), eigvals_only=True)
    np.testing.assert_allclose(frequencies, np.sqrt(joined) / math.tau, rtol=1e-4)


def test_mac_of_known_angles():
    angles = np.radians([0.0, 30.0, 60.0, 90.0, 180.0])
    shapes = np.array([np.cos(angles), np.sin(angles)])
    table = modal.mac(shapes[:, :1], shapes)
    np.testing.assert_allclose(table, [[1.0, 0.75, 0.25, 0.0, 1.0]], atol=1e-15)
    scaled = shapes * [-3.0, 1e-3, 250.0, 1.0, -1.0]
    np.testing.assert_allclose(
        modal.mac(shapes, scaled), modal.mac(shapes, shapes), rtol=1e-12, atol=1e-15
    )
    # Missing sensors are left out.
    first = np.array([[1.0], [np.nan], [1.0]])
    other = np.array([[1.0, np.nan, np.nan], [5.0, 2.0, 1.0], [0.0, 3.0, np.nan]])
    # Common sensors 1 and 3, (1, 1) and (1, 0): a half. Sensor 3 alone: one. None.
    np.testing.assert_allclose(modal.mac(first, other), [[0.5, 1.0, np.nan]], rtol=1e-15)


def test_shapes_are_scaled_by_the_main_structure():
    shapes = np.array([[0.1, -0.2, 5.0], [0.0, 0.0, 3.0]])
    scaled = modal.scaled_shapes(shapes, shapes[:, :2])
    np.testing.assert_allclose(scaled, [[0.5, -1.0, 25.0], [0.0, 0.0, 3.0]])
    measured = np.array([[0.1, np.nan, -0.4]])
    np.testing.assert_allclose(modal.scaled_shapes(measured, measured), [[0.25, np.nan, -1.0]])


@pytest.mark.parametrize("off", [-1e-15, 0.0, 1e-15])
def test_the_first_of_equally_large_components_is_positive(off):
    shapes = np.array([[1.0, 0.5, -1.0 + off], [-1.0 + off, -0.5, 1.0]])
    np.testing.assert_array_equal(modal.shape_signs(shapes, np.empty((2, 0)), None), [1.0, -1.0])


def test_shapes_are_turned_with_their_own_kind():
    """Bending in x and in y at nearly one frequency: draws differ in which of them comes first."""
    x, y = np.array([0.5, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, -0.5, -1.0])
    rng = np.random.default_rng(3)
    first, flips = rng.random(40) < 0.7, np.where(rng.random(40) < 0.5, -1.0, 1.0)
    shapes = np.where(first[:, None], x, y) + 0.02 * rng.standard_normal((40, 4))
    flipped = shapes * flips[:, None]
    turned = flipped * modal.shape_signs(flipped, np.empty((40, 0)), None)[:, None]
    np.testing.assert_allclose(turned, np.where(first[:, None], shapes, -shapes), atol=1e-12)
    # An identified shape decides, at the sensors that measured it.
    signs = modal.shape_signs(shapes, shapes, np.array([np.nan, -1.0, np.nan, 1.0]))
    np.testing.assert_array_equal(signs, -1.0)


def test_modes_without_components_have_no_sign_to_turn():
    np.testing.assert_array_equal(modal.shape_signs(np.empty((3, 0)), np.empty((3, 0)), None), 1.0)


K = bs.Parameter("k", bs.LogNormal(median=1.0, cov=0.3))
# Alike in x and in y, which nothing couples.
TOWER = bs.ShearBuilding3D(
    masses=(1.0,) * 3, radii_of_gyration=(1.2,) * 3, stiffnesses_x=(800.0 * K,) * 3,
    stiffnesses_y=(800.0 * K,) * 3, torsional_stiffnesses=(3000.0 * K,) * 3,
)  # fmt: skip
VALUES = np.random.default_rng(0).uniform(0.5, 2.0, (50, 1))


@pytest.fixture
def turned(monkeypatch):
    """A solver that gives any other basis of modes of equal frequency, as another processor may."""
    solve, rng = np.linalg.eigh, np.random.default_rng(1)

    def eigh(matrices):
        eigenvalues, vectors = solve(matrices)
        for values, shapes in zip(eigenvalues, vectors, strict=True):
            edges = np.flatnonzero(np.diff(values) > 1e-9 * values[1:]) + 1
            for group in np.split(np.arange(len(values)), edges):
                normal = rng.standard_normal((len(group), len(group)))
                shapes[:, group] = shapes[:, group] @ np.linalg.qr(normal)[0]
        return eigenvalues, vectors

    monkeypatch.setattr(np.linalg, "eigh", eigh)


def directions(shapes):
    """Shares (B, 3, m) of x, y and torsion in the squares of shapes (B, 9, m)."""
    squares = (shapes**2).reshape(len(shapes), 3, 3, -1).sum(axis=1)
    return squares / squares.sum(axis=1, keepdims=True)


@pytest.mark.usefixtures("turned")
def test_a_tower_alike_in_two_directions_moves_in_one_of_them_in_each_mode():
    frequencies_hz, shapes = TOWER.modes(VALUES)
    np.testing.assert_allclose(frequencies_hz[:, 0], frequencies_hz[:, 1], rtol=1e-12)
    np.testing.assert_allclose(directions(shapes).max(axis=1), 1.0, atol=1e-12)
    # Of two that move equally far, the first degree of freedom counts: x, then y.
    np.testing.assert_array_equal(directions(shapes)[:, :, :2].argmax(axis=1), [[0, 1]] * 50)


@pytest.mark.usefixtures("turned")
def test_a_likelihood_does_not_hang_on_the_solver():
    data = exact_modes(TOWER, ("floor 3 x", "floor 3 y"), (0.0, 20.0), 2, [1.0])
    error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    candidate = bs.ModelClass("tower", TOWER, data, error, pairing={"1": 1, "2": 2})
    values = np.ones((20, 1))
    log_likelihoods = candidate.log_likelihood(values)
    np.testing.assert_allclose(log_likelihoods, log_likelihoods[0], rtol=1e-9)
    np.testing.assert_allclose(
        candidate.likelihoods[0].compared_modes(values).shape_distances, 0.0, atol=1e-9
    )


@pytest.mark.parametrize("half_width", [11, 5])
def test_dense_and_sparse_solvers_give_the_same_modes(half_width):
    """By Lanczos iterations, and by the flexibility of few degrees of freedom with mass."""
    n = 23
    middle = np.abs(np.arange(n) - n // 2) <= half_width
    mass = np.outer(middle, middle).ravel().astype(float)
    stiffness = membrane(n)
    dense = modal.lowest_eigenpairs(stiffness.toarray(), np.diag(mass), 6)
    sparse = lowest_modes(stiffness, sp.csc_array(sp.diags_array(mass)), 6)
    for i in range(6):
        a, b = dense.vectors[:, i], sparse.vectors[:, i]
        np.testing.assert_allclose(a * np.sign(a @ b), b, atol=1e-6 * np.abs(a).max())
    np.testing.assert_allclose(sparse.eigenvalues, dense.eigenvalues, rtol=1e-9)


def test_a_pair_is_whole_where_only_its_first_mode_is_wanted():
    one, two = (modal.lowest_eigenpairs(membrane(7).toarray(), np.eye(49), n) for n in (2, 3))
    np.testing.assert_allclose(one.vectors, two.vectors[:, :2], atol=1e-9)


def test_shapes_at_fewer_sensors_than_equal_modes():
    shapes = np.array([[[3.0, 4.0, 0.0]]])
    modal.settle(np.array([[1.0, 1.0, 1.0]]), shapes)
    np.testing.assert_allclose(shapes, [[[5.0, 0.0, 0.0]]], atol=1e-15)


def test_other_modes_and_rows_stay_as_they_are():
    shapes = np.random.default_rng(2).standard_normal((3, 4, 3))
    before = shapes.copy()
    modal.settle(np.array([[1.0, 1.1, 1.1], [1.0, 1.1, 1.2], [np.nan] * 3]), shapes)
    np.testing.assert_array_equal(shapes[1:], before[1:])
    np.testing.assert_array_equal(shapes[0, :, 0], before[0, :, 0])
    assert not np.allclose(shapes[0, :, 1:], before[0, :, 1:])
    plane = np.linalg.qr(before[0, :, 1:])[0]
    np.testing.assert_allclose(plane @ (plane.T @ shapes[0, :, 1:]), shapes[0, :, 1:], atol=1e-12)


def test_motions_of_rounding_are_none():
    shapes = np.array([[[1.0, 1e-12], [0.5, 1.0]]])
    np.testing.assert_array_equal(modal.seen_shapes(shapes), [[[1.0, 0.0], [0.5, 1.0]]])
