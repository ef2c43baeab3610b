"""Candidates for modes, and peaks that hold one or two, against the modes of what was simulated."""

from types import SimpleNamespace

import numpy as np
from simulated_records import FRAME, simulated_record, truth_of

from bayes_ssi.measurements.records import band_search
from bayes_ssi.measurements.records.explained_band import OneOrTwo
from bayes_ssi.measurements.records.mode_candidates import candidates
from bayes_ssi.measurements.records.spectra import transforms_of

SENSORS = ("floor 1", "floor 2", "floor 3")


def test_peaks_have_the_poles_of_their_modes():
    """Medians over five records: f to a quarter of the half-power width 2 ζ f, MACs above 0.99.

    Dampings to a quarter, of modes that a record holds 3000 periods of.
    """
    damping = 0.04
    truth = truth_of(FRAME, SENSORS, damping)
    frequencies, dampings, macs = np.empty((3, 5, 3))
    for seed in range(5):
        rng = np.random.default_rng(seed)
        record = simulated_record(FRAME, SENSORS, rng, damping=damping)
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
