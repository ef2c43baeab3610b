"""Figures of an identification show what was identified."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.plots import (
    plot_singular_values,
    plot_stabilisation,
    plot_whitened_residuals,
)


@pytest.fixture(scope="module")
def identified():
    sensors = ("floor 1", "floor 2", "floor 3")
    record = simulated_record(
        with_infill(), sensors, np.random.default_rng(0), duration_s=300.0, rate_hz=20.0
    )
    return bs.identify(record, (0.6, 4.6))


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_spectra_and_poles_have_the_modes_with_their_90_percent_widths(identified):
    for ax in (plot_singular_values(identified), plot_stabilisation(identified)):
        widths = [patch.get_width() for patch in ax.patches]
        modes = identified.quoted.modes
        expected = [2 * 1.645 * mode.frequency_cov * mode.frequency_hz for mode in modes]
        np.testing.assert_allclose(widths, expected, rtol=1e-9)


def test_residuals_are_one_on_average_where_the_fit_is_right(identified):
    """But for what the unknowns of each band take up, and the scatter of a few hundred blocks."""
    left = plot_whitened_residuals(identified).lines[0].get_ydata()
    assert 0.6 < left.mean() < 1.1


def test_fitted_singular_values_are_those_of_the_record(identified):
    """Their sums, over all blocks of the band of the second mode: to the scatter of blocks."""
    band = min(identified.bands, key=lambda each: each.distance_to(2.604))
    data = band.fit.data
    measured = data.to_channels @ data.matrices @ data.to_channels.T
    ratios = np.einsum("kii->k", measured).real / band.singular_values().sum(1)
    assert ratios.mean() == pytest.approx(1.0, abs=0.15)
