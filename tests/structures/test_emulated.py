"""Modes between runs of a program: right to what is claimed, and more runs asked for by name."""

import csv
from pathlib import Path

import numpy as np
import pytest
from conftest import COARSE, assert_one_line_error
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.structures.emulation.emulated_runs import first_runs
from bayes_ssi.structures.structure import Requirement

NAMES, SENSORS = ("lower", "upper"), ("floor 1", "floor 3")


def solved(lower, upper):
    """Frequencies and shapes of three unit masses on springs, by the generalised eigenproblem."""
    k = np.array([1500.0 * lower, 1000.0 * upper, 1000.0 * upper])
    stiffness = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    squares, shapes = eigh(stiffness, np.eye(3))
    return np.sqrt(squares[:2]) / (2 * np.pi), shapes[[0, 2], :2]


def emulated(factors, runs):
    modes = [solved(*run) for run in runs]
    columns = dict(zip(NAMES, np.transpose(runs), strict=True))
    shapes = np.array([shape for _, shape in modes])
    return bs.EmulatedRuns(factors, columns, np.array([hz for hz, _ in modes]), shapes, SENSORS)


PRIOR = bs.LogNormal(median=1.0, cov=0.3)
OWN = {name: bs.Parameter(name, PRIOR) for name in NAMES}
RUNS = first_runs(2, 6)


def test_the_first_runs_begin_at_nominal_and_fill_what_is_likely():
    runs = first_runs(4, 10)
    assert runs.shape == (10, 4)
    np.testing.assert_array_equal(runs[0], 1.0)
    assert np.exp(-0.3 * 1.8) <= runs.min() < 0.7 < 1.4 < runs.max() <= np.exp(0.3 * 1.8) + 1e-3


def test_runs_are_reproduced_and_claimed_errors_are_those_between():
    runs = first_runs(2, 12)
    structure = emulated(OWN, runs)
    at_runs = structure.modes(runs)
    np.testing.assert_allclose(at_runs.frequencies_hz, [solved(*run)[0] for run in runs], rtol=1e-4)
    between = np.exp(0.2 * np.random.default_rng(0).standard_normal((100, 2)))
    exact = np.array([solved(*row)[0] for row in between])
    errors = np.abs(structure.modes(between).frequencies_hz / exact - 1.0).max(axis=1)
    claimed = structure.accuracy(between).frequency
    # Cautious: with few runs their number is part of the claim.
    assert np.quantile(errors, 0.9) < claimed < 20 * np.median(errors)


def test_one_factor_for_all_properties_is_emulated_from_the_same_runs():
    common = emulated(dict.fromkeys(NAMES, bs.Parameter("all", PRIOR)), RUNS)
    own = emulated(OWN, RUNS)
    at = np.array([[0.9, 0.9]])
    np.testing.assert_array_equal(common.modes(at[:, :1])[0], own.modes(at)[0])


def test_runs_that_are_missing_are_named_among_what_is_required():
    structure = emulated(OWN, RUNS)
    values = np.array([[1.0, 1.0], [0.9, 1.1], [0.5, 2.0]])
    words = structure.advice(Requirement(values, 1e-6, 1e-6))
    assert words.startswith("run the program next at lower=0.5, upper=2")


@pytest.mark.parametrize(
    ("factors", "runs", "words"),
    [
        ({"lower": 1.0}, RUNS, "no factor of 'upper'"),
        (OWN | {"roof": 1.0}, RUNS, "no property 'roof'"),
        (OWN, RUNS[:5], "5 runs for 2 properties, too few"),
    ],
)
def test_what_cannot_be_emulated_is_refused(factors, runs, words):
    with pytest.raises(ValueError, match=words):
        emulated(factors, runs)


def table(hz, shapes):
    """In descending order, as some programs list them."""
    rows = [[i + 1, float(hz[i]), *map(float, shapes[:, i])] for i in (1, 0)]
    return [["Mode", "Frequency (Hz)", *SENSORS], *rows]


