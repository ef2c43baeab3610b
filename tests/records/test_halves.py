"""Errors grow where the halves of a record disagree, and only there; skewed clocks are said."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.measurements.records.explained_band import Explained
from bayes_ssi.measurements.records.halves import growth_by_halves, skewed_clocks
from bayes_ssi.measurements.records.modal_identification import _clocks_at_fault
from bayes_ssi.measurements.records.spectra import Resonances, transforms_of

RATE, N = 20.0, 24_000
SHAPES = np.array([[0.526, 0.851], [0.851, -0.526]])


def samples(seed, hz, first=SHAPES[:, 0], zeta=0.02):
    """Accelerations of two modes under white loads, exact at the rate and stationary."""
    rng = np.random.default_rng(seed)
    both = 0.02 * rng.standard_normal((2, N // 2))
    for shape, f in zip((first, SHAPES[:, 1]), (hz, 2.62), strict=True):
        pole = np.exp(2 * np.pi * f / RATE * (-zeta + 1j * np.sqrt(1 - zeta**2)))
        recursion = [1.0, -2.0 * pole.real, abs(pole) ** 2]
        motion = lfilter([1.0, -2.0, 1.0], recursion, rng.standard_normal(N))
        both += np.outer(shape, motion[N // 2 :])
    return both


def identified(*halves, at=(1.02, 2.62)):
    record = bs.Record(np.hstack(halves), RATE, ("a", "b"), "acceleration", "m/s2")
    return bs.identify(record, (0.5, 4.0), at=at)


def said(found):
    return [text for text in found.remarks if "halves" in text]


def test_halves_of_stationary_records_agree():
    for seed in range(2):
        assert not said(identified(samples(seed, 1.0), samples(100 + seed, 1.0)))
    # Short records, of 100 cycles each, have none.
    assert not said(identified(samples(0, 1.0)[:, :2000], samples(1, 1.04)[:, :2000]))


def test_errors_cover_a_frequency_that_changes():
    """From 1.00 to 1.04 Hz: the error of the mean, half of the difference, is 2 %."""
    found = identified(samples(0, 1.0), samples(1, 1.04))
    assert "differ in frequency by more than their errors" in said(found)[0]
    first, second = found.quoted.modes
    assert first.frequency_cov == pytest.approx(0.5 * np.log(1.04), rel=0.3)
    assert first.frequency_hz == pytest.approx(1.02, rel=2.0 * first.frequency_cov)
    assert second.frequency_cov < 0.003
    covariance = found.quoted.covariance
    assert covariance[0, 0] == pytest.approx(first.frequency_cov**2)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12


def turned(angle, sd, sign=1.0):
    """One mode at two sensors, whose shape is at an angle, known within sd across it."""
    shape = np.array([np.cos(angle), np.sin(angle)])
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = 1e-6 * np.eye(2)
    covariance[2:, 2:] = sd**2 * (np.eye(2) - np.outer(shape, shape))
    return Resonances(np.ones(1), np.array([0.02]), sign * shape[:, None]), covariance


@pytest.mark.parametrize(("degrees", "is_apart"), [(2.0, False), (10.0, True)])
def test_the_growth_of_an_error_of_a_shape(monkeypatch, degrees, is_apart):
    """Shapes δ apart, each known within σ, differ by √2 tan(δ/2) / σ errors of their difference.

    That is as the error of the mean, (δ/2) / (σ/√2); it grows beyond 3.3 errors. Signs are free.
    """
    delta, sd = np.radians(degrees), 0.01
    halves = [turned(0.4, sd), turned(0.4 + delta, sd, sign=-1.0)]
    monkeypatch.setattr(Explained, "estimates", lambda self, *_: self.fit.modes)
    fits = [SimpleNamespace(modes=h, converged=True, are_modes=np.ones(1, bool)) for h in halves]
    band = Explained(None, (), True, tuple(fits))
    growth = growth_by_halves(band, [0], [0, 1], turned(0.4, sd / np.sqrt(2.0))[1])
    expected = np.sqrt(2.0) * np.tan(0.5 * delta) / sd
    assert (expected > 3.3) == is_apart
    np.testing.assert_allclose(growth[:, 0], [1.0, 1.0, expected if is_apart else 1.0], rtol=1e-6)


def test_one_mode_whose_shape_changes_is_no_pair():
    """By 6 degrees: the mean of both halves has two shapes at one frequency, but neither half."""
    turn = np.radians(6.0)
    turn = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    found = identified(samples(2, 1.0), samples(3, 1.0, turn @ SHAPES[:, 0]), at=())
    (failed,) = found.failed_checks
    assert "two modes share a peak of the whole record, but not of each half" in failed


def test_a_clock_of_another_rate_is_said():
    """A ten-thousandth over 20 minutes: 60 ms from the middle of one half to that of the other."""
    names = ("floor 1", "floor 2", "floor 3")
    record = simulated_record(with_infill(), names, np.random.default_rng(1))
    times = np.arange(record.n_samples) / record.rate_hz
    skewed = record.samples.copy()
    skewed[1] = np.interp(times * (1.0 - 1e-4), times, skewed[1])

    def found(samples):
        halves = (replace(record, samples=each) for each in np.split(samples, 2, axis=1))
        transforms = [transforms_of(half, (0.3, 6.0)) for half in halves]
        return skewed_clocks(transforms, np.array([0.983, 2.604, 3.005, 3.984]))

    (delay,) = found(skewed)
    assert delay.sensor == 1
    assert delay.seconds == pytest.approx(0.06, abs=3.0 * delay.deviation)
    (text,) = _clocks_at_fault(names, SimpleNamespace(doubtful=[]), [delay])
    assert text.startswith("sensor 'floor 2': its clock runs at another rate; it is later by 0.06")
    assert not found(record.samples)


def test_real_shapes_and_their_errors_do_not_depend_on_the_phase_of_complex_ones():
    band = identified(samples(0, 1.0), samples(1, 1.0)).bands[0]
    turn, fit, r = np.exp(0.7j), band.fit, len(band.fit.modes.shapes)
    whole = np.eye(2 + 2 * r)
    whole[2:, 2:] = np.kron([[turn.real, -turn.imag], [turn.imag, turn.real]], np.eye(r))
    modes = fit.modes._replace(shapes=turn * fit.modes.shapes)
    turned = replace(
        fit, model=fit.model._replace(modes=modes), covariance=whole @ fit.covariance @ whole.T
    )
    (_, _, shapes), errors = band.estimates([0], [0, 1])
    (_, _, of_turned), errors_of_turned = replace(band, fit=turned).estimates([0], [0, 1])
    np.testing.assert_allclose(of_turned, shapes, rtol=1e-9)
    np.testing.assert_allclose(errors_of_turned, errors, rtol=1e-6, atol=1e-12)
