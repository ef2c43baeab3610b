"""The condensed frame, against a portal's closed form and a frame with all its rotations."""

import itertools
import math

import numpy as np
import pytest
from conftest import multiplier

import bayes_ssi as bs

NONE = np.empty((1, 0))
ANGULAR = 2.0 * math.pi


def portal(**others):
    given = {
        "storey_heights": (2.5,), "x_lines": (-2.0, 2.0), "y_lines": (-1.5, 1.5),
        "elastic_modulus": 200.0, "column_inertias_x": (3.0,), "column_inertias_y": (2.0,),
        "beam_inertias_x": (5.0,), "beam_inertias_y": (4.0,), "masses": (10.0,),
        "rotational_inertias": (30.0,),
    }  # fmt: skip
    return bs.SpaceFrame(**{**given, **others})


def portal_stiffness(height, span, column, beam):
    """k = (24 E I_c/h³) (6κ + 1)/(6κ + 4), κ = (I_b/L)/(I_c/h): two columns, fixed, one beam."""
    kappa = (beam / span) / (column / height)
    return 24.0 * 200.0 * column / height**3 * (6.0 * kappa + 1.0) / (6.0 * kappa + 4.0)


def test_a_portal_has_its_closed_form():
    stiffness, mass = portal().matrices(NONE)
    along_x, along_y = portal_stiffness(2.5, 4.0, 3.0, 5.0), portal_stiffness(2.5, 3.0, 2.0, 4.0)
    torsion = 2.0 * (1.5**2 * along_x + 2.0**2 * along_y)
    expected = np.diag([2.0 * along_x, 2.0 * along_y, torsion])
    np.testing.assert_allclose(stiffness[0], expected, rtol=1e-13, atol=1e-9)
    np.testing.assert_array_equal(mass, [[10.0, 10.0, 30.0]])


# A whole frame in space with 12 degrees of freedom a member, assembled directly.
def member_stiffness(length, modulus, inertia_y, inertia_z):
    """In local axes, x along the member; no resistance to stretching or twisting is needed."""
    k = np.zeros((12, 12))
    for inertia, displacement, rotation, sign in ((inertia_z, 1, 5, 1.0), (inertia_y, 2, 4, -1.0)):
        at = [displacement, rotation, displacement + 6, rotation + 6]
        s = np.array([1.0, sign * length, 1.0, sign * length])
        bending = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4.0]])
        k[np.ix_(at, at)] += modulus * inertia / length**3 * bending * np.outer(s, s)
    return k


def flexibility_of_whole_frame(heights, xs, ys, modulus, columns_x, columns_y, beams_x, beams_y):
    """F (3n, 3n) of the floors' displacements, rotations of all joints being free.

    Joints stay at their height, move with their rigid floor and turn with it about the vertical.
    """
    n, points = len(heights), list(itertools.product(range(len(xs)), range(len(ys))))
    size = 3 * n + 2 * n * len(points)
    place = {joint: i for i, joint in enumerate(itertools.product(range(n), points))}

    def motion(level, point):
        """(6, size): ux, uy, uz, rx, ry, rz of a joint, from all unknowns."""
        rows = np.zeros((6, size))
        if level < 0:
            return rows
        x, y = xs[point[0]], ys[point[1]]
        at = 3 * n + 2 * place[level, point]
        rows[0, 3 * level], rows[0, 3 * level + 2] = 1.0, -y
        rows[1, 3 * level + 1], rows[1, 3 * level + 2] = 1.0, x
        rows[3, at] = rows[4, at + 1] = rows[5, 3 * level + 2] = 1.0
        return rows

    def add(length, axes, ends, inertia_y, inertia_z):
        turn = np.kron(np.eye(4), np.array(axes, dtype=float))
        local = turn @ np.vstack([motion(*end) for end in ends])
        return local.T @ member_stiffness(length, modulus, inertia_y, inertia_z) @ local

    total = np.zeros((size, size))
    for level in range(n):
        for i, j in points:
            vertical = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]  # local z is y: I_y resists motion in y
            ends = ((level - 1, (i, j)), (level, (i, j)))
            total += add(heights[level], vertical, ends, columns_y[level], columns_x[level])
            if i + 1 < len(xs):
                along_x = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
                ends = ((level, (i, j)), (level, (i + 1, j)))
                total += add(xs[i + 1] - xs[i], along_x, ends, beams_x[level], 7.0)
            if j + 1 < len(ys):
                along_y = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
                ends = ((level, (i, j)), (level, (i, j + 1)))
                total += add(ys[j + 1] - ys[j], along_y, ends, beams_y[level], 7.0)
    return np.linalg.inv(total)[: 3 * n, : 3 * n]


