"""Modes from simulated records: right within their claimed errors, which the checks judge."""

import math
import re
from dataclasses import replace
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from random_structures import spectra_of, stationary
from scipy.signal import lfilter
from scipy.stats import chi2
from simulated_records import FRAME, simulated_record, truth_of, with_infill

import bayes_ssi as bs
from bayes_ssi.measurements.modes.identification_summary import METHOD_NAMES, Peak
from bayes_ssi.measurements.records import explained_band
from bayes_ssi.measurements.records.band_search import _explains_more, _largest_move, explain
from bayes_ssi.measurements.records.explained_band import ExplainedPeak
from bayes_ssi.measurements.records.local_fit import Fitter
from bayes_ssi.measurements.records.modal_identification import (
    broad_modes,
    peaks_without_mode,
    quoted_modes,
)
from bayes_ssi.measurements.records.mode_candidates import Candidates
from bayes_ssi.measurements.records.other_methods import compared, fdd, modes_by, next_era, tfie
from bayes_ssi.measurements.records.spectra import Resonances
from bayes_ssi.measurements.records.usable_motion import usable_motion

SENSORS = ("floor 1", "floor 2", "floor 3")
BAND = (0.6, 4.6)
STRUCTURE = with_infill()
TRUTH = truth_of(STRUCTURE, SENSORS, damping=0.02)


@cache
def simulated(seed, **changed):
    return simulated_record(STRUCTURE, SENSORS, np.random.default_rng(seed), **changed)


@cache
def identified(seed, *, ground):
    return bs.identify(simulated(seed, ground=ground), BAND)


def changed(record, samples):
    return bs.Record(samples, record.rate_hz, record.sensors, record.quantity, record.unit)


def of_modes(data, name):
    return np.array([getattr(mode, name) for mode in data.modes])


def errors(data, truth=TRUTH):
    """Frequencies' and shapes' errors in claimed standard deviations."""
    covs = of_modes(data, "frequency_cov")
    frequencies = np.log(data.frequencies_hz / truth.frequencies_hz) / covs
    cosines = np.abs((data.unit_shapes * truth.shapes).sum(0))
    return frequencies, np.sqrt(2 - 2 * cosines) / (of_modes(data, "shape_sd") * np.sqrt(2))


def all_errors_within_four(data, truth=TRUTH):
    frequencies, shapes = errors(data, truth)
    return max(np.abs(frequencies).max(), shapes.max()) < 4.0


def test_claimed_errors_are_near_the_least_that_long_records_allow():
    """The variance of ln f is at least ζ/(2πN) for N periods (Au 2014), of modes alone."""
    data = identified(0, ground=False).quoted
    periods = 2.0 * np.pi * data.frequencies_hz * simulated(0, ground=False).duration_s
    over_least = of_modes(data, "frequency_cov") / np.sqrt(0.02 / periods)
    assert 1.0 < over_least[0] < 1.3
    assert 1.0 < over_least[3] < 1.5


@pytest.mark.parametrize(
    ("added", "least_hz", "n_peaks", "explains"),
    [(1.8, 1.0, 1, True), (1.9, 1.0, 1, False), (1.0, -1.0, 1, False), (1.0, 1.0, 0, False)],
)
def test_what_a_wider_band_must_explain(added, least_hz, n_peaks, explains):
    """Ten blocks of 20 transforms in two directions: 1.1 and three times √(9.8/160) are allowed."""
    at = np.linspace(0.0, 1.9, 20)
    data = SimpleNamespace(weights=np.full(20, 20.0), matrices=np.zeros((20, 2, 2)))
    left = np.where(at < least_hz, added, 9.0)
    fit = SimpleNamespace(data=data, residuals=lambda: (at, left), modes=SimpleNamespace(n_modes=1))
    narrower = SimpleNamespace(data=SimpleNamespace(band_hz=(least_hz, 2.0)))
    assert _explains_more(SimpleNamespace(fit=fit, peaks=[()] * n_peaks), narrower) == explains


