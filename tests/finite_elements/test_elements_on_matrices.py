"""Elements on models given by matrices, against hand-assembled ones and the same building."""

import math
import pickle

import numpy as np
import pytest
from chains import spring_chain
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.inference.model_class.class_record import described
from bayes_ssi.structures.modal import mac
from bayes_ssi.structures.structure import Requirement

MASSES, STIFFNESSES = (3.0, 2.0, 1.5), (900.0, 700.0, 400.0)
FLOORS = [f"floor {i}" for i in (1, 2, 3)]
k, m = bs.Parameter("k", bs.LogNormal(1.0, 0.3)), bs.Parameter("m", bs.LogNormal(0.2, 0.5))
f = bs.Parameter("f", bs.LogNormal(2.0, 0.5))
VALUES = np.random.default_rng(0).lognormal(0.0, 0.2, (7, 3)) * [1.0, 0.2, 2.0]
DIRECTION = {"floor 1": 0.6, "floor 3": -0.8}


def building():
    first, *others = STIFFNESSES
    return bs.ShearBuilding(MASSES, (k * first, *others))


def as_matrices(**options):
    """The same building by its matrices; the rows are the floors."""
    first = np.zeros((3, 3))
    first[0, 0] = STIFFNESSES[0]
    _, k2, k3 = STIFFNESSES
    others = np.array([[k2, -k2, 0.0], [-k2, k2 + k3, -k3], [0.0, -k3, k3]])
    options = {"labels": FLOORS, "n_modes": 3, "influence": np.ones(3), **options}
    return bs.MatrixStructure([(k, first), others], np.diag(MASSES), **options)


TANK = bs.Pendulum("floor 2", m, f, label="tank")
CARRIED = {
    "pendulum": [TANK],
    "pendulum in a direction": [bs.Pendulum(DIRECTION, m, f)],
    "pendulum on a pendulum": [TANK, bs.Pendulum("tank", 0.1, 1.2)],
    "two pendulums": [TANK, bs.Pendulum("floor 3", 0.1, f)],
    "added mass": [bs.AddedMass(m * f, (("floor 1", 0.25), ("floor 3", 0.75)))],
    "mass in a direction": [bs.AddedMass(m * f, ((DIRECTION, 1.0),))],
    "spring": [bs.InPlaneInfill(("floor 2", "floor 3"), m, 250.0 * f)],
    "spring to the ground": [bs.InPlaneInfill((0, DIRECTION), m, 250.0 * f)],
    "vibrating infill": [bs.OutOfPlaneInfill(("floor 1", "floor 3"), m, f)],
    "vibrating infill on the ground": [bs.OutOfPlaneInfill((0, "floor 1"), m, f)],
    "between a tank and a floor": [TANK, bs.InPlaneInfill(("tank", "floor 3"), 0.1, 9.0)],
}


def carrying(structure, elements):
    for element in elements:
        structure = structure.with_element(element)
    return structure


def carrying_tank(structure, place):
    return structure.with_element(bs.Pendulum(place, 0.2, 2.0, label="tank"))


def assert_same(structure, other, values, tolerance=1e-10):
    modes, expected = structure.modes(values), other.modes(values)
    assert structure.degrees_of_freedom == other.degrees_of_freedom
    np.testing.assert_allclose(modes.frequencies_hz, expected.frequencies_hz, rtol=tolerance)
    np.testing.assert_allclose(np.abs(modes.shapes), np.abs(expected.shapes), atol=tolerance)
    driven = [each.modal_model(values) for each in (structure, other)]
    products = [each.shapes * each.participation[:, None, :] for each in driven]
    np.testing.assert_allclose(products[0], products[1], atol=tolerance)
    np.testing.assert_allclose(driven[0].influence, driven[1].influence, atol=1e-14)


@pytest.mark.parametrize("elements", CARRIED.values(), ids=CARRIED)
def test_elements_are_those_of_a_building(elements):
    expected = carrying(building(), elements)
    structure = carrying(as_matrices(), elements)
    values = VALUES[:, : len(expected.parameters)]
    order = [structure.parameters.index(each) for each in expected.parameters]
    assert order == list(range(len(order)))
    assert structure.appendages == expected.appendages
    assert_same(structure, expected, values)


def test_a_sensor_is_a_place_too():
    """At a point of a rigid floor, and by the name of a row of a model."""
    floor = bs.ShearBuilding3D((2.0,), (1.5,), (800.0,), (600.0,), (900.0,)).with_sensors(
        [bs.floor_sensor("corner", 1, (2.0, 1.0), "x")]
    )
    by_shares = {"floor 1 x": 1.0, "floor 1 torsion": -1.0}
    at_corner, at_point = (carrying_tank(floor, place) for place in ("corner", by_shares))
    assert_same(at_corner, at_point, np.empty((1, 0)), 1e-14)
    assert at_corner.heights()["tank"] > 1.0
    named = as_matrices(labels=None, sensors={"roof": 2, "first": 0})
    of_sensor, of_row = (carrying_tank(named, place) for place in ("roof", "dof 2"))
    assert_same(of_sensor, of_row, np.ones((1, 1)), 1e-14)
    assert of_sensor.degrees_of_freedom == ("roof", "first", "tank")