FRAMES = {
    "two storeys, one bay": ((2.0, 2.0), (-2.0, 2.0), (-1.5, 1.5)),
    "two equal bays": ((3.0, 2.5), (-4.0, 0.0, 4.0), (-1.5, 1.5)),
    "unequal bays, off centre": ((3.0, 2.5, 2.8), (-2.0, 1.0, 5.0), (-1.0, 2.5)),
    "a storey": ((3.0,), (0.0, 4.0), (-3.0, -1.0, 1.0, 3.0)),
}


@pytest.mark.parametrize(("heights", "xs", "ys"), FRAMES.values(), ids=FRAMES)
def test_the_frame_is_that_with_all_its_rotations(heights, xs, ys):
    n = len(heights)
    sections = np.random.default_rng(n + len(xs)).uniform(0.5, 4.0, (4, n))
    masses, inertias = [5.0 + i for i in range(n)], [20.0 - i for i in range(n)]
    names = [[f"{kind} {i}" for i in range(n)] for kind in ("cx", "cy", "bx", "by")]
    structure = bs.SpaceFrame(
        heights, xs, ys, 200.0, *([multiplier(name) for name in row] for row in names), masses,
        inertias,
    )  # fmt: skip
    batch = np.vstack([sections.ravel(), np.full(4 * n, 1.7)])
    modes = structure.modes(batch)
    mass = np.diag(np.column_stack([masses, masses, inertias]).ravel())
    for row, values in enumerate(batch):
        flexible = flexibility_of_whole_frame(heights, xs, ys, 200.0, *values.reshape(4, n))
        expected = 1.0 / np.sqrt(np.sort(np.linalg.eigvals(flexible @ mass).real)[::-1])
        np.testing.assert_allclose(ANGULAR * modes.frequencies_hz[row], expected, rtol=1e-9)
        for mode, omega in zip(modes.shapes[row].T, expected, strict=True):
            np.testing.assert_allclose(omega**2 * flexible @ (mass @ mode), mode, atol=1e-7)


def test_frequencies_of_the_papers_bare_frame():
    inertias = ((each * 1e-8,) * 2 for each in (1509.0, 549.7, 1317.0, 1317.0))
    masses = (3533.0, 3398.0), (9010.0, 8167.0)
    frame = bs.SpaceFrame((2.0, 2.0), (-2.0, 2.0), (-1.5, 1.5), 210e9, *inertias, *masses)
    modes = frame.modes(NONE)
    np.testing.assert_allclose(
        modes.frequencies_hz[0], [3.48, 4.32, 6.13, 10.48, 15.66, 19.82], rtol=5e-3
    )
    largest = np.abs(modes.shapes[0]).reshape(2, 3, 6).max(axis=0)  # direction, mode
    assert largest[:, [0, 3]].argmax(axis=0).tolist() == [1, 1]  # y, the second one is the fourth
    second = modes.shapes[0].reshape(2, 3, 6)[:, 1, 3]
    assert second[0] * second[1] < 0.0