def test_moves_between_bands_are_in_their_errors():
    """A damping moves by 10 % with an error of 4 %, and a frequency by 0.2 % with one of 1 %."""
    before = SimpleNamespace(
        modes=Resonances(np.array([2.0]), np.array([0.02]), np.ones((1, 1))),
        covariance=np.diag([0.01, 0.04, 9.0]) ** 2,
    )
    modes = before.modes._replace(frequencies_hz=[2.004], dampings=[0.022])
    assert _largest_move(SimpleNamespace(modes=modes), before) == pytest.approx(np.log(1.1) / 0.04)


@pytest.mark.parametrize("ground", [False, True])
def test_four_modes_with_errors_that_are_right(ground):
    """Four modes, and squares of errors as chi-square has them.

    Shapes at three sensors have two components each: their squares have that mean.
    """
    result = identified(0, ground=ground)
    assert not result.failed_checks
    assert result.is_explained
    assert [peak.modes for peak in result.peaks] == [(0,), (1,), (2,), (3,)]
    assert max(peak.probability_of_two or 0.0 for peak in result.peaks) < 0.5
    assert max(peak.probability_of_phases for peak in result.peaks) < 0.5
    assert all_errors_within_four(result.quoted)
    frequencies, shapes = errors(result.quoted)
    assert chi2(4).cdf((frequencies**2).sum()) == pytest.approx(0.5, abs=0.495)
    assert chi2(8).cdf(2.0 * (shapes**2).sum()) == pytest.approx(0.5, abs=0.495)


def test_modes_beyond_the_band_do_not_hide_the_one_in_it():
    """Of four at 2 / (2π) √(k/m) sin((2i - 1) π / 18) Hz."""
    building = bs.ShearBuilding(masses=(1e5,) * 4, stiffnesses=(2e8,) * 4)
    names, rng = tuple(f"floor {i}" for i in range(1, 5)), np.random.default_rng(1)
    record = simulated_record(
        building, names, rng, damping=0.012, duration_s=300.0, rate_hz=50.0, noise=0.02
    )
    hz = np.sqrt(2e3) / np.pi * np.sin((2.0 * np.arange(1, 5) - 1.0) * np.pi / 18.0)
    (truth,) = hz[(hz > 5.0) & (hz < 9.0)]
    result = bs.identify(record, (5.0, 9.0))
    (mode,) = result.modes
    assert not result.failed_checks
    assert abs(np.log(mode.frequency_hz / truth)) < 4.0 * mode.frequency_cov


def test_loads_may_be_coloured():
    """Independent loads, low-passed at 1 Hz."""
    record, decay = simulated(5, duration_s=600.0), np.exp(-2.0 * np.pi / 50.0)
    samples = lfilter([1.0 - decay], [1.0, -decay], record.samples, axis=1)
    result = bs.identify(changed(record, samples), BAND, at=TRUTH.frequencies_hz)
    assert not result.failed_checks
    assert all_errors_within_four(result.quoted)


def delayed(record, seconds):
    lines = np.fft.rfft(record.samples)
    frequencies = np.fft.rfftfreq(record.n_samples, 1.0 / record.rate_hz)
    turns = np.exp(-2j * np.pi * np.outer(seconds, frequencies))
    return changed(record, np.fft.irfft(lines * turns, record.n_samples))


def test_a_sensor_that_is_too_late_to_be_set_right_fails_a_check():
    """By 0.15 s: 54 degrees at the first mode, and more than half a turn at the fourth."""
    late = delayed(simulated(0, duration_s=400.0), [0.0, 0.15, 0.0])
    failed = bs.identify(late, BAND, at=TRUTH.frequencies_hz).failed_checks
    assert any("'floor 2' is out of phase with the others by up to" in check for check in failed)


def test_sensors_that_are_late_make_no_pair_and_are_set_right():
    """Delays of 15 and -8 ms: 16 degrees at the fourth mode."""
    late = delayed(simulated(0, duration_s=400.0), [0.015, 0.0, -0.008])
    result = bs.identify(late, BAND, at=TRUTH.frequencies_hz)
    assert all_errors_within_four(result.quoted)
    assert max(peak.probability_of_two or 0.0 for peak in result.peaks) < 0.05
    assert max(peak.probability_of_phases for peak in result.peaks) < 0.5
    (said,) = (text for text in result.remarks if "by the phases of all modes" in text)
    delays = re.findall(r"'floor (\d)' by ([\d.]+) ± ([\d.]+) s \((late|early)\)", said)
    assert [(floor, word) for floor, *_, word in delays] == [("1", "late"), ("3", "early")]
    for (_, delay, deviation, _), true in zip(delays, (0.015, 0.008), strict=True):
        assert float(delay) == pytest.approx(true, abs=3.0 * float(deviation))
        assert 1e-4 < float(deviation) < 0.003


