"""Where nodes are, and where the places of elements are that labels name."""

import math

import numpy as np
import pytest

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
    ],
)
def test_bad_geometries_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        bs.Geometry(*arguments)


def test_a_geometry_of_other_nodes_is_refused():
    with pytest.raises(ValueError, match="geometry: no degree of freedom is at any of its nodes"):
        structure(bs.Geometry({"one": (0.0, 0.0, 0.0)}))
