"""Records that cannot be used: one line each."""

import numpy as np
import pytest
from conftest import FLOORS, assert_one_line_error

import bayes_ssi as bs

SAMPLES = np.random.default_rng(0).standard_normal((3, 400))  # 8 s
STATED = {"rate_hz": 50.0, "quantity": "acceleration", "unit": "m/s2"}


@pytest.mark.parametrize(
    ("changed", "options", "words"),
    [
        ({"rate_hz": 0.0}, (), "rate_hz must be a positive, finite number, got 0.0"),
        ({}, ("--rate", 40.0), "two rates are given: 40 and 50 Hz"),
        ({"samples": SAMPLES[:1], "sensors": FLOORS[:1]}, (), "no mode is identified from 0.6 to"),
        ({"samples": SAMPLES[:, :3]}, (), "the wrong way round?"),
        ({}, ("--mode", 1.0, "--mode", 9.0), "at: frequencies must be within 0.6 to 4.6 Hz, got"),
        ({"samples": SAMPLES[:, :100]},
         ("--mode", 1.0, "--mode", 1.1, "--mode", 1.2, "--mode", 1.3),
         "the band has 8 lines of 3 sensors, fewer than the 40 unknowns of 4 modes"),
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_used_is_one_line(run, changed, options, words):
    np.savez("setup.npz", **({"samples": SAMPLES, "sensors": FLOORS} | STATED | changed))
    done = run("identify", "setup.npz", "--band", 0.6, 4.6, *options, "--out", "modes.csv")
    assert_one_line_error(done, words)


def test_a_text_file_with_a_row_for_each_sensor_is_recognised(run):
    np.savetxt("setup.csv", SAMPLES, delimiter=",")
    assert_one_line_error(
        run("identify", "setup.csv", "--band", 0.6, 4.6),
        "setup.csv: 3 rows of 400 samples; a record has a row for each instant and a column for",
        "the wrong way round?",
    )


STUDY = """\
import bayes_ssi as bs

k = bs.Parameter("k", bs.LogNormal(40.0, 0.3))
modes = bs.read_modal_data("modes.csv")
building = bs.ShearBuilding((1.0, 1.0), (k, k))
study = bs.Study("a", [bs.ModelClass("b", building, modes, pairing={"1": 1})])
"""


@pytest.mark.parametrize("command", ["rank", "calibrate", "search"])
def test_sensors_that_the_structure_has_not_are_named(run, tmp_path, command):
    mode = bs.IdentifiedMode("1", 1.0, [0.6, 0.8])
    source = "identified from setup.npz"
    bs.write_modal_data(bs.ModalData((mode,), (0.0, 2.0), ("floor 1", "roof"), source), "modes.csv")
    (tmp_path / "study.py").write_text(STUDY)
    assert_one_line_error(
        run(command, tmp_path / "study.py"),
        "study.py: line 6: ValueError: model class 'b': data (identified from setup.npz): sensor "
        "'roof': the structure has no degree of freedom 'roof'; choose from 'floor 1', 'floor 2'",
    )
