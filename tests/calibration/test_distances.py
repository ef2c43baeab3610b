"""Distances of calibrated classes from a reference class: the paper's Table 1 and section 4.6."""

import math
from pathlib import Path

import pytest
from click.testing import CliRunner

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.inference.calibration.calibration import distances_from
from bayes_ssi.studies.ranking.study_file import load_study

STUDY = Path(__file__).parents[2] / "model_classes" / "shear_building.py"


@pytest.fixture(scope="module")
def calibrated():
    classes = load_study(STUDY).only(["1-a", "1-b", "3"]).model_classes
    return classes, {each.name: bs.calibrate(each, 0.0, n_starts=16) for each in classes}


def test_the_distances_of_table_1_are_from_approach_3(calibrated):
    """Over the three parameters that all infer: 13.0 and 33.6 % in the paper."""
    parameters, distances = distances_from("3", *calibrated)
    assert parameters == ("k1", "k2", "k3")
    assert distances == pytest.approx({"1-a": 0.130, "1-b": 0.336, "3": 0.0}, abs=6e-4)


def test_what_a_class_does_not_infer_is_at_its_prior_median(calibrated):
    classes, calibrations = calibrated
    k3 = calibrations["1-a"].best.values[2]
    fixed = bs.ModelClass(
        "k3 as drawn",
        bs.ShearBuilding(
            masses=classes[0].structure.masses,
            stiffnesses=(*classes[0].structure.stiffnesses[:2], 199.3),
        ),
        classes[0].data,
        pairing={"1": 1, "2a": 2, "3": 3},
    )
    calibrations = {"1-a": calibrations["1-a"], fixed.name: bs.calibrate(fixed, 0.0, n_starts=4)}
    _, distances = distances_from("1-a", (classes[0], fixed), calibrations)
    ours, theirs = (calibrations[name].best.values for name in ("1-a", fixed.name))
    squares = [(theirs[0] - ours[0]) ** 2, (theirs[1] - ours[1]) ** 2, (1.0 - k3) ** 2]
    assert distances[fixed.name] == pytest.approx(math.sqrt(sum(squares) / 3.0))


def test_the_command_prints_them_and_refuses_an_unknown_class():
    arguments = ["calibrate", str(STUDY), "--shape-weight", "0", "--starts", "8"]
    result = CliRunner().invoke(main, [*arguments, "--only", "1-a,3", "--reference", "3"])
    assert result.exit_code == 0, result.output
    assert "Distance d from '3', over k1, k2, k3" in " ".join(result.stdout.split())
    assert "13.0" in result.stdout.rpartition("Distance")[2]
    wrong = CliRunner().invoke(main, [*arguments, "--reference", "4"])
    assert wrong.exit_code == 2
    assert "--reference: no model class '4'; choose from '1-a', '1-b', '2', '3'" in wrong.stderr
