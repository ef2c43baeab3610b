"""Sensors by coordinates; and axes and units of a test against the nominal model."""

import math

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.measurements.modes.sensors_on_model import (
    SensorPoint,
    compared_with_nominal,
    nearest_degrees_of_freedom,
    read_sensor_points,
)
from bayes_ssi.structures.solver_files.exported_model import Matrices, exported_model

LABELS = [f"{node} {direction}" for node in "234" for direction in "xy"]

CHAIN = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])


def model_of(stiffness, **more):
    return exported_model("test", Matrices((stiffness, np.eye(6)), ("K", "M"), LABELS, **more))


def tower():
    """Three masses on springs, three times as stiff in y as in x."""
    stiffness = np.kron(CHAIN, np.diag([1e3, 3e3]))
    geometry = bs.Geometry({str(i): (0.0, 0.5, 3.0 * (i - 1)) for i in (1, 2, 3, 4)})
    return model_of(stiffness, geometry=geometry)


def points(scale=1.0):
    return [
        SensorPoint(f"{axis}{i}", (0.1 * scale, 0.5 * scale, 3.0 * i * scale + 0.2 * scale), axis)
        for i in (1, 2, 3)
        for axis in "xy"
    ]


def modes(frequency_factor=1.0):
    structure = bs.MatrixStructure(tower().stiffness, tower().mass, labels=LABELS, n_modes=4)
    frequencies, shapes = (each[0] for each in structure.modes(np.empty((1, 0))))
    return bs.ModalData.from_arrays(
        frequency_factor * frequencies[:3], shapes[:, :3], (0.0, 1e4), LABELS
    )


def test_nearest_nodes_and_their_distances():
    mapped = nearest_degrees_of_freedom(points(), tower())
    assert {name: label for name, (label, _) in mapped.items()} == {
        "x1": "2 x", "y1": "2 y", "x2": "3 x", "y2": "3 y", "x3": "4 x", "y3": "4 y",
    }  # fmt: skip
    for _, distance in mapped.values():
        assert distance == pytest.approx(math.hypot(0.1, 0.2))


def test_what_has_no_node_of_its_own_is_refused_and_other_units_are_named():
    close = [SensorPoint("a", (0.0, 0.5, 3.1), "x"), SensorPoint("b", (0.0, 0.5, 2.9), "x")]
    for placed, words in (
        (points(scale=1000.0), r"up to \d+ from .* but 0.2236 .* 0.001 \(mm to m\): give"),
        (close, "sensors 'a' and 'b' are nearest to the same .* '2 x'"),
        ([SensorPoint("a", (0.0, 0.0, 3.0), "z")], "no node with coordinates moves along z"),
    ):
        assert_refused(words, nearest_degrees_of_freedom, placed, tower())


HEAD = "sensor,direction,x_coord,y_coord,z_coord"


def test_points_from_a_file(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(f"# of 12 May\n{HEAD}\nroof x,x,0.1,0.5,9.2\n")
    assert read_sensor_points(path) == (SensorPoint("roof x", (0.1, 0.5, 9.2), "x"),)
    for head, row, message in (
        ("sensor,x,y,z", "a,1,2,3", r"points.csv: must have the columns sensor, x_coord"),
        (HEAD, "a,-x,1,2,3", r"line 2: .* got '-x'; where"),
        (HEAD, "a,x,1,2", r"line 2: must have a cell in"),
        (HEAD, "a,x,1,2,q", r"line 2: must have three finite"),
    ):
        path.write_text(f"{head}\n{row}\n")
        with pytest.raises(ValueError, match=message):
            read_sensor_points(path)


PLACES = {name: name for name in LABELS}


def test_the_right_axes_pass():
    identified = ", ".join(f"{f:.4g}" for f in modes().frequencies_hz)
    assert compared_with_nominal(tower(), modes(), PLACES) == [
        f"Nominal frequencies: {identified} Hz; identified: {identified} Hz.",
        "Largest MACs of the identified shapes with nominal ones: 1.00, 1.00, 1.00.",
    ]


def test_shapes_that_are_none_of_the_models_are_said():
    """A tower that is soft 20° off x: along (cos, sin), which exchanged is (sin, cos)."""
    angle = math.radians(20.0)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    model = model_of(np.kron(CHAIN, turn @ np.diag([1e3, 9e3]) @ turn.T))
    sway = np.kron(np.linalg.eigh(CHAIN)[1][:, 0], turn[:, 0][::-1])
    data = bs.ModalData((bs.IdentifiedMode("1", 2.0, sway),), (0.0, 1e4), sensors=tuple(LABELS))
    # (sin, cos) · (cos, sin), squared; sway across is no mode as low.
    assert compared_with_nominal(model, data, PLACES)[-1] == (
        "(!) Largest MACs of the identified shapes with nominal ones: "
        f"{math.sin(2.0 * angle) ** 2:.2f}: are axes and places the same?"
    )


@pytest.mark.parametrize("rounding", [0.0, 1e-10])
def test_motions_that_are_rounding_resemble_no_shape(rounding):
    """In y the lowest modes, in x, move by rounding errors, here by the sensors' shape."""
    stiffness = np.kron(CHAIN, np.diag([1e3, 50e3]))
    values, vectors = np.linalg.eigh(CHAIN * 1e3)
    across = np.array([1.0, -1.0, 1.0])
    stiffness[1::2, ::2] = stiffness[::2, 1::2] = 0.0
    load = (CHAIN * 50e3 - values[0] * np.eye(3)) @ across
    coupling = rounding * np.outer(load, vectors[:, 0])
    stiffness[1::2, ::2], stiffness[::2, 1::2] = coupling, coupling.T
    model = model_of(stiffness)
    frequency = float(np.sqrt(values[0]) / (2.0 * np.pi))
    in_x = tuple(label for label in LABELS if label.endswith("x"))
    data = bs.ModalData((bs.IdentifiedMode("1", frequency, across),), (0.0, 1e4), sensors=in_x)

    said = compared_with_nominal(model, data, {name: f"{name[0]} y" for name in in_x})
    assert said[-1].startswith("(!) Largest MACs of the identified shapes with nominal ones: 0.00:")


def test_units_that_do_not_belong_together_are_said():
    said = compared_with_nominal(tower(), modes(frequency_factor=math.sqrt(1000.0)), PLACES)
    assert said[1].startswith("(!) The lowest nominal frequency is 0.0316 times")
