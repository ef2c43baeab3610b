"""Figures of classes, modes and parameters: what is drawn where, and with which words."""

from dataclasses import replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.pairings import InferredPairing, PairingShare
from bayes_ssi.inference.posterior import model_at_draws
from bayes_ssi.plots.class_plots import plot_corner, plot_evidence, plot_frequencies
from bayes_ssi.plots.figure_style import figures_for_files, save_figure, style
from bayes_ssi.plots.shape_plots import plot_identified_modes, plot_mode_shapes

pytestmark = pytest.mark.usefixtures("close_figures")

PNG = b"\x89PNG\r\n"


@pytest.fixture
def data():
    first = bs.IdentifiedMode("1", 1.0, frequency_cov=0.01)
    others = bs.IdentifiedMode("2", 2.0), bs.IdentifiedMode("x", 2.2)
    return bs.ModalData((first, *others), (0.0, 3.0))


@pytest.fixture
def posteriors(make_posterior):
    """The model's frequencies are 1.0 and 2.5 Hz, each with a standard deviation of 1 %."""
    return [make_posterior("a", -3.0, 0.2), make_posterior("b", 1.0, 0.1, pairing={"1": 1})]


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


def points(ax):
    """x, y of the single points of the error bars, in the order drawn."""
    return np.array([bars[0].get_xydata()[0] for bars in ax.containers])


def test_evidence_has_its_error_bars_and_the_fit(posteriors):
    ax = plot_evidence(bs.compare(posteriors))
    errorbars = [c for c in ax.containers if len(c) == 3 and c[0] is not None]
    assert errorbars[0].get_label().startswith("log evidence")
    np.testing.assert_allclose([bar[0].get_xdata()[0] for bar in errorbars], [1.0, -3.0])
    segments = [segment for bar in errorbars for segment in bar[2][0].get_segments()]
    np.testing.assert_allclose([s[:, 0] for s in segments], [[0.9, 1.1], [-3.2, -2.8]])
    (fit,) = [line for line in ax.lines if line.get_label().startswith("fit")]
    np.testing.assert_allclose(fit.get_xdata(), [4.0, 0.0])
    bars = ax.patches
    np.testing.assert_allclose([bar.get_x() for bar in bars], [1.0, -3.0])
    np.testing.assert_allclose([bar.get_width() for bar in bars], [3.0, 3.0])
    assert [t.get_text() for t in ax.get_yticklabels()] == ["b\n(0.9820)", "a\n(0.0180)"]
    assert ax.get_xlabel() == "nats"
    low, high = ax.get_ylim()
    assert low > high  # the best at the top
    assert len(texts(ax.figure.legends[0])) == 3


def test_frequencies_relative_to_the_identified_ones(data, posteriors):
    ax = plot_frequencies(data, posteriors)
    actual = points(ax)
    # Class a explains modes 1 and 2, class b only mode 1; 2.5 Hz lies 25 % above 2 Hz.
    np.testing.assert_allclose(actual[:, 0], [-0.3, 0.7, 0.3])
    np.testing.assert_allclose(actual[:, 1], [0.0, 25.0, 0.0], atol=0.2)
    segments = [bars[2][0].get_segments()[0][:, 1] for bars in ax.containers]
    np.testing.assert_allclose(np.diff(segments[0]), 2 * 1.645, atol=0.3)  # 90 % of sd 1 %
    np.testing.assert_allclose(np.diff(segments[1]), 2 * 1.645 * 1.25, atol=0.4)
    crosses = [line.get_xdata() for line in ax.lines if line.get_marker() == "x"]
    np.testing.assert_allclose(np.sort(np.concatenate(crosses)), [1.3, 1.7, 2.3])
    assert texts(ax.figure.legends[0]) == ["a", "b", "called spurious"]
    assert [t.get_text() for t in ax.get_xticklabels()] == ["1\n1 Hz", "2\n2 Hz", "x\n2.2 Hz"]
    assert "%" in ax.get_ylabel()
    # The band of an identified mode is its 90 per cent; one class is drawn in the middle of it.
    heights = ax.collections[0].get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((-1.645, 1.645), abs=0.01)
    np.testing.assert_allclose(points(plot_frequencies(data, posteriors[:1]))[:, 0], [0.0, 1.0])


@pytest.mark.parametrize("draw", ["evidence", "frequencies"])
def test_drawing_on_given_axes(data, posteriors, draw):
    _, axes = plt.subplots(1, 2)
    if draw == "evidence":
        actual = plot_evidence(bs.compare(posteriors), axes[1])
    else:
        actual = plot_frequencies(data, posteriors, ax=axes[1])
    assert actual is axes[1]
    assert actual.has_data()
    assert not axes[0].has_data()
    assert len(plt.get_fignums()) == 1
    actual.figure.canvas.draw()


def test_corner(make_posterior):
    posterior = make_posterior("3", names=("k1", "k2", "ks"))
    figure = plot_corner(posterior, parameters=("k1", "ks"))
    k1, _, ks_k1, ks = figure.axes
    assert (ks_k1.get_xlabel(), ks.get_xlabel()) == ("k1", "ks")
    assert (k1.get_ylabel(), ks_k1.get_ylabel()) == ("", "ks")
    assert figure.get_suptitle().startswith("3\n")
    assert f"{np.median(posterior.values[:, 2]):.4g}" in ks.get_title()
    with pytest.raises(ValueError, match="no parameter 'k9'; choose from 'k1', 'k2'"):
        plot_corner(posterior, parameters=("k9",))