def test_harmonics_are_taken_out_and_said():
    """Each half as strong as all motion, between two modes and 1 % beside one."""
    record = simulated(3)
    times = np.arange(record.n_samples) / record.rate_hz
    sines = sum(np.sin(2.0 * np.pi * hz * times + 1.0) for hz in (1.7, 2.63))
    pattern = np.array([[0.5], [1.0], [0.7]]) * 0.5 * record.samples.std()
    disturbed = changed(record, record.samples + pattern * sines)
    result = bs.identify(disturbed, BAND, at=TRUTH.frequencies_hz)
    assert all_errors_within_four(result.quoted)
    for hz in (1.7, 2.63):
        assert any(f"a line at {hz:.4g} Hz" in text for text in result.remarks)


def test_a_quake_in_an_ambient_record_is_left_out():
    record = simulated(0)
    times = np.arange(record.n_samples) / record.rate_hz
    after = np.maximum(times - 600.0, 0.0)
    envelope = after**2 * np.exp(-after / 3.0) / (36.0 * np.exp(-2.0))
    quake = simulated_record(STRUCTURE, SENSORS, np.random.default_rng(50), ground=True)
    only_then = quake.samples + 3.0 * quake.samples.std() * np.sin(2.0 * np.pi * 1.7 * times)
    result = bs.identify(changed(record, record.samples + 30.0 * envelope * only_then), BAND)
    assert any("not used, has a clear peak at 1.7" in text for text in result.remarks)
    assert not result.failed_checks
    assert all_errors_within_four(result.quoted)
    (said,) = [text for text in result.remarks if "is left out" in text]
    start, end = (float(said.split()[i]) for i in (1, 3))
    assert 580.0 < start < 605.0
    assert 620.0 < end < 700.0


def shaken(seed, n=12_000, starts=(20.0, 90.0, 130.0)):
    """Quakes of coloured ground motion, and the absolute accelerations of the frame."""
    rng, rate = np.random.default_rng(seed), 50.0
    times = np.arange(n) / rate
    ground = np.zeros(n)
    for start in starts:
        after = np.maximum(times - start, 0.0)
        ground += after**2 * np.exp(-after / 2.0) * rng.standard_normal(n)
    at_hz = np.fft.rfftfreq(2 * n, 1.0 / rate)
    lines = np.fft.rfft(ground, 2 * n) / (1.0 + 1j * at_hz / 2.0)
    lines[0] = 0.0
    model = STRUCTURE.modal_model(np.empty((1, 0)))
    at_sensors = STRUCTURE.sensor_matrix(SENSORS).apply(model.shapes)[0]
    beta = model.frequencies_hz / np.maximum(at_hz, 1e-9)[:, None]
    h = 1.0 / (1.0 - beta**2 - 0.04j * beta)
    # Relative to the ground, and with it.
    amplification = 1.0 - (h * model.participation[0]) @ at_sensors.T
    samples = np.fft.irfft(np.vstack([lines, amplification.T * lines]), 2 * n)[:, :n]
    samples += 0.01 * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    return bs.Record(samples, rate, ("ground", *SENSORS), "acceleration", "m/s2")


def test_quakes_are_used_where_the_motion_of_the_ground_is_measured():
    for seed in (1, 2):
        found = bs.identify(shaken(seed), BAND, ground="ground" if seed == 1 else None)
        assert found.quoted.sensors == SENSORS
        assert len(found.modes) == 4
        off_f, off_shapes = errors(found.quoted)
        assert np.abs(off_f).max() < 4.0
        assert np.abs(off_shapes).max() < 4.0
        assert (of_modes(found.quoted, "frequency_cov") < 0.01).all()
        assert len(found.remarks) == (seed != 1)
        assert found.loads == "the motion of sensor 'ground'"


