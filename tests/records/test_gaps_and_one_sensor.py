"""Pieces between gaps are identified together, and one sensor gives frequencies and dampings."""

import numpy as np
import pytest
from scipy.signal import lfilter

import bayes_ssi as bs
from bayes_ssi.measurements.records.other_methods import compared
from bayes_ssi.measurements.records.usable_motion import _pieces, usable_motion

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
    return record, bs.identify(record, (0.5, 4.0), at=tuple(MODES)).modal_data()


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
        # As much information as is left, but hardly more: variances are as dampings.
        of_dampings = np.sqrt(mode.damping / same.damping)
        assert 1.0 < mode.frequency_cov / same.frequency_cov / of_dampings < 1.25


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


BAND = (0.5, 4.0)


def beside_two_sound_ones(samples, wrong):
    """Four sensors, of which the third is wrong."""
    rng = np.random.default_rng(2)
    rows = np.vstack([samples, samples + 0.05 * rng.standard_normal((2, N))])
    rows[2] = wrong(rows, rng)
    return bs.Record(rows, RATE, tuple("abcd"), "acceleration", "m/s2")


def dead(_rows, _rng):
    return 0.2


def clipped(rows, _rng):
    """By three standard deviations, beyond which are 0.0027: motion looks smaller by as much."""
    limit = 3.0 * rows[2].std()
    return rows[2].clip(-limit, limit)


@pytest.mark.parametrize(
    ("wrong", "out", "why"),
    [
        (dead, "c", "dead, all samples are 0.2"),
        (lambda rows, _: -rows[3], "cd", "the same samples but for the sign as sensor 'd'"),
        (clipped, "c", "clipped; 0.19 % of"),
        (lambda rows, rng: rows[2].std() * rng.standard_normal(N), "c", "noise alone"),
        (
            lambda rows, _: np.r_[rows[2, :3000], [rows[2, 3000]] * 3000, rows[2, 6000:]],
            "c",
            "on straight lines, or the same as before, in 25% of",
        ),
    ],
    ids=["dead", "copied", "clipped", "noise", "stuck"],
)
def test_a_sensor_that_measured_nothing_is_left_out(samples, wrong, out, why):
    record = beside_two_sound_ones(samples, wrong)
    motion = usable_motion(record, BAND, "")
    assert sorted(motion.left_out) == [*out]
    assert why in motion.left_out["c"]
    sound = record.selected([name for name in record.sensors if name not in out])
    np.testing.assert_array_equal(motion.record.samples, sound.samples)
    assert motion.pieces is None


def test_shapes_have_no_component_where_nothing_was_measured(samples, run, tmp_path):
    """Modes, errors and covariance are those of the sound sensors alone, and files say so."""
    record = beside_two_sound_ones(samples, dead)
    sound = [0, 1, 3]
    found = bs.identify(record, BAND, at=tuple(MODES))
    alone = bs.identify(record.selected(("a", "b", "d")), BAND, at=tuple(MODES)).quoted
    files = bs.write_modal_data(found.modal_data(), tmp_path / "modes.csv")
    data = bs.read_modal_data(files[0])
    assert data.sensors == (*"abcd",)
    np.testing.assert_array_equal(data.unit_shapes[sound], alone.unit_shapes)
    assert np.isnan(data.unit_shapes[2]).all()
    places = np.r_[:2, (2 + 4 * np.arange(2)[:, None] + sound).ravel()]
    np.testing.assert_allclose(
        data.covariance[np.ix_(places, places)], alone.covariance, atol=1e-15
    )
    assert not np.delete(data.covariance, places, axis=0).any()
    sds = [mode.shape_sd for mode in alone.modes]
    assert [mode.shape_sd for mode in data.modes] == pytest.approx(sds)
    said = run("check", files[0]).output.replace("\n", " ")
    assert "sensor 'c' is left out of shapes: dead, all samples are 0.2" in said
    assert [text for text in data.warnings() if "not measured" in text] == []


@pytest.mark.parametrize("how", ["held", "repeated"])
def test_gaps_that_were_filled_are_gaps(samples, how):
    """A logger that holds its last sample, or writes its last ten seconds again, of all sensors."""
    both, missing = samples.copy(), samples.copy()
    for first in (2000, 5000, 7000, 9000):
        end = first + 200
        both[:, first:end] = (
            samples[:, [first]] if how == "held" else samples[:, first - 200 : first]
        )
        missing[:, first:end] = np.nan
    filled, gaps = (
        usable_motion(bs.Record(rows, RATE, ("a", "b"), "acceleration", "m/s2"), BAND, "")
        for rows in (both, missing)
    )
    assert filled.record.gaps == gaps.record.gaps
    np.testing.assert_array_equal(filled.record.samples, gaps.record.samples)
    np.testing.assert_array_equal(filled.pieces, gaps.pieces)


def test_parts_of_a_record_that_are_used(samples):
    """Without gaps, without what a mask leaves out, and on time: in both halves."""
    # Late by a tenth of a second, but for the first two samples.
    rows = np.vstack([samples[0], np.roll(samples[0], 2)])
    rows[:, 3000:3400] = np.nan
    motion = usable_motion(bs.Record(rows, RATE, ("a", "b"), "acceleration", "m/s2"), BAND, "")
    mask = np.ones(N)
    mask[7000:8000] = 0.0
    first, second = motion.halves(mask, np.array([0.0, 0.1]))
    # In the second half nothing but the mask is out, in the first nothing but the gap.
    assert second.share == pytest.approx(1.0 - 1000 / (N / 2))
    assert first.share == pytest.approx(np.mean(motion.pieces[: N // 2] ** 2))
    for half in (first, second):
        assert abs(np.angle(half.spectra(0.95, 1.05, 0.05).matrices[0, 0, 1])) < 0.02


def test_where_all_sensors_measured_nothing_nothing_is_identified(samples):
    record = bs.Record(0.0 * samples, RATE, ("a", "b"), "acceleration", "m/s2")
    with pytest.raises(ValueError, match=r"no sensor measured what .* 'a': dead, .* 'b': dead"):
        bs.identify(record, (0.5, 4.0))


def test_sensors_that_are_all_clipped_stay(samples):
    """Nothing tells which of them would be right without the others."""
    limits = 2.0 * samples.std(1, keepdims=True)
    record = bs.Record(samples.clip(-limits, limits), RATE, ("a", "b"), "acceleration", "m/s2")
    assert usable_motion(record, BAND, "").left_out == {}
    # Of a normal variable 4.55 % are beyond two standard deviations.
    shares = [float(text.split("; ")[1].split(" %")[0]) for text in record.warnings()]
    assert shares == pytest.approx([4.55, 4.55], abs=0.4)
