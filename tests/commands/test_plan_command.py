"""``bayes-ssi plan``: what it prints, saves and refuses."""

import json

import pytest
from code_blocks import ROOT
from conftest import assert_one_line_error, succeeded

import bayes_ssi as bs

STUDY = ROOT / "model_classes" / "shear_building.py"
FAST = ("--tests", 60, "--draws", 150)


def test_plan_prints_layouts_and_saves_the_form(run, tmp_path):
    out = tmp_path / "plan"
    done = succeeded(run("plan", STUDY, "--sensors", 2, "--out", out, *FAST))
    printed = " ".join(done.stdout.split())
    for words in (
        "Layouts of 2 sensors",
        "any: frequencies alone",
        "Gain against the number of sensors",
        "Before any test, the layout of 2 sensors that says most about which of the 2 model",
    ):
        assert words in printed
    sensors = json.loads((out / "plan.json").read_text("utf-8"))["layouts"][0]["sensors"]
    assert sensors == (out / "modes.csv").read_text("utf-8").splitlines()[2].split(",")[5:]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--sensors", 5), "a layout of 5 sensors cannot be had"),
        (("--sensors", 2, "--class", "1-a,1-b"), "'1-a or 1-b' is alone"),
        (("--sensors", 2, "--configuration", "bare"), "got 'bare'"),
        (("--sensors", 2, "--fixed", "roof"), "no candidate 'roof'"),
        (("--sensors", 2, "--added-mass", "roof=1"), "the structure has no place 'roof'"),
        (("--sensors", 2, "--added-mass", "floor 3"), "must be PLACE=MASS, got 'floor 3'"),
        (("--sensors", 2, "--after", "nowhere"), "not a result directory"),
    ],
)
def test_bad_input_is_one_line(run, options, message):
    assert_one_line_error(run("plan", STUDY, *options), message)


def test_a_prediction_of_the_study_and_added_masses(run, tmp_path):
    """The frequency of the first mode is known as well as ln k is, with or without the mass."""
    study = tmp_path / "one.py"
    study.write_text(
        """
import numpy as np

import bayes_ssi as bs

k = bs.Parameter("k", bs.LogNormal(median=1.0, cov=0.3))
structure = bs.ShearBuilding((1.0,), (100.0 * k,))
data = bs.ModalData((bs.IdentifiedMode("1", 1.6, np.ones(1)),), (0.0, 6.0), ("floor 1",))
error = bs.ErrorModel(0.03, 0.05)
study = bs.Study("one", [bs.ModelClass("one", structure, data, error, pairing="any")])


def first_hz(structure, values):
    return np.log(structure.modes(values).frequencies_hz[:, 0])
""",
        "utf-8",
    )
    more = ("--added-mass", "floor 1=0.5", "--json", *FAST)
    gains = []
    for aim in ("k", "first_hz"):
        done = succeeded(run("plan", study, "--sensors", 1, "--aim", aim, *more))
        plan = json.loads(done.stdout)["plan"]
        assert plan["aim"] == aim
        assert list(plan["alternatives"]) == ["no mass added", "0.5 added at floor 1"]
        gains += [each["gain"] for each in plan["alternatives"].values()]
    assert gains == pytest.approx([gains[0]] * 4, abs=0.1)
    assert gains[0] > 1.0


def test_candidates_of_a_file(run, tmp_path):
    file = tmp_path / "places.csv"
    file.write_text("name,place\nfirst,floor 1\nroof,floor 4\n", "utf-8")
    assert_one_line_error(
        run("plan", STUDY, "--sensors", 2, "--candidates", file), "no degree of freedom 'floor 4'"
    )
    assert bs.read_candidates(file)[0].name == "first"
