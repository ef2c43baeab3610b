"""Sensors that see a combination of degrees of freedom, on structures of every kind."""

import math
import pickle

import numpy as np
import pytest
import scipy.linalg
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.structures.response import transfer_functions
from bayes_ssi.studies.appendages.baselines import choose_baselines, hypothesis

BUILDING = bs.ShearBuilding3D([2.0, 1.0], [1.5, 1.5], [800.0] * 2, [1800.0] * 2, [5000.0] * 2)
CORNER = (2.0, -1.5)


def test_a_point_of_a_floor_moves_with_it_rigidly():
    """A small rotation about (0, 0), and a translation, of a point by plane geometry."""
    u, v, turn = 0.3, -0.2, 1e-6
    moved = complex(u, v) + complex(*CORNER) * complex(math.cos(turn), math.sin(turn))
    seen = moved - complex(*CORNER)
    for direction, expected in (
        ("x", seen.real), ("y", seen.imag), (30.0, (seen * complex(math.sqrt(0.75), -0.5)).real)
    ):  # fmt: skip
        sensor = bs.floor_sensor("a", 2, CORNER, direction)
        floor = {"floor 2 x": u, "floor 2 y": v, "floor 2 torsion": turn}
        result = sum(share * floor[label] for label, share in sensor.motion)
        assert result == pytest.approx(expected, abs=1e-10)


def test_along_an_axis_no_rounding_error_is_left():
    assert bs.floor_sensor("a", 1, (0.0, 0.0), "y").motion == (("floor 1 y", 1.0),)
    assert bs.floor_sensor("a", 1, (1.0, 0.0), "x").motion == (("floor 1 x", 1.0),)


def test_sensors_and_degrees_of_freedom_side_by_side():
    structure = BUILDING.with_sensors(
        [bs.floor_sensor("NE x", 1, CORNER, "x"), bs.floor_sensor("NE y", 2, CORNER, "y")]
    )
    matrix = structure.sensor_matrix(["NE y", "floor 1 torsion", "NE x"])
    dense = [[0, 0, 0, 0, 1, 2.0], [0, 0, 1, 0, 0, 0], [1, 0, 1.5, 0, 0, 0]]
    shapes = np.random.default_rng(0).standard_normal((4, 6, 5))
    np.testing.assert_allclose(matrix.apply(shapes), dense @ shapes, rtol=1e-14)


def test_responses_at_a_sensor_are_those_of_its_point():
    """Under ground motion, and under a force there, against the floor's own three motions."""
    structure = bs.ShearBuilding3D(
        [2.0, 1.0], [1.5, 1.5], [800.0] * 2, [1800.0] * 2, [5000.0] * 2, [(0.3, 0.2)] * 2
    ).with_sensors([bs.floor_sensor("corner", 2, CORNER, "x")])
    floor = ("floor 2 x", "floor 2 torsion")
    row = np.array([1.0, -CORNER[1]])
    at = np.array([1.0, 2.5, 7.0])

    def response(places, quantity, force_at=None):
        return transfer_functions(
            structure, np.empty((1, 0)), at, bs.Output(quantity, places), 0.02, force_at=force_at
        )[0]

    for quantity in ("displacement", "acceleration"):
        expected = row @ response(floor, quantity)
        np.testing.assert_allclose(response(("corner",), quantity)[0], expected, rtol=1e-12)
    forces = [response(floor, "displacement", place) for place in floor]
    at_corner = response(floor, "displacement", "corner")
    np.testing.assert_allclose(at_corner, row[0] * forces[0] + row[1] * forces[1], rtol=1e-12)
    drift = response((("floor 1 x", "corner"),), "drift")[0]
    below, above = response(("floor 1 x", "corner"), "displacement")
    np.testing.assert_allclose(drift, above - below, rtol=1e-12)


class Large(bs.Structure):
    parameters = ()
    n_modes = 2
    degrees_of_freedom = tuple(f"node {i} {d}" for i in range(33_334) for d in "xyz")
    sensors = (bs.Sensor("mean", {"node 7 x": 0.5, "node 33333 x": 0.5}),)

    def modes(self, values):
        raise NotImplementedError


def test_only_measured_degrees_of_freedom_are_read():
    structure = Large()
    names = [f"node {i} z" for i in range(20)] + ["mean"]
    shapes = np.random.default_rng(2).standard_normal((1, len(structure.degrees_of_freedom), 2))
    matrix = structure.sensor_matrix(names)
    result = matrix.apply(shapes)
    assert matrix.rows.size == matrix.weights.size == 2 * len(names)
    np.testing.assert_array_equal(result[0, -1], 0.5 * shapes[0, 21] + 0.5 * shapes[0, 3 * 33333])
    np.testing.assert_array_equal(result[0, 5], shapes[0, 17])


def test_messages_list_what_can_be_listed():
    with pytest.raises(ValueError, match=r"sensor 'q': .*'mean', 'node 0 x', .* and \d+ more"):
        Large().sensor_matrix(["q"])
    off = [bs.Sensor("top", {"floor 9 x": 1.0})]
    with pytest.raises(ValueError, match="sensor 'top': the structure has no degree of freedom "
                                         "'floor 9 x'; choose from 'floor 1 x'"):  # fmt: skip
        BUILDING.with_sensors(off)


