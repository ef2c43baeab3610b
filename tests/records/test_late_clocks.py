"""Delays of clocks against phases of damping, from shapes whose phases are made up."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from threadpoolctl import threadpool_info, threadpool_limits

import bayes_ssi as bs
from bayes_ssi.measurements.records import late_clocks
from bayes_ssi.measurements.records.late_clocks import Delay, delays_of
from bayes_ssi.measurements.records.spectra import Transforms

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
        own = delays_of(shapes(rng, n, own=[(3, phases)]), covariances, HZ)
        assert all(each.sensor == 3 and each.probability < 0.1 for each in own)
        one = shapes(rng, n, [(1, 0.02)])[:, :1]
        assert all(each.probability < 0.9 for each in delays_of(one, covariances[:1], HZ[:1]))


def test_a_late_floor_beside_a_damper():
    """Of a building whose damper turns by any phases; neither is seen while the other is not."""
    rng, n = np.random.default_rng(1), 5
    covariances = np.tile(NOISE**2 * np.eye(n), (len(HZ), 1, 1))
    for _ in range(10):
        phases = rng.uniform(-1.2, 1.2, len(HZ))
        clock, damper = delays_of(shapes(rng, n, [(2, 0.01)], [(4, phases)]), covariances, HZ)
        assert clock.sensor == 2
        assert clock.is_sure
        assert abs(clock.seconds - 0.01) < 3.5 * clock.deviation
        assert damper.sensor == 4
        assert damper.probability < 0.1


def test_a_delay_that_is_not_sure_is_said_and_not_removed(monkeypatch):
    """Of two sensors either may be late, and noise leaves some doubt."""
    samples = np.random.default_rng(0).standard_normal((2, 6000))
    pole = 0.998 * np.exp(0.3j)
    samples[:] = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], samples[0])
    samples += np.random.default_rng(1).standard_normal((2, 6000))
    record = bs.Record(samples, 20.0, ("a", "b"), "acceleration", "m/s2")

    def delays(*_):
        assert {
            each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"
        } == {1}
        return [Delay(1, 0.3, 0.1, 0.95)]

    monkeypatch.setattr(late_clocks, "delays_of", delays)
    with threadpool_limits(limits=2, user_api="blas"):
        found = bs.identify(record, (0.5, 2.0))
    (failed,) = found.failed_checks
    assert failed.startswith("sensor 'b' may be 0.3 s late against the others (probability 0.95)")
    assert found.modes[0].mean_phase_deg < 5.0
    assert not Delay(1, 0.3, 0.1, 0.99).is_sure


def test_delays_of_several_searches_add_up(monkeypatch):
    """And the lines are turned by their sum, 2π f τ."""
    seen = iter([[Delay(1, 0.010, 1e-3, 1.0)], [Delay(1, 0.002, 1e-3, 1.0)], []])
    monkeypatch.setattr(late_clocks, "explain", lambda *_: [None])
    monkeypatch.setattr(late_clocks, "widened", lambda _, bands, __: bands)
    monkeypatch.setattr(late_clocks, "_delays_of_bands", lambda _: next(seen))
    lines = Transforms(10, 0.1, 1.0, np.ones((2, 30), complex))
    found = SimpleNamespace(turned=lambda _: None)
    on_time = late_clocks.explained_on_time(lines, found, (0.5, 1.9), False, False)
    (delay,) = on_time.removed
    assert delay.seconds == pytest.approx(0.012)
    np.testing.assert_allclose(on_time.delays_s, [0.0, 0.012])
    angles = 2.0 * np.pi * lines.frequencies_hz * 0.012
    np.testing.assert_allclose(np.angle(on_time.transforms.values), [0.0 * angles, angles])