def test_a_report_describes_the_elements():
    lines = dict(described(as_matrices().with_element(TANK)))
    assert lines["tank"] == "pendulum: tank; on floor 2; mass = m; frequency = f"


def test_names_of_sensors_that_count_from_one_are_no_rows():
    structure = as_matrices(labels=None, sensors={"dof 1": 0, "dof 3": 2})
    at_first = carrying_tank(structure, "dof 1")
    expected = carrying_tank(as_matrices(), "floor 1")
    frequencies = (each.modes(np.ones((1, 1))).frequencies_hz for each in (at_first, expected))
    np.testing.assert_allclose(*frequencies, rtol=1e-12)
    with pytest.raises(ValueError, match=r"'dof 2'; choose from 'dof 1', 'dof 3', or 0 for the gr"):
        structure.with_element(bs.Pendulum("dof 2", 0.1, 1.0))


N = 120


def chain():
    """A chain with two stiffnesses and a few sensors, too large to be solved in batches."""
    left, right = (N**2 * part for part in spring_chain(N, 2))
    kl, kr = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in ("left", "right"))
    return bs.MatrixStructure(
        [(kl, left), (kr, right)], np.eye(N), sensors={f"s{i}": i for i in range(9, N, 10)},
        n_modes=4, influence=np.ones(N),
    ), (left, right)  # fmt: skip


@pytest.fixture(scope="module")
def reduced():
    structure, _ = chain()
    made = structure.reduced()
    assert made.basis.size
    return made


F1 = 0.25  # about the first frequency of the chain
IN_CHAIN = {
    "resonant pendulum": bs.Pendulum("s59", 5.0 * m, F1 * f, label="tank"),
    "pendulum between sensors": bs.Pendulum("dof 33", 5.0 * m, F1 * f, label="tank"),
    "pendulum in a direction": bs.Pendulum({"dof 33": 0.6, "s79": 0.8}, 5.0 * m, F1 * f),
    "mass": bs.AddedMass(10.0 * m * f, (("dof 44", 0.5), ("s99", 0.5))),
    "spring": bs.InPlaneInfill(("dof 20", "s59"), m, 20.0 * f),
    "vibrating infill": bs.OutOfPlaneInfill(("dof 20", "s59"), 5.0 * m, F1 * f),
}
IN_CHAIN_VALUES = np.random.default_rng(1).lognormal(0.0, 0.25, (25, 4)) * [1.0, 1.0, 1.0, 2.0]


@pytest.mark.parametrize("element", IN_CHAIN.values(), ids=IN_CHAIN)
def test_a_large_model_is_that_of_dense_matrices(element):
    structure, (left, right) = chain()
    whole = structure.with_element(element)
    row = dict(zip((p.name for p in whole.parameters), IN_CHAIN_VALUES[0], strict=True))
    own = [element.own_degree_of_freedom] if element.own_degree_of_freedom else []
    size = N + len(own)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    stiffness[:N, :N] = row["left"] * left + row["right"] * right
    mass[:N, :N] = np.eye(N)

    def value(product):
        return product.scale * math.prod(row[p.name] ** power for p, power in product.powers)

    def vector(direction):
        v = np.zeros(size)
        for place, component in direction:
            v[N if place in own else int(place.removeprefix("dof ").removeprefix("s"))] += component
        return v

    for spring in element.springs():
        v = vector(spring.direction)
        stiffness += value(spring.coefficient) * np.outer(v, v)
    for each in element.masses():
        v = vector(each.direction)
        mass += value(each.coefficient) * np.outer(v, v)
    n = whole.n_modes
    assert n == 4 + len(own)
    squares, vectors = eigh(stiffness, mass, subset_by_index=[0, n - 1])
    modes = whole.modes(IN_CHAIN_VALUES[:1])
    np.testing.assert_allclose(modes.frequencies_hz[0], np.sqrt(squares) / math.tau, rtol=1e-10)
    rows = [*range(9, N, 10), *range(N, size)]
    np.testing.assert_allclose(np.abs(modes.shapes[0]), np.abs(vectors[rows]), atol=1e-8)


@pytest.mark.parametrize("element", IN_CHAIN.values(), ids=IN_CHAIN)
def test_a_reduced_basis_carries_elements_without_a_full_solution(reduced, element, monkeypatch):
    full = reduced.full.with_element(element)
    exact = full.modes(IN_CHAIN_VALUES)

    with monkeypatch.context() as context:
        context.setattr(bs.MatrixStructure, "full_modes", None)  # cannot be called
        whole = reduced.with_element(element)
        modes, bounds = whole.modes(IN_CHAIN_VALUES), whole.bounds(IN_CHAIN_VALUES)
    assert whole.n_full_solutions == reduced.n_full_solutions
    assert whole.basis.size <= reduced.basis.size + 3
    off = np.abs(modes.frequencies_hz / exact.frequencies_hz - 1.0)
    assert off.max() < 2e-3
    assert np.all(bounds.frequency >= off - 1e-12)
    assert np.median(bounds.frequency / np.maximum(off, 1e-12)) < 100.0
    at_sensors = (each.shapes[:, : len(reduced.degrees_of_freedom)] for each in (exact, modes))
    alike = [np.diag(mac(a, b)) for a, b in zip(*at_sensors, strict=True)]
    assert np.min(alike) > 0.999
    assert np.mean(bounds.shape >= np.sqrt(np.maximum(1.0 - np.array(alike), 0.0)) - 1e-7) > 0.95
    assert full.degrees_of_freedom == whole.degrees_of_freedom
    copied = pickle.loads(pickle.dumps(whole)).modes(IN_CHAIN_VALUES[:3])
    np.testing.assert_array_equal(copied.frequencies_hz, modes.frequencies_hz[:3])