@pytest.mark.parametrize("seed", [0, 1])
def test_dampings_are_right_where_the_ground_moves_early(seed):
    """2 %; without rest before the record, that of the last mode is 5.7 and 4.4 errors too low."""
    found = bs.identify(shaken(seed, 6_000, (5.0,)), BAND, ground="ground")
    off = (of_modes(found, "damping") - 0.02) / of_modes(found, "damping_sd")
    assert len(off) == 4
    assert np.abs(off).max() < 3.0


def test_a_sensor_on_the_ground_that_drives_nothing_is_one_like_the_others():
    ambient = simulated(0)
    noise = np.random.default_rng(1).standard_normal((1, ambient.n_samples)) * 0.01
    rows = np.vstack([noise, ambient.samples])
    named = bs.Record(rows, ambient.rate_hz, ("Ground", *SENSORS), "acceleration", "m/s2")
    found = bs.identify(named, BAND, at=TRUTH.frequencies_hz)
    assert found.quoted.sensors == SENSORS
    assert found.left_out[0][0] == "Ground"
    assert "noise alone" in found.left_out[0][1]
    with pytest.raises(ValueError, match="no sensor measured what modes are identified from; sens"):
        bs.identify(named, BAND, ground="Ground")
    np.testing.assert_allclose(found.quoted.frequencies_hz, TRUTH.frequencies_hz, rtol=0.01)


def test_a_clear_peak_without_a_mode_is_named():
    candidates = identified(0, ground=False).candidates
    named = peaks_without_mode(candidates.peaks, [], BAND)
    clear = [peak.frequency_hz for peak in candidates.peaks if peak.is_clear]
    assert [hz for hz, _ in named] == [hz for hz in clear if BAND[0] < hz < BAND[1]]
    assert len(named) >= 3
    assert all("explained by no mode there" in why for _, why in named)
    assert not peaks_without_mode(candidates.peaks, list(identified(0, ground=False).bands), BAND)


def test_modes_that_given_frequencies_leave_out_fail_a_check():
    result = bs.identify(simulated(2, duration_s=600.0), (2.2, 4.4), at=[2.8, 4.0])
    assert result.failed_checks
    assert len(result.modes) == 2


@pytest.mark.parametrize(
    ("two", "is_open", "words"),
    [(0.04, False, "0.040; modes of"), (0.06, True, "0.060: the record can"), (None, False, "no")],
)
def test_a_peak_says_what_the_record_can_tell(two, is_open, words):
    """Between 0.05 and 0.95 it cannot; an undecided one is a doubt of its band."""
    peak = Peak((2.0,), (0,), two, 0.1, 0.05, 1.0)
    assert peak.is_open == is_open
    assert words in str(peak)
    band = identified(0, ground=False).bands[1]
    undecided = replace(band, peaks=(ExplainedPeak((0,), -5.0, None, is_undecided=True),))
    assert band.doubt is None
    assert undecided.doubt.endswith("it is undecided whether a peak holds one mode or two")
    assert ExplainedPeak((0,), 0.0, two and math.log(two)).probabilities[1] == (
        two and pytest.approx(two / (2.0 + two))
    )


@pytest.mark.parametrize("seed", [3, 6])  # with the latter, one source seems more probable first
def test_two_shapes_at_one_frequency_are_two_modes(seed):
    """Equal poles, orthogonal shapes: the plane that the shapes span is known, and P(two)."""
    rng, rate, n = np.random.default_rng(seed), 20.0, 12_000
    directions = np.linalg.qr(rng.standard_normal((4, 2)))[0]
    pole = np.exp((-0.012 + 1j) * 2.0 * np.pi * 2.0 / rate)
    recursion = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    modal = lfilter([1.0, -2.0, 1.0], recursion, rng.standard_normal((2, n)) * [[1.0], [0.7]])
    samples = directions @ modal + 0.05 * rng.standard_normal((4, n))
    result = bs.identify(bs.Record(samples, rate, tuple("abcd"), "acceleration", "g"), (1.45, 2.7))
    assert not result.failed_checks
    (peak,) = result.peaks
    assert len(peak.frequencies_hz) == 2
    assert peak.probability_of_two > 0.999
    frequencies = np.log(np.array(peak.frequencies_hz) / 2.0)
    assert np.abs(frequencies / of_modes(result.quoted, "frequency_cov")).max() < 3.0
    cosines = np.linalg.svd(directions.T @ np.linalg.qr(result.quoted.unit_shapes)[0])[1]
    assert cosines.min() > 0.999


