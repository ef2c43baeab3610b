"""Where halves of a record disagree errors grow; clocks that are late or skewed are said."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.measurements.records import late_clocks
from bayes_ssi.measurements.records.explained_band import Explained
from bayes_ssi.measurements.records.halves import growth_by_halves, skewed_clocks
from bayes_ssi.measurements.records.late_clocks import Delay, delays_of
from bayes_ssi.measurements.records.modal_identification import _clocks_at_fault
from bayes_ssi.measurements.records.spectra import Resonances, Transforms, transforms_of

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


def test_short_records_have_no_halves():
    """Of 100 cycles each."""
    found = identified(samples(0, 1.0)[:, :2000], samples(1, 1.04)[:, :2000])
    assert not said(found)


def test_a_clock_of_another_rate_is_said():
    """A ten-thousandth over 20 minutes: 60 ms from the middle of one half to that of the other."""
    names = ("floor 1", "floor 2", "floor 3")
    rng = np.random.default_rng(1)
    record = simulated_record(with_infill(), names, rng)
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
    (text,) = _clocks_at_fault(names, [], [delay])
    assert text.startswith("sensor 'floor 2': its clock runs at another rate; it is later by 0.06")
    assert not found(record.samples)


HZ = np.array([1.1, 3.0, 4.7, 6.2])
NOISE = 0.003


def shapes(rng, n, delays=(), own=()):
    """Turned shapes (n, m) with the delays in s of some sensors, and phases of some sensors."""
    real = np.zeros((n, len(HZ)))
    while np.abs(real[2]).min() < 0.1:  # at the nodes of most modes nothing is known of a clock
        real = np.linalg.qr(rng.standard_normal((n, len(HZ))))[0]
    angles = np.zeros(real.shape)
    for sensor, seconds in delays:
        angles[sensor] = -2.0 * np.pi * HZ * seconds
    for sensor, phases in own:
        angles[sensor] = phases
    return real * np.exp(1j * angles) + NOISE * 1j * rng.standard_normal(real.shape)


@pytest.mark.parametrize("n", [5, 12])
def test_delays_are_known_with_their_errors(n):
    """Of twenty sensors that are 6 to 40 ms late: squares over variances have a mean near 1."""
    rng = np.random.default_rng(n)
    covariances = np.tile(NOISE**2 * np.eye(n), (len(HZ), 1, 1))
    squares = []
    for true in np.linspace(0.006, 0.04, 20):
        (found,) = delays_of(shapes(rng, n, [(2, true)]), covariances, HZ)
        assert found.sensor == 2
        assert found.is_sure
        squares.append(((found.seconds - true) / found.deviation) ** 2)
    assert 0.4 < np.mean(squares) < 1.9  # of chi-square of 20: one in a thousand beyond either


def test_what_is_no_delay_is_not_said():
    """Sound shapes; phases of one sensor that do not grow with frequency; one mode alone."""
    rng, n = np.random.default_rng(0), 6
    covariances = np.tile(NOISE**2 * np.eye(n), (len(HZ), 1, 1))
    for seed in range(20):
        assert not delays_of(shapes(rng, n), covariances, HZ)
        phases = (0.3, -0.3, 0.05, 0.02) if seed % 2 else (0.2, 0.1, 0.0, 0.0)
        assert not delays_of(shapes(rng, n, own=[(3, phases)]), covariances, HZ)
        one = shapes(rng, n, [(1, 0.02)])[:, :1]
        assert not delays_of(one, covariances[:1], HZ[:1])


def test_a_delay_that_is_not_sure_is_said_and_not_removed(monkeypatch):
    """Of two sensors either may be late, and noise leaves some doubt."""
    samples = np.random.default_rng(0).standard_normal((2, 6000))
    pole = 0.999 * np.exp(0.3j)
    samples[:] = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], samples[0])
    samples += np.random.default_rng(1).standard_normal((2, 6000))
    record = bs.Record(samples, 20.0, ("a", "b"), "acceleration", "m/s2")
    monkeypatch.setattr(late_clocks, "delays_of", lambda *_: [Delay(1, 0.3, 0.1, 0.95)])
    found = bs.identify(record, (0.5, 2.0))
    (failed,) = found.failed_checks
    assert failed.startswith("sensor 'b' may be 0.3 s late against the others (probability 0.95)")
    assert found.modes[0].mean_phase_deg < 5.0
    assert not Delay(1, 0.3, 0.1, 0.99).is_sure


def test_delays_of_several_searches_add_up(monkeypatch):
    """And the lines are turned by their sum, 2π f τ."""
    seen = iter([[Delay(1, 0.010, 1e-3, 1.0)], [Delay(1, 0.002, 1e-3, 1.0)], []])
    monkeypatch.setattr(late_clocks, "explain", lambda *_: [])
    monkeypatch.setattr(late_clocks, "_delays_of_bands", lambda _: next(seen))
    lines = Transforms(10, 0.1, 1.0, np.ones((2, 30), complex))
    found = SimpleNamespace(turned=lambda _: None)
    on_time = late_clocks.explained_on_time(lines, found, (0.5, 1.9), False, False)
    (delay,) = on_time.removed
    assert delay.seconds == pytest.approx(0.012)
    np.testing.assert_allclose(on_time.delays_s, [0.0, 0.012])
    angles = 2.0 * np.pi * lines.frequencies_hz * 0.012
    np.testing.assert_allclose(np.angle(on_time.transforms.values), [0.0 * angles, angles])