def test_a_block_counts_with_mass_static_moment_and_polar_inertia():
    """One block on one floor, against the mass matrix written out by hand."""
    m, (x, y) = 3.0, (1.2, -0.7)
    stiffness, mass = portal().with_element(bs.FloorBlock(1, m, (x, y))).matrices(NONE)
    block = m * np.array([[1, 0, -y], [0, 1, x], [-y, x, x**2 + y**2]])
    np.testing.assert_allclose(mass[0], np.diag([10.0, 10.0, 30.0]) + block, rtol=1e-14)
    modes = portal().with_element(bs.FloorBlock(1, m, (x, y))).modes(NONE)
    eigenvalues, _ = np.linalg.eig(np.linalg.solve(mass[0], stiffness[0]))
    expected = np.sqrt(np.sort(eigenvalues.real)) / ANGULAR
    np.testing.assert_allclose(modes.frequencies_hz[0], expected, rtol=1e-12)
    shapes = modes.shapes[0]
    np.testing.assert_allclose(shapes.T @ mass[0] @ shapes, np.eye(3), atol=1e-13)


def test_blocks_that_balance_each_other_leave_the_mass_diagonal():
    structure = portal()
    for x, y in itertools.product((-1.3, 1.3), (-0.8, 0.8)):
        structure = structure.with_element(bs.FloorBlock(1, 340.0, (x, y), label=f"{x} {y}"))
    _, mass = structure.matrices(NONE)
    polar = 4 * 340.0 * (1.3**2 + 0.8**2)
    np.testing.assert_allclose(mass, [[10.0 + 1360.0, 10.0 + 1360.0, 30.0 + polar]], rtol=1e-14)


def test_a_mass_that_is_not_positive_definite_has_no_modes():
    # J about the centre is less than the static moment asks for: no such body exists.
    light = portal(rotational_inertias=(1e-9,), masses=(1e-9,))
    structure = light.with_element(bs.FloorBlock(1, multiplier("a", 0.1), (1.0, 0.0)))
    modes = structure.modes(np.array([[1.0], [math.nan], [-1.0], [2.0]]))
    assert np.isfinite(modes.frequencies_hz).all(axis=1).tolist() == [True, False, False, True]


def test_the_ground_moves_in_one_direction():
    """A rigid block on soft columns: all of its mass takes part, in that direction alone."""
    for direction, expected in (("x", [1, 0, 0]), ("y", [0, 1, 0])):
        structure = portal(ground_motion=direction).with_element(
            bs.Pendulum("floor 1 y", 0.5, 1.0, label="brace")
        )
        model = structure.modal_model(NONE)
        own = 1.0 if direction == "y" else 0.0  # the pendulum follows its floor
        assert model.influence.tolist() == [*expected, own]
        assert (model.participation[0] ** 2).sum() == pytest.approx(10.0 + 0.5 * own)


def test_the_ground_s_motion_with_a_block_off_centre():
    model = portal().with_element(bs.FloorBlock(1, 3.0, (1.2, -0.7))).modal_model(NONE)
    assert (model.participation[0] ** 2).sum() == pytest.approx(13.0)


def refused(match, **changed):
    with pytest.raises((ValueError, TypeError), match=match):
        portal(**changed)


def test_bad_fields_are_refused():
    refused("one of each per storey, at least one, got 2 column", column_inertias_x=(1.0, 1.0))
    refused("storey_heights must be positive", storey_heights=(-2.0,))
    refused("x_lines must be two or more finite coordinates in ascending order", x_lines=(1.0,))
    refused("y_lines must be two or more", y_lines=(1.0, 1.0))
    refused("y_lines must be a sequence, each item a number", y_lines=("a", "b"))
    refused("x_lines must be two or more finite coordinates", x_lines=(0.0, math.inf))
    refused("masses, number 1 from below, must be positive", masses=(0.0,))
    refused("elastic_modulus must be positive", elastic_modulus=-1.0)
    refused("beam_inertias_y, number 1 from below, must be a number", beam_inertias_y=("I",))
    refused("ground_motion must be 'x' or 'y', got 'z'", ground_motion="z")