BROAD = Resonances(
    np.array([0.86, 1.14, 3.1]),
    np.array([0.065, 0.08, 0.01]),
    np.array([[0.3, 0.32, 0.8], [0.55, 0.6, 0.3], [0.78, 0.73, -0.5]]),
)


@cache
def with_broad_modes():
    """Of a damper: two modes 28 % apart, of nearly one shape; and a third."""
    rng, (true_hz, dampings, shapes) = np.random.default_rng(3), BROAD
    samples = stationary(
        lambda hz: spectra_of(true_hz, (shapes, shapes), dampings, hz), 12000, 8.0, rng
    )
    samples += 0.03 * samples.std(1, keepdims=True) * rng.standard_normal(samples.shape)
    return bs.Record(samples, 8.0, ("a", "b", "c"), "acceleration", "g")


@pytest.mark.parametrize(
    ("hz", "shapes"),
    [([2.0, 3.1], [[1.0, 0.0], [0.5, 0.0], [0.0, 1.0]]),
     ([2.0, 2.012], [[0.6, 0.8], [0.8, -0.6], [0.3, 0.5]])],
    ids=["in two directions", "close"],
)  # fmt: skip
def test_a_sensor_with_a_peak_is_not_noise_alone_though_no_other_follows_it(hz, shapes):
    rng, true_hz, shapes = np.random.default_rng(0), np.array(hz), np.array(shapes)
    damped = partial(spectra_of, true_hz, (shapes, shapes), np.full(2, 0.004))
    samples = stationary(damped, 18_000, 20.0, rng)
    samples += 0.02 * samples.std() * rng.standard_normal(samples.shape)
    found = bs.identify(bs.Record(samples, 20.0, tuple("abc"), "acceleration", "g"), (1.5, 4.0))
    assert not found.left_out
    off = np.log(found.quoted.frequencies_hz / true_hz) / of_modes(found.quoted, "frequency_cov")
    assert np.abs(off).max() < 4.0


def test_broad_modes_are_not_left_to_the_background_of_a_narrow_band():
    """A narrow band shows one of them."""
    found = bs.identify(with_broad_modes(), (0.45, 2.0))
    off = np.log(found.quoted.frequencies_hz / BROAD[0][:2]) / of_modes(found, "frequency_cov")
    assert np.abs(off).max() < 3.0


def test_broad_modes_are_tried_where_all_peaks_are_narrow():
    """Peaks of noise, each in a band of its own whose background explains it."""
    transforms = usable_motion(with_broad_modes(), (0.45, 2.0), None).transforms()
    hz = np.array([0.62, 0.8, 0.93, 1.06, 1.3])
    peaks = Resonances(hz, np.full(5, 0.005), np.tile(BROAD.shapes[:, :1], 5))
    possible = Candidates((), peaks, BROAD.at([0, 1]), np.full(2, 0.4), np.empty((2, 0)))
    (band,) = explain(transforms, possible, (0.45, 2.0), fixed=False, is_driven=False)
    sds = np.sqrt(band.fit.covariance.diagonal()[:2])
    assert np.abs(np.log(band.modes.frequencies_hz / BROAD[0][:2]) / sds).max() < 3.0


@pytest.mark.parametrize(("damping", "said"), [(0.03, 0), (0.05, 1)])
def test_a_mode_much_broader_than_the_others_may_be_two(damping, said):
    """Three times as broad, by more than two standard deviations of 0.003."""
    modes = [SimpleNamespace(damping=z, damping_sd=0.003) for z in (damping, 0.01, 0.012)]
    data = SimpleNamespace(modes=modes)
    peaks = [Peak((f,), (i,), None, 0.1, 0.05, 1.0) for i, f in enumerate((1.0, 3.0, 5.0))]
    sentences = list(broad_modes(data, peaks))
    assert len(sentences) == said
    assert all("at 1 Hz: its damping, 5 %, is far above the usual 1.1 %" in s for s in sentences)
    assert not list(broad_modes(data, [replace(peaks[0], modes=(0, 1))]))  # two already


