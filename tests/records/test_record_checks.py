"""What is wrong with a record is recognised and said; sound records give no remark."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.signal import butter, lfilter, sosfiltfilt
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.measurements.records.record_checks import (
    machine_lines,
    moving,
    remarks_on,
    without_lines,
)

SENSORS = ("floor 1", "floor 2", "floor 3")
RATE = 50.0


def simulated(seed, **changed):
    rng = np.random.default_rng(seed)
    return simulated_record(with_infill(), SENSORS, rng, **{"duration_s": 600.0} | changed)


@pytest.fixture(scope="module")
def sound():
    return simulated(1).samples


@pytest.mark.parametrize(
    "changed",
    [{}, {"ground": True}, {"duration_s": 300.0}, {"damping": 0.005},
     {"damping": 0.05, "ground": True}],
)  # fmt: skip
def test_sound_records_give_no_remark(changed):
    assert [simulated(seed, **changed).warnings() for seed in range(6)] == [[]] * 6


@pytest.mark.parametrize("low_pass", [10.0, 20.0])
def test_a_filtered_earthquake_has_no_machines(low_pass):
    """Above the filter nothing is left but rounding, from which any line may stand out."""
    for seed in range(4):
        samples = simulated(seed, ground=True, damping=0.03, duration_s=80.0).samples
        after = np.maximum(np.arange(samples.shape[1]) / RATE - 10.0, 0.0)
        strength = 0.002 + after**2 * np.exp(-after / 3.0)
        band_pass = butter(4, [0.1, low_pass], "bandpass", fs=RATE, output="sos")
        quake = np.round(sosfiltfilt(band_pass, samples * strength), 6)
        assert not [text for text in remarks_on(quake, RATE, SENSORS) if "straight" not in text]


@pytest.mark.parametrize("level", [0.2, -3000.0, 1e-9])
def test_a_sensor_is_dead_where_it_moves_by_rounding_alone(level):
    """Twenty last digits are rounding; a step of a 32-bit converter, 2⁻³¹, is motion."""
    steps = np.random.default_rng(2).choice([-1.0, 0.0, 1.0], size=500)
    rows = level * (1.0 + np.outer([0.0, 20.0 * np.finfo(float).eps, 2.0**-31], steps))
    np.testing.assert_array_equal(moving(rows), [False, False, True])
    assert not moving(np.zeros((1, 500))).any()


def often_held(row):
    row[: row.size // 10 * 3].reshape(30, -1)[:] = row[np.arange(30) * row.size // 100][:, None]
    return row


@pytest.mark.parametrize(
    ("wrong", "remark"),
    [
        (lambda row: 0.0 * row + 0.2, "dead, all samples are 0.2"),
        # Of a normal variable 1.24 % are beyond 2.5 standard deviations.
        (
            lambda row: row.clip(-2.5 * row.std(), 2.5 * row.std()),
            "clipped; 1.2 % of its samples are at an extreme value",
        ),
        (
            lambda row: np.r_[row[:1000], np.linspace(*row[[1000, 1199]], 200), row[1200:]],
            "on a straight line, or the same as before, from 20 s on for 4 s; it is taken",
        ),
        (
            lambda row: np.r_[row[:1000], [row[1000]] * 50, row[1050:]],
            "on a straight line, or the same as before, from 20 s on for 1 s",
        ),
        (
            lambda row: np.r_[row[:5000], row[1000:1200], row[5200:]],
            "on a straight line, or the same as before, from 100 s on for 4 s",
        ),
        (often_held, "on straight lines, or the same as before, in 30% of its samples"),
        (
            lambda row: np.random.default_rng(1).standard_normal(len(row)),
            "noise alone, coherent with no other sensor at any frequency",
        ),
    ],
    ids=["dead", "clipped", "filled", "held", "repeated", "often held", "noise"],
)
def test_a_wrong_sensor_is_said(sound, wrong, remark):
    samples = sound.copy()
    samples[1] = wrong(samples[1])
    (said,) = remarks_on(samples, RATE, SENSORS)
    assert said.startswith(f"sensor 'floor 2': {remark}")


def machine(frequency_hz, amplitude, pattern, samples):
    """A sine of all floors, of so many times their root mean square."""
    times = np.arange(samples.shape[1]) / RATE
    scales = amplitude * samples.std(axis=1, keepdims=True) * np.array(pattern)[:, None]
    return scales * np.sin(2.0 * np.pi * frequency_hz * times + 1.0)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude", "ground"),
    [
        # In all of five minutes of ambient motion, and one percent from the first mode.
        (2.8003, 0.07, False),
        (0.9930, 0.3, False),
        # Ground motion is the same at all floors nearby, and hides less.
        (2.8003, 0.03, True),
        (7.3001, 0.03, True),
    ],
)
def test_a_machine_is_found_and_taken_out(frequency_hz, amplitude, ground):
    for seed in range(3):
        samples = simulated(seed, ground=ground).samples
        line, n_samples = 1.0 / 600.0, samples.shape[1]
        disturbed = samples + machine(frequency_hz, amplitude, (0.6, 1.0, -0.4), samples)
        frequencies = machine_lines(disturbed, RATE)
        assert frequencies == pytest.approx([frequency_hz], abs=0.1 * line)
        left = without_lines(disturbed, RATE, frequencies) - samples
        # What is left of the sine and what is taken from the rest: two lines of it.
        window = np.hanning(n_samples)
        near = np.rint(frequency_hz / line).astype(int) + np.arange(-10, 11)
        powers = np.abs(np.fft.rfft(window * np.array([samples, left]))[..., near]) ** 2
        assert (powers[1].sum(1) < 3.0 / 21.0 * 2.5 * powers[0].sum(1)).all()


def test_many_machines_are_counted_and_the_strongest_are_named(sound):
    frequencies = np.array([1.7, 5.3, 6.1, 8.2, 9.9])
    samples = sound + sum(
        machine(f, 0.5 / k, (1.0, 0.5, -1.0), sound) for k, f in enumerate(frequencies, 1)
    )
    np.testing.assert_allclose(machine_lines(samples, RATE), frequencies, atol=2e-4)
    (said,) = remarks_on(samples, RATE, SENSORS)
    assert said.startswith(
        "lines at 5 frequencies, the strongest at 1.7, 5.3, 6.1 Hz, as of a machine; a mode so"
    )
    np.testing.assert_array_equal(without_lines(sound, RATE, np.empty(0)), sound)


def test_a_machine_that_drifts_slowly_is_taken_out(sound):
    """Amplitude and phase that change by a tenth to either side leave a hundredth of the sine."""
    along = np.linspace(-1.0, 1.0, sound.shape[1])
    times = np.arange(sound.shape[1]) / RATE
    sine = (1.0 + 0.1 * along) * np.sin(2.0 * np.pi * 6.1 * times + 0.1 * along)
    samples = sound + np.outer(sound.std(axis=1), sine)
    left = without_lines(samples, RATE, machine_lines(samples, RATE)) - sound
    without = without_lines(sound, RATE, np.array([6.1])) - sound
    assert (left.std(axis=1) < 1.2 * without.std(axis=1) + 0.01 * samples.std(axis=1)).all()


def test_a_mode_as_narrow_as_the_lines_is_no_machine():
    """With ζ f T of 0.5: a twentieth of noise beside it, and the steady sine that replaces it."""
    n, taken = 30_000, [0, 0]
    for seed in range(15):
        rng = np.random.default_rng(seed)
        pole = np.exp((-0.5 * RATE / n / 1.3 + 1j) * 2.0 * np.pi * 1.3 / RATE)
        recursion = [1.0, -2.0 * pole.real, abs(pole) ** 2]
        mode = lfilter([1.0, -2.0, 1.0], recursion, rng.standard_normal(2 * n))[n:]
        sine = np.sin(2.0 * np.pi * 1.3 / RATE * np.arange(n))
        noise = 0.2 * rng.standard_normal((2, n))
        for k, motion in enumerate((mode, sine)):
            taken[k] += len(machine_lines(noise + motion / motion.std(), RATE)) > 0
    assert taken[0] <= 1
    assert taken[1] == 15


def test_a_machine_that_ran_for_a_while_is_no_line(sound):
    samples = sound.copy()
    samples[:, :10_000] += machine(6.1, 0.3, (1.0, 0.5, -1.0), sound)[:, :10_000]
    assert not len(machine_lines(samples, RATE))


def test_copies_are_said_and_a_coarse_sensor_is_none(sound):
    assert remarks_on(np.round(sound / sound.std(1, keepdims=True) * 20.0), RATE, SENSORS) == []
    copied = np.array([sound[0], sound[1], sound[0], -sound[1]])
    assert remarks_on(copied, RATE, ("a", "b", "c", "d"))[:3] == [
        "sensor 'c': the same samples as sensor 'a'; which one is the copy?",
        "sensor 'a': the same samples as sensor 'c'; which one is the copy?",
        "sensor 'd': the same samples but for the sign as sensor 'b'; which one is the copy?",
    ]


def test_the_command_shows_a_record_with_its_remarks(sound, tmp_path):
    path = tmp_path / "setup.csv"
    head = "# quantity, acceleration\n# unit, g\nfloor 1,floor 2,floor 3"
    np.savetxt(path, sound.T[:6000], delimiter=",", header=head, comments="", fmt="%.5f")

    def check(*arguments):
        return CliRunner().invoke(main, ["check", *map(str, arguments)])

    done = check(path, "--rate", 50)
    assert done.exit_code == 0
    assert "acceleration in g, 6,000 samples at 50 Hz (120 s), up to 25 Hz" in done.stdout
    assert "No warnings." in done.stdout
    samples = sound.copy()
    samples[2] = samples[0]
    np.savez(tmp_path / "setup.npz", samples=samples, sensors=SENSORS, quantity="acceleration")
    done = check(tmp_path / "setup.npz", "--rate", 50, "--unit", "g", "--json")
    assert json.loads(done.stdout)["remarks"] == [
        f"sensor 'floor {i}': the same samples as sensor 'floor {j}'; which one is the copy?"
        for i, j in ((3, 1), (1, 3))
    ]
    modes = tmp_path / "modes.csv"
    modes.write_text("# band_hz, 0, 3\nlabel,frequency_hz,a,b\n1,1.0,1,1\n", encoding="utf-8")
    done = check(modes, "--rate", 50)
    assert done.exit_code == 2
    assert "--rate: applies to vibration records" in done.stderr
    assert isinstance(bs.read_modal_data(modes), bs.ModalData)
