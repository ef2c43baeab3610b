"""Pieces between gaps are identified together, and one sensor gives frequencies and dampings."""

import numpy as np
import pytest
from scipy.signal import lfilter

import bayes_ssi as bs
from bayes_ssi.measurements.records.modal_identification import _pieces
from bayes_ssi.measurements.records.other_methods import compared

RATE, N = 20.0, 12_000
MODES = {1.0: 0.02, 2.62: 0.02}  # Hz and damping
SHAPES = np.array([[0.526, 0.851], [0.851, -0.526]])


@pytest.fixture(scope="module")
def samples():
    """Accelerations at two floors of two modes under white loads, simulated exactly at the rate."""
    rng = np.random.default_rng(1)
    both = 0.02 * rng.standard_normal((2, N))
    for shape, (hz, zeta) in zip(SHAPES.T, MODES.items(), strict=True):
        pole = np.exp(2 * np.pi * hz / RATE * (-zeta + 1j * np.sqrt(1 - zeta**2)))
        poles = [1.0, -2.0 * pole.real, abs(pole) ** 2]
        both += shape[:, None] * lfilter([1.0, -2.0, 1.0], poles, rng.standard_normal(N))
    return both


def identified(samples, sensors=("floor 1", "floor 2")):
    record = bs.Record(samples, RATE, sensors, "acceleration", "m/s2")
    return record, bs.identify(record, (0.5, 4.0)).modal_data()


def test_pieces_between_gaps_are_identified_together(samples):
    gapped = samples.copy()
    gapped[0, 5000:5400] = np.nan
    gapped[1, 8000:8100] = np.nan
    record, modes = identified(gapped)
    assert record.gaps == ((5000, 5400), (8000, 8100))
    _, whole = identified(samples)
    assert len(modes.modes) == len(whole.modes) == 2
    for mode, same, hz, shape in zip(modes.modes, whole.modes, MODES, SHAPES.T, strict=True):
        assert abs(mode.frequency_hz / hz - 1) < 3 * mode.frequency_cov
        across = mode.unit_shape @ [shape[1], -shape[0]]
        assert abs(across) < 3 * mode.shape_sd
        # As much information as is left, but hardly more.
        assert 1.0 < mode.frequency_cov / same.frequency_cov < 1.25


def test_the_mask_of_pieces(samples):
    def record(*gaps):
        gapped = samples.copy()
        for first, end in gaps:
            gapped[0, first:end] = np.nan
        return bs.Record(gapped, RATE, ("a", "b"), "acceleration", "g")

    # A line over two steps replaces a quarter of a period at 2.5 Hz.
    assert _pieces(record((500, 501)), 0.5, 2.6) is not None
    assert _pieces(record((500, 501)), 0.5, 2.4) is None
    mask = _pieces(record((5000, 5400)), 0.5, 4.0)
    assert not mask[5000:5400].any()
    flank = 8.0 / 0.5 * RATE  # eight periods of the lowest frequency
    np.testing.assert_allclose(
        mask[5400 : 5400 + int(flank)],
        np.sin(0.5 * np.pi * (np.arange(flank) + 0.5) / flank) ** 2, atol=1e-12,
    )  # fmt: skip
    assert mask[:4600].min() == mask[5800:].min() == 1.0
    with pytest.raises(ValueError, match=r"60 gaps leave pieces so short that 1?\d% of the record"):
        _pieces(record(*((k, k + 5) for k in range(100, N, 200))), 0.5, 4.0)


def test_one_sensor_gives_frequencies_and_dampings(samples):
    record, modes = identified(samples[:1], ("roof",))
    assert record.warnings() == []
    assert len(modes.modes) == 2
    for mode, (hz, zeta) in zip(modes.modes, MODES.items(), strict=True):
        assert abs(mode.frequency_hz / hz - 1) < 3 * mode.frequency_cov
        assert abs(mode.damping - zeta) < 3 * mode.damping_sd
        assert mode.scored_shape is None
        assert mode.shape_sd is None
    # The others compare sensors.
    for words in list(compared(record, modes).values())[1:]:
        assert "needs two sensors or more" in words


def test_one_sensor_from_the_command_line_to_a_ranking(samples, run, tmp_path):
    head = "# rate_hz, 20\n# unit, m/s2\nfloor 2"
    np.savetxt(tmp_path / "a.csv", samples[1], header=head, comments="")
    done = run("identify", tmp_path / "a.csv", "--band", 0.5, 4, "--out", tmp_path / "m.csv")
    assert done.exit_code == 0, done.output
    modes = bs.read_modal_data(tmp_path / "m.csv")
    k = bs.Parameter("k", bs.LogNormal(median=100.0, cov=0.3))
    building = bs.ShearBuilding((1.0, 1.0), (k, k))
    one = bs.ModelClass("a", building, modes, bs.ErrorModel(0.01), pairing={"1": 1, "2": 2})
    assert np.isfinite(one.log_likelihood(np.array([[100.0]])))