def test_what_a_background_of_any_shape_costs():
    """Of one mode alone: ζ / (2π N_c) is the variance of ln f under white noise (Au 2014).

    What lies beside a mode may be anything smooth and coherent with it: claimed deviations are
    larger than that by up to two and a half times, and not smaller.
    """
    result = bs.identify(simulated(0), (0.75, 1.25), at=[0.98])
    cycles = TRUTH.frequencies_hz[0] * 1200.0
    expected = np.sqrt(of_modes(result.quoted, "damping")[0] / (2.0 * np.pi * cycles))
    assert 1.0 < of_modes(result.quoted, "frequency_cov")[0] / expected < 2.5
    data = result.modal_data("test")
    assert (data.labels, data.sensors, data.band_hz) == (("1",), SENSORS, (0.75, 1.25))
    assert data.modes[0].frequency_cov == pytest.approx(of_modes(result.quoted, "frequency_cov")[0])


def test_a_climb_that_does_not_end_fails_a_check():
    record = simulated(2, duration_s=300.0)
    whole = bs.identify(record, BAND, at=TRUTH.frequencies_hz)
    band = whole.bands[0]
    fitter = Fitter(band.fit.data, band.fit.one_source)
    start = whole.candidates.of_peaks.at([0]).in_directions(band.fit.data)
    stopped = replace(band, fit=fitter.fit(start, has_phases=False, most_steps=1))
    assert "the most probable modes were not reached" in stopped.doubt
    (peak,) = quoted_modes(record, BAND, [(stopped, [0])], range(len(record.sensors)))[1]
    assert peak.probability_of_two is None
    assert str(peak).endswith("the spectra around it are not explained")


def test_what_cannot_be_identified_is_refused():
    record = simulated(0, duration_s=60.0)
    with pytest.raises(ValueError, match="30 Hz is beyond 25 Hz, half the rate of the record"):
        bs.identify(record, (0.5, 30))
    with pytest.raises(ValueError, match=r"at: frequencies must be within 0.6 to 4.6 Hz, got \[7"):
        bs.identify(record, BAND, at=[7.0])
    with pytest.raises(ValueError, match=r"ground: no sensor 'base'; the record's sensors are"):
        bs.identify(record, BAND, ground="base")
    with pytest.raises(ValueError, match="ground: 'floor 1' is the record's only sensor"):
        bs.identify(record.selected(SENSORS[:1]), BAND, ground="floor 1")


@pytest.mark.parametrize("method", [fdd, tfie])
def test_simple_methods_find_the_modes(method):
    """To a line or two of their spectra: 0.012 Hz and 0.03 Hz; shapes of the paper's quality."""
    found = method(simulated(3), BAND, near=TRUTH)
    np.testing.assert_allclose(found.frequencies_hz, TRUTH.frequencies_hz, atol=0.06)
    assert np.abs((found.unit_shapes * TRUTH.shapes).sum(0)).min() ** 2 > 0.99
    with pytest.raises(ValueError, match=r"the record lasts 30 s; from 0\.6 Hz on"):
        method(simulated(3, duration_s=30.0), BAND, near=TRUTH)
    twins = TRUTH._replace(frequencies_hz=TRUTH.frequencies_hz[[0, 0, 1]])
    with pytest.raises(ValueError, match=r"two of the modes at .* Hz have one peak"):
        method(simulated(3), BAND, near=twins)


