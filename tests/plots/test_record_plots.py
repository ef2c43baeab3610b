"""Figures of an identification show what was identified."""

from itertools import pairwise

import numpy as np
import pytest
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.plots import plot_singular_values, plot_stabilisation, plot_whitened_residuals
from bayes_ssi.plots.figure_style import ORANGE

pytestmark = pytest.mark.usefixtures("close_figures")


@pytest.fixture(scope="module")
def identified():
    sensors, rng = ("floor 1", "floor 2", "floor 3"), np.random.default_rng(0)
    record = simulated_record(with_infill(), sensors, rng, duration_s=300.0, rate_hz=20.0)
    return bs.identify(record, (0.6, 4.6))


def test_spectra_and_poles_have_the_modes_with_their_90_percent_widths(identified):
    for ax in (plot_singular_values(identified), plot_stabilisation(identified)):
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
    lines = ax.lines
    means = [line.get_xdata() for line in lines if line.get_color() == ORANGE]
    assert len(means) == len(bands)
    for line, band in zip(means, bands, strict=True):
        assert line[0] >= band.frequencies_hz[0]
        assert line[-1] <= band.frequencies_hz[-1]


def test_fitted_singular_values_are_those_of_the_record(identified):
    """Their sums, over all blocks of the band of the second mode: to the scatter of blocks."""
    band = min(identified.bands, key=lambda each: each.distance_to(2.604))
    data = band.fit.data
    measured = data.to_channels @ data.matrices @ data.to_channels.T
    ratios = np.einsum("kii->k", measured).real / band.singular_values().sum(1)
    assert ratios.mean() == pytest.approx(1.0, abs=0.15)
