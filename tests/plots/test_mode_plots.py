"""Figures of stored modes and parameters: what is drawn where, on axes given or new."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.plots.class_plots import plot_corner
from bayes_ssi.plots.shape_plots import plot_identified_modes, plot_mode_shapes

pytestmark = pytest.mark.usefixtures("close_figures")


def points(ax):
    """Text of a point → where it is."""
    actual = {}
    for line in ax.lines:
        if str(line.get_gid()).startswith("hover: "):
            actual[line.get_gid().removeprefix("hover: ")] = line.get_xydata()[0]
    return actual


def test_identified_modes(case_c):
    figure = plot_identified_modes(case_c)
    band, *shapes = figure.axes
    assert [text.get_text() for text in band.texts] == ["1", "2a", "2b", "3"]
    assert points(band)["mode 2a: 2.6043 Hz"][0] == pytest.approx(2.6042925)
    assert len(shapes) == 4
    # The largest component, at floor 3, is 0.7336 at unit length, that at floor 1 is 0.3314.
    bars = {bar.get_gid().split(", ")[-1]: bar.get_width() for bar in shapes[0].patches}
    assert bars["floor 3: 1.000"] == pytest.approx(1.0)
    assert bars["floor 1: 0.452"] == pytest.approx(0.3314169 / 0.7336109)


def test_modes_without_shapes(case_c):
    assert len(plot_identified_modes(case_c.without_shapes()).axes) == 1


def test_shapes_beside_identified_ones(updated, case_c):
    figure = plot_mode_shapes(updated, case_c)
    assert [ax.get_title().split("\n")[0] for ax in figure.axes] == [
        "mode 1", "mode 2a", "mode 2b", "mode 3",
    ]  # fmt: skip
    first = figure.axes[0]
    (crosses,) = [line for line in first.lines if line.get_label() == "identified"]
    median = np.array(updated.modes[0].shape_after[1])[:3]
    np.testing.assert_allclose(crosses.get_xdata(), median, atol=0.02)
    np.testing.assert_array_equal(crosses.get_ydata(), [0, 1, 2])
    assert [bar.get_width() for bar in first.patches] == list(updated.modes[0].shape_after[1])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    beyond = "appendage beyond the scale, its component below"
    assert labels == ["model", "appendage", "identified", beyond]
    with pytest.raises(ValueError, match="no mode is paired"):
        plot_mode_shapes(replace(updated, modes=()), case_c)


def test_units_stand_beside_the_names_of_parameters(make_posterior):
    units = {"k2": "N/m"}
    corner = plot_corner(make_posterior("a"), units=units)
    assert {ax.get_xlabel() for ax in corner.axes[-2:]} == {"k1", "k2 (N/m)"}


# Standard deviations to either side that hold 90 %.
Z = 1.645
SHAPE, SDS = np.array([0.6, 0.8]), np.array([0.04, 0.03])


def data(sensors, with_covariance=True, **errors):
    """A mode with a shape, whose errors lie across it, and one without."""
    covariance = None
    if with_covariance:
        along = np.array([-0.8, 0.6]) * 0.05  # SDS, at right angles to the shape
        covariance = np.zeros((6, 6))
        covariance[:2, :2] = 1e-6 * np.eye(2)
        covariance[2:4, 2:4] = np.outer(along, along)
    modes = (bs.IdentifiedMode("1", 1.0, 2.0 * SHAPE, **errors), bs.IdentifiedMode("2", 3.0))
    return bs.ModalData(modes, (0.0, 4.0), sensors, covariance=covariance)


@pytest.mark.parametrize(
    ("arguments", "sds"), [({}, SDS), ({"with_covariance": False, "shape_sd": 0.05}, 0.05)]
)
def test_over_sensors(arguments, sds):
    """In the scale in which the largest component is one."""
    _, ax = plot_identified_modes(data(("x", "y"), **arguments)).axes
    bars = np.array(ax.containers[1].lines[2][0].get_segments())[:, :, 0]
    np.testing.assert_allclose(bars.mean(axis=1), [0.75, 1.0])
    np.testing.assert_allclose(np.diff(bars)[:, 0] / 2.0, Z * sds / 0.8 * np.ones(2), rtol=1e-9)
    assert [each.get_text() for each in ax.get_yticklabels()] == ["x", "y"]