def test_a_corner_plot_marks_true_values_and_states_units(make_posterior):
    corner = plot_corner(make_posterior("a"), units={"k2": "N/m"})
    assert {ax.get_xlabel() for ax in corner.axes[-2:]} == {"k1", "k2 (N/m)"}
    k1, _, _, k2 = plot_corner(make_posterior("3"), truths={"k2": 0.25}).axes
    at = [line.get_xdata()[0] for line in k2.lines]
    assert at[:3] == pytest.approx(np.quantile(make_posterior("3").values[:, 1], [0.05, 0.5, 0.95]))
    assert at[3:] == [0.25]
    assert k2.get_xlim()[0] < 0.25
    assert len(k1.lines) == 3
    assert_refused("no parameter 'k9'", plot_corner, make_posterior("3"), truths={"k9": 1.0})


def test_contours_of_a_corner_plot_hold_their_shares_of_the_draws(make_posterior):
    """Of a normal density of two variables, exp(-r^2 / 2) is outside r standard deviations."""
    draws = np.random.default_rng(4).multivariate_normal([1.0, 2.0], [[1, 0.5], [0.5, 2]], 40_000)
    joint = plot_corner(make_posterior("3", draws=draws[None])).axes[2]
    outer, inner = joint.collections[-1].get_paths()
    shares = [path.contains_points(draws).mean() for path in (inner, outer)]
    # Smoothing by a bin, 0.2 standard deviations, widens the contours by 2 %.
    np.testing.assert_allclose(shares, 1.0 - np.exp(-0.5 * 1.02**2 * np.array([1, 4])), atol=0.02)


@pytest.mark.parametrize("names", [("k",), ("k", "the mass ratio, infill 1-2")])
def test_names_fit_the_panels_of_a_corner_plot(make_posterior, names):
    with figures_for_files():
        figure = plot_corner(make_posterior("3", names=names))
    figure.draw_without_rendering()
    first, last = figure.axes[0], figure.axes[-1]
    for ax in (first, last):
        title, panel = ax.title.get_window_extent(), ax.get_window_extent()
        assert title.width <= 1.1 * panel.width
        assert title.y1 < figure._suptitle.get_window_extent().y0


def test_the_style_does_not_outlive_its_block():
    before = dict(mpl.rcParams)
    with style():
        assert mpl.rcParams["font.size"] == 9
    assert dict(mpl.rcParams) == before


def test_many_classes_are_drawn_by_their_names_literally(tmp_path, data, make_posterior):
    odd = ("k_1 & k^2", "50 %", "cost $5 or $6", "[a]", "_hidden", "θ")
    names = [*odd, *(f"class {i}" for i in range(6))]
    posteriors = [make_posterior(name, -i, names=odd) for i, name in enumerate(names)]
    with figures_for_files():
        frequencies = plot_frequencies(data, posteriors)
        evidence = plot_evidence(bs.compare(posteriors))
        figures = frequencies.figure, evidence.figure, plot_corner(posteriors[0])
        paths = [save_figure(each, tmp_path / f"{i}.png") for i, each in enumerate(figures)]
    assert all(path.read_bytes()[: len(PNG)] == PNG for path in paths)
    assert plt.get_fignums() == []
    assert texts(frequencies.figure.legends[0]) == [*names, "called spurious"]
    assert [tick.get_text().split("\n")[0] for tick in evidence.get_yticklabels()] == names


def test_frequencies_under_an_inferred_pairing_are_those_of_each_draw(make_posterior):
    """The first model mode is another one in some draws; the paired one is at 1 Hz in all."""
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 3.0))
    inferred = InferredPairing((PairingShare({"1": 1}, 1.0),), {"1": {1: 0.6, 2: 0.4}})
    own = model_at_draws.UpdatedMode("1", 1, 1.1, (0.99, 1.0, 1.01), None, None, ((1.0,),) * 3)
    modes = model_at_draws.UpdatedModes(("floor 1",), (), (own,))
    frequencies = np.tile([0.5, 1.0], (4, 250, 1))
    tests = (model_at_draws.ConfigurationModes("", 2, {"1": 1}, inferred, modes),)
    posterior = make_posterior("a", frequencies_hz=frequencies, configurations=tests)
    (bar,) = plot_frequencies(data, [posterior]).containers
    (ends,) = bar.lines[2][0].get_segments()
    assert ends[:, 1] == pytest.approx([-1.0, 1.0])


def test_identified_modes(case_c):
    band, *shapes = plot_identified_modes(case_c).axes
    assert [text.get_text() for text in band.texts] == ["1", "2a", "2b", "3"]
    points = {line.get_gid(): line.get_xydata()[0] for line in band.lines}
    assert points["hover: mode 2a: 2.6043 Hz"][0] == pytest.approx(2.6042925)
    assert len(shapes) == 4
    # The largest component, at floor 3, is 0.7336 at unit length, that at floor 1 is 0.3314.
    bars = {bar.get_gid().split(", ")[-1]: bar.get_width() for bar in shapes[0].patches}
    assert bars["floor 3: 1.000"] == pytest.approx(1.0)
    assert bars["floor 1: 0.452"] == pytest.approx(0.3314169 / 0.7336109)
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
    assert_refused("no mode is paired", plot_mode_shapes, replace(updated, modes=()), case_c)


# Standard deviations to either side that hold 90 %.
Z = 1.645
SHAPE, SDS = np.array([0.6, 0.8]), np.array([0.04, 0.03])


def one_shape(sensors, with_covariance=True, **errors):
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
    _, ax = plot_identified_modes(one_shape(("x", "y"), **arguments)).axes
    bars = np.array(ax.containers[1].lines[2][0].get_segments())[:, :, 0]
    np.testing.assert_allclose(bars.mean(axis=1), [0.75, 1.0])
    np.testing.assert_allclose(np.diff(bars)[:, 0] / 2.0, Z * sds / 0.8 * np.ones(2), rtol=1e-9)
    assert [each.get_text() for each in ax.get_yticklabels()] == ["x", "y"]
