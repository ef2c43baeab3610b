"""The order of distinct minima."""

import itertools

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.calibration.calibration import distinct_minima
from bayes_ssi.inference.calibration.least_squares import CalibrationProblem


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
    error = bs.ErrorModel(0.01)
    candidate = bs.ModelClass("c", structure, data, error, pairing={"1": 1, "2": 2})
    problem = CalibrationProblem(candidate, 0.0)
    z = np.log(2.0) / np.sqrt(np.log1p(0.3**2))
    ends = [np.array([z, -z]) * (1.0 + signs[0]), np.array([-z, z]) * (1.0 + signs[1])]
    for order in (ends, ends[::-1]):
        minima, undetermined = distinct_minima(problem, order)
        np.testing.assert_allclose(problem.values(np.array(minima)), [[0.5, 2.0], [2.0, 0.5]])
        assert undetermined == 0
