"""Many tests of one structure: from rankings of each to populations, tables and files."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import assert_one_line_error, assert_refused

import bayes_ssi as bs
from bayes_ssi.commands.options import read_covariate
from bayes_ssi.inference.criticism.adequacy import PValue
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.results.hierarchy.hierarchy_record import MARKER
from bayes_ssi.results.hierarchy.ranked_populations import (
    different_structures,
    repeated_errors,
    unexplained_tests,
)
from bayes_ssi.studies.ranking.comparison import Check

FREQUENCIES = {"January": (1.02, 2.66), "April": (1.0, 2.62), "July": (0.98, 2.57)}
TEMPERATURES = {"January": -4.0, "April": 10.0, "July": 27.0}
COARSE = bs.SamplingSettings(
    log_evidence_error=0.05, particles=100, searches=1, effective_sample_size=500, max_steps=500
)
SAME, BOTH = "the same in all tests", "varies with temperature and from test to test"


def configuration(name):
    k1, k2 = (bs.Parameter(f"k{i}", bs.LogNormal(median=1.0, cov=0.3)) for i in (1, 2))
    building = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(103.0 * k1, 103.0 * k2))
    shapes = [[0.53, 0.85], [0.85, -0.53]]
    sensors = building.degrees_of_freedom
    data = bs.ModalData.from_arrays(FREQUENCIES[name], shapes, (0.0, 4.0), sensors)
    return bs.Configuration(name, building, data, pairing={"1": 1, "2": 2})


def model_class(name, error=None):
    test = configuration(name)
    error = error or bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    return bs.ModelClass("frame", test.structure, test.data, error, pairing=test.pairing)


def ranking(*classes):
    return bs.rank(bs.Study("one test", list(classes)), settings=COARSE)


@pytest.fixture(scope="module")
def rankings():
    return {name: ranking(model_class(name)) for name in FREQUENCIES}


@pytest.fixture(scope="module")
def made(rankings):
    return bs.hierarchy(rankings, TEMPERATURES, covariate_name="temperature", settings=COARSE)


def population(made, name):
    return next(each for each in made.populations if each.name == name)


def test_the_same_parameters_in_all_tests_are_those_of_one_class_of_all(made):
    """Sampled jointly, with the tests as configurations of one class."""
    error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.05)
    tests = list(map(configuration, FREQUENCIES))
    joint = bs.sample(bs.ModelClass("all", configurations=tests, error=error))
    same = population(made, SAME)
    allowed = 4.0 * np.hypot(same.error, joint.evidence.error)
    assert same.error < 0.3
    assert same.log_evidence == pytest.approx(joint.evidence.log_evidence, abs=allowed)
    # 500 draws: the mean and the standard deviation have errors of 1/√500 and 1/√1000.
    centres, sds = joint.values.mean(axis=0), joint.values.std(axis=0)
    drawn = made.centres(same)
    np.testing.assert_allclose((drawn.mean(axis=0) - centres) / sds, 0.0, atol=4.0 / 500**0.5)
    np.testing.assert_allclose(drawn.std(axis=0) / sds, 1.0, atol=4.0 / 1000**0.5)


def test_what_a_hierarchy_says(made):
    assert made.model_class == "frame"
    assert made.names == ("k1", "k2")
    assert [test.name for test in made.tests] == list(FREQUENCIES)
    assert made.covariate.mean == pytest.approx(11.0)
    assert {each.name for each in made.populations} == {
        SAME, "varies from test to test", "varies with temperature", BOTH,
    }  # fmt: skip
    assert sum(each.probability for each in made.populations) == pytest.approx(1.0)
    assert made.failed_checks == ()
    # A straight line through the medians of the single tests, which have equal errors.
    medians = np.array([[median for _, median, _ in test.intervals] for test in made.tests])
    line = np.polyfit(list(TEMPERATURES.values()), medians, 1)[0]
    slopes = made.slopes(population(made, "varies with temperature"))
    np.testing.assert_array_less(np.abs(slopes.mean(axis=0) - line), 0.5 * slopes.std(axis=0))


def test_the_next_test(made):
    both = population(made, BOTH)
    warm = replace(made, populations=(replace(both, probability=1.0),)).next_test(20_000, 30.0)
    assert warm.shape == (20_000, 2)
    # Of lognormal parameters, with what the population says at its draws.
    means, slopes, spreads = both.population.split(both.draws)
    x = (30.0 - made.covariate.mean) / made.covariate.sd
    z = np.log(warm) / bs.LogNormal(1.0, 0.3).log_sd
    sd = np.sqrt((spreads**2).mean(axis=0) + (means + slopes * x).var(axis=0))
    error = sd / 20_000**0.5
    np.testing.assert_array_less(np.abs(z.mean(0) - (means + slopes * x).mean(0)), 4.0 * error)
    np.testing.assert_allclose(z.std(axis=0), sd, rtol=0.05)


@pytest.fixture(scope="module")
def of_k2(rankings):
    return bs.hierarchy(
        rankings, TEMPERATURES, parameters=["k2"], covariate_name="temperature", settings=COARSE
    )


def test_parameters_that_are_left_out_are_independent_from_test_to_test(of_k2):
    assert of_k2.best.population.parameters[0].name == "mean of k2"
    k1 = of_k2.next_test(20_000, 10.0)[:, 0]
    assert np.median(k1) == pytest.approx(1.0, abs=0.02)  # its prior
    with pytest.raises(ValueError, match="there is no covariate, got 3"):
        replace(of_k2, covariate=None).next_test(covariate=3.0)


def test_a_test_that_the_class_does_not_explain_fails(rankings):
    """And one whose data failed a check of their own."""
    candidate = model_class("April")
    mistaken = replace(candidate.data, sensors=candidate.data.sensors[::-1])
    tests = [replace(candidate.configurations[0], data=mistaken)]
    april = ranking(replace(candidate, configurations=tests))
    doubtful = rankings["July"].comparison.with_checks([Check("data", "the methods differ")])
    july = replace(rankings["July"], comparison=doubtful)
    made = bs.hierarchy({**rankings, "April": april, "July": july}, settings=COARSE)
    of_data, failed = made.failed_checks
    assert of_data == "test 'July': the methods differ"
    assert failed.startswith("test 'April', 'frame': the data are not explained: mode '")
    assert "Likely cause: channels 'floor 2' and 'floor 1' seem to be exchanged" in failed


def posteriors_of(rankings):
    return {name: made.posteriors[0] for name, made in rankings.items()}


@pytest.mark.parametrize(("p_value", "fails"), [(0.004, False), (0.003, True)])
def test_of_three_tests_one_has_to_be_three_times_as_unusual_to_fail(rankings, p_value, fails):
    posteriors = posteriors_of(rankings)
    january = posteriors["January"]
    unusual = replace(january.adequacy, overall=PValue.of(np.log(p_value)))
    tests = {**posteriors, "January": replace(january, adequacy=unusual)}
    assert len(list(unexplained_tests("frame", tests))) == fails


def wrong_tower(degrees, ratio):
    """A tower of one stiffness, whose second frequency is ``ratio`` of what it should be."""
    k = bs.Parameter("k", bs.LogNormal(median=1.0, cov=0.3))
    scale = 1.0 - 0.001 * degrees
    modes = bs.IdentifiedMode("1", scale), bs.IdentifiedMode("2", 2.618 * ratio * scale)
    building = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(103.4 * k, 103.4 * k))
    data = bs.ModalData(modes, band_hz=(0.0, 4.0))
    return bs.ModelClass("tower", building, data, pairing={"1": 1, "2": 2})


@pytest.mark.parametrize(("ratio", "fails"), [(0.94, True), (1.0, False)])
def test_a_class_that_errs_alike_in_all_tests_fails(ratio, fails):
    rankings = {str(at): ranking(wrong_tower(at, ratio)) for at in (-10.0, 10.0, 30.0)}
    failed = list(repeated_errors("tower", posteriors_of(rankings)))
    assert len(failed) == fails
    if fails:
        assert re.search(r"mode 1 -\d\.\d %, mode 2 \+\d\.\d % on average", failed[0])


def of_classes(ranking, *classes):
    """The ranking as if it had been of these classes, which have one posterior."""
    posteriors = tuple(replace(ranking.posteriors[0], name=each.name) for each in classes)
    study = bs.Study("one test", list(classes))
    return replace(ranking, study=study, posteriors=posteriors, comparison=bs.compare(posteriors))


def test_what_is_refused(rankings):
    january, april, july = rankings.values()
    own = model_class("July")
    other = of_classes(july, replace(own, priors={"k2": bs.LogNormal(1.0, 0.5)}))
    two = of_classes(july, own, replace(own, name="other"))
    free = of_classes(july, model_class("July", bs.ErrorModel(shape_sd=0.05)))
    for problem, tests, options in (
        ("at least 2 tests are needed, got 1", {"a": january}, {}),
        ("tests 'a' and 'b' have the same data", {"a": january, "b": january}, {}),
        ("has the parameter ParameterRecord(name='k2'", {"a": january, "b": other}, {}),
        ("in test 'a' and ParameterRecord(", {"a": january, "b": free}, {}),
        ("'b': no model class 'x'; Choose from 'frame', 'other'", {"b": two},
         {"class_name": "x"}),
        ("'a': which model class? Choose from", {"a": two, "b": april}, {}),
        ("the structure has no parameter 'k3'; choose from 'k1', 'k2'", rankings,
         {"parameters": ["k3"]}),
        ("no parameter is named", rankings, {"parameters": []}),
        ("no value of 'covariate' for test 'July'", rankings,
         {"covariate": {"January": 1.0, "April": 2.0}}),
        ("of test 'April' must be a finite number, got nan", rankings,
         {"covariate": {**TEMPERATURES, "April": float("nan")}}),
        ("'covariate' is 4 in all tests", rankings, {"covariate": dict.fromkeys(rankings, 4)}),
    ):  # fmt: skip
        tests = {**tests, "July": july} if list(tests) == ["b"] else tests
        assert_refused(re.escape(problem), bs.hierarchy, tests, **options)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "the file is empty"),
        ("# comment", "the first line must be 'test, NAME OF THE COVARIATE', got nothing"),
        ("test\nx, 1", "got ['test']"),
        ("test, t\nx", "line 2: expected a test and its t, got 'x'"),
        ("test, t\nx, warm", "line 2: t must be a number, got 'warm'"),
        ("test, t\n# comment\n\nx, 1\nx, 2", "line 5: a second value for test 'x'"),
    ],
)
def test_covariate_files_that_are_refused(tmp_path, text, problem):
    path = tmp_path / "t.csv"
    path.write_text(text)
    assert_refused(f"^{re.escape(str(path))}.*{re.escape(problem)}", read_covariate, path)


@pytest.fixture(scope="module")
def directory(rankings, tmp_path_factory):
    """Results of all tests, with their temperatures."""
    path = tmp_path_factory.mktemp("tests")
    for name, made in rankings.items():
        bs.save_result(made, path / name)
    rows = [f"{name}, {value}" for name, value in TEMPERATURES.items()]
    (path / "t.csv").write_text("\n".join(["test, temperature", *rows]))
    return path


def test_structures_that_are_not_defined_alike_are_said_once(rankings):
    heavier = bs.ShearBuilding((1.0, 2.0), configuration("January").structure.stiffnesses)
    others = {}
    for name in ("April", "July"):
        test = replace(configuration(name), structure=heavier)
        others[name] = of_classes(rankings[name], replace(model_class(name), configurations=[test]))
    alike, not_alike = (
        list(different_structures({n: class_record(r.study.model_classes[0]) for n, r in all_of}))
        for all_of in (rankings.items(), {**rankings, **others}.items())
    )
    assert not alike
    (remark,) = not_alike
    assert remark.startswith("the structure of test 'April' is not defined as that of 'January': ")


@pytest.fixture
def saved(directory, monkeypatch):
    """Names of the tests, whose results are in the working directory."""
    monkeypatch.chdir(directory)
    return list(FREQUENCIES)


@pytest.mark.usefixtures("coarse_command")
def test_the_command(run, saved, of_k2):
    options = ("--covariate", "t.csv", "--parameters", "k2", "--next", "30", "--out", "made")
    command = ["hierarchy", *saved, *options]
    done = run(*command, "--json")
    assert done.exit_code in (0, 3), done.output  # coarse as it is, the sampling may fail a check
    ours = {each["name"]: each["log_evidence"] for each in json.loads(done.stdout)["populations"]}
    assert ours == {
        each.name: pytest.approx(each.log_evidence, abs=4.0 * (each.error + 0.02))
        for each in of_k2.populations
    }
    assert Path("made/population.png").stat().st_size > 10_000
    loaded = bs.load_hierarchy("made")
    assert loaded.best.log_evidence == next(iter(ours.values()))
    with open("made/next_test.csv", newline="") as file:
        names, *rows = list(csv.reader(file))
    assert names == ["k1", "k2"]
    np.testing.assert_allclose(np.array(rows, dtype=float), loaded.next_test(1000, 30.0), rtol=1e-6)
    assert_one_line_error(run(*command), "made: exists already and is not overwritten")


def test_the_command_refuses(run, saved):
    for arguments, problem in (
        ([*saved, "--next", "3"], "--next: there is no covariate"),
        ([*saved, saved[0]], "January: given twice"),
        ([*saved, "missing"], "missing: not a result directory: no result.json"),
        ([*saved, "--spread", "0"], "HalfNormal: scale must be positive, got 0.0"),
    ):
        assert_one_line_error(run("hierarchy", *arguments), problem)


def test_a_damaged_hierarchy_is_refused(made, tmp_path):
    bs.save_hierarchy(made, tmp_path / "made")
    path = tmp_path / "made" / MARKER
    path.write_text(path.read_text().replace('"format": 2', '"format": 99'))
    assert_refused("a hierarchy of format 99", bs.load_hierarchy, tmp_path / "made")
