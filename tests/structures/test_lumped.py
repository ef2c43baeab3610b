"""Assembly for a batch, ties between fields, sensors, and elements that do not fit."""

import math

import numpy as np
import pytest

import bayes_ssi as bs


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
    ],
)
def test_elements_off_the_structure_are_refused(fixed, element, message):
    with pytest.raises(ValueError, match=message):
        fixed.with_element(element)


def test_two_elements_of_one_label_are_refused(fixed):
    with pytest.raises(ValueError, match=r"element 'pendulum 1': .* label of its own"):
        fixed.with_element(bs.Pendulum(1, 0.1, 1.0)).with_element(bs.Pendulum(1, 0.2, 2.0))
    with pytest.raises(ValueError, match="element 'floor 2'"):
        fixed.with_element(bs.Pendulum(1, 0.1, 1.0, label="floor 2"))


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
