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
    return record, bs.identify(record, (0.6, 4.6))


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def test_spectra_and_poles_have_the_modes_with_their_90_percent_widths(identified):
    record, found = identified
    for ax in (plot_singular_values(found), plot_stabilisation(record, found)):
        widths = [patch.get_width() for patch in ax.patches]
        modes = found.quoted
        expected = 2 * 1.645 * modes.frequency_covs * modes.frequencies_hz
        np.testing.assert_allclose(widths, expected, rtol=1e-9)


def test_residuals_are_one_on_average_where_the_fit_is_right(identified):
    _, found = identified
    points = plot_whitened_residuals(found).lines[0]
    n_blocks, unknowns = len(points.get_ydata()), found.fit.model.layout.n_coordinates
    whiteness = points.get_ydata().sum() * 9 / (9 * n_blocks - unknowns)
    assert whiteness == pytest.approx(found.fit.whiteness)
