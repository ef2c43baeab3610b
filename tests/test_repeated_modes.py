"""Modes of equal frequency: one basis, whatever the rounding of the solver makes of them."""

import numpy as np
import pytest
import scipy.sparse as sp
from chains import membrane

import bayes_ssi as bs
from bayes_ssi.structures.finite_elements.sparse_modes import lowest_modes
from bayes_ssi.structures.modal import lowest_eigenpairs, settle

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
    frequencies_hz, shapes = TOWER.modes(np.ones((1, 1)))
    tops = ("floor 3 x", "floor 3 y")
    modes = tuple(
        bs.IdentifiedMode(name, float(frequencies_hz[0, i]), np.append(shapes[0, 6:8, i], 0.0)[:2])
        for i, name in enumerate("xy")
    )
    data = bs.ModalData(modes, (0.0, 20.0), tops)
    error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    candidate = bs.ModelClass("tower", TOWER, data, error, pairing={"x": 1, "y": 2})
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
    dense = lowest_eigenpairs(stiffness.toarray(), np.diag(mass), 6)
    sparse = lowest_modes(stiffness, sp.csc_array(sp.diags_array(mass)), 6)
    for i in range(6):
        a, b = dense.vectors[:, i], sparse.vectors[:, i]
        np.testing.assert_allclose(a * np.sign(a @ b), b, atol=1e-6 * np.abs(a).max())
    np.testing.assert_allclose(sparse.eigenvalues, dense.eigenvalues, rtol=1e-9)


def test_a_pair_is_whole_where_only_its_first_mode_is_wanted():
    one, two = (lowest_eigenpairs(membrane(7).toarray(), np.eye(49), n) for n in (2, 3))
    np.testing.assert_allclose(one.vectors, two.vectors[:, :2], atol=1e-9)


def test_shapes_at_fewer_sensors_than_equal_modes():
    shapes = np.array([[[3.0, 4.0, 0.0]]])
    settle(np.array([[1.0, 1.0, 1.0]]), shapes)
    np.testing.assert_allclose(shapes, [[[5.0, 0.0, 0.0]]], atol=1e-15)


def test_other_modes_and_rows_stay_as_they_are():
    rng = np.random.default_rng(2)
    shapes = rng.standard_normal((3, 4, 3))
    before = shapes.copy()
    settle(np.array([[1.0, 1.1, 1.1], [1.0, 1.1, 1.2], [np.nan] * 3]), shapes)
    np.testing.assert_array_equal(shapes[1:], before[1:])
    np.testing.assert_array_equal(shapes[0, :, 0], before[0, :, 0])
    assert not np.allclose(shapes[0, :, 1:], before[0, :, 1:])
    plane = np.linalg.qr(before[0, :, 1:])[0]
    np.testing.assert_allclose(plane @ (plane.T @ shapes[0, :, 1:]), shapes[0, :, 1:], atol=1e-12)
