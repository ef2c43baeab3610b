"""Figures of responses: what is drawn where, and with which words."""

import numpy as np
import pytest

from bayes_ssi.plots.class_plots import plot_mac
from bayes_ssi.plots.prediction_plots import plot_time_history, plot_transfer_functions
from bayes_ssi.plots.shape_plots import BEYOND, plot_shape_components
from bayes_ssi.results.predictions.posterior_draws import Band

pytestmark = pytest.mark.usefixtures("close_figures")

X = np.linspace(0.5, 2.5, 5)


def band(middle, half):
    middle = np.asarray(middle, dtype=float)
    return Band(middle - half, middle, middle + half)


def line(ax, label):
    (actual,) = [each for each in ax.lines if each.get_label() == label]
    return actual


@pytest.mark.parametrize(
    ("plot", "x_label", "scale"),
    [(plot_transfer_functions, "frequency (Hz)", "log"), (plot_time_history, "time (s)", "linear")],
)
def test_a_band_its_median_and_the_reference(plot, x_label, scale):
    ax = plot(X, {"class $3$": band(X, 0.1)}, reference=("true", 2.0 * X), quantity="q (-)")
    np.testing.assert_array_equal(line(ax, "class $3$").get_xydata(), np.c_[X, X])
    np.testing.assert_array_equal(line(ax, "true").get_ydata(), 2.0 * X)
    outline = ax.collections[0].get_paths()[0].vertices
    at_2 = outline[outline[:, 0] == 2.0, 1]
    np.testing.assert_allclose([at_2.min(), at_2.max()], [1.9, 2.1])
    assert ax.get_ylabel() == "q (-)"
    assert (ax.get_xlabel(), ax.get_yscale()) == (x_label, scale)
    assert ax.get_xlim() == (0.5, 2.5)
    (legend,) = ax.figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["class $3$", "true"]
    ax.figure.canvas.draw()


def test_transfer_functions_that_vanish_leave_the_others_visible():
    amplitude = np.array([1e-9, 1.0, 2.0, 1e-12])
    ax = plot_transfer_functions(np.arange(4.0), {"a": band(amplitude, 0.0)})
    assert ax.get_ylim()[0] == pytest.approx(2e-4)
    assert ax.get_ylim()[1] > 2.0


def test_bands_differ_in_colour_and_line_and_are_four_at_most():
    ax = plot_transfer_functions(X, {name: band(X, 0.1) for name in "abcd"}, legend=False)
    looks = {(line(ax, name).get_color(), line(ax, name).get_linestyle()) for name in "abcd"}
    assert len({colour for colour, _ in looks}) == len({style for _, style in looks}) == 4
    assert not ax.figure.legends
    with pytest.raises(ValueError, match="at most 4 bands, got 5"):
        plot_transfer_functions(X, {name: band(X, 0.1) for name in "abcde"})


def test_components_reach_as_far_as_the_main_structure(augmented):
    places = augmented.degrees_of_freedom
    shape = band([0.7, 0.2, -0.7, -3.4], 0.1)
    ax = plot_shape_components(augmented, places, shape, title="mode $1$")
    assert [bar.get_width() for bar in ax.patches] == [0.7, 0.2, -0.7, -3.4]
    assert ax.get_xlim() == pytest.approx((-1.15 * 0.8, 1.15 * 0.8))
    assert ax.get_xlabel() == "infill 1-2:\n-3.4\n(-3.5 to -3.3)"
    assert tuple(t.get_text() for t in ax.get_yticklabels()) == places
    ax.figure.canvas.draw()
    # An interval that reaches beyond is written below, too.
    middle = np.array([0.7, 0.2, -0.7, -0.5])
    wide = Band(middle - np.array([0.1, 0.1, 0.1, 4.0]), middle, middle)
    ax = plot_shape_components(augmented, places, wide)
    assert ax.get_xlabel() == "infill 1-2:\n-0.5\n(-4.5 to -0.5)"
    assert BEYOND not in [line.get_label() for line in ax.lines]


def test_the_mac_matrix_is_written_out():
    matrix = np.array([[1.0, 0.02], [0.92, np.nan]])
    ax = plot_mac(matrix, ["2a", "2b"], ["1", "2"], of=("correct", "incorrect"))
    assert [text.get_text() for text in ax.texts] == ["1.00", "0.02", "0.92"]
    np.testing.assert_array_equal(ax.images[0].get_array().filled(np.nan), matrix)
    assert (ax.get_ylabel(), ax.get_xlabel()) == ("correct", "incorrect")
    assert [t.get_text() for t in ax.get_yticklabels()] == ["2a", "2b"]
