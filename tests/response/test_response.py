"""Responses against direct solutions, closed forms and an exact integration of the equations."""

import itertools
import math

import numpy as np
import pytest
from conftest import FLOORS, assert_refused
from scipy.linalg import expm

import bayes_ssi as bs
from bayes_ssi.structures.modal import ModalModel, Modes
from bayes_ssi.structures.response import (
    GROUND,
    GroundMotion,
    Output,
    damping_ratios,
    time_histories,
    transfer_functions,
)

NO_VALUES = np.empty((1, 0))
RATIOS = (0.01, 0.02, 0.03, 0.05)


@pytest.fixture
def values():
    return np.exp(0.2 * np.random.default_rng(2).standard_normal((3, 4)))


def full_matrices(structure, values, ratios):
    """K, C and M of one row of values; C from modal damping ratios."""
    stiffness, mass = structure.matrices(values)
    M = np.diag(mass[0])
    modes = structure.modes(values)
    phi, omega = modes.shapes[0], 2.0 * math.pi * modes.frequencies_hz[0]
    return stiffness[0], M @ phi @ np.diag(2.0 * np.array(ratios) * omega) @ phi.T @ M, M


def direct(structure, values, ratios, frequencies_hz, load):
    """Displacements (n_dof, F) that solve (K + iωC - ω²M) u = load."""
    K, C, M = full_matrices(structure, values, ratios)
    columns = []
    for omega in 2.0 * math.pi * frequencies_hz:
        columns.append(np.linalg.solve(K + 1j * omega * C - omega**2 * M, load(M)))
    return np.array(columns).T


def test_transfer_functions_from_ground_acceleration_solve_the_equations(augmented, values):
    frequencies = np.linspace(0.0, 6.0, 61)
    omega = 2.0 * math.pi * frequencies
    everywhere = augmented.degrees_of_freedom
    drifts = ((GROUND, "floor 1"), ("floor 1", "floor 2"), ("floor 2", "infill 1-2"))
    computed = {
        quantity: transfer_functions(
            augmented, values, frequencies, Output(quantity, places), RATIOS
        )
        for quantity, places in (
            ("displacement", everywhere), ("acceleration", everywhere), ("drift", drifts)
        )
    }  # fmt: skip
    for row in range(3):
        u = direct(augmented, values[row : row + 1], RATIOS, frequencies, lambda M: -M @ np.ones(4))
        expected = {
            "displacement": u,
            "acceleration": 1.0 - omega**2 * u,
            "drift": np.array([u[0], u[1] - u[0], u[3] - u[1]]),
        }
        for quantity, exact in expected.items():
            np.testing.assert_allclose(
                computed[quantity][row], exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max()
            )


