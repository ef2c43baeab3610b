"""Non-structural elements on a structure, against hand-assembled matrices."""

import math
from dataclasses import make_dataclass

import numpy as np
import pytest
from conftest import assert_refused
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.structures.modal import mac

NO_VALUES = np.empty((1, 0))
MASSES = (3.0, 2.0, 1.5)
STIFFNESSES = (900.0, 700.0, 400.0)


@pytest.fixture
def building():
    return bs.ShearBuilding(MASSES, STIFFNESSES)


def bare_matrices(n_extra=0):
    """Stiffness and diagonal mass of the building with room for extra degrees of freedom."""
    k1, k2, k3 = STIFFNESSES
    stiffness = np.zeros((3 + n_extra, 3 + n_extra))
    stiffness[:3, :3] = [[k1 + k2, -k2, 0.0], [-k2, k2 + k3, -k3], [0.0, -k3, k3]]
    return stiffness, np.array([*MASSES, *[0.0] * n_extra])


def check(structure, stiffness, mass):
    squares, vectors = eigh(stiffness, np.diag(mass))
    modes = structure.modes(NO_VALUES)
    np.testing.assert_allclose(modes.frequencies_hz[0], np.sqrt(squares) / math.tau, rtol=1e-11)
    np.testing.assert_allclose(np.abs(modes.shapes[0]), np.abs(vectors), atol=1e-11)


# Half of an out-of-plane infill's mass is the new degree of freedom, on a spring to the mean of the
# two floors; a quarter goes to each floor.
INFILL, PENDULUM = 0.3 * (math.tau * 1.7) ** 2, 0.2 * (math.tau * 2.2) ** 2
TANK = bs.Pendulum(2, 0.2, 2.2, label="tank")
# Elements; the springs that they add, as stiffness and direction; and the masses.
ADDED = {
    "in plane": ([bs.InPlaneInfill((2, 3), 0.8, 250.0)], [(250.0, [0, -1, 1])], [0, 0.4, 0.4]),
    "in plane, on the ground": ([bs.InPlaneInfill((0, 1), 0.8, 250.0)], [(250.0, [1, 0, 0])],
                                [0.4, 0, 0]),
    "out of plane": ([bs.OutOfPlaneInfill((1, 2), 0.6, 1.7)], [(INFILL, [-0.5, -0.5, 0, 1])],
                     [0.15, 0.15, 0, 0.3]),
    "out of plane, on the ground": ([bs.OutOfPlaneInfill((0, 1), 0.6, 1.7)],
                                    [(INFILL, [-0.5, 0, 0, 1])], [0.15, 0, 0, 0.3]),
    "pendulum": ([TANK], [(PENDULUM, [0, -1, 0, 1])], [0, 0, 0, 0.2]),
    "pendulum on a pendulum": (
        [TANK, bs.Pendulum("tank", 0.1, 1.2)],
        [(PENDULUM, [0, -1, 0, 1, 0]), (0.1 * (math.tau * 1.2) ** 2, [0, 0, 0, -1, 1])],
        [0, 0, 0, 0.2, 0.1],
    ),
    "added mass": ([bs.AddedMass(1.0, ((1, 0.25), (3, 0.75)))], [], [0.25, 0, 0.75]),
    "pendulum in a direction": ([bs.Pendulum({1: 0.6, "floor 3": -0.8}, 0.2, 2.2)],
                                [(PENDULUM, [-0.6, 0, 0.8, 1])], [0, 0, 0, 0.2]),
    "spring to the ground in a direction": ([bs.InPlaneInfill((0, {1: 0.6, 3: 0.8}), 1e-12, 250.0)],
                                            [(250.0, [0.6, 0, 0.8])], [0, 0, 0]),
}  # fmt: skip


@pytest.mark.parametrize(("elements", "springs", "masses"), ADDED.values(), ids=ADDED)
def test_elements_add_springs_and_masses(building, elements, springs, masses):
    stiffness, mass = bare_matrices(len(masses) - 3)
    for k, direction in springs:
        stiffness += k * np.outer(direction, direction)
    for element in elements:
        building = building.with_element(element)
    check(building, stiffness, mass + masses)
    own = [e.label for e in elements if e.own_degree_of_freedom]
    assert building.degrees_of_freedom == ("floor 1", "floor 2", "floor 3", *own)


@pytest.mark.parametrize(
    ("element", "added"),
    [
        (bs.Pendulum(2, 0.6, 2.2), [0.0, 0.6, 0.0]),
        (bs.OutOfPlaneInfill((1, 2), 0.6, 1.7), [0.3, 0.3, 0.0]),
        (bs.OutOfPlaneInfill((0, 1), 0.6, 1.7), [0.3, 0.0, 0.0]),
        (bs.InPlaneInfill((2, 3), 0.6, 250.0), [0.0, 0.3, 0.3]),
        (bs.AddedMass(0.6, ((3, 1.0),)), [0.0, 0.0, 0.6]),
    ],
)
def test_as_mass(building, element, added):
    stiffness, mass = bare_matrices()
    structure = building.with_element(element.as_mass())
    check(structure, stiffness, mass + added)
    assert structure.degrees_of_freedom == ("floor 1", "floor 2", "floor 3")


