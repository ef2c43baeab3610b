"""Spectral matrices in closed form, and candidates for modes in those that are simulated."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm
from simulated_records import FRAME, simulated_record, truth_of

import bayes_ssi as bs
from bayes_ssi.measurements.records import band_search
from bayes_ssi.measurements.records.explained_band import OneOrTwo, _nats_of_place, share_a_peak
from bayes_ssi.measurements.records.local_fit import allowed_whiteness
from bayes_ssi.measurements.records.mode_candidates import candidates
from bayes_ssi.measurements.records.spectra import Resonances, Spectra, noise_scales, transforms_of


def white_record(rng, n_samples=600, rate=10.0):
    return bs.Record(rng.standard_normal((2, n_samples)), rate, ("a", "b"), "acceleration", "m/s2")


def test_white_noise_has_its_density_and_no_more_information_than_its_lines():
    """The mean over a band is the variance over the rate; its scatter says what blocks count."""
    rng = np.random.default_rng(1)
    means = []
    for _ in range(500):
        data = transforms_of(white_record(rng), (1.0, 4.0)).spectra(1.0, 4.0, 0.02)
        n_tapers = np.round(data.widths_hz * 60.1) - 1.0
        means.append((n_tapers * data.matrices[:, 0, 0].real).sum() / n_tapers.sum())
        assert data.weights.sum() < n_tapers.sum() <= 180
    w = data.weights
    scatter = 0.1 / np.sqrt(w.sum())
    assert np.mean(means) == pytest.approx(0.1, abs=4 * scatter / np.sqrt(500))
    # A standard deviation from 500 has an error of 3.2 %; that of plain lines would be 11 % less.
    inflation = (n_tapers**2 / w).sum() / n_tapers.sum() ** 2 * w.sum()
    assert np.std(means) == pytest.approx(scatter * np.sqrt(inflation), rel=0.1)


def test_a_masked_record_has_the_same_density_and_less_information():
    """Half of white noise, under a mask with flanks: the density stays, lines count for half."""
    record = white_record(np.random.default_rng(5), 20_000)
    mask = np.zeros(20_000)
    mask[:10_000] = 1.0
    whole, half = (
        transforms_of(record, (1.0, 4.0), own).spectra(1.0, 4.0, 0.02) for own in (None, mask)
    )
    assert half.weights.sum() == pytest.approx(0.5 * whole.weights.sum())
    mean = half.weights @ half.matrices[:, 0, 0].real / half.weights.sum()
    assert mean == pytest.approx(0.1, abs=4 * 0.1 / np.sqrt(half.weights.sum()))


def test_the_noise_of_a_channel_is_what_no_other_explains():
    """1 - c² of its power, with a coherence c; n over the number of few lines is added to 1."""

    def scales(coherence, n_lines):
        matrix = np.array([[[4.0, 2.0 * coherence], [2.0 * coherence, 1.0]]])
        return noise_scales(Spectra(np.ones(1), np.ones(1), np.array([n_lines]), matrix))

    np.testing.assert_allclose(scales(0.6, 100.0), [1.6, 0.8])
    diagonal = 1.0 + 2.0 / 3.9
    share = (diagonal - 0.99**2 / diagonal) ** 0.5
    np.testing.assert_allclose(scales(0.99, 3.9), [2.0 * share, share])


def test_velocities_and_displacements_become_accelerations():
    """Of a(t) = cos ωt, v = sin ωt / ω and u = -cos ωt / ω²: the same spectral matrices."""
    times = np.arange(4000) / 20.0
    omega = 2.0 * np.pi * 1.3
    histories = {
        "acceleration": (np.cos(omega * times), "m/s2"),
        "velocity": (np.sin(omega * times) / omega, "m/s"),
        "displacement": (-np.cos(omega * times) / omega**2, "m"),
    }
    powers = []
    for quantity, (history, unit) in histories.items():
        record = bs.Record(np.array([history, 2.0 * history]), 20.0, ("a", "b"), quantity, unit)
        powers.append(transforms_of(record, (1.0, 1.6)).spectra(1.2, 1.4, 0.02).matrices.sum(0))
    np.testing.assert_allclose(powers[1], powers[0], rtol=0.01)
    np.testing.assert_allclose(powers[2], powers[0], rtol=0.01)
    np.testing.assert_allclose(powers[0][1, 1], 4.0 * powers[0][0, 0])


def test_delays_are_removed():
    common = np.random.default_rng(2).standard_normal(4003)
    both = np.array([common[3:], common[:-3]])
    record = bs.Record(both, 10.0, ("a", "b"), "acceleration", "m/s2")
    on_time = transforms_of(record, (1.0, 2.0)).turned(np.array([0.0, 0.3]))
    phases = np.angle(on_time.spectra(1.0, 2.0, 0.02).matrices[:, 0, 1])
    np.testing.assert_allclose(phases, 0.0, atol=0.05)


def test_the_whiteness_of_few_tapers_scatters_as_allowed():
    """Of 50 blocks of three tapers and four sensors, 2000 times; scatters are known to 2 %."""
    rng = np.random.default_rng(4)
    vectors = rng.standard_normal((2000 * 50, 4, 3, 2)) @ np.sqrt([0.5, -0.5 + 0j])
    matrices = vectors @ vectors.conj().swapaxes(1, 2) / 3.0
    squares = 3.0 * (np.abs(matrices - np.eye(4)) ** 2).sum((1, 2)) / 16.0
    whiteness = squares.reshape(2000, 50).mean(1)
    assert whiteness.mean() == pytest.approx(1.0, abs=4 * whiteness.std() / np.sqrt(2000))
    allowed = allowed_whiteness(np.full(50, 3.0), np.full(50, 4.0), 50 * 16.0)
    assert allowed == pytest.approx(1.1 + 3.0 * whiteness.std(), rel=0.06)


def test_a_band_without_lines_is_refused():
    lines = transforms_of(white_record(np.random.default_rng(3)), (1.0, 2.0))
    with pytest.raises(ValueError, match="the record has only 2 lines in the band"):
        lines.spectra(1.0, 1.045, 0.02)


SENSORS = ("floor 1", "floor 2", "floor 3")


def test_peaks_have_the_poles_of_their_modes():
    """Medians over five records: f to a quarter of the half-power width 2 ζ f, MACs above 0.99.

    Dampings to a quarter, of modes that a record holds 3000 periods of.
    """
    damping = 0.04
    truth = truth_of(FRAME, SENSORS, damping)
    frequencies, dampings, macs = np.empty((3, 5, 3))
    for seed in range(5):
        record = simulated_record(FRAME, SENSORS, np.random.default_rng(seed), damping=damping)
        found = candidates(transforms_of(record, (0.4, 6.0)), 0.6, 4.6)
        for i, frequency in enumerate(truth.frequencies_hz):
            clear = np.array([peak.frequency_hz if peak.is_clear else 0.0 for peak in found.peaks])
            pole = found.of_peaks.at([int(np.abs(clear - frequency).argmin())])
            frequencies[seed, i], dampings[seed, i] = pole.frequencies_hz[0], pole.dampings[0]
            macs[seed, i] = np.abs(pole.shapes[:, 0].conj() @ truth.shapes[:, i]) ** 2
    middle = np.median(frequencies, axis=0)
    np.testing.assert_allclose(middle, truth.frequencies_hz, rtol=0.5 * damping)
    np.testing.assert_allclose(np.median(dampings, axis=0)[1:], damping, rtol=0.25)
    assert (np.median(macs, axis=0) > 0.99).all()


@pytest.mark.parametrize(("apart_hz", "they_do"), [(0.29, True), (0.31, False)])
def test_two_modes_share_a_peak_where_both_have_a_tenth_of_their_power(apart_hz, they_do):
    """Three half widths from it, a resonance has 1 / (1 + 3²) of its power: of 0.04 and 0.06 Hz."""
    frequencies_hz = np.array([2.0, 2.0 + apart_hz])
    modes = Resonances(frequencies_hz, np.array([0.04, 0.06]) / frequencies_hz, np.ones((1, 2)))
    assert share_a_peak(modes, 0) == they_do
    assert not share_a_peak(modes, 1)


def test_a_second_mode_is_near_the_first_and_not_anywhere_in_the_band():
    """A normal density of ln f on one side, over that of anywhere from 1 to 3 Hz."""
    modes = Resonances(np.array([2.0, 2.1]), np.array([0.02, 0.04]), np.ones((1, 2)))
    fit = SimpleNamespace(data=SimpleNamespace(band_hz=(1.0, 3.0)), modes=modes)
    near = 2.0 * norm.pdf(np.log(1.05), scale=2.0 * 2.0 * 0.03)
    assert _nats_of_place(fit, [0, 1]) == pytest.approx(np.log(near * np.log(3.0)))


def test_a_pair_takes_the_place_of_its_mode_among_those_of_the_band(monkeypatch):
    """Of modes a, b and c, b is better explained as two: peaks are (a), (b, b'), (c)."""

    def fit_of(*names):
        return SimpleNamespace(modes=SimpleNamespace(n_modes=len(names)), names=names)

    def two_in_place_of(_, fit, i):
        if fit.names[i] == "b":
            return OneOrTwo(100.0, fit_of("a", "b", "b'", "c"))
        return OneOrTwo(None, None)

    monkeypatch.setattr(band_search, "two_in_place_of", two_in_place_of)
    monkeypatch.setattr(band_search, "share_a_peak", lambda *_: False)
    best, peaks = band_search._peaks(None, fit_of("a", "b", "c"), 1.0, False)
    assert best.names == ("a", "b", "b'", "c")
    assert [peak.modes for peak in peaks] == [(0,), (1, 2), (3,)]
    best, peaks = band_search._peaks(None, fit_of("a", "b", "c"), 1.0, True)
    assert [peak.modes for peak in peaks] == [(0,), (1,), (2,)]