def test_transfer_functions_from_a_force_solve_the_equations(augmented, values):
    frequencies = np.linspace(0.0, 6.0, 61)
    u = direct(augmented, values[:1], [0.02] * 4, frequencies, lambda M: np.eye(len(M))[1])
    accelerations = -((2.0 * math.pi * frequencies) ** 2) * u
    for quantity, exact in (("displacement", u), ("acceleration", accelerations)):
        output = Output(quantity, augmented.degrees_of_freedom)
        computed = transfer_functions(
            augmented, values[:1], frequencies, output, 0.02, force_at="floor 2"
        )
        np.testing.assert_allclose(computed[0], exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("n_places", [1, 3])
def test_a_draw_does_not_depend_on_its_batch(augmented, values, n_places):
    motion = GroundMotion(np.random.default_rng(5).standard_normal(150), 0.02)
    output = Output("acceleration", FLOORS[:n_places])
    for response, given in ((time_histories, motion), (transfer_functions, np.arange(0.1, 9.0))):
        alone = [response(augmented, row[None], given, output, RATIOS)[0] for row in values]
        np.testing.assert_array_equal(response(augmented, values, given, output, RATIOS), alone)


def exact_history(structure, values, ratios, motion):
    """Relative displacements and absolute accelerations, by the matrix exponential.

    The state and the record's value and slope form one linear system; exact for each step.
    """
    K, C, M = full_matrices(structure, values, ratios)
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    augmented = np.zeros((2 * n + 2, 2 * n + 2))
    augmented[: 2 * n, : 2 * n] = A
    augmented[n : 2 * n, 2 * n] = -1.0
    augmented[2 * n, 2 * n + 1] = 1.0
    step = expm(augmented * motion.dt)
    states = [np.zeros(2 * n)]
    for before, after in itertools.pairwise(motion.acceleration):
        states.append((step @ np.r_[states[-1], before, (after - before) / motion.dt])[: 2 * n])
    states = np.array(states)
    # ü + a_g ι: what springs and dampers give.
    return states[:, :n].T, (states @ A[n:].T).T


@pytest.mark.parametrize(
    ("n_samples", "dt", "ratios"),
    [
        (2, 0.01, RATIOS), (32, 0.01, RATIOS), (33, 0.01, RATIOS), (500, 0.02, RATIOS),
        (200, 0.4, RATIOS), (400, 0.0004, (0.001, 0.2, 0.001, 0.2)),
    ],
)  # fmt: skip
def test_time_histories_are_exact_for_a_linear_record(augmented, values, n_samples, dt, ratios):
    motion = GroundMotion(1.0 + np.random.default_rng(5).standard_normal(n_samples), dt)
    everywhere = Output("displacement", augmented.degrees_of_freedom)
    displacement = time_histories(augmented, values, motion, everywhere, ratios)
    acceleration = time_histories(augmented, values, motion, Output("acceleration", FLOORS), ratios)
    drift = time_histories(
        augmented, values, motion, Output("drift", ((GROUND, "floor 1"), ("floor 1", "floor 2"))),
        ratios,
    )  # fmt: skip
    for row in range(3):
        u, total = exact_history(augmented, values[row : row + 1], ratios, motion)
        scale = np.abs(u).max()
        np.testing.assert_allclose(displacement[row], u, atol=1e-9 * scale)
        np.testing.assert_allclose(drift[row], [u[0], u[1] - u[0]], atol=1e-9 * scale)
        np.testing.assert_allclose(acceleration[row], total[:3], atol=1e-9 * np.abs(total).max())


def test_a_mode_at_the_sampling_rate_is_no_special_case():
    stiff = bs.ShearBuilding((1.0,), ((2.0 * math.pi * 10.0) ** 2,))  # 10 Hz, sampled at 10 Hz
    motion = GroundMotion(np.random.default_rng(1).standard_normal(100), 0.1)
    computed = time_histories(stiff, NO_VALUES, motion, Output("displacement", ("floor 1",)), 1e-6)
    u, _ = exact_history(stiff, NO_VALUES, [1e-6], motion)
    np.testing.assert_allclose(computed[0], u, atol=1e-8 * np.abs(u).max())


def test_an_empty_batch_has_an_empty_response(augmented):
    motion = GroundMotion([0.0, 1.0], 0.1)
    output = Output("acceleration", FLOORS)
    nothing = np.empty((0, 4))
    assert time_histories(augmented, nothing, motion, output, 0.02).shape == (0, 3, 2)
    assert transfer_functions(augmented, nothing, [1.0], output, 0.02).shape == (0, 3, 1)


class BlackBox(bs.Structure):
    """A program that prints frequencies, mass-normalised shapes and participation factors."""

    parameters = ()
    degrees_of_freedom = ("floor 1",)
    n_modes = 1
    wrong = False

    def modes(self, values):
        return Modes(np.full((len(values), 1), 2.0), np.ones((len(values), 1, 1)))

    def modal_model(self, values):
        n = len(values)
        mass = 3.0
        shapes = np.full((n, 1, 1), mass**-0.5)
        participation = np.full((n, 2 if self.wrong else 1), mass**0.5)
        return ModalModel(np.full((n, 1), 2.0), shapes, participation, np.ones(1))


def test_a_black_box_answers_through_the_same_seam():
    oscillator = bs.ShearBuilding((3.0,), (3.0 * (2.0 * math.pi * 2.0) ** 2,))
    motion = GroundMotion(np.random.default_rng(0).standard_normal(50), 0.02)
    output = Output("acceleration", ("floor 1",))
    np.testing.assert_allclose(
        time_histories(BlackBox(), NO_VALUES, motion, output, 0.02),
        time_histories(oscillator, NO_VALUES, motion, output, 0.02), rtol=1e-10, atol=1e-14,
    )  # fmt: skip
    # A modal model that does not fit is refused.
    box = BlackBox()
    box.wrong = True
    with pytest.raises(ValueError, match=r"BlackBox: its modal model .*expected \(\(1, 1\)"):
        transfer_functions(box, NO_VALUES, [1.0], Output("displacement", ("floor 1",)), 0.02)


class ModesOnly(BlackBox):
    modal_model = bs.Structure.modal_model


def test_a_structure_without_masses_says_so():
    with pytest.raises(TypeError, match="structure ModesOnly gives frequencies and shapes but no"):
        transfer_functions(
            ModesOnly(), NO_VALUES, [1.0], Output("displacement", ("floor 1",)), 0.02
        )


@pytest.mark.parametrize("damping", [0.0, 1.0, -0.02, 2.0, math.nan, "two", (0.02, 1.5, 0.1, 0.1)])
def test_damping_is_a_fraction(damping):
    assert_refused("damping must be a fraction of critical damping", damping_ratios, damping, 4)


def test_damping_is_one_ratio_or_one_a_mode():
    np.testing.assert_array_equal(damping_ratios(0.02, 3), [0.02] * 3)
    np.testing.assert_array_equal(damping_ratios([0.1, 0.2], 2), [0.1, 0.2])
    assert_refused("one for each of the 4 modes, got 2 ratios", damping_ratios, [0.1, 0.2], 4)


@pytest.mark.parametrize(
    ("quantity", "places", "message"),
    [
        ("velocity", ("floor 1",), "quantity must be one of 'displacement', 'acceleration'"),
        ("displacement", (), r"places must be a list of one or more, got \(\)"),
        ("displacement", "floor 1", "places must be a list of one or more, got 'floor 1'"),
        ("displacement", (("floor 1", "floor 2"),), "place of 'displacement' must be a label"),
        ("drift", ("floor 1",), "place of 'drift' must be a pair"),
        ("drift", (("floor 1", "floor 1"),), "place of 'drift' must be a pair"),
    ],
)
def test_outputs_that_make_no_sense(quantity, places, message):
    assert_refused(message, Output, quantity, places)


@pytest.mark.parametrize(
    "output", [Output("acceleration", ("roof",)), Output("drift", (("floor 1", "roof"),))]
)
def test_unknown_places_are_named(augmented, values, output):
    motion = GroundMotion(np.ones(4), 0.01)
    message = "place 'roof': the structure has no degree of freedom 'roof'; choose from 'floor 1'"
    for compute in (
        lambda: transfer_functions(augmented, values, [1.0], output, 0.02),
        lambda: time_histories(augmented, values, motion, output, 0.02),
        lambda: transfer_functions(
            augmented, values, [1.0], Output("displacement", FLOORS), 0.02, force_at="roof"
        ),
    ):
        assert_refused(message, compute)


@pytest.mark.parametrize("frequencies", [[], [[1.0]], [-1.0], [math.nan], [1e300], 1.0])
def test_frequencies_that_make_no_sense(augmented, values, frequencies):
    with pytest.raises(ValueError, match="frequencies_hz must be"):
        transfer_functions(augmented, values, frequencies, Output("displacement", FLOORS), 0.02)