@pytest.mark.parametrize("label", ["floor 1 x", "twice"])
def test_labels_are_taken_once(label):
    sensors = [bs.floor_sensor("twice", 1, CORNER, "x"), bs.floor_sensor(label, 1, CORNER, "y")]
    with pytest.raises(ValueError, match=f"sensor '{label}': another sensor or degree of freedom"):
        BUILDING.with_sensors(sensors)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bs.floor_sensor("a", 1, CORNER, "z"), "direction must be 'x', 'y' or degrees"),
        (lambda: bs.floor_sensor("a", 1, CORNER, math.nan), "direction must be"),
        (lambda: bs.floor_sensor("a", 1, (1.0,), "x"), r"sensor 'a': at must be two coordinates"),
        (lambda: bs.Sensor("", {"x": 1.0}), "label must be text"),
        (lambda: bs.Sensor("a", {}), "sensor 'a': motion must give a finite number"),
        (lambda: bs.Sensor("a", {"x": math.inf}), "sensor 'a': motion must give a finite number"),
    ],
)
def test_bad_sensors_are_refused(make, message):
    assert_refused(message, make)


K = np.array([[300.0, -200.0, 0.0], [-200.0, 400.0, -200.0], [0.0, -200.0, 200.0]])
NAMES = ("a", "b", "c")
HALFWAY = bs.Sensor("halfway", {"a": 0.5, "b": 0.5})
SLOPED = bs.Sensor("sloped", {"b": 0.6, "c": -0.8})


def stiff():
    return bs.Parameter("k", bs.LogNormal(1.0, 0.3))


def matrices():
    return bs.MatrixStructure([(stiff(), K)], np.eye(3), labels=NAMES, n_modes=3)


def solved(k):
    return k * K, np.eye(3)


def function():
    return bs.FunctionStructure(solved, {"k": stiff()}, n_modes=3, sensors=NAMES)


def frequencies_and_shapes(structure, sensors, value=1.3):
    frequencies, shapes = structure.modes(np.array([[value]]))
    return frequencies[0], structure.sensor_matrix(sensors).apply(shapes)[0]


@pytest.mark.parametrize("make", [matrices, function])
def test_they_measure_combinations_of_the_modes(make):
    structure = make().with_sensors([HALFWAY]).with_sensors([SLOPED])
    frequencies, shapes = frequencies_and_shapes(structure, ("halfway", "c", "sloped"))
    values, vectors = scipy.linalg.eigh(1.3 * K)
    np.testing.assert_allclose(frequencies, np.sqrt(values) / (2.0 * np.pi))
    rows = np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])
    np.testing.assert_allclose(np.abs(shapes), np.abs(rows @ vectors), atol=1e-9)
    assert not make().sensors
    assert structure.description()["combined sensors"].startswith("halfway = 0.5 a + 0.5 b; ")
    again = pickle.loads(pickle.dumps(structure))
    np.testing.assert_array_equal(frequencies_and_shapes(again, ("halfway",))[1], shapes[:1])


@pytest.mark.parametrize("make", [matrices, function])
@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (bs.Sensor("a", {"b": 1.0}), "another sensor or degree of freedom has that label"),
        (bs.Sensor("d", {"e": 1.0}), "the structure has no degree of freedom 'e'"),
    ],
)
def test_what_is_not_on_the_structure_is_refused(make, sensor, message):
    assert_refused(message, make().with_sensors, [sensor])


def test_they_stay_on_a_reduced_model_with_an_element():
    structure = matrices().with_sensors([HALFWAY])
    tank = bs.Pendulum("c", mass=0.1, frequency=2.0, label="tank")
    exact = structure.with_element(tank)
    reduced = structure.reduced().with_element(tank)
    both = (frequencies_and_shapes(each, ("halfway", "tank")) for each in (exact, reduced))
    for one, other in zip(*both, strict=True):
        np.testing.assert_allclose(np.abs(one), np.abs(other), rtol=1e-5, atol=1e-7)


def test_a_search_hangs_appendages_on_what_they_measure():
    structure = matrices().with_sensors([HALFWAY, SLOPED])
    frequencies, shapes = frequencies_and_shapes(structure, ("halfway", "sloped"), 1.0)
    data = bs.ModalData.from_arrays(frequencies, shapes, (0.0, 6.0), ("halfway", "sloped"))
    candidate = bs.ModelClass("points", structure, data, pairing="any")
    places = choose_baselines(bs.Study("points", [candidate])).appendages("points")
    assert [place.name for place in places] == ["pendulum a", "pendulum b", "pendulum c"]
    carrying = hypothesis(candidate, places[:1])
    medians = np.array([[p.prior.quantile(0.5) for p in carrying.parameters]])
    assert np.isfinite(carrying.log_likelihood(medians)).all()


def test_a_sensor_on_an_appendage_stays_where_it_becomes_a_mass():
    """It then moves with the mean of the two floors, or with the floor that carries it."""
    frame = bs.ShearBuilding(masses=(1.0, 1.0, 1.0), stiffnesses=(200.0, 200.0, 200.0))
    infill = bs.OutOfPlaneInfill(between=(1, 2), mass=0.1, frequency=2.0)
    tank = bs.Pendulum(on=3, mass=0.05, frequency=1.5, label="tank")
    whole = frame.with_element(infill).with_element(tank)
    rigid = frame.with_element(infill.as_mass()).with_element(tank.as_mass())
    sensors = ("infill 1-2", "tank", "floor 2")
    assert set(whole.appendages) == {"infill 1-2", "tank"}
    assert not rigid.appendages
    rows = rigid.sensor_matrix(sensors).apply(np.eye(3), axis=0)
    np.testing.assert_allclose(rows, [[0.5, 0.5, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    assert_refused("'tank'", frame.sensor_matrix, ["tank"])
