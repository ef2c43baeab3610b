"""AutoMAC and COMAC against closed forms, and what is said of them."""

from types import SimpleNamespace

import numpy as np

import bayes_ssi as bs
from bayes_ssi.report.page_content import auto_mac, co_mac
from bayes_ssi.structures.modal import comac


def turned(degrees):
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle)])


def data_of(shapes, sensors=("a", "b")):
    modes = tuple(bs.IdentifiedMode(str(i), float(i), shape) for i, shape in enumerate(shapes, 1))
    return bs.ModalData(modes, (0.0, 10.0), sensors)


def test_auto_mac_is_the_squared_cosine_of_the_angle_between_shapes():
    found = auto_mac(data_of([turned(0), turned(60), None, turned(75)]))
    assert found["labels"] == ["1", "2", "4"]
    cosines = np.cos(np.radians([[0, 60, 75], [60, 0, 15], [75, 15, 0]]))
    np.testing.assert_allclose(found["matrix"], cosines**2, atol=1e-12)
    assert "cannot tell apart modes 2 and 4 (MAC 0.93): their" in found["sentence"]
    apart = auto_mac(data_of([turned(0), turned(60), turned(100)]))
    words = "tell all modes apart: the most alike are 2 and 3 (MAC 0.59)."
    assert apart["sentence"].endswith(words)


def test_shapes_that_cannot_be_compared():
    assert auto_mac(data_of([turned(0), None])) is None
    found = auto_mac(data_of([[1.0, np.nan], [np.nan, 1.0]]))
    assert found["sentence"] == "No two modes were measured at a common sensor."


def test_comac_of_two_modes_is_a_squared_cosine():
    """Of rows (cos α, sin α) and (cos β, sin β), of any signs: cos²(α - β)."""
    shapes, others = np.array([turned(20), turned(45)]), np.array([turned(50), turned(45)])
    others[:, 1] *= -1.0
    np.testing.assert_allclose(comac(shapes, others), [np.cos(np.radians(30)) ** 2, 1.0])


def test_sensors_at_odds_with_the_model_are_named():
    """Modes 1 and 2 of the data are the model's 2 and 1."""
    measured = [0.8, 0.6], [0.6, -0.8]
    scatter = 1.0 + 0.01 * np.random.default_rng(5).normal(size=(400, 2, 2))
    draws = scatter * [[0.6, 0.8], [-0.8, 0.6]]
    modes = SimpleNamespace(pairing={"1": 2, "2": 1})
    found = co_mac(data_of([*measured, None]), modes, draws)
    assert found["sentence"].startswith("No sensor is at odds with the model: the smallest is 1")
    # Where the model moves b in one mode alone: the share of that mode, 0.6², in what is measured.
    draws[:, 1, 0] = 0.0
    found = co_mac(data_of([*measured, None]), modes, draws)
    (name, three), (other, _) = found["rows"]
    assert (name, other) == ("b", "a")
    np.testing.assert_allclose(three, 0.36)
    assert found["sentence"] == "Model and measurement are at odds at b (0.36)."
    assert co_mac(data_of([measured[0], None]), modes, draws) is None
    # A test of one sensor: its model has no shapes, for a single component says nothing of them.
    unknown = np.full((20, 1, 2), np.nan)
    assert co_mac(data_of([[1.0], [1.0]], ("a",)), modes, unknown) is None


def test_sensors_that_no_paired_mode_was_measured_at_have_no_comac():
    shapes = [np.array([0.6, 0.8, np.nan]), np.array([0.8, -0.6, np.nan]), [0.0, 0.0, 1.0]]
    draws = np.stack([np.array([[0.6, 0.8, 0.3], [0.8, -0.6, 0.1]]).T] * 20)
    modes = SimpleNamespace(pairing={"1": 1, "2": 2})
    found = co_mac(data_of(shapes, ("a", "b", "c")), modes, draws)
    assert {name for name, _ in found["rows"]} == {"a", "b"}
    for _, three in found["rows"]:
        np.testing.assert_allclose(three, 1.0)
