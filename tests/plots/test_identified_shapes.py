"""Identified shapes with their errors: on the structure, or over the sensors' names."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import bayes_ssi as bs
from bayes_ssi.plots import plot_identified_shapes
from bayes_ssi.plots.ranking_plots import figures_of_identified_shapes
from bayes_ssi.structures.geometry import Geometry

pytestmark = pytest.mark.usefixtures("close_figures")
# Standard deviations to either side that hold 90 %.
Z = 1.645
SHAPE, SDS = np.array([0.6, 0.8]), np.array([0.04, 0.03])
NODES = {"a": (0.0, 0.0, 0.0), "b": (0.0, 0.0, 4.0), "c": (0.0, 0.0, 8.0)}


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


@pytest.fixture
def in_space():
    return bs.MatrixStructure(
        np.diag([1.0, 2.0]), np.eye(2), labels=["b x", "c y"], sensors=["b x", "c y"], n_modes=2,
        geometry=Geometry(NODES, (("a", "b"), ("b", "c"))),
    )  # fmt: skip


@pytest.fixture
def building():
    return bs.ShearBuilding((1.0, 1.0), (40.0, 40.0))


@pytest.mark.parametrize(
    ("arguments", "sds"), [({}, SDS), ({"with_covariance": False, "shape_sd": 0.05}, 0.05)]
)
def test_over_sensors(arguments, sds):
    """In the scale in which the largest component is one."""
    (ax,) = plot_identified_shapes(data(("x", "y"), **arguments)).axes
    bars = np.array(ax.containers[1].lines[2][0].get_segments())[:, :, 0]
    np.testing.assert_allclose(bars.mean(axis=1), [0.75, 1.0])
    np.testing.assert_allclose(np.diff(bars)[:, 0] / 2.0, Z * sds / 0.8 * np.ones(2), rtol=1e-9)
    assert [each.get_text() for each in ax.get_yticklabels()] == ["x", "y"]


def test_on_a_building(building):
    (ax,) = plot_identified_shapes(data(("floor 1", "floor 2")), building).axes
    floors = [line.get_xdata().mean() for line in ax.lines if line.get_linewidth() == 2.5]
    np.testing.assert_allclose(floors, [0.75, 1.0])
    (edge,) = {np.ptp(p.vertices[np.isclose(p.vertices[:, 1], 2.0), 0]).round(9)
               for p in (c.get_paths()[0] for c in ax.collections)}  # fmt: skip
    assert edge == pytest.approx(2.0 * Z * SDS[1] / 0.8)


def test_in_space(in_space):
    """A quarter of the longest side is a component of one: 2 m of 8 m."""
    (ax,) = plot_identified_shapes(data(("b x", "c y")), in_space).axes
    lines = [np.array(line.get_data_3d()).T for line in ax.lines]
    components = [line for line in lines if len(line) == 2]
    expected = {
        "b x": [NODES["b"], (1.5, 0.0, 4.0)],
        "its interval": [(1.5 - d, 0.0, 4.0) for d in (s * 2.0 * Z * 0.05 for s in (1, -1))],
        "c y": [NODES["c"], (0.0, 2.0, 8.0)],
    }
    for each in expected.values():
        assert any(np.allclose(line, each) for line in components), each


def test_sensors_that_are_not_on_the_structure_are_names(in_space, building):
    for structure in (in_space, building):
        figure = plot_identified_shapes(data(("x", "y")), structure, Figure())
        assert [each.get_text() for each in figure.axes[0].get_yticklabels()] == ["x", "y"]


def test_without_a_shape_there_is_nothing_to_draw():
    with pytest.raises(ValueError, match="no mode has a shape"):
        plot_identified_shapes(data(("x", "y")).without_shapes())


@pytest.mark.parametrize(
    ("sensors", "arguments", "names"),
    [
        (("floor 1", "floor 2"), {}, ["identified_shapes_1"]),
        (("floor 1", "floor 2"), {"with_covariance": False}, []),
    ],
)
def test_a_result_has_a_figure_of_shapes_with_errors(building, sensors, arguments, names):
    candidate = bs.ModelClass("a", building, data(sensors, **arguments), pairing={"1": 1})
    assert [name for name, _ in figures_of_identified_shapes(candidate)] == names
