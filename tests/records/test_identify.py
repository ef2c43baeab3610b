"""Modes from simulated records: right within their claimed errors, which the checks judge."""

import sys
from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import chi2
from simulated_records import FRAME, simulated_record, truth_of, with_infill

import bayes_ssi as bs
from bayes_ssi.records.fdd import fdd
from bayes_ssi.records.modal_estimates import Poles
from bayes_ssi.records.ssi_cov import ssi_cov
from bayes_ssi.records.tfie import tfie

SENSORS = ("floor 1", "floor 2", "floor 3")
BAND = (0.6, 4.6)
STRUCTURE = with_infill()
TRUTH = truth_of(STRUCTURE, SENSORS, damping=0.02)


def simulated(seed, **changed):
    return simulated_record(STRUCTURE, SENSORS, np.random.default_rng(seed), **changed)


@cache
def identified(seed, *, ground=False):
    return bs.identify(simulated(seed, ground=ground), BAND)


def errors(estimates):
    """Frequencies' and shapes' errors in claimed standard deviations."""
    frequencies = np.log(estimates.frequencies_hz / TRUTH.frequencies_hz) / estimates.frequency_covs
    cosines = np.abs((estimates.shapes * TRUTH.shapes).sum(0))
    return frequencies, np.sqrt(2 - 2 * cosines) / (estimates.shape_sds * np.sqrt(2))


@pytest.mark.parametrize(
    ("ground", "loads"), [(False, "independent loads"), (True, "ground motion in one direction")]
)
def test_four_modes_with_errors_that_are_right(ground, loads):
    """Of two records: four modes each, and squares of errors as chi-square has them.

    Shapes at three sensors have two components each: their squares have that mean.
    """
    of_frequencies, of_shapes = [], []
    for seed in range(2):
        result = identified(seed, ground=ground)
        assert str(result.fit.loads) == loads
        assert result.quoted is result.bayesian
        assert not result.failed_checks
        assert 0.9 < result.fit.whiteness < result.fit.allowed_whiteness
        for estimates in (result.bayesian, result.era):
            frequencies, shapes = errors(estimates)
            assert np.abs(frequencies).max() < 4.0
            assert shapes.max() < 4.0
        frequencies, shapes = errors(result.quoted)
        of_frequencies.append(frequencies)
        of_shapes.append(shapes)
    squares = np.array(of_frequencies) ** 2
    assert chi2(8).cdf(squares.sum()) == pytest.approx(0.5, abs=0.495)
    squares = 2.0 * np.array(of_shapes) ** 2
    assert chi2(16).cdf(squares.sum()) == pytest.approx(0.5, abs=0.495)


def test_loads_may_be_coloured():
    """Independent loads, low-passed at 1 Hz: modes and the spectrum's slope are right.

    ln S = -ln(1 + f²) has the slope -2 f² / (1 + f²) over ln f.
    """
    record, decay = simulated(5, duration_s=600.0), np.exp(-2.0 * np.pi / 50.0)
    samples = lfilter([1.0 - decay], [1.0, -decay], record.samples, axis=1)
    result = bs.identify(bs.Record(samples, 50.0, SENSORS, "acceleration", "m/s2"), BAND)
    assert result.quoted is result.bayesian
    assert not result.failed_checks
    frequencies, shapes = errors(result.quoted)
    assert max(np.abs(frequencies).max(), shapes.max()) < 4.0
    model = result.fit.model
    covariance = np.linalg.inv(result.fit.curvature)[model.layout.colour, model.layout.colour]
    slope = -2.0 * model.middle_hz**2 / (1.0 + model.middle_hz**2)
    assert model.colour[0] == pytest.approx(slope, abs=4.0 * np.sqrt(covariance[0, 0]))
    assert covariance[0, 0] < 0.1**2


@pytest.mark.parametrize(("strength", "fails"), [(5.0, True), (1.0, False), (0.0, False)])
def test_a_shock_is_said_and_fails_a_check_where_it_moves_modes(strength, fails):
    """All modes decay freely from halfway on, at first with so many times the usual motion."""
    record = simulated(0, duration_s=600.0)
    samples, after = np.array(record.samples), np.maximum(np.arange(30_000) / 50.0 - 300.0, 0.0)
    for frequency, shape in zip(TRUTH.frequencies_hz, TRUTH.shapes.T, strict=True):
        omega = 2.0 * np.pi * frequency
        decay = np.sin(omega * after) * np.exp(-0.02 * omega * after)
        samples += strength * samples.std(axis=1).mean() * np.outer(shape, decay)
    result = bs.identify(bs.Record(samples, 50.0, SENSORS, "acceleration", "m/s2"), BAND)
    said = [text for text in (*result.remarks, *result.failed_checks) if "stationary" in text]
    assert bool(said) == (strength > 0.0)
    assert any(text in result.failed_checks for text in said) == fails
    if said:
        assert said[0].startswith("the loads about 300") or said[0].startswith(
            "the loads about 299"
        )


