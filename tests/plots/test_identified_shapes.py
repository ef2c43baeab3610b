"""Identified shapes with their errors, over the names of the sensors."""

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.plots import plot_identified_modes

pytestmark = pytest.mark.usefixtures("close_figures")
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
