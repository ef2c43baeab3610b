"""The four-storey laboratory frame: calibration as published, and what the study finds."""

import functools

import numpy as np
import pytest
from conftest import kept_study

import bayes_ssi as bs
from bayes_ssi.studies.ranking.class_sampling import sample_all

# Published least-squares fit to four frequencies and four shapes.
STIFFNESSES = [7.19, 8.06, 9.00, 14.75]  # lb/in
FREQUENCIES = [0.883, 2.747, 4.299, 5.533]  # Hz
MACS = [0.999, 0.994, 0.997, 0.995]
# The published values, to their last digit, are those at this weight of the shapes.
SHAPE_WEIGHT = 0.1

study = functools.partial(kept_study, "four_storey_frame")


@pytest.fixture(scope="module")
def posteriors():
    coarse = bs.SamplingSettings(0.05, searches=2, effective_sample_size=500)
    return sample_all(study().model_classes, 0, coarse)


@functools.cache
def calibration(shape_weight=SHAPE_WEIGHT):
    (each,) = study().only(["each storey"]).model_classes
    return bs.calibrate(each, shape_weight)


def test_calibrated_stiffnesses_and_modes():
    # Nominal stiffnesses are 10 lb/in; parameters multiply them.
    np.testing.assert_allclose(10.0 * np.array(calibration().best.values), STIFFNESSES, atol=0.02)
    assert calibration().undetermined_directions == 0
    modes = calibration().best.modes
    np.testing.assert_allclose([mode.model_hz for mode in modes], FREQUENCIES, atol=5.1e-4)
    np.testing.assert_allclose([mode.mac for mode in modes], MACS, atol=5.1e-4)


@pytest.mark.parametrize("shape_weight", [None, 1.0])
def test_every_mode_fits_whatever_the_weight_of_shapes(shape_weight):
    for mode in calibration(shape_weight).best.modes:
        assert mode.mac >= 0.99
        assert mode.model_hz == pytest.approx(mode.identified_hz, rel=0.01)


def test_each_storey_needs_its_own_stiffness(posteriors):
    comparison = bs.compare(posteriors, study().prior_weights)
    probability = {row.name: row.probability for row in comparison.classes}
    assert probability["each storey"] + probability["each storey, free errors"] > 0.999
    assert comparison.failed_checks == ()


def test_the_posterior_agrees_with_the_calibration(posteriors):
    (each,) = [p for p in posteriors if p.name == "each storey"]
    for row, stiffness in zip(each.summary, STIFFNESSES, strict=True):
        assert abs(10.0 * row.mean - stiffness) < 3.0 * 10.0 * row.sd


def test_inferred_errors_are_learnt_from_the_data(posteriors):
    (free,) = [p for p in posteriors if p.name == "each storey, free errors"]
    assert free.parameter_names[-2:] == ("frequency_cov", "shape_sd")
    frequency_cov, shape_sd = free.summary[-2:]
    assert 0.0 < frequency_cov.median < 0.02
    assert 0.0 < shape_sd.median < 0.1