def test_what_is_quoted_is_as_sharp_as_the_record_allows():
    """Of one mode alone in a band: ζ / (2π N_c) is the variance of ln f (Au 2014, long data)."""
    result = bs.identify(simulated(0), (0.75, 1.25), at=[0.98])
    cycles = TRUTH.frequencies_hz[0] * 1200.0
    expected = np.sqrt(result.quoted.dampings[0] / (2.0 * np.pi * cycles))
    # Lines beyond the band, 5 % of the information there, and overlapping tapers, 9 %.
    assert result.quoted.frequency_covs[0] == pytest.approx(1.07 * expected, rel=0.07)
    data = result.modal_data("test")
    assert (data.labels, data.sensors, data.band_hz) == (("1",), SENSORS, (0.75, 1.25))
    assert data.modes[0].frequency_cov == pytest.approx(result.quoted.frequency_covs[0])


def test_integrated_records_have_the_same_modes():
    record = simulated(1, duration_s=300.0)
    lines = np.fft.rfft(record.samples)
    lines[:, 0] = 0.0
    lines[:, 1:] /= 2j * np.pi * np.fft.rfftfreq(record.n_samples, 1.0 / record.rate_hz)[1:]
    velocity = np.fft.irfft(lines, record.n_samples)
    integrated = bs.Record(velocity, record.rate_hz, SENSORS, "velocity", "m/s")
    of_velocity, of_acceleration = (
        bs.identify(each, BAND, at=TRUTH.frequencies_hz).bayesian for each in (integrated, record)
    )
    moves = np.log(of_velocity.frequencies_hz / of_acceleration.frequencies_hz)
    np.testing.assert_allclose(moves / of_acceleration.frequency_covs, 0.0, atol=0.3)


def test_a_spectral_model_that_is_wrong_is_not_quoted():
    """One mode where there are two is not white: NExT-ERA is quoted, and that is said."""
    record = simulated(2, duration_s=600.0)
    result = bs.identify(record, (2.2, 4.4), at=[2.8, 4.0])
    assert not result.fit.is_white
    assert result.quoted is result.era
    assert "NExT-ERA is quoted" in result.remarks[-1]
    # What the Bayesian FFT made of two modes is neither of them, and neither one mode nor two.
    assert "differ by" in result.failed_checks[0]
    assert [peak.probability_of_two is None for peak in result.peaks] == [True, False]
    assert str(result.peaks[0]).endswith("one mode or two, no model explains the spectra around it")


def test_a_resonance_that_no_structure_has_is_no_mode():
    """Where loads have a spectrum of their own, such resonances would stand for it."""
    result = bs.identify(simulated(0, damping=0.4, duration_s=300.0), BAND, at=[1.0, 3.0])
    assert not result.fit.are_modes.all()
    assert any(
        "more damping than the 20% that a structure" in text for text in result.failed_checks
    )


def test_a_mode_that_one_method_alone_has_fails_a_check():
    """In the noise between two modes the Bayesian FFT finds one more if it must."""
    result = bs.identify(simulated(2, duration_s=300.0), BAND, at=[*TRUTH.frequencies_hz, 1.7])
    assert result.era is None
    assert "NExT-ERA: no order shows the modes at" in result.failed_checks[0]


def test_a_climb_that_does_not_end_is_not_quoted(monkeypatch):
    monkeypatch.setattr("bayes_ssi.records.scoring.MOST_STEPS", 2)
    result = bs.identify(simulated(2, duration_s=300.0), BAND, at=TRUTH.frequencies_hz)
    assert not result.fit.settled
    assert result.quoted is result.era
    assert "did not reach its most probable modes; NExT-ERA is quoted" in result.remarks[-1]


@pytest.mark.parametrize(
    ("duration", "changed", "message"),
    [
        (60.0, {}, "the record is too short to look for modes; give their frequencies as at"),
        (60.0, {"band_hz": (0.5, 30)}, "30 Hz is beyond 25 Hz, half the rate of the record"),
        (60.0, {"at": [7.0]}, r"at: frequencies must be within 0.6 to 4.6 Hz, got \[7.0\]"),
        (
            8.0,
            {"at": [1.0, 1.1, 1.2, 1.3], "band_hz": (0.6, 1.7)},
            "the band has 6 lines of 3 sensors, fewer than the 30 unknowns",
        ),
    ],
)
def test_what_cannot_be_identified_is_refused(duration, changed, message):
    record = simulated(0, duration_s=duration)
    with pytest.raises(ValueError, match=message):
        bs.identify(record, **{"band_hz": BAND} | changed)


@pytest.mark.parametrize("method", [fdd, tfie])
def test_simple_methods_find_the_modes(method):
    """To a line or two of their spectra: 0.012 Hz and 0.03 Hz; shapes of the paper's quality."""
    found = method(simulated(3), BAND, near=TRUTH.frequencies_hz)
    np.testing.assert_allclose(found.frequencies_hz, TRUTH.frequencies_hz, atol=0.06)
    cosines = np.abs((found.shapes * TRUTH.shapes).sum(0))
    assert cosines.min() ** 2 > 0.99
    with pytest.raises(ValueError, match=r"the record lasts 30 s; from 0\.6 Hz on"):
        method(simulated(3, duration_s=30.0), BAND, near=TRUTH.frequencies_hz)


