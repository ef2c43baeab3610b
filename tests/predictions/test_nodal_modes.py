"""Predicted modes: at all nodes, in files; and frequencies with the errors of the model."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from conftest import assert_one_line_error, assert_refused, succeeded
from searches import COARSE

import bayes_ssi as bs
from bayes_ssi.results.predictions.nodal_modes import (
    nodal_modes,
    write_modes_csv,
    write_universal_file,
)

NODES = {"1": (0.0, 0.0, 0.0), "2": (0.0, 0.0, 3.0), "7": (1.5, -2.0, 6.0)}
GEOMETRY = bs.Geometry(NODES, (("1", "2"), ("2", "7")), unit="m")
LABELS = ["2 x", "7 x", "2 ry", "internal 9 x", "7 y"]
STIFFNESS = np.diag([5.0, 4.0, 6.0, 9.0, 2.0]) + 0.5
MASS = np.diag([2.0, 1.0, 0.5, 1.0, 3.0])


def structure(**options):
    factor = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    return bs.MatrixStructure(
        [(factor, STIFFNESS)], MASS, labels=LABELS, sensors=["7 x"], n_modes=3, **options
    )


def test_modes_at_all_nodes_are_those_of_the_matrices():
    modes = nodal_modes(structure(geometry=GEOMETRY), np.array([4.0]))
    eigenvalues, vectors = scipy.linalg.eigh(4.0 * STIFFNESS, MASS)
    expected = np.sqrt(eigenvalues[:3]) / (2.0 * math.pi)
    np.testing.assert_allclose(modes.frequencies_hz, expected, rtol=1e-12)
    assert modes.nodes == ("1", "2", "7")
    for shape, vector in zip(modes.displacements, vectors.T, strict=False):
        rows = np.array([shape[1, 0], shape[2, 0], shape[1, 4], shape[2, 1]])
        vector = vector[[0, 1, 2, 4]] / max(abs(vector[[0, 1, 4]]))
        np.testing.assert_allclose(rows, vector * np.sign(rows @ vector), atol=1e-12)
        assert not shape[0].any()  # the restrained node
        assert abs(shape[:, :3]).max() == pytest.approx(1.0)


def test_a_reduced_and_a_lumped_structure():
    reduced = structure(geometry=GEOMETRY).reduced()
    exact = nodal_modes(reduced.full, np.array([1.0]))
    np.testing.assert_array_equal(
        nodal_modes(reduced, np.array([1.0])).displacements, exact.displacements
    )
    building = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(100.0, 100.0))
    assert nodal_modes(building, np.empty(0)) is None


def test_csv(tmp_path):
    modes = nodal_modes(structure(geometry=GEOMETRY), np.array([1.0]))
    write_modes_csv(tmp_path / "modes.csv", modes)
    with (tmp_path / "modes.csv").open() as file:
        frequencies, columns, *rows = csv.reader(file)
    np.testing.assert_array_equal(np.array(frequencies[1:], float), modes.frequencies_hz)
    # Only directions in which some mode moves.
    assert ", ".join(columns[:4]) == "node, x_coord, y_coord, z_coord"
    assert columns[4:7] == ["mode 1 x", "mode 1 y", "mode 1 ry"]
    assert rows[2][:4] == ["7", "1.5", "-2.0", "6.0"]
    moved = modes.displacements[0, 2, [0, 1, 4]]
    np.testing.assert_allclose(np.array(rows[2][4:7], float), moved, rtol=1e-8)


def test_universal_file(tmp_path):
    """As pyuff, which others wrote, reads it; numbers have six digits."""
    pyuff = pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    modes = nodal_modes(structure(geometry=GEOMETRY), np.array([1.0]))
    path = tmp_path / "modes.uff"
    write_universal_file(path, modes, "frame, updated")
    file = pyuff.UFF(str(path))
    assert [int(kind) for kind in file.get_set_types()] == [15, 82, 55, 55, 55]
    nodes, lines, first, *_ = file.read_sets()
    assert nodes["node_nums"] == [1, 2, 7]
    assert (nodes["x"][2], nodes["y"][2], nodes["z"][2]) == NODES["7"]
    assert list(lines["nodes"]) == [1, 2, 0, 2, 7]
    np.testing.assert_allclose(first["r5"], modes.displacements[0, :, 4], rtol=1e-5)
    back = bs.read_modal_data(path, band_hz=(0.0, 10.0))
    rows = [back.sensors.index(name) for name in ("7 x", "2 x")]
    np.testing.assert_allclose(back.frequencies_hz, modes.frequencies_hz, rtol=1e-5)
    for mode, shape in zip(back.modes, modes.displacements, strict=True):
        np.testing.assert_allclose(mode.shape[rows], shape[[2, 1], 0], rtol=1e-5)


def test_nodes_that_have_names_are_numbered(tmp_path):
    pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    labels = ["Top right x", "Top left x"]
    named = bs.MatrixStructure(np.eye(2), np.eye(2), labels=labels, n_modes=1)
    write_universal_file(tmp_path / "modes.uff", nodal_modes(named, np.empty(0)), "named")
    text = [*map(str.rstrip, (tmp_path / "modes.uff").read_text().splitlines())]
    assert text[1] == f"{55:6d}"  # no coordinates, no lines
    assert text[10].split() == ["1"]
    assert text[12].split() == ["2"]


@pytest.mark.usefixtures("coarse_command")
def test_export(run):
    pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    Path("study.py").write_text(
        "import numpy as np\nimport bayes_ssi as bs\n"
        "k = bs.Parameter('columns', bs.LogNormal(1.0, 0.3))\n"
        "top = bs.MatrixStructure([(k, [[8.0, -4.0], [-4.0, 4.0]])], np.eye(2),\n"
        "    labels=['1 x', '2 x'], n_modes=2)\n"
        "modes = bs.ModalData((bs.IdentifiedMode('1', 0.2, [0.5, 0.8]),\n"
        "    bs.IdentifiedMode('2', 0.5, [0.8, -0.5])), (0.0, 1.0), sensors=('1 x', '2 x'))\n"
        "error = bs.ErrorModel(frequency_cov=0.01, shape_sd=0.1)\n"
        "study = bs.Study('one', [bs.ModelClass('one', top, modes, error,\n"
        "    pairing={'1': 1, '2': 2})])\n"
    )
    succeeded(run("rank", "study.py", "--accept-failed-checks"))
    succeeded(run("export", "runs/results/study"))
    folder = Path("runs/results/study/updated")
    assert sorted(each.name for each in folder.iterdir()) == [
        "modes.csv", "modes.uff", "parameters.csv",
    ]  # fmt: skip
    with (folder / "parameters.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["name"] == "columns"
    factor = float(row["most_probable"])
    assert float(row["quantile_05"]) < factor < float(row["quantile_95"])
    with (folder / "modes.csv").open() as file:
        frequencies = next(csv.reader(file))[1:]
    # 4 k (3 ∓ √5)/2 are the eigenvalues of a fixed chain of two.
    expected = np.sqrt(4.0 * factor * (3.0 + np.array([-1.0, 1.0]) * math.sqrt(5.0)) / 2.0)
    np.testing.assert_allclose(np.array(frequencies, float), expected / (2.0 * math.pi))
    again = run("export", "runs/results/study")
    assert_one_line_error(again, "exists already and is not overwritten")
    assert run("export", "runs/results/study", "--overwrite").exit_code == 0
    wrong = run("export", "runs/results/study", "--class", "two", "--out", "other")
    assert_one_line_error(wrong, "no model class 'two'; choose from 'one'")


SD, RHO = 0.02, 0.9
NOMINAL = np.array([1.0, 2.0, 3.0])


class Fixed(bs.Structure):
    """Frequencies that one parameter hardly changes."""

    degrees_of_freedom = ("place",)
    n_modes = 3
    parameters = (bs.Parameter("k", bs.Normal(0.0, 1.0)),)

    def __init__(self, scale=1.0):
        self.scale = scale

    def modes(self, values):
        return bs.Modes(self.scale * NOMINAL * (1.0 + 1e-9 * values), np.ones((len(values), 1, 3)))


def configurations(identified, frequency_cov):
    """Tests with these identified frequencies of the first modes, (n_tests, n)."""
    for t, frequencies in enumerate(identified):
        modes = [
            bs.IdentifiedMode(f"mode {i}", f, frequency_cov=frequency_cov)
            for i, f in enumerate(frequencies, 1)
        ]
        data, pairing = bs.ModalData(modes, (0.0, 9.0)), {m.label: int(m.label[-1]) for m in modes}
        yield bs.Configuration(f"test {t}", Fixed(), data, pairing=pairing)


@pytest.fixture(scope="module")
def sampled():
    identified = [[1.03, 2.01], [1.02, 2.03]]
    error, tests = bs.ErrorModel(SD, 0.05, RHO, 0.5), tuple(configurations(identified, 0.01))
    candidate = bs.ModelClass("fixed", configurations=tests, error=error)
    return candidate, bs.sample(candidate, settings=COARSE)


def expected(further):
    """Mean and covariance of residuals of (test, mode), from all tests' in one matrix."""
    paired = [(t, i) for t in (0, 1) for i in (1, 2)]
    residuals = np.array([1 / 1.03, 2 / 2.01, 1 / 1.02, 2 / 2.03]) - 1.0
    t, i = np.transpose([*paired, *further])
    shared = np.where(np.equal.outer(t, t), 1.0, RHO)
    covariance = SD**2 * shared * 0.5 ** np.abs(np.subtract.outer(i, i))
    n = len(paired)
    gain = covariance[n:, :n] @ np.linalg.inv(covariance[:n, :n] + 0.01**2 * np.eye(n))
    return gain @ residuals, covariance[n:, n:] - gain @ covariance[:n, n:]


