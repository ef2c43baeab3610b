"""Where nodes and places are, assembly for a batch, and elements that do not fit."""

import math

import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs

NODES = {"1": (0.0, 0.0, 0.0), "2": (4.0, 0.0, 3.0)}
LABELS = ("1 x", "1 y", "2 x", "2 rz")
TANK = bs.Pendulum(on="1 x", mass=1.0, frequency=2.0, label="tank")


def structure(geometry=None, sensors=("1 x", "2 x")):
    geometry = geometry or bs.Geometry(NODES, (("1", "2"),), "m")
    return bs.MatrixStructure(
        np.eye(4), np.eye(4), labels=LABELS, sensors=sensors, n_modes=1, geometry=geometry
    )


@pytest.mark.parametrize(
    ("place", "position", "direction"),
    [
        ("1 y", (0, 0, 0), (0, 1, 0)),
        ("2 rz", (4, 0, 3), None),
        ({"1 x": 3.0, "1 y": -4.0}, (0, 0, 0), (0.6, -0.8, 0)),
        ({"1 x": 1.0, "2 x": 3.0}, (3, 0, 2.25), (1, 0, 0)),
        ({"1 x": 1.0, "2 x": -1.0}, (2, 0, 1.5), None),
        ("roof", (4, 0, 3), (1, 0, 0)),
    ],
)
def test_places_are_where_their_nodes_are(place, position, direction):
    pair = tuple(place.items()) if isinstance(place, dict) else place
    for each in (structure(sensors={"roof": "2 x"}), structure(sensors={"roof": "2 x"}).reduced()):
        location = each.with_element(TANK).location_of(pair)
        assert location.position == pytest.approx(position)
        if direction is None:
            assert location.direction is None
        else:
            assert location.direction == pytest.approx(direction)


def test_a_place_that_is_at_no_node_has_no_location():
    assert structure().with_element(TANK).location_of("tank") is None
    assert bs.ShearBuilding((1.0,), (1.0,)).location_of(1) is None
    assert bs.ShearBuilding((1.0,), (1.0,)).geometry is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({},), "there are no nodes"),
        (({"7": (1.0, 2.0)},), r"node '7': must have three finite coordinates .* got \(1.0, 2.0\)"),
        (({"7": (1.0, math.nan, 0.0)},), "node '7': must have three finite coordinates"),
        (({"7": "abc"},), "node '7': must have three finite coordinates"),
        ((NODES, (("1", "3"),)), r"a line joins two nodes that it names, got \('1', '3'\)"),
        ((NODES, (("1", "2", "1"),)), "a line joins two nodes"),
        ((NODES, (), "", (("1", "2"),)), r"a face joins three or more .* got \('1', '2'\)"),
        ((NODES, (), "", (("1", "2", "3"),)), "a face joins three or more nodes that it names"),
    ],
)
def test_bad_geometries_are_refused(arguments, message):
    assert_refused(message, bs.Geometry, *arguments)


def test_a_geometry_of_other_nodes_is_refused():
    with pytest.raises(ValueError, match="geometry: no degree of freedom is at any of its nodes"):
        structure(bs.Geometry({"one": (0.0, 0.0, 0.0)}))


@pytest.fixture
def fixed():
    return bs.ShearBuilding((1.0, 1.0), (1.0, 1.0))


def test_a_structure_without_parameters_answers_for_every_row(fixed):
    assert fixed.parameters == ()
    modes = fixed.modes(np.empty((5, 0)))
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    expected = np.broadcast_to([golden, golden + 1.0], (5, 2)) / math.tau
    np.testing.assert_allclose(modes.frequencies_hz, expected, rtol=1e-13)
    assert modes.shapes.shape == (5, 2, 2)
    np.testing.assert_array_equal(modes.shapes, np.broadcast_to(modes.shapes[0], (5, 2, 2)))


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (bs.Pendulum(3, 0.1, 1.0), "pendulum 3: the structure has no place 3; .* from 1 to 2"),
        (bs.Pendulum(-1, 0.1, 1.0), "the structure has no place -1"),
        (bs.Pendulum("tank", 0.1, 1.0), "the structure has no place 'tank'"),
        (bs.OutOfPlaneInfill((2, 3), 0.1, 1.0), "infill 2-3: the structure has no place 3"),
        (bs.InPlaneInfill((2, 3), 0.1, 1.0), "in-plane infill 2-3: .* no place 3"),
        (bs.AddedMass(0.1, ((5, 1.0),)), "added mass: the structure has no place 5"),
        (bs.Pendulum(1, 0.1, 1.0, label="floor 2"), "element 'floor 2'"),
    ],
)
def test_elements_that_the_structure_cannot_have_are_refused(fixed, element, message):
    assert_refused(message, fixed.with_element, element)


def test_two_elements_of_one_label_are_refused(fixed):
    with pytest.raises(ValueError, match=r"element 'pendulum 1': .* label of its own"):
        fixed.with_element(bs.Pendulum(1, 0.1, 1.0)).with_element(bs.Pendulum(1, 0.2, 2.0))


def test_where_drawings_put_degrees_of_freedom(frame):
    building = (
        frame.with_element(bs.OutOfPlaneInfill((1, 2), 0.1, 2.0, label="infill"))
        .with_element(bs.Pendulum(3, 0.1, 2.0, label="tank"))
        .with_element(bs.Pendulum("infill", 0.1, 2.0, label="shelf"))
        .with_element(bs.OutOfPlaneInfill((0, 1), 0.1, 2.0, label="lower"))
        .with_element(bs.InPlaneInfill((0, 1), 0.1, 2.0))
    )
    assert building.appendages == ("infill", "tank", "shelf", "lower")
    assert building.heights() == pytest.approx(
        {"floor 1": 1.0, "floor 2": 2.0, "floor 3": 3.0, "infill": 1.5, "tank": 3.35,
         "shelf": 1.85, "lower": 0.5}
    )  # fmt: skip
    assert frame.appendages == ()