@pytest.mark.parametrize("name", ["pendulum in a direction", "spring"])
def test_full_solutions_with_the_element_are_added_where_needed(reduced, name):
    whole = reduced.with_element(IN_CHAIN[name])
    better = whole.accurate_at(Requirement(IN_CHAIN_VALUES, 1e-7, 1e-3))
    assert better.n_full_solutions > whole.n_full_solutions
    assert better.bounds(IN_CHAIN_VALUES).frequency.max() <= 1e-7
    assert_same(better, better.exact, IN_CHAIN_VALUES, 1e-4)
    frequencies = better.modes(IN_CHAIN_VALUES).frequencies_hz
    exact = better.exact.modes(IN_CHAIN_VALUES).frequencies_hz
    np.testing.assert_allclose(frequencies, exact, rtol=1e-7)


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (bs.Pendulum("floor 9", 0.1, 1.0), r"pendulum floor 9: .* no degree of .* 'floor 9'; ch"),
        (bs.Pendulum(2, 0.1, 1.0), "pendulum 2: the structure has no degree of freedom .* 2; ch"),
        (bs.Pendulum("floor 1", 0.1, 1.0, label="floor 2"), "element 'floor 2': the structure has"),
        (bs.FloorBlock(1, 0.1), "block on floor 1: .* 'floor 1 x'"),
    ],
)
@pytest.mark.parametrize("make", [as_matrices, lambda: as_matrices().reduced()])
def test_places_that_do_not_exist_are_refused(make, element, message):
    with pytest.raises(ValueError, match=message):
        make().with_element(element)


@pytest.mark.parametrize("reduced", [False, True], ids=["exact", "reduced"])
def test_a_block_off_a_node(reduced):
    """Mass, static moment and polar inertia: K and M of a floor in space, against the floor."""
    floor = bs.ShearBuilding3D((2.0,), (1.5,), (800.0,), (600.0,), (900.0,))
    stiffness, mass = (matrices[0] for matrices in floor.matrices(np.empty((1, 0))))
    node = ("7 x", "7 y", "7 rz")
    matrices = bs.MatrixStructure(stiffness, np.diag(mass), labels=node, sensors=node, n_modes=3)
    floor, matrices = (
        structure.with_sensors([bs.floor_sensor("corner", on, (1.0, 2.0), 30.0)])
        for structure, on in ((floor, 1), (matrices, node))
    )
    at, block = (1.2, -0.7), bs.Parameter("m", bs.LogNormal(0.5, 0.1))
    expected, made = (
        structure.with_element(bs.FloorBlock(on, block, at)).with_element(
            bs.FloorBlock(on, 0.1, radius=0.8)
        )
        for structure, on in ((floor, 1), (matrices.reduced() if reduced else matrices, node))
    )
    assert bs.FloorBlock(node, block, at).label == "block on 7 x"
    values = np.array([[0.5], [0.9]])
    modes, of_floor = made.modes(values), expected.modes(values)
    np.testing.assert_allclose(modes.frequencies_hz, of_floor.frequencies_hz, rtol=1e-10)
    at_corner, of_corner = (
        structure.sensor_matrix(["corner"]).apply(each.shapes)
        for structure, each in ((made, modes), (expected, of_floor))
    )
    np.testing.assert_allclose(abs(at_corner), abs(of_corner), atol=1e-9)


def test_a_rigid_part_is_three_labels():
    for on in (("7 x", "7 y"), ("7 x", "7 y", ""), "7 x", True):
        with pytest.raises(ValueError, match="on must be a floor from 1 upwards, or three labels"):
            bs.FloorBlock(on, 1.0, (0.0, 0.0))


def test_a_model_with_elements_is_sent_without_matrices_of_its_own():
    """A search sends a large model once for each hypothesis; its matrices are most of it."""
    n = 500
    stiffness = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    main = bs.MatrixStructure([(k, stiffness)], np.eye(n), sensors={"top": n - 1}, n_modes=2)
    carrying = main.with_element(bs.Pendulum("top", m, f))
    values = np.array([[1.0, 0.2, 0.01]])
    expected = carrying.modes(values)
    sent = pickle.dumps(carrying)
    assert len(sent) < len(pickle.dumps(main)) + 5000
    for here, there in zip(expected, pickle.loads(sent).modes(values), strict=True):
        assert np.array_equal(here, there)
    assert repr(pickle.loads(sent)) == repr(carrying)