def test_methods_are_compared_and_one_of_them_is_used():
    record, result = simulated(0), identified(0, ground=False)
    modes = compared(record, result.quoted)
    assert list(modes) == list(METHOD_NAMES)
    era = modes["next-era"]
    np.testing.assert_allclose(era.frequencies_hz, TRUTH.frequencies_hz, rtol=0.01)
    assert (np.abs((era.unit_shapes * TRUTH.shapes).sum(0)) > 0.99).all()
    data = modes_by("fdd", record, result.quoted)
    assert data.modes[0].frequency_cov is None
    np.testing.assert_allclose(data.frequencies_hz, TRUTH.frequencies_hz, atol=0.06)
    with pytest.raises(ValueError, match="method must be one of 'bayesian-fft', 'next-era'"):
        modes_by("efdd", record, result.quoted)
    beside = TRUTH._replace(frequencies_hz=TRUTH.frequencies_hz + 0.35)
    with pytest.raises(ValueError, match=r"NExT-ERA: orders do not agree on the modes at 1\.3"):
        next_era(simulated(1), BAND, beside)


@pytest.mark.parametrize(
    ("mass", "n_modes", "low", "high"), [(0.0163, 2, 0.95, 1.0), (0.0028, 1, 0.0, 0.05)]
)
def test_a_peak_holds_two_modes_with_a_probability(mass, n_modes, low, high):
    """Infills that split the second mode by 1.2 and by 0.5 half-power bandwidths.

    Each of the former has its own shape. The latter are too close, and that is said: for what can
    be told at 0.02 of damping, see the closed form in explained_band.py: (4 n / (π ζ f T))^(1/4)
    bandwidths apart gain n nats.
    """
    structure = with_infill(mass=mass)
    truth = truth_of(structure, SENSORS, 0.02)
    record = simulated_record(structure, SENSORS, np.random.default_rng(1))
    result = bs.identify(record, BAND)
    assert [len(peak.frequencies_hz) for peak in result.peaks] == [1, n_modes, 1]
    peak = result.peaks[1]
    assert low <= (peak.probability_of_two or 0.0) <= high
    if n_modes == 2:
        assert all_errors_within_four(result.quoted, truth)
        given = bs.identify(record, BAND, at=[1.0, 2.8, 4.04])
        assert len(given.modes) == 3  # modes given by hand are kept, and the doubt is said
        assert given.peaks[1].probability_of_two > 0.95
    else:
        assert truth.frequencies_hz[2] - truth.frequencies_hz[1] < peak.resolution_hz
        assert "could not be told apart" in str(peak)


def test_nothing_is_claimed_of_damping_and_shape_of_a_short_record():
    truth = truth_of(FRAME, SENSORS, damping=0.02)
    record = simulated_record(FRAME, SENSORS, np.random.default_rng(4), duration_s=25.0)
    result = bs.identify(record, BAND, at=truth.frequencies_hz)
    lengths = of_modes(result.quoted, "damping") * result.quoted.frequencies_hz * 25.0
    assert result.too_short == tuple(np.flatnonzero(lengths < 1.0))
    assert result.too_short
    data = result.modal_data("test")
    for i, mode in enumerate(data.modes):
        assert (mode.shape is None) == (mode.damping is None) == (i in result.too_short)
    first = result.too_short[0]
    shapes = slice(3 + 3 * first, 6 + 3 * first)  # frequencies come first
    assert not data.covariance[shapes].any()
    assert np.sqrt(data.covariance[0, 0]) == data.modes[0].frequency_cov
    assert "nothing is claimed of its damping and shape" in result.remarks[-1]


def test_complexity_of_shapes(monkeypatch):
    """(1, i) has no line; (1, e^iα) has a collinearity of cos² α, and α/2 to either side."""
    real = identified(0, ground=False)
    assert min(mode.mpc for mode in real.modes) > 0.995
    assert max(mode.mean_phase_deg for mode in real.modes) < 2.5
    alpha = np.radians(20.0)
    shapes = np.array([[1.0, 1.0, 2.0], [1j, np.exp(1j * alpha), -1.0]])
    monkeypatch.setattr(explained_band, "complex_shapes", lambda _: (None, shapes, None))
    mpc, phases = explained_band.Explained(None, (), True).complexity([0, 1, 2], [0, 1])
    np.testing.assert_allclose(mpc, [0.0, np.cos(alpha) ** 2, 1.0], atol=1e-12)
    np.testing.assert_allclose(phases[1:], [10.0, 0.0], atol=1e-6)
