"""What is fitted as a mode but moves nowhere surely is not quoted, unless it was asked for."""

import re
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from random_structures import spectra_of, stationary

import bayes_ssi as bs
from bayes_ssi.measurements.records import modal_identification
from bayes_ssi.measurements.records.modal_identification import modes_to_quote, peaks_without_mode
from bayes_ssi.measurements.records.mode_candidates import Prominence
from bayes_ssi.measurements.records.spectra import Resonances
from bayes_ssi.measurements.records.usable_motion import usable_motion

BAND_HZ = (1.4, 2.9)


@pytest.fixture(scope="module")
def record():
    """13 minutes of a mode at 2 Hz and two far from it; this draw of loads asks for one more."""
    rng = np.random.default_rng([52, 19])
    rng.random(5)
    shapes = rng.standard_normal((4, 4))[:, [0, 1, 3]]
    shapes /= np.linalg.norm(shapes, axis=0)
    samples = stationary(
        lambda hz: spectra_of(np.array([0.7, 2.0, 5.5]), (shapes, shapes), np.full(3, 0.0378), hz),
        15368, 20.0, rng,
    )  # fmt: skip
    samples += 0.0113 * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    return bs.Record(samples, 20.0, ("a", "b", "c", "d"), "acceleration", "g")


def test_a_broad_rest_of_the_spectrum_is_no_mode(record, monkeypatch):
    searched = cache(modal_identification._search)
    motion = usable_motion(record, BAND_HZ, "")
    monkeypatch.setattr(modal_identification, "_search", lambda *_: searched(motion, ()))
    found = bs.identify(record, BAND_HZ)
    (frequency,) = found.quoted.frequencies_hz
    assert abs(np.log(frequency / 2.0)) < 3.0 * found.modes[0].frequency_cov
    (peak,) = found.peaks
    assert peak.probability_of_two is None
    assert found.failed_checks == ()
    (remark,) = found.remarks
    # Where along a nearly flat maximum, rounding says.
    said = r"what is fitted at 2\.4\d+ Hz with a damping of (9\.\d|1\d) % is not quoted"
    assert re.match(said, remark)
    # And a clear peak of a shape that is not known is said.
    monkeypatch.setattr(modal_identification, "MOST_SHAPE_SD", 0.0)
    said = r"no mode is identified .* the peak at 1\.99\d Hz: it stands out by 13 dB"
    with pytest.raises(ValueError, match=said):
        bs.identify(record, BAND_HZ)


def test_the_limit_is_half_the_length_of_the_shape():
    """Of two modes at two of three sensors: variances of (ln f, ln ζ), then of components."""
    variances = np.array([9.0, 9.0, 9.0, 9.0, 0.12, 0.12, 0.12, 0.14])
    modes = Resonances(np.array([1.0, 5.0, 2.0]), np.full(3, 0.02), np.ones((3, 3)))
    band = SimpleNamespace(
        modes=modes,
        fit=SimpleNamespace(modes=modes),
        estimates=lambda *_: (None, np.diag(variances)),
    )
    kept, left_out = modes_to_quote([band], (0.5, 3.0), [0, 2], are_given=False)
    assert kept == [(band, [0])]
    assert left_out == [(2.0, 0.02)]
    assert modes_to_quote([band], (0.5, 3.0), [0, 2], are_given=True) == ([(band, [0, 2])], [])
    peak = Prominence(2.0, 0.05, 12.0, True)
    assert not peaks_without_mode([peak], [band], (0.5, 3.0))
    ((hz, why),) = peaks_without_mode([peak], [band], (0.5, 3.0), [2.0])
    assert hz == 2.0
    assert why.startswith("it stands out by 12 dB")
