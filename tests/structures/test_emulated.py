"""Emulated modes: what is exact, what is estimated, and how well; runs given in files."""

import csv
from pathlib import Path

import numpy as np
import pytest
from conftest import COARSE, assert_one_line_error, assert_refused, succeeded
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.structures.emulation.emulated_runs import first_runs
from bayes_ssi.structures.emulation.emulated_structure import (
    EmulatedStructure,
    FailingPoints,
    mode_errors,
)
from bayes_ssi.structures.emulation.gaussian_process import (
    GaussianProcess,
    _negative_log_likelihood,
)
from bayes_ssi.structures.emulation.mode_representations import ModalOperator, TrackedModes
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


def test_few_runs_leave_the_size_of_errors_uncertain(monkeypatch):
    """Of six runs of two properties Student's t has 3 degrees of freedom, and a variance of 3."""
    name = "bayes_ssi.structures.emulation.emulated_runs.mode_errors"
    monkeypatch.setattr(name, lambda *_: np.ones((1, 2)))
    fit = emulated(OWN, RUNS)._fit_for(2)
    np.testing.assert_allclose(fit.ratios * fit.process.left_out[1][:, None], 3**0.5)


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
    assert_refused(words, emulated, factors, runs)


def table(hz, shapes):
    """In descending order, as some programs list them."""
    rows = [[i + 1, float(hz[i]), *map(float, shapes[:, i])] for i in (1, 0)]
    return [["Mode", "Frequency (Hz)", *SENSORS], *rows]


@pytest.fixture
def made(run):
    """Runs that the command chose, in files and in a workbook, and data at factors 0.9, 1.1."""
    openpyxl = pytest.importorskip("openpyxl", reason="pip install bayes_ssi[xlsx]")
    done = succeeded(run("import", "tower", "--runs", "runs", "--properties", "lower, upper"))
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
    done = succeeded(run("import", "tower", "--runs", "runs", "--data", "modes.csv"))
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


def uncoupled(x):
    """Two oscillators, whose frequencies cross at x = 0: modes in ascending order, (B, ...)."""
    frequencies = np.column_stack([2.0 * np.exp(0.3 * x), 2.0 * np.exp(-0.2 * x)])
    order = np.argsort(frequencies, axis=1)
    return bs.Modes(np.sort(frequencies, axis=1), np.eye(2)[:, order].swapaxes(0, 1))


@pytest.mark.parametrize("representation", [ModalOperator(2, 2), TrackedModes(2, 2)])
def test_modes_that_cross_are_emulated_exactly(representation):
    """The logarithms of their frequencies are linear, whichever comes first."""
    x, between = np.linspace(-2.0, 2.0, 21), np.linspace(-1.93, 1.93, 40)
    process = GaussianProcess.fitted(x[:, None], representation.encoded(x[:, None], uncoupled(x)))
    modes = representation.decoded(process.mean(between[:, None]))
    assert mode_errors(modes, uncoupled(between), 2).max() < 1e-6


def test_modes_that_veer_are_emulated_by_their_operator():
    """Two coupled oscillators exchange their shapes within 0.02 of x = 0."""

    def modes(x):
        k = np.zeros((len(x), 2, 2))
        k[:, 0, 0], k[:, 1, 1] = 1.0 + 0.3 * x, 1.0 - 0.3 * x
        k[:, 0, 1] = k[:, 1, 0] = 0.003
        eigenvalues, shapes = np.linalg.eigh(k)
        return bs.Modes(np.sqrt(eigenvalues), shapes)

    x, between = np.linspace(-1.0, 1.0, 13), np.linspace(-0.9, 0.9, 50)
    errors = []
    for representation in (ModalOperator(2, 2), TrackedModes(2, 2)):
        process = GaussianProcess.fitted(x[:, None], representation.encoded(x[:, None], modes(x)))
        decoded = representation.decoded(process.mean(between[:, None]))
        errors.append(mode_errors(decoded, modes(between), 2).max())
    assert errors[0] < 1e-3 < errors[1]


@pytest.mark.parametrize("rounding", [0.0, 1e-15, -1e-15])
def test_a_pair_of_equal_frequency_is_a_plane_whatever_rounding_makes_of_its_operator(rounding):
    """Of ((1, e), (-e, 1)) the eigenvalues are complex, of ((1, e), (e, 1)) they are not."""
    representation = ModalOperator(2, 2)
    for sign in (-1.0, 1.0):
        operator = np.eye(2) + rounding * np.array([[0.0, 1.0], [sign, 0.0]])
        modes = representation.decoded(np.concatenate([operator.ravel(), np.eye(2).ravel()])[None])
        np.testing.assert_allclose(modes.frequencies_hz, np.e)
        assert np.linalg.matrix_rank(modes.shapes[0]) == 2


