"""Descents of least squares, and the order of distinct minima."""

import itertools

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.calibration.calibration import distinct_minima
from bayes_ssi.inference.calibration.least_squares import FARTHEST, CalibrationProblem, descend


def alike(a, b):
    """Two parts of a structure that may be exchanged."""
    return np.sqrt([a * b, a + b]), None


@pytest.mark.parametrize("signs", list(itertools.product([-1e-12, 0.0, 1e-12], repeat=2)))
def test_minima_that_mirror_one_another_have_one_order(signs):
    """The product and the sum of two stiffnesses fit with either of them the larger one."""
    factors = {name: bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in "ab"}
    structure = bs.FunctionStructure(alike, factors, n_modes=2)
    modes = (bs.IdentifiedMode("1", 1.0), bs.IdentifiedMode("2", np.sqrt(2.5)))
    data = bs.ModalData(modes, (0.0, 5.0))
    candidate = bs.ModelClass("c", structure, data, bs.ErrorModel(0.01), pairing={"1": 1, "2": 2})
    problem = CalibrationProblem(candidate, 0.0)
    z = np.log(2.0) / np.sqrt(np.log1p(0.3**2))
    ends = [np.array([z, -z]) * (1.0 + signs[0]), np.array([-z, z]) * (1.0 + signs[1])]
    for order in (ends, ends[::-1]):
        minima, undetermined = distinct_minima(problem, order)
        np.testing.assert_allclose(problem.values(np.array(minima)), [[0.5, 2.0], [2.0, 0.5]])
        assert undetermined == 0


PRECISE = 1e-12


def test_linear_residuals_are_solved_exactly():
    rng = np.random.default_rng(0)
    designs, observed = rng.standard_normal((5, 7, 3)), rng.standard_normal((5, 7))

    def residuals(z, rows):
        return np.einsum("nmi,ni->nm", designs[rows], z) - observed[rows]

    ends, curvatures = descend(residuals, np.zeros((5, 3)), 20, PRECISE)
    at_ends = residuals(ends, np.arange(5))
    for i in range(5):
        exact, squares, *_ = np.linalg.lstsq(designs[i], observed[i])
        np.testing.assert_allclose(ends[i], exact, atol=1e-6)
        assert at_ends[i] @ at_ends[i] == pytest.approx(squares[0], rel=1e-9)
        np.testing.assert_allclose(curvatures[i], designs[i].T @ designs[i], rtol=1e-5)


def valley(z, _rows):
    """Rosenbrock's: a curved valley down to (1, 1); no answer where the first is above 2."""
    residuals = np.column_stack([10.0 * (z[:, 1] - z[:, 0] ** 2), 1.0 - z[:, 0]])
    return np.where(z[:, :1] > 2.0, np.nan, residuals)


STARTS = np.array([[-1.2, 1.0], [1.9, -3.0], [0.0, 5.0], [2.5, 0.0]])


def test_a_curved_valley_is_followed():
    ends, _ = descend(valley, STARTS, 60, PRECISE)
    np.testing.assert_allclose(ends[:3], 1.0, atol=1e-5)
    np.testing.assert_allclose(0.5 * (valley(ends[:3], None) ** 2).sum(1), 0.0, atol=1e-10)
    # Without an answer at the start there is nothing to descend.
    np.testing.assert_array_equal(ends[3], STARTS[3])


def test_rows_do_not_depend_on_one_another():
    together = descend(valley, STARTS, 9, PRECISE)
    for i in range(len(STARTS)):
        for of_one, of_all in zip(descend(valley, STARTS[[i]], 9, PRECISE), together, strict=True):
            np.testing.assert_array_equal(of_one[0], of_all[i])


def test_the_search_stays_near():
    seen = []

    def residuals(z, _rows):
        seen.append(z)
        return np.exp(-z)  # falls for ever

    descend(residuals, np.zeros((3, 1)), 30, PRECISE)
    assert np.abs(np.concatenate(seen)).max() < FARTHEST + 1e-6
