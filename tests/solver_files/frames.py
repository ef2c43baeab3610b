"""A small frame of known matrices, to be written in the formats of solvers."""

import numpy as np

import bayes_ssi as bs

LABELS = ("2 x", "2 z", "2 ry", "7 x", "7 z", "7 ry")
# Nodes, and their degrees of freedom as programs number them.
PLACES = [(node, number) for node in (2, 7) for number in (1, 3, 5)]


def portal():
    """Two columns (EA, EI, h), clamped, and a beam: textbook element matrices, joint masses.

    Returns:
        Stiffness and mass, (6, 6), of joints 2 and 7 in x, z and ry.
    """
    ea, ei, h, span = 6.3e8, 1.8e7, 3.5, 6.0
    column = np.diag([12 * ei / h**3, ea / h, 4 * ei / h])
    column[0, 2] = column[2, 0] = 6 * ei / h**2
    a, b, c = ea / span, 12 * ei / span**3, 6 * ei / span**2
    beam = np.array([
        [a, 0, 0, -a, 0, 0], [0, b, -c, 0, -b, -c], [0, -c, 4 * ei / span, 0, c, 2 * ei / span],
        [-a, 0, 0, a, 0, 0], [0, -b, c, 0, b, c], [0, -c, 2 * ei / span, 0, c, 4 * ei / span],
    ])  # fmt: skip
    beam[:3, :3] += column
    beam[3:, 3:] += column
    return beam, np.diag([2e3, 2e3, 0.0, 3e3, 3e3, 0.0])


def lower_entries(matrix):
    """(row, column, entry), from 0, of the lower triangle, zeros left out."""
    rows, columns = np.nonzero(np.tril(matrix))
    return [(int(i), int(j), float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]


def frequencies_of(model, sensor, n_modes):
    structure = bs.MatrixStructure(
        model.stiffness, model.mass, labels=model.labels, sensors=[sensor], n_modes=n_modes
    )
    return structure.modes(np.empty((1, 0))).frequencies_hz[0]


def assert_is_portal(model, labels=LABELS):
    """Read back exactly."""
    stiffness, mass = portal()
    np.testing.assert_array_equal(model.stiffness.toarray(), stiffness)
    np.testing.assert_array_equal(model.mass.toarray(), mass)
    assert model.labels == labels
