"""What is no mode: lines of machines, by their steady amplitudes, and what moves nowhere surely."""

import re
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from random_structures import spectra_of, stationary
from scipy.signal import hilbert, lfilter
from simulated_records import FRAME, simulated_record, truth_of

import bayes_ssi as bs
from bayes_ssi.measurements.records import modal_identification
from bayes_ssi.measurements.records.modal_identification import modes_to_quote, peaks_without_mode
from bayes_ssi.measurements.records.mode_candidates import Prominence
from bayes_ssi.measurements.records.spectra import Resonances, transforms_of
from bayes_ssi.measurements.records.steady_amplitudes import (
    FEWEST_LINES,
    MOST_SDS,
    steady_modes,
    variation,
)
from bayes_ssi.measurements.records.usable_motion import usable_motion

SENSORS = ("floor 1", "floor 2", "floor 3")


def phases(rng, *shape):
    return np.exp(2j * np.pi * rng.random(shape))


def wandering(rng, times, hz, share):
    """A sine of constant amplitude whose frequency wanders by a share of it within a minute."""
    kept = np.exp(-(times[1] - times[0]) / 60.0)
    steps = np.sqrt(1.0 - kept**2) * rng.standard_normal(len(times))
    now_hz = hz * (1.0 + share * lfilter([1.0], [1.0, -kept], steps))
    return np.sin(2.0 * np.pi * np.cumsum(now_hz) * (times[1] - times[0]))


def test_resonances_under_random_loads_vary_as_they_are_expected_to():
    rng = np.random.default_rng(0)
    for n in (FEWEST_LINES, 15, 100):
        x = 1.0 / (1.0 + 1j * np.linspace(-4.0, 4.0, n))
        loads = rng.standard_normal((1000, n)) + 1j * rng.standard_normal((1000, n))
        ratios, sds = np.transpose([variation(x * each) for each in loads])
        assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / np.sqrt(1000)
        assert (np.log(ratios) / sds).min() > -MOST_SDS


@pytest.mark.parametrize("is_steady", [True, False])
def test_the_variation_is_that_of_the_envelope(is_steady):
    """Relative variances of envelopes in time, of the lines and of the same with random phases."""
    rng, n = np.random.default_rng(1), 60
    lines = phases(rng, n)
    if is_steady:
        lines = np.fft.fft(np.exp(1j * np.cumsum(rng.normal(0.0, 0.4, n))))
    drawn = np.vstack([lines, np.abs(lines) * phases(rng, 3000, n)])
    powers = np.abs(np.fft.ifft(np.fft.fftshift(drawn, 1), 4 * n)) ** 2
    own, *others = powers.var(axis=1) / powers.mean(axis=1) ** 2
    mean, sd = np.mean(others), np.std(others)
    ratio, own_sd = variation(np.fft.fftshift(lines))
    assert ratio == pytest.approx(own / mean, rel=4.0 * sd / mean / np.sqrt(3000))
    # Sums of a few lines are neither quite independent nor quite exponential.
    assert 0.6 < own_sd / (sd / mean) < 1.5
    assert (np.log(ratio) < -MOST_SDS * own_sd) == is_steady


def sensed(motions, shapes):
    """Lines of a record whose sensors sense motions (m, N), at 20 Hz, by complex shapes (n, m)."""
    samples = sum(shapes[:, [i]] * hilbert(motion) for i, motion in enumerate(motions)).real
    sensors = tuple(f"s{i}" for i in range(len(samples)))
    return transforms_of(bs.Record(samples, 20.0, sensors, "acceleration", "m/s2"), (1.0, 3.0))


TIMES = np.arange(12_000) / 20.0
LINE = np.array([1.0, 0.5 - 0.6j, -0.3 + 0.2j])


def resonant(rng, hz, damping):
    """A mode's motion under random loads, of about unit size."""
    at = np.fft.rfftfreq(len(TIMES), 0.05)
    response = 1.0 / (hz**2 - at**2 + 2j * damping * hz * at)
    motion = np.fft.irfft(np.fft.rfft(rng.standard_normal(len(TIMES))) * response)
    return motion / motion.std()


def test_a_line_is_seen_beneath_a_stronger_mode_of_another_shape():
    rng = np.random.default_rng(3)
    mode, shapes = np.array([0.4, 1.0, 0.7j]), np.empty((3, 2), complex)
    shapes.T[:] = mode / np.linalg.norm(mode), LINE / np.linalg.norm(LINE)
    motions = [resonant(rng, 2.0, 0.005), 0.4 * wandering(rng, TIMES, 2.01, 0.001)]
    both = Resonances(np.array([2.0, 2.01]), np.array([0.005, 0.001]), shapes)
    assert steady_modes(sensed(motions, shapes), both) == [1]


def test_a_line_that_two_modes_explain_is_steady_over_both():
    """It is in the band of the one or of the other, where its amplitude is not steady at all."""
    rng = np.random.default_rng(6)
    shapes = np.repeat(LINE[:, None], 2, axis=1) / np.linalg.norm(LINE)
    line = sensed([wandering(rng, TIMES, 2.0, 0.006)], shapes[:, :1])
    modes = Resonances(np.array([1.985, 2.015]), np.array([0.002, 0.002]), shapes)
    assert steady_modes(line, modes) == [0, 1]
    assert steady_modes(line, modes.at([0])) == []


def test_a_line_that_wanders_fails_a_check_and_modes_do_not():
    rng = np.random.default_rng(2)
    record = simulated_record(FRAME, SENSORS, rng, duration_s=600.0)
    times = np.arange(record.n_samples) / record.rate_hz
    line = 0.3 * record.samples.std() * wandering(rng, times, 2.2, 0.002)
    samples = record.samples + np.array([[1.0], [0.4], [0.7]]) * line
    disturbed = bs.Record(samples, record.rate_hz, SENSORS, record.quantity, record.unit)
    modes_hz = truth_of(FRAME, SENSORS, 0.02).frequencies_hz
    result = bs.identify(disturbed, (0.6, 4.6), at=(*modes_hz, 2.2))
    said = [text for text in result.failed_checks if "a wandering line of a machine" in text]
    assert said
    for text in said:
        hz = float(re.match(r"mode at ([\d.]+) Hz: its amplitude is steadier", text)[1])
        assert abs(hz / 2.2 - 1.0) < 0.01
    assert any("far below the usual" in text for text in said)


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
    fit, covariance = SimpleNamespace(modes=modes), np.diag(variances)
    band = SimpleNamespace(modes=modes, fit=fit, estimates=lambda *_: (None, covariance))
    kept, left_out = modes_to_quote([band], (0.5, 3.0), [0, 2], are_given=False)
    assert kept == [(band, [0])]
    assert left_out == [(2.0, 0.02)]
    assert modes_to_quote([band], (0.5, 3.0), [0, 2], are_given=True) == ([(band, [0, 2])], [])
    peak = Prominence(2.0, 0.05, 12.0, True)
    assert not peaks_without_mode([peak], [band], (0.5, 3.0))
    ((hz, why),) = peaks_without_mode([peak], [band], (0.5, 3.0), [2.0])
    assert hz == 2.0
    assert why.startswith("it stands out by 12 dB")
