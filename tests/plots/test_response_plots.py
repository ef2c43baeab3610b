"""Figures of responses and of identifications: what is drawn where, and with which words."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.plots import plot_singular_values, plot_stabilisation, plot_whitened_residuals
from bayes_ssi.plots.class_plots import plot_mac
from bayes_ssi.plots.figure_style import ORANGE
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


@pytest.fixture(scope="module")
def identified():
    sensors, rng = ("floor 1", "floor 2", "floor 3"), np.random.default_rng(0)
    building, sizes = with_infill(), {"duration_s": 300.0, "rate_hz": 20.0}
    return bs.identify(simulated_record(building, sensors, rng, damping=0.01, **sizes), (0.6, 4.6))


def test_spectra_and_poles_have_the_modes_with_their_90_percent_widths(identified):
    identified = replace(identified, not_identified=((1.5, ""), (1.6, "")))
    values = plot_singular_values(identified)
    assert [line.get_label() for line in values.lines].count("peak not identified") == 1
    for ax in (values, plot_stabilisation(identified)):
        widths = [patch.get_width() for patch in ax.patches]
        modes = identified.quoted.modes
        expected = [2 * 1.645 * mode.frequency_cov * mode.frequency_hz for mode in modes]
        np.testing.assert_allclose(widths, expected, rtol=1e-9)


def test_residuals_are_one_on_average_where_the_fit_is_right(identified):
    """But for what the unknowns of each band take up, and the scatter of a few hundred blocks."""
    lines = plot_whitened_residuals(identified).lines
    left = np.concatenate([line.get_ydata() for line in lines if line.get_linestyle() == "None"])
    assert 0.6 < left.mean() < 1.1


def test_means_of_residuals_are_within_bands(identified):
    """Of the record's four modes the first has a band of its own, and beside it there is a gap."""
    bands = [band.fit.data for band in identified.bands if band.is_wanted]
    assert any(high.band_hz[0] - low.band_hz[1] > 0.1 for low, high in pairwise(bands))
    ax = plot_whitened_residuals(identified)
    ends = bands[0].frequencies_hz[0], bands[-1].frequencies_hz[-1]
    np.testing.assert_array_equal(ax.get_xlim(), ends)
    means = [line.get_xdata() for line in ax.lines if line.get_color() == ORANGE]
    assert len(means) == len(bands)
    for line, band in zip(means, bands, strict=True):
        assert line[0] >= band.frequencies_hz[0]
        assert line[-1] <= band.frequencies_hz[-1]


def test_fitted_singular_values_are_those_of_the_record(identified):
    """Their sums, over all blocks of the band of the second mode: to the scatter of blocks."""
    band = min(identified.bands, key=lambda each: abs(2.604 - sum(each.band_hz) / 2.0))
    data = band.fit.data
    measured = data.to_channels @ data.matrices @ data.to_channels.T
    ratios = np.einsum("kii->k", measured).real / band.singular_values().sum(1)
    assert ratios.mean() == pytest.approx(1.0, abs=0.15)
