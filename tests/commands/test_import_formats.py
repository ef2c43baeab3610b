"""``bayes-ssi import`` of every format that needs no other package, from files as programs lay out.

Each writes the same frame of two storeys, whose stiffnesses are the properties.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sp
from click.testing import CliRunner

from bayes_ssi.cli import main
from bayes_ssi.studies.ranking.study import load_study

FACTORS = {"frame": (1.0, 1.0), "lower": (1.2, 1.0), "upper": (1.0, 0.8), "both": (0.9, 1.3)}
M = np.diag([5e3, 4e3])


def stiffness(lower, upper):
    return np.array([[9e5 * lower + 7e5 * upper, -7e5 * upper], [-7e5 * upper, 7e5 * upper]])


def entries(matrix, line):
    return "".join(line.format(i + 1, j + 1, matrix[i, j]) for i in range(2) for j in range(2))


def abaqus(name, k):
    """``*MATRIX OUTPUT``: node, degree of freedom, node, degree of freedom, entry."""
    for kind, matrix in (("STIF", k), ("MASS", M)):
        Path(f"{name}_{kind}1.mtx").write_text(entries(matrix, "{0},1, {1},1, {2: .15e}\n"))
    return f"{name}_STIF1.mtx"


def abaqus_coordinate(name, k):
    """FORMAT=COORDINATE: row, column and entry between blanks."""
    for kind, matrix in (("STIF", k), ("MASS", M)):
        Path(f"{name}_{kind}1.mtx").write_text(entries(matrix, "{0} {1} {2: .15e}\n"))
    return f"{name}_STIF1.mtx"


def calculix(name, k):
    Path(f"{name}.dof").write_text("1.1\n2.1\n")
    for ending, matrix in (("sti", k), ("mas", M)):
        upper = "".join(
            f"{i + 1} {j + 1} {float(matrix[i, j])!r}\n" for i, j in ((0, 0), (0, 1), (1, 1))
        )
        Path(f"{name}.{ending}").write_text(upper)
    return f"{name}.sti"


def matrix_market(name, k):
    """ANSYS ``*EXPORT, …, MMF``."""
    for kind, matrix in (("K", k), ("M", M)):
        with Path(f"{name}{kind}.mmf").open("wb") as file:
            scipy.io.mmwrite(file, sp.coo_array(np.tril(matrix)), precision=16)
    return f"{name}K.mmf+{name}M.mmf"


def opensees(name, k):
    """``printA -file``: a row a line."""
    for kind, matrix in (("K", k), ("M", M)):
        rows = [" ".join(f"{value:.15g}" for value in row) for row in matrix]
        Path(f"{name}{kind}.out").write_text("\n".join([*rows, ""]))
    return f"{name}K.out+{name}M.out"


def matlab(name, k):
    scipy.io.savemat(f"{name}.mat", {"Kff": k, "Mff": M, "Kother": np.eye(3), "Mother": np.eye(3)})
    return f"{name}.mat"


def npz(name, k):
    np.savez(f"{name}.npz", K=k, M=M)
    return f"{name}.npz"


UNLABELLED = ("--labels", "labels.txt")
FORMATS = {
    abaqus: (), abaqus_coordinate: UNLABELLED, calculix: (),
    matrix_market: UNLABELLED, opensees: UNLABELLED, npz: UNLABELLED,
    matlab: ("--keys", "Kff,Mff", *UNLABELLED),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("labels.txt").write_text("1 x\n2 UX\n")
    Path("modes.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,1 x\n1,1.3,1\n")
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, ["import", *arguments])


def options(files):
    return (
        "frame", "--nominal", files["frame"], "--changed", f"lower=1.2:{files['lower']}",
        "--changed", f"upper=0.8:{files['upper']}", "--data", "modes.csv",
        "--check", f"lower=0.9,upper=1.3:{files['both']}",
    )  # fmt: skip


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("written", FORMATS, ids=lambda written: written.__name__)
def test_a_format_by_one_command(written):
    files = {name: written(name, stiffness(*factors)) for name, factors in FACTORS.items()}
    done = run(*options(files), *FORMATS[written])
    assert done.exit_code == 0, done.output
    structure = load_study("frame.py").model_classes[-1].structure
    assert {parameter.name for parameter in structure.parameters} == {"lower", "upper"}
    values = {"lower": 1.3, "upper": 0.7}
    at = np.array([[values[parameter.name] for parameter in structure.parameters]])
    expected = np.sqrt(scipy.linalg.eigvalsh(stiffness(1.3, 0.7), M)) / (2.0 * np.pi)
    np.testing.assert_allclose(structure.modes(at).frequencies_hz[0], expected, rtol=1e-7)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("written", "change", "words"),
    [
        (opensees, lambda each: each.split("+")[0], "frameK.out+MASS in commands, mass= in Python"),
        (matlab, None, "as in --keys KAA,MAA"),
    ],
)
def test_what_a_format_needs_is_said_as_the_command_takes_it(written, change, words):
    files = {name: written(name, stiffness(*factors)) for name, factors in FACTORS.items()}
    if change is not None:
        files = {name: change(file) for name, file in files.items()}
    done = run(*options(files))
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())


@pytest.mark.usefixtures("folder")
def test_unlabelled_exports_need_labels():
    files = {name: abaqus_coordinate(name, stiffness(*FACTORS[name])) for name in FACTORS}
    done = run(*options(files))
    assert done.exit_code == 2
    words = " ".join(done.output.split())
    assert "no labels, by which sensors are named: give them in a --labels file" in words
    assert not Path("frame.py").exists()


@pytest.mark.usefixtures("folder")
def test_keys_are_two():
    files = {name: npz(name, stiffness(*factors)) for name, factors in FACTORS.items()}
    done = run(*options(files), "--keys", "K")
    assert done.exit_code == 2
    assert "--keys: expected STIFFNESS,MASS, got 'K'" in done.output
