"""Records that cannot be used: one line each, from the command line and in Python."""

import numpy as np
import pytest
from conftest import assert_one_line_error

import bayes_ssi as bs

NAMES = ("floor 1", "floor 2", "floor 3")
SAMPLES = np.random.default_rng(0).standard_normal((3, 400))  # 8 s
STATED = {"rate_hz": 50.0, "quantity": "acceleration", "unit": "m/s2"}


def changed(value):
    samples = SAMPLES.copy()
    samples[1, 6] = value
    return samples


def csv(path, samples=SAMPLES, names=NAMES, **stated):
    head = [f"# {key}, {value}" for key, value in (STATED | stated).items() if value is not None]
    names = ",".join(names)
    np.savetxt(path, samples.T, delimiter=",", header="\n".join([*head, names]), comments="")
    return path


def npz(path, samples=SAMPLES, names=NAMES, **stated):
    stated = {key: value for key, value in (STATED | stated).items() if value is not None}
    np.savez(path, samples=samples, sensors=names, **stated)
    return path


@pytest.mark.parametrize("write", [csv, npz])
@pytest.mark.parametrize(
    ("content", "options", "words"),
    [
        ({"rate_hz": None}, {}, "rate_hz, the samples per second, is not given; give it in Hz"),
        ({"rate_hz": 0.0}, {}, "rate_hz must be a positive, finite number, got 0.0"),
        ({"dt_s": 0.01}, {}, "two rates are given: 50 and 100 Hz"),
        ({}, {"rate": 40.0}, "two rates are given: 40 and 50 Hz"),
        ({"samples": SAMPLES[:1], "names": NAMES[:1]}, {}, "no mode is identified from 0.6 to 4.6"),
        ({"samples": changed(np.nan)}, {}, "no mode is identified from 0.6 to 4.6 Hz"),
        ({"samples": changed(-np.inf)}, {}, "sensor 'floor 2': sample 7 is not finite: -inf"),
        ({"samples": SAMPLES[:, :3]}, {}, "the wrong way round?"),
        ({}, {"band": (0.6, 30.0)}, "30 Hz is beyond 25 Hz, half the rate of the record"),
        ({}, {"band": (3.0, 1.0)}, "band_hz must be 0 <= lowest < highest, got 3.0, 1.0"),
        (
            {},
            {"at": (1.0, 1.1, 1.2, 1.3), "band": (0.6, 1.7)},
            "the band has 8 lines of 3 sensors, fewer than the 40 unknowns of 4 modes",
        ),
    ],
)
def test_a_record_that_cannot_be_used_is_one_line(run, write, content, options, words):
    path = write(f"setup.{write.__name__}", **content)
    rate, at, band = options.get("rate"), options.get("at", ()), options.get("band", (0.6, 4.6))
    arguments = [*(["--rate", rate] if rate else []), *(x for f in at for x in ("--mode", f))]
    done = run("identify", path, "--band", *band, *arguments, "--out", "modes.csv")
    assert_one_line_error(done, words)
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the words are checked
        bs.identify(bs.read_record(path, rate_hz=rate), band, at=at)
    assert words in str(error.value)


@pytest.mark.parametrize("names", [NAMES, tuple(f"s{i}" for i in range(400))])
def test_a_text_file_with_a_row_for_each_sensor_is_recognised(run, names):
    csv("setup.csv", SAMPLES.T, names if len(names) == 400 else ["# no names"])
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