@pytest.fixture
def made(run):
    """Runs that the command chose, in files and in a workbook, and data at factors 0.9, 1.1."""
    openpyxl = pytest.importorskip("openpyxl", reason="pip install bayes_ssi[xlsx]")
    done = run("import", "tower", "--runs", "runs", "--properties", "lower, upper")
    assert done.exit_code == 0, done.output
    assert "1, 1.0, 1.0" in done.output.splitlines()
    with Path("runs/design.csv").open() as file:
        rows = list(csv.DictReader(file))
    book = openpyxl.Workbook()
    for row in rows:
        lines = table(*solved(*(float(row[name]) for name in NAMES)))
        if row["run"] in ("1", "2"):
            sheet = book.create_sheet(row["run"])
            for line in lines:
                sheet.append(line)
        else:
            with Path("runs", f"{row['run']}.csv").open("w", newline="") as file:
                csv.writer(file).writerows(lines)
    book.save("runs/some.xlsx")
    hz, shapes = solved(0.9, 1.1)
    data = bs.ModalData.from_arrays(hz, shapes, (0, 8), SENSORS, frequency_cov=0.05, shape_sd=0.1)
    bs.write_modal_data(data, "modes.csv")
    return rows


def test_a_study_from_runs(run, made):
    done = run("import", "tower", "--runs", "runs", "--data", "modes.csv")
    assert done.exit_code == 0, done.output
    assert "6 runs of lower, upper: 2 modes at 2 sensors." in done.output
    study = bs.load_study(Path("tower.py"))
    assert study.names == ("one factor", "each its own")
    (own,) = study.only(["each its own"]).model_classes
    at_run = [[float(made[3][name]) for name in NAMES]]
    (test,) = own.configurations
    np.testing.assert_allclose(
        test.structure.modes(np.array(at_run)).frequencies_hz[0], solved(*at_run[0])[0], rtol=1e-4
    )
    posterior = bs.sample(own, 1, COARSE)
    # Errors of 5 % are large enough for six runs, and nothing else was asked for.
    assert any("modes emulated from 6 solutions" in remark for remark in posterior.remarks)
    assert not any("run the program next" in check for check in posterior.failed_checks)
    Path("runs/6.csv").unlink()
    assert_one_line_error(run("rank", "tower.py"), "EmulatedRuns: 5 runs for 2 properties, too few")


@pytest.mark.usefixtures("made")
def test_runs_that_are_too_few_for_the_data_are_a_failed_check(run):
    run("import", "tower", "--runs", "runs", "--data", "modes.csv")
    modes = bs.read_modal_data("modes.csv")
    precise = [bs.IdentifiedMode(m.label, m.frequency_hz, m.shape, 1e-4, 1e-3) for m in modes.modes]
    data = bs.ModalData(tuple(precise), modes.band_hz, modes.sensors)
    structure = bs.EmulatedRuns(OWN, **bs.read_runs("runs"))
    error = bs.ErrorModel(frequency_cov=1e-4, shape_sd=1e-3)
    one = bs.ModelClass("a", structure, data, error, pairing={"1": 1, "2": 2})
    posterior = bs.sample(one, 1, COARSE)
    assert any("run the program next at lower=" in check for check in posterior.failed_checks)


@pytest.mark.parametrize(
    ("design", "words"),
    [
        ("run,lower,upper\n7,1,1\n", "runs: no run has a table, such as "),
        ("run,lower,upper\n3,1,0\n", "design.csv, line 2: must be a run and 2 positive factors"),
        ("lower,upper\n1,1\n", "design.csv: columns must be run and the properties"),
    ],
)
@pytest.mark.usefixtures("made")
def test_wrong_designs_are_refused(run, design, words):
    Path("runs/design.csv").write_text(design)
    assert_one_line_error(run("import", "tower", "--runs", "runs", "--data", "modes.csv"), words)


@pytest.mark.usefixtures("made")
def test_runs_need_properties_first_and_data_then(run):
    assert_one_line_error(run("import", "a", "--runs", "runs"), "give --properties to begin, or")
    again = run("import", "a", "--runs", "runs", "--properties", "lower")
    assert_one_line_error(again, "design.csv: exists already and is not overwritten")
    assert_one_line_error(run("import", "a"), "give --nominal, an export, or --runs")
