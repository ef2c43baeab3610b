"""``bayes-ssi plan``: what it prints, saves and refuses."""

import json

import pytest
from code_blocks import ROOT
from conftest import assert_one_line_error

import bayes_ssi as bs

STUDY = ROOT / "model_classes" / "shear_building.py"
FAST = ("--tests", 60, "--draws", 150)


def test_plan_prints_layouts_and_saves_the_form(run, tmp_path):
    out = tmp_path / "plan"
    done = run("plan", STUDY, "--sensors", 2, "--out", out, *FAST)
    assert done.exit_code == 0, done.output
    printed = " ".join(done.stdout.split())
    for words in (
        "Layouts of 2 sensors",
        "any: frequencies alone",
        "Gain against the number of sensors",
        "all errors half as large",
        "Before any test, the layout of 2 sensors that says most about which of the 2 model",
    ):
        assert words in printed
    record = json.loads((out / "plan.json").read_text("utf-8"))
    sensors = record["layouts"][0]["sensors"]
    assert sensors == (out / "modes.csv").read_text("utf-8").splitlines()[2].split(",")[5:]


def test_json_holds_the_plan(run):
    done = run("plan", STUDY, "--sensors", 1, "--aim", "k1", "--json", *FAST)
    assert done.exit_code == 0, done.output
    plan = json.loads(done.stdout)["plan"]
    assert plan["aim"] == "k1"
    assert plan["greatest"] is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--sensors", 5), "a layout of 5 sensors cannot be had"),
        (("--sensors", 2, "--only", "1-a,1-b"), "'1-a or 1-b' is alone"),
        (("--sensors", 2, "--configuration", "bare"), "got 'bare'"),
        (("--sensors", 2, "--fixed", "roof"), "no candidate 'roof'"),
        (("--sensors", 2, "--after", "nowhere"), "not a result directory"),
    ],
)
def test_bad_input_is_one_line(run, options, message):
    assert_one_line_error(run("plan", STUDY, *options), message)


def test_candidates_of_a_file(run, tmp_path):
    file = tmp_path / "places.csv"
    file.write_text("name,place\nfirst,floor 1\nroof,floor 4\n", "utf-8")
    assert_one_line_error(
        run("plan", STUDY, "--sensors", 2, "--candidates", file), "no degree of freedom 'floor 4'"
    )
    assert bs.read_candidates(file)[0].name == "first"