def test_ssi_through_pyoma2_agrees_with_the_bayesian_fft():
    """From one record, to three of its own standard deviations, which are twice as large."""
    pytest.importorskip("pyoma2", reason="pip install bayes_ssi[oma]")
    record = simulated(1)
    found = ssi_cov(record, BAND, Poles(*TRUTH))
    result = identified(1)
    apart = found.poles.frequencies_hz - result.quoted.frequencies_hz
    assert np.abs(apart / found.frequency_sds).max() < 3.0
    assert (np.abs((found.poles.shapes * TRUTH.shapes).sum(0)) > 0.999).all()
    ratios = found.frequency_sds / result.quoted.frequencies_hz / result.quoted.frequency_covs
    assert ((ratios > 1.0) & (ratios < 3.0)).all()


def test_ssi_without_pyoma2_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoma2", None)
    monkeypatch.setitem(sys.modules, "pyoma2.functions", None)
    with pytest.raises(ValueError, match=r"pip install \"bayes_ssi\[oma\]\""):
        ssi_cov(simulated(1, duration_s=60.0), BAND, Poles(*TRUTH))


@pytest.mark.parametrize(
    ("mass", "n_modes", "low", "high"), [(0.0163, 2, 0.95, 1.0), (0.0028, 1, 0.0, 0.05)]
)
def test_a_peak_holds_two_modes_with_a_probability(mass, n_modes, low, high):
    """Infills that split the second mode by 1.2 and by 0.5 half-power bandwidths.

    The latter are too close, and that is said: for what can be told at 0.02 of damping, see the
    closed form in peaks.py: a separation of (4 n / (π ζ f T))^(1/4) bandwidths gains n nats.
    """
    structure = with_infill(mass=mass)
    truth = truth_of(structure, SENSORS, 0.02)
    record = simulated_record(structure, SENSORS, np.random.default_rng(1))
    result = bs.identify(record, BAND)
    assert [len(peak.frequencies_hz) for peak in result.peaks] == [1, n_modes, 1]
    peak = result.peaks[1]
    assert low <= peak.probability_of_two <= high
    apart = truth.frequencies_hz[2] - truth.frequencies_hz[1]
    assert (apart > peak.resolution_hz) == (n_modes == 2)
    if n_modes == 2:
        deviations = np.log(result.quoted.frequencies_hz / truth.frequencies_hz)
        assert np.abs(deviations / result.quoted.frequency_covs).max() < 4.0
        given = bs.identify(record, BAND, at=[1.0, 2.8, 4.04])
        assert given.quoted.n_modes == 3  # modes given by hand are kept, and the doubt is said
        assert given.peaks[1].probability_of_two > 0.95
    else:
        assert "could not be told apart" in str(peak)


def test_each_mode_of_a_close_pair_has_its_own_shape():
    """1.2 bandwidths apart; this record's fit with the shapes exchanged settles, 65 nats below."""
    structure = with_infill(mass=0.0163)
    truth = truth_of(structure, SENSORS, damping=0.02)
    record = simulated_record(structure, SENSORS, np.random.default_rng(2))
    found = bs.identify(record, BAND).quoted
    cosines = np.abs((found.shapes * truth.shapes).sum(0))
    assert (np.sqrt(2.0 - 2.0 * cosines) < 4.0 * np.sqrt(2.0) * found.shape_sds).all()


def test_the_gain_by_a_second_mode_is_as_small_as_stated():
    """The least mean divergence of one resonance from two, d bandwidths apart: (π/4) d⁴ a unit."""
    x = np.linspace(-200.0, 200.0, 80_001)
    apart = 0.1
    two = 0.5 / ((x - apart) ** 2 + 1.0) + 0.5 / ((x + apart) ** 2 + 1.0)

    def divergence(parameters):
        ratio = two * (x**2 + np.exp(parameters[1])) / np.exp(parameters[0])
        return (ratio - 1.0 - np.log(ratio)).sum() * (x[1] - x[0])

    least = minimize(divergence, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-7}).fun
    assert least == pytest.approx(np.pi / 4.0 * apart**4, rel=0.03)


def test_nothing_is_claimed_of_damping_and_shape_of_a_short_record():
    truth = truth_of(FRAME, SENSORS, damping=0.02)
    record = simulated_record(FRAME, SENSORS, np.random.default_rng(4), duration_s=25.0)
    result = bs.identify(record, BAND, at=truth.frequencies_hz)
    assert 0 in result.too_short  # ζ f T = 0.5
    assert 2 not in result.too_short  # ζ f T = 2
    data = result.modal_data("test")
    assert data.modes[0].shape is None
    assert data.modes[0].damping is None
    assert data.modes[2].damping is not None
    # Frequencies come first, then three components of each shape.
    assert not data.covariance[3:6].any()
    assert data.covariance[9:12].any()
    assert np.sqrt(data.covariance[0, 0]) == data.modes[0].frequency_cov
    assert "nothing is claimed of its damping and shape" in result.remarks[-1]
