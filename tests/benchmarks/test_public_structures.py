"""Leaving one mode out of measured structures, and the structures that are new there."""

import numpy as np
import pytest
from conftest import ROOT, kept_study, script_of

import bayes_ssi as bs

COARSE = bs.SamplingSettings(log_evidence_error=0.05, particles=60, searches=1, max_steps=400)


@pytest.fixture(scope="module")
def script():
    return script_of("public_structures")


def frame(modes_hz):
    """Two equal floors, the first at 1 Hz at the prior median."""
    k = bs.Parameter("k", bs.LogNormal(median=103.36, cov=0.3))
    modes = tuple(bs.IdentifiedMode(str(i), hz) for i, hz in enumerate(modes_hz, 1))
    data = bs.ModalData(modes, band_hz=(0.0, 4.0))
    structure = bs.ShearBuilding((1.0, 1.0), (k, k))
    error = bs.ErrorModel(frequency_cov=0.01)
    return bs.ModelClass("frame", structure, data, error, pairing={"1": 1, "2": 2})


def test_a_mode_that_was_left_out_is_predicted_by_the_other_with_both_errors(script):
    """f2/f1 is (3 + √5)/2; both errors are 1 %, so that the interval is 1.645 √2 % wide."""
    each = script.predicted([frame((1.0, 2.7))], "", "2", 0, COARSE)
    ratio = (3.0 + np.sqrt(5.0)) / 2.0
    assert each.median_hz == pytest.approx(ratio, rel=0.002)
    assert each.half_width * each.measured_hz / ratio == pytest.approx(0.02326, rel=0.1)
    assert not each.covered
    assert np.isnan(each.mac)


def test_a_mode_that_was_not_looked_for_is_no_missed_one(script):
    """The likelihood depends on the mode that is left only, as if there were one model mode."""
    left = script.without(frame((1.0, 2.6)), "", "2")
    values = left.values(np.array([[0.0], [0.5]]))
    density = left.log_likelihood(values)
    hz = np.sqrt(values[:, 0] * (3.0 - np.sqrt(5.0)) / 2.0) / (2.0 * np.pi)
    expected = -0.5 * ((hz - 1.0) / 0.01) ** 2
    assert density[1] - density[0] == pytest.approx(expected[1] - expected[0], abs=0.002)


def test_the_air_frame_is_that_of_its_source():
    """Frequencies of the source's matrices, the angles' mass moved from a wing tip to the tail."""
    bonded, *_ = kept_study("garteur").model_classes
    known = (2, [6.5447, 32.4838, 48.8944, 55.7801]), (0, [17.8138, 32.5071, 37.1930, 45.9033])
    for test, (first, expected) in zip(bonded.configurations, known, strict=True):
        full = test.structure.full
        hz = full.modes(full.prior_medians()).frequencies_hz[0, first:][:4]
        # The source takes the torsion constants from a table, which is 0.3 % off.
        np.testing.assert_allclose(hz, expected, rtol=0.0015)


def test_states_with_thin_columns_are_compared_as_if_nothing_were_known_of_them():
    (frame,) = bs.load_study(ROOT / "runs" / "los_alamos_columns.py").model_classes
    known = kept_study("los_alamos_frame").model_classes[1]
    names = [test.name for test in frame.configurations]
    assert names == ["state 1", "state 4", "state 5", "state 6", "state 7", "state 8", "state 9"]
    intact = known.configuration("state 1").structure
    hz = intact.modes(intact.prior_medians()).frequencies_hz
    for test in frame.configurations:
        assert test.data.digest == known.configuration(test.name).data.digest
        np.testing.assert_array_equal(test.structure.modes(intact.prior_medians())[0], hz)
