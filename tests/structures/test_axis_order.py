"""The order of axes of mode shapes: parameter values, degree of freedom, mode."""

import numpy as np
import pytest

import bayes_ssi as bs

K = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
MASSES = np.array([1.0, 2.0, 5.0])
STIFFNESSES = (3.0 * K, 2.0, 1.0)


def matrices(k):
    of_storeys = np.array([[3 * k + 2, -2, 0], [-2, 3, -1], [0, -1, 1.0]])
    return of_storeys, np.diag(MASSES)


@pytest.mark.parametrize(
    "structure",
    [
        bs.ShearBuilding(MASSES, STIFFNESSES),
        bs.FunctionStructure(matrices, {"k": K}, n_modes=3, sensors=("a", "b", "c")),
        bs.MatrixStructure(
            [(K, matrices(1.0)[0] - matrices(0.0)[0]), (1.0, matrices(0.0)[0])],
            np.diag(MASSES), n_modes=3,
        ),
    ],
)  # fmt: skip
def test_modes_are_columns(structure):
    """Orthogonal with respect to the mass, which tells rows from columns in square shapes."""
    (shape,) = structure.modes([[1.3]]).shapes
    np.testing.assert_allclose(shape.T @ (MASSES[:, None] * shape), np.eye(3), atol=1e-9)
    exchanged = shape @ (MASSES[:, None] * shape.T)
    assert np.abs(exchanged - np.eye(3)).max() > 0.1


def test_exchanged_axes_are_named():
    function = bs.FunctionStructure(
        lambda k: ([k, 2.0], np.ones((2, 3))), {"k": K}, n_modes=2, sensors=("a", "b", "c")
    )
    with pytest.raises(ValueError, match=r"\(3, 2\), got ndarray of shape \(2, 3\), its transpose"):
        function.modes([[1.0]])
