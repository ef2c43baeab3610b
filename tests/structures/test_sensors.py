"""Sensors that see a combination of degrees of freedom."""

import math

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.structures.geometry import Sensor, SensorMatrix
from bayes_ssi.structures.response import transfer_functions
from bayes_ssi.structures.structure import Structure

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


def test_the_likelihood_sees_what_the_sensors_see():
    """The same modes given at centres and at corners, by a change of the data instead."""
    names = ["a", "b", "c"]
    sensors = [
        bs.floor_sensor("a", 1, CORNER, "x"), bs.floor_sensor("b", 2, CORNER, "y"),
        bs.floor_sensor("c", 2, (-1.0, 0.5), 45.0),
    ]  # fmt: skip
    k = bs.Parameter("k", bs.LogNormal(900.0, 0.3))
    structure = bs.ShearBuilding3D(
        [2.0, 1.0], [1.5, 1.5], [k] * 2, [1800.0] * 2, [5000.0] * 2, [(0.3, 0.2)] * 2
    ).with_sensors(sensors)
    values = np.array([[700.0], [1000.0]])
    modes = structure.modes(values)
    matrix = np.array([dict(s.motion).get(d, 0.0) for s in sensors
                       for d in structure.degrees_of_freedom]).reshape(3, 6)  # fmt: skip
    measured = np.array([1.0, -0.4, 0.3])
    data = bs.ModalData((bs.IdentifiedMode("1", 2.5, measured),), (0.0, 20.0), names)
    error = bs.ErrorModel(0.02, 0.1)
    candidate = bs.ModelClass("a", structure, data, error, pairing={"1": 1})
    result = candidate.likelihoods[0].terms(values)
    at_sensors = matrix @ modes.shapes[:, :, 0].T
    cosine = np.abs(measured @ at_sensors) / (
        np.linalg.norm(measured) * np.linalg.norm(at_sensors, axis=0)
    )
    difference = result.shape[1, 0] - result.shape[0, 0]
    assert difference == pytest.approx((cosine[1] - cosine[0]) / 0.1**2, rel=1e-10)
    assert abs(difference) > 1e-3


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
    np.testing.assert_allclose(
        response(floor, "displacement", "corner"),
        row[0] * forces[0] + row[1] * forces[1],
        rtol=1e-12,
    )
    drift = response((("floor 1 x", "corner"),), "drift")[0]
    expected = (
        response(("corner",), "displacement")[0] - response(("floor 1 x",), "displacement")[0]
    )
    np.testing.assert_allclose(drift, expected, rtol=1e-12)


def test_a_row_is_the_same_in_any_batch():
    matrix = SensorMatrix.of([{"a": 0.3, "b": -1.7, "d": 0.1}, {"c": 1.0}], "abcd")
    shapes = np.random.default_rng(1).standard_normal((65, 4, 3))
    whole = matrix.apply(shapes)
    for size in (1, 2, 7, 64):
        parts = [matrix.apply(shapes[i : i + size]) for i in range(0, 65, size)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


class Large(Structure):
    parameters = ()
    n_modes = 2
    degrees_of_freedom = tuple(f"node {i} {d}" for i in range(33_334) for d in "xyz")
    sensors = (Sensor("mean", {"node 7 x": 0.5, "node 33333 x": 0.5}),)

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
    off = [Sensor("top", {"floor 9 x": 1.0})]
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
        (lambda: Sensor("", {"x": 1.0}), "label must be text"),
        (lambda: Sensor("a", {}), "sensor 'a': motion must give a finite number"),
        (lambda: Sensor("a", {"x": math.inf}), "sensor 'a': motion must give a finite number"),
    ],
)
def test_bad_sensors_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