def test_the_resonant_infill_of_the_numerical_study(augmented, rigid, case_c):
    """Whose modes were computed otherwise, to the digits given; and the infill as mass only."""
    frequencies, shapes = (each[0] for each in augmented.modes(np.ones((1, 4))))
    np.testing.assert_allclose(frequencies, case_c.frequencies_hz, 1e-8)
    np.testing.assert_allclose(np.diag(mac(shapes[:3], case_c.unit_shapes)), 1.0, atol=1e-13)
    as_mass = rigid.modes(np.ones((1, 3))).frequencies_hz[0]
    np.testing.assert_allclose(as_mass, [0.9832, 2.7372, 3.9213], atol=5e-5)


@pytest.mark.parametrize(
    ("kind", "place"), [(bs.Pendulum, 2), (bs.OutOfPlaneInfill, (1, 2))], ids=["pendulum", "infill"]
)
def test_a_spring_four_times_as_stiff_is_a_frequency_twice_as_high(building, kind, place):
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    doubled = building.with_element(kind(place, 0.2, 4.4)).modes(NO_VALUES).frequencies_hz
    stiffer = building.with_element(kind(place, 0.2, 2.2, stiffness_factor=k))
    np.testing.assert_allclose(stiffer.modes(np.array([[4.0]])).frequencies_hz, doubled, 1e-12)
    faster = building.with_element(kind(place, 0.2, 2.2 * k))
    np.testing.assert_allclose(faster.modes(np.array([[2.0]])).frequencies_hz, doubled, 1e-12)


@pytest.mark.parametrize("kind", [bs.OutOfPlaneInfill, bs.InPlaneInfill])
@pytest.mark.parametrize(
    "between", [(1, 1), (1, 2, 3), (True, 2), (-1, 1), (1.0, 2.0), "12", (1,), 1, None]
)
def test_infills_between_impossible_floors_are_refused(kind, between):
    assert_refused("between must be two different floors such as", kind, between, 0.2, 1.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: bs.Pendulum(0, 0.2, 1.0), "pendulum 0: an appendage must stand on a floor"),
        (lambda: bs.Pendulum("tank", 0.1, 1.0, label="tank"), "tank: an appendage must stand on"),
        (lambda: bs.Pendulum(1, -0.2, 1.0), "pendulum 1: mass must be positive .* -0.2"),
        (lambda: bs.Pendulum(1, 0.2, 0.0), "pendulum 1: frequency must be positive .* 0.0"),
        (lambda: bs.Pendulum(1, 0.2, 1.0, stiffness_factor=-1.0, label="tank"),
         "tank: stiffness_factor must be positive .* -1.0"),
        (lambda: bs.OutOfPlaneInfill((1, 2), 0.0, 1.0), "infill 1-2: mass must be positive"),
        (lambda: bs.OutOfPlaneInfill((1, 2), bs.Parameter("m", bs.Normal(1.0, 1.0)), 1.0),
         "infill 1-2: mass must be positive, but parameter 'm'"),
        (lambda: bs.OutOfPlaneInfill((1, 2), 0.1, -1.0), "infill 1-2: frequency must be positive"),
        (lambda: bs.OutOfPlaneInfill((1, 2), 0.1, 1.0, stiffness_factor=0.0),
         "infill 1-2: stiffness_factor must be positive"),
        (lambda: bs.InPlaneInfill((1, 2), -1.0, 1.0), "in-plane infill 1-2: mass must be"),
        (lambda: bs.InPlaneInfill((1, 2), 1.0, 0.0), "in-plane infill 1-2: stiffness must be"),
        (lambda: bs.AddedMass(-1.0, ((1, 1.0),)), "added mass: mass must be positive .* -1.0"),
        (lambda: bs.Pendulum({"a": 0.0}, 0.1, 1.0), "pendulum: on is a direction of zeros"),
        (lambda: bs.Pendulum({}, 0.1, 1.0), "pendulum: on must be a floor, the label of a degree"),
        (lambda: bs.Pendulum({"a": math.inf}, 0.1, 1.0), "pendulum: on must be a floor, .* inf"),
        (lambda: bs.Pendulum(" ", 0.1, 1.0), "pendulum: on must be a floor, the label"),
        (lambda: bs.InPlaneInfill(("a", {"b": 0.0}), 1.0, 1.0), "infill: between .* of zeros"),
        (lambda: bs.AddedMass(1.0, (({"a": 0.0}, 1.0),)), "a place is a direction of zeros"),
    ],
)  # fmt: skip
def test_impossible_elements_are_refused(build, message):
    assert_refused(message, build)


def test_an_element_quantity_that_is_no_number_is_refused():
    with pytest.raises(TypeError, match=r"pendulum 1: mass must be a number, a Parameter .* None"):
        bs.Pendulum(1, None, 1.0)


@pytest.mark.parametrize("annotation", [Value, "Value"])
def test_quantities_are_checked_with_and_without_delayed_annotations(annotation):
    block = make_dataclass(
        "Block", [("extra", annotation, 1.0)], bases=(bs.AddedMass,), frozen=True
    )
    block(1.0, ((1, 1.0),), "block", extra=2.0)
    with pytest.raises(ValueError, match=r"block: extra must be positive and finite, got -2\.0"):
        block(1.0, ((1, 1.0),), "block", extra=-2.0)