@pytest.mark.parametrize(
    ("state", "test", "scale", "numbers"),
    [
        (Fixed(0.9), 2, 0.9, (1, 2, 3)),
        ("test 1", 1, 1.0, (3, 2)),  # one that was not identified, and one that was
    ],
    ids=["new state", "tested state"],
)
def test_errors_are_those_given_the_residuals_of_the_tests(sampled, state, test, scale, numbers):
    candidate, posterior = sampled
    n = 20_000
    modes = {f"mode {i}": i for i in numbers}
    predicted = bs.predict_frequencies(posterior, candidate, state, modes, n, seed=1).draws
    assert predicted.shape == (n, len(numbers))
    residuals = scale * NOMINAL[np.array(numbers) - 1] / predicted - 1.0
    mean, covariance = expected([(test, i) for i in numbers])
    sds = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(residuals.mean(0), mean, atol=5.0 * sds.max() / math.sqrt(n))
    scaled = np.cov(residuals.T) / np.outer(sds, sds)
    np.testing.assert_allclose(scaled, covariance / np.outer(sds, sds), atol=7.0 / math.sqrt(n))


def test_independent_errors_are_not_expected_again(sampled):
    candidate, posterior = sampled
    alone = bs.ModelClass("alone", configurations=candidate.configurations, error=bs.ErrorModel(SD))
    predicted = bs.predict_frequencies(posterior, alone, Fixed(), {"mode 1": 1}, 20_000).draws
    assert (1.0 / predicted - 1.0).mean() == pytest.approx(0.0, abs=5.0 * SD / math.sqrt(20_000))
    assert (1.0 / predicted - 1.0).std() == pytest.approx(SD, rel=0.03)


class Unknown(Fixed):
    parameters = (bs.Parameter("other", bs.Normal(0.0, 1.0)),)


@pytest.mark.parametrize(
    ("state", "number", "message"),
    [
        (Fixed(), 4, "mode 'x' is model mode 4; the structure has modes 1 to 3"),
        ("roof", 1, "model class 'fixed' has no configuration 'roof'"),
        (Unknown(), 1, "model class 'fixed' has no parameter 'other'; choose from 'k'"),
    ],
)
def test_what_cannot_be_predicted_is_refused(sampled, state, number, message):
    candidate, posterior = sampled
    assert_refused(message, bs.predict_frequencies, posterior, candidate, state, {"x": number})
