"""What is wrong with a record is recognised and said; sound records give no remark."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from simulated_records import simulated_record, with_infill

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.records.record_checks import remarks_on

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
    [
        {},
        {"ground": True},
        {"duration_s": 300.0},
        {"damping": 0.005},
        {"damping": 0.05, "ground": True},
    ],
)
def test_sound_records_give_no_remark(changed):
    assert [simulated(seed, **changed).warnings() for seed in range(6)] == [[]] * 6


def filled(row, _):
    row[1000:1200] = np.linspace(row[1000], row[1199], 200)


def held(row, _):
    row[1000:1050] = row[1000]


def clipped(row, _):
    np.clip(row, -2.5 * row.std(), 2.5 * row.std(), out=row)


def dead(row, _):
    row[:] = 0.2


def drifting(row, times):
    row += 3.0 * row.std() * times / times[-1]


def late(row, _):
    row[:] = np.roll(row, 2)


def slow_clock(row, times):
    row[:] = np.interp(times * (1.0 - 2e-4), times, row)


def with_machine(row, times):
    row += 0.1 * row.std() * np.sin(2.0 * np.pi * 2.8 * times)


@pytest.mark.parametrize(
    ("wrong", "remark"),
    [
        (dead, "dead, all samples are 0.2"),
        (clipped, "stays at its extreme value for three samples or more"),
        (filled, "on a straight line from 20 s on for 4 s; is it a gap that was filled?"),
        (held, "on a straight line from 20 s on for 1 s"),
        (drifting, "drifts; its mean over twentieths of the record scatters by 0.8"),
        (late, "0.039 s late against the others; are the clocks synchronised?"),
        (slow_clock, "its clock runs at another rate; it is later by 0.05"),
        (with_machine, "a line at 2.8 Hz, as of a machine"),
    ],
)
def test_a_wrong_sensor_is_said(sound, wrong, remark):
    samples = sound.copy()
    wrong(samples[1], np.arange(samples.shape[1]) / RATE)
    said = remarks_on(samples, RATE, SENSORS)
    assert len(said) == 1
    assert remark in said[0]
    assert "'floor 2'" in said[0] or wrong is with_machine


def test_copies_are_said_and_a_coarse_sensor_is_none(sound):
    coarse = np.round(sound / sound.std(1, keepdims=True) * 20.0)
    assert remarks_on(coarse, RATE, SENSORS) == []
    copied = np.array([sound[0], sound[1], sound[0], -sound[1]])
    assert remarks_on(copied, RATE, ("a", "b", "c", "d"))[:2] == [
        "sensors 'a' and 'c': the same samples",
        "sensors 'b' and 'd': the same samples but for the sign",
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
        "sensors 'floor 1' and 'floor 3': the same samples"
    ]
    done = check(path)
    assert done.exit_code == 2
    assert "rate_hz, the samples per second, is not given" in done.stderr
    modes = tmp_path / "modes.csv"
    modes.write_text("# band_hz, 0, 3\nlabel,frequency_hz,a,b\n1,1.0,1,1\n", encoding="utf-8")
    done = check(modes, "--rate", 50)
    assert done.exit_code == 2
    assert "--rate: applies to vibration records" in done.stderr
    assert isinstance(bs.read_modal_data(modes), bs.ModalData)
