"""Sensors that see a combination of degrees of freedom."""

import math

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.structures.response import transfer_functions

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
    with pytest.raises(ValueError, match=message):
        make()