def test_a_structure_alike_in_two_directions_is_emulated_as_well_as_another():
    """Frequencies are products of parameters and shapes fixed, so that a dozen solutions do."""
    k, r = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in "kr")
    stiffnesses = [(factor,) * 2 for factor in (800.0 * k, 800.0 * k, 3000.0 * r)]
    tower = bs.ShearBuilding3D((1.0, 1.0), (1.2, 1.2), *stiffnesses)
    values = np.random.default_rng(0).uniform(0.7, 1.4, (40, 2))
    accuracy = EmulatedStructure(tower).accuracy(values)
    assert accuracy.frequency < 1e-9
    assert accuracy.shape < 1e-6


def test_errors_of_points_left_out_are_those_of_fits_without_them():
    x = np.random.default_rng(0).standard_normal((30, 2))
    y = np.column_stack([np.sin(x).sum(axis=1), x[:, 0] * x[:, 1] ** 2])
    whole = GaussianProcess(x, y, np.array([1.5, 2.0]), 1e-6)
    left_out, spreads = whole.left_out
    for row in (0, 7, 29):
        rest = np.delete(np.arange(30), row)
        without = GaussianProcess(x[rest], y[rest], whole.lengths, whole.noise)
        np.testing.assert_allclose(left_out[row], without.mean(x[[row]])[0], rtol=1e-6)
        assert spreads[row] == pytest.approx(float(without.spreads(x[[row]])[0]), rel=1e-6)


def test_a_polynomial_of_second_degree_is_exact():
    rng = np.random.default_rng(1)
    x, new = rng.standard_normal((40, 3)), rng.standard_normal((10, 3))
    process = GaussianProcess.fitted(x, (1.0 + x[:, 0] - 2.0 * x[:, 1] * x[:, 2])[:, None])
    exact = 1.0 + new[:, 0] - 2.0 * new[:, 1] * new[:, 2]
    np.testing.assert_allclose(process.mean(new)[:, 0], exact, atol=1e-6)


def test_a_row_of_a_batch_does_not_depend_on_the_others():
    structure = EmulatedStructure(building())
    values = np.exp(0.3 * np.random.default_rng(4).standard_normal((600, 3)))
    whole = structure.modes(values)
    for row in (0, 17, 256, 599):
        alone = structure.modes(values[[row]])
        np.testing.assert_array_equal(alone.frequencies_hz[0], whole.frequencies_hz[row])
        np.testing.assert_array_equal(alone.shapes[0], whole.shapes[row])


def test_claimed_errors_are_those_of_points_never_seen():
    """At 300 draws of the prior, within a factor of two."""
    exact = building()
    emulated = EmulatedStructure(exact)
    values = np.exp(0.3 * np.random.default_rng(3).standard_normal((300, 3)))
    errors = mode_errors(emulated.modes(values), exact.modes(values), exact.n_modes)
    claimed = np.array(emulated.accuracy(values)[:2])
    np.testing.assert_array_less(np.median(errors, axis=0) / 2.0, claimed)
    better = emulated
    for _ in range(3):
        better = better.accurate_at(Requirement(values, *(0.1 * claimed)))
    errors_after = mode_errors(better.modes(values), exact.modes(values), exact.n_modes)
    assert (np.median(errors_after, axis=0) < np.median(errors, axis=0)).all()


def test_a_half_space_that_fails_is_recognised():
    rng = np.random.default_rng(2)
    x, new = rng.standard_normal((200, 3)), rng.standard_normal((500, 3))
    failed = x[:, 0] + x[:, 1] > 1.0
    failing = FailingPoints(x[failed], x[failed], x[~failed])
    sums = new[:, 0] + new[:, 1]
    by_odds, by_nearest = failing.votes(new)
    is_open = by_odds != by_nearest
    assert is_open.mean() < 0.2
    assert ((failing.expected(new) != (sums > 1.0)) & ~is_open).mean() < 0.01


def building():
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in (1, 2, 3)]
    return bs.ShearBuilding((1.0,) * 3, [4000.0 * k for k in factors])


def test_the_gradient_of_a_process_is_that_of_its_likelihood():
    """By central differences."""
    rng = np.random.default_rng(3)
    x, y = rng.standard_normal((14, 2)), rng.standard_normal((14, 3))
    logs, step = np.array([0.3, -0.2, -3.0]), 1e-5
    values = [
        [_negative_log_likelihood(logs + sign * step * e, x, y)[0] for e in np.eye(3)]
        for sign in (1.0, -1.0)
    ]
    by_differences = np.subtract(*values) / (2.0 * step)
    np.testing.assert_allclose(
        _negative_log_likelihood(logs, x, y)[1], by_differences, rtol=1e-6, atol=1e-8
    )
