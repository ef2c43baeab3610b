"""``bayes-ssi import``: a study from exports, whole or not at all."""

import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from click.testing import CliRunner
from conftest import assert_one_line_error, succeeded
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.results.predictions.nodal_modes import NodalModes, write_universal_file

DATA = Path(__file__).parent.parent / "solver_files" / "data"
SENSORS = ("100 x", "200 x", "340 x", "340 y")
FACTORS = {"frame": (1.0, 1.0), "lower": (1.2, 1.0), "upper": (1.0, 0.8), "both": (0.9, 1.3)}
M = np.diag([5e3, 4e3])


def stiffness(lower, upper):
    return np.array([[9e5 * lower + 7e5 * upper, -7e5 * upper], [-7e5 * upper, 7e5 * upper]])


def calculix(name, k):
    Path(f"{name}.dof").write_text("1.1\n2.1\n")
    for ending, matrix in (("sti", k), ("mas", M)):
        upper = "".join(
            f"{i + 1} {j + 1} {float(matrix[i, j])!r}\n" for i, j in ((0, 0), (0, 1), (1, 1))
        )
        Path(f"{name}.{ending}").write_text(upper)
    return f"{name}.sti"


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


@pytest.fixture
def tower(tmp_path, monkeypatch):
    """CalculiX's exports of a tower of bricks, and modes of it with both halves altered."""
    monkeypatch.chdir(tmp_path)
    for name in ("tower", "lower", "upper", "both"):
        shutil.copy(DATA / "tower.dof", f"{name}.dof")
        shutil.copy(DATA / "tower.inp", f"{name}.inp")
        for ending, packed in (("sti", name), ("mas", "tower")):
            unpacked = lzma.decompress((DATA / f"{packed}.{ending}.xz").read_bytes())
            Path(f"{name}.{ending}").write_bytes(unpacked)
    altered = bs.read_model("both.sti")
    structure = bs.MatrixStructure(
        altered.stiffness, altered.mass, labels=altered.labels, sensors=list(SENSORS), n_modes=4
    )
    bs.write_modal_data(exact_modes(structure, SENSORS, (0.0, 18.0)), "modes.csv")


FRAME = (
    "--nominal", "frame.sti", "--changed", "lower=1.2:lower.sti", "--changed", "upper=0.8:upper.sti"
)  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Exports of two storeys by CalculiX, whose stiffnesses are the properties, and modes."""
    monkeypatch.chdir(tmp_path)
    for name, factors in FACTORS.items():
        calculix(name, stiffness(*factors))
    Path("labels.txt").write_text("1 x\n2 UX\n")
    Path("modes.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,1 x\n1,1.3,1\n")
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(main, ["import", *arguments])


@pytest.mark.usefixtures("tower")
def test_a_study_from_exports():
    changed = ("--changed", "lower=1.2:lower.sti", "--changed", "upper=0.8:upper.sti")
    check = ("--check", "lower=0.9,upper=1.3:both.sti")
    data = ("--data", "modes.csv", "--units", "N, m")
    done = succeeded(run("tower", "--nominal", "tower.sti", *changed, *check, *data))
    lines = done.output.splitlines()
    # All bricks are in one of the halves: nothing is constant.
    assert "K = lower K_lower + upper K_upper" in lines
    assert "M = M_0" in lines
    error = next(line for line in lines if line.startswith("both.sti: predicted to "))
    assert float(error.rsplit(" ", 1)[1]) < 1e-10
    study = bs.load_study("tower.py")
    assert [each.name for each in study.model_classes] == ["one factor", "each its own"]
    own = study.model_classes[1].structure
    assert [p.name for p in own.parameters] == ["lower", "upper"]
    assert own.degrees_of_freedom == SENSORS
    assert own.geometry.nodes["340"] == (0.5, 0.7, 12.0)
    assert own.geometry.unit == "m"
    assert study.mass_unit == "kg"
    identified = [mode.frequency_hz for mode in bs.read_modal_data("modes.csv").modes]
    modes = own.modes(np.array([[0.9, 1.3]])).frequencies_hz[0, :4]
    np.testing.assert_allclose(modes, identified, rtol=1e-6)


def test_sensors_of_other_names_and_data_to_come(folder):
    done = succeeded(run("later", *FRAME, "--sensor", "roof=2 x"))
    assert "(!) No --check" in done.output
    assert "Put the modes into later.csv." in done.output
    assert '    "roof": "2 x",\n' in (folder / "later.py").read_text("utf-8")
    (folder / "later.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,roof\n1,1.9,1\n")
    assert bs.load_study("later.py").model_classes[1].structure.degrees_of_freedom == ("roof",)


def test_several_tests_are_configurations(folder):
    """With the sensors of each, and elements put on one of them by hand."""
    (folder / "light.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,roof\n1,1.9,1\n")
    data = ("--data", "as built=modes.csv", "--data", "with a tank=light.csv")
    done = succeeded(run("both", *FRAME, *data, "--sensor", "roof=2 x"))
    assert done.output.count("bayes-ssi check") == 2
    text = (folder / "both.py").read_text("utf-8")
    tank = 'bs.AddedMass(2500.0, (("2 x", 1.0),))'
    (folder / "both.py").write_text(text.replace('tank": []', f'tank": [{tank}]'))
    built, with_tank = bs.load_study("both.py").model_classes[0].configurations
    assert (built.name, with_tank.name) == ("as built", "with a tank")
    assert built.structure.degrees_of_freedom == ("1 x",)
    assert with_tank.structure.degrees_of_freedom == ("roof",)
    for each, mass in ((built, 0.0), (with_tank, 2500.0)):
        squares = scipy.linalg.eigvalsh(stiffness(1.0, 1.0), M + np.diag([0.0, mass]))
        frequencies = each.structure.modes(np.array([[1.0]])).frequencies_hz[0]
        np.testing.assert_allclose(frequencies, np.sqrt(squares) / (2 * np.pi), rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*FRAME, "--data", "modes.csv", "--data", "b=modes.csv"),
         "--data: must be TEST=CSV where there are"),
        ((*FRAME, "--data", "a=modes.csv", "--data", "a=modes.csv"), "--data: 'a' is given twice"),
        ((*FRAME, "--check", "lower=1.1,upper=1.3:both.sti"), "both.sti: its stiffness is missed"),
        ((*FRAME, "--check", "foot=1.1:both.sti"), "both.sti: no other export alters alone 'foot'"),
        ((*FRAME[:2], "--changed", "lower:lower.sti"), "--changed: expected PROPERTY=FACTOR:FILE,"),
        ((*FRAME[:2], "--changed", "lower=1.2"), "--changed: expected PROPERTY=FACTOR:FILE, got"),
        ((*FRAME, "--units", "SI"), "units must be one of 'N, m', 'N, mm'"),
        ((*FRAME, "--sensor", "roof"), "--sensor: must be SENSOR=LABEL, got 'roof'"),
        ((*FRAME, "--sensor", "roof=9999 x"), "no degree of freedom is labelled '9999 x'"),
        ((*FRAME, "--data", "modes.csv", "--sensor", "roof=2 x"),
         "--sensor: the data have no sensor 'roof'; choose from '1 x'"),
        ((*FRAME, "--data", "absent.csv"), "absent.csv"),
    ],
)  # fmt: skip
def test_what_is_refused_leaves_nothing(folder, arguments, message):
    before = sorted(folder.iterdir())
    assert_one_line_error(run("study", *arguments), message)
    assert sorted(folder.iterdir()) == before


@pytest.mark.usefixtures("tower")
def test_sensors_by_coordinates():
    """The nearest nodes, with the distances; in mm they are refused."""
    (at,) = Path("modes.csv").read_text().splitlines()[1:2]
    names = at.split(",")[2:]
    nodes = bs.read_model("tower.sti").geometry.nodes
    for scale, file in ((1.0, "m.csv"), (1000.0, "mm.csv")):
        rows = ["sensor,direction,x_coord,y_coord,z_coord"]
        for name in names:
            node, direction = name.split()
            x, y, z = nodes[node]
            rows.append(f"{name},{direction},{scale * x},{scale * (y + 0.01)},{scale * z}")
        Path(file).write_text("\n".join([*rows, ""]))
    arguments = ("tower", "--nominal", "tower.sti", "--changed", "lower=1.2:lower.sti")
    refused = run(*arguments, "--data", "modes.csv", "--points", "mm.csv")
    assert_one_line_error(refused, "times 0.001 (mm to m): give them in the model's unit")
    done = succeeded(run(*arguments, "--data", "modes.csv", "--points", "m.csv"))
    assert "340 x: 340 x, 0.01 away" in done.output.splitlines()
    assert "Nominal frequencies: 1.943, 2.716, 12.1, 16.8 Hz" in done.output
    assert "(!) with" not in done.output


def test_the_band_of_a_universal_file_is_the_studys(folder):
    pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    moved = np.zeros((1, 2, 6))
    moved[0, :, 0] = 0.5, 1.0
    modes = NodalModes(("1", "2"), np.full((2, 3), np.nan), None, np.array([1.9]), moved)
    write_universal_file(Path("modes.uff"), modes, "two storeys")
    succeeded(run("uff_study", *FRAME, "--data", "modes.uff", "--band", "0.5", "17"))
    data = bs.load_study(folder / "uff_study.py").model_classes[0].data
    assert data.band_hz == (0.5, 17.0)
    assert data.sensors == ("1 x", "2 x")


def test_sensors_on_a_rigid_diaphragm(tmp_path, monkeypatch):
    """SAP2000's text: joint 5 moves as equation 1 less 2 times the rotation, equation 2."""
    monkeypatch.chdir(tmp_path)
    for name, (sway, twist) in {"f": (1.0, 1.0), "s": (1.1, 1.0), "t": (1.0, 1.2)}.items():
        files = {
            "TXE": "D\t1\t0\t0\t0\t0\t2\n5\t-1\t0\t0\t0\t0\t0\n",
            "TXC": "-1\t1\t1.0\n-1\t2\t-2.0\n",
            "TXK": f"1\t1\t{4e5 * sway!r}\n2\t1\t1e4\n2\t2\t{9e6 * twist!r}\n",
            "TXM": "1\t1\t1e3\n2\t2\t8e3\n",
        }
        for ending, text in files.items():
            Path(f"{name}.{ending}").write_text(f"headings\n{text}")
    Path("modes.csv").write_text("# band_hz,0,9\nlabel,frequency_hz,5 x,D x\n1,3.2,1,0.98\n")
    changed = ("--changed", "sway=1.1:s.TXK", "--changed", "twist=1.2:t.TXK")
    done = succeeded(run("floor", "--nominal", "f.TXK", *changed, "--data", "modes.csv"))
    assert "1 rows are added for displacements of constraints" in done.output.splitlines()
    structure = bs.load_study("floor.py").model_classes[1].structure
    stiffness = np.array([[4.4e5, 1e4], [1e4, 9e6 * 0.9]])
    values, vectors = scipy.linalg.eigh(stiffness, np.diag([1e3, 8e3]))
    modes = structure.modes(np.array([[1.1, 0.9]]))
    assert modes.frequencies_hz[0, 0] == pytest.approx(np.sqrt(values[0]) / (2.0 * np.pi))
    ratio = (vectors[0, 0] - 2.0 * vectors[1, 0]) / vectors[0, 0]
    assert modes.shapes[0, 0, 0] / modes.shapes[0, 1, 0] == pytest.approx(ratio)


@pytest.mark.parametrize("taken", ["study.py", "study_matrices"])
def test_nothing_is_overwritten(folder, taken):
    (folder / taken).write_text("precious")
    before = sorted(folder.iterdir())
    done = run("study.py", *FRAME)
    assert_one_line_error(done, f"{taken}: exists already and is not overwritten")
    assert (folder / taken).read_text() == "precious"
    assert sorted(folder.iterdir()) == before


@pytest.mark.usefixtures("folder")
def test_one_export_has_one_factor_and_names_are_checked_before_it_is_read():
    done = succeeded(run("one", "--nominal", "frame.sti", "--data", "modes.csv"))
    assert "K = stiffness K_stiffness" in done.output
    (only,) = bs.load_study(Path("one.py")).model_classes
    (modes,) = (each.structure.modes(np.array([[2.0]])) for each in only.configurations)
    squares = scipy.linalg.eigvalsh(2.0 * stiffness(1.0, 1.0), M)
    np.testing.assert_allclose(modes.frequencies_hz[0], np.sqrt(squares) / (2 * np.pi))
    Path("frame.sti").unlink()
    done = run("two", "--nominal", "frame.sti", "--data", "modes.csv", "--sensor", "roof=1 x")
    assert_one_line_error(done, "--sensor: the data have no sensor 'roof'")


STIFFNESS = np.array([[1600.0, -700.0], [-700.0, 700.0]])


def test_rows_without_labels_are_numbered_where_told_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("frame.npz", K=STIFFNESS, M=5.0 * np.eye(2))
    Path("modes.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,dof 2\n1,1.9,1\n")
    one = ("one", "--nominal", "frame.npz", "--data", "modes.csv")
    assert_one_line_error(run(*one), "or --number-rows for 'dof 1'")
    succeeded(run(*one, "--number-rows"))
    assert bs.read_model("frame.npz", numbered=True).labels == ("dof 1", "dof 2")
    with pytest.raises(ValueError, match="numbers do not say which rows are rotations"):
        bs.read_model("frame.npz", numbered=True, units="N, mm")


def test_weights_in_place_of_masses_are_recognised(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # g in in/s², of kip and in.
    np.savez("frame.npz", K=STIFFNESS, M=386.089 * np.eye(2), labels=("1 x", "2 x"))
    hz = np.sqrt(np.linalg.eigvalsh(STIFFNESS)[0]) / (2 * np.pi)
    Path("modes.csv").write_text(f"# band_hz,0,18\nlabel,frequency_hz,1 x\n1,{1.1 * hz},1\n")
    done = run("one", "--nominal", "frame.npz", "--data", "modes.csv")
    assert "divided by g = 386.089 in/s² it fits: are the masses weights?" in done.output


def test_nine_digits_make_no_matrix_of_rounding(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    half = np.random.default_rng(0).standard_normal((6, 6))
    stiffness = half @ half.T + np.eye(6)
    for name, factor in (("a", 1.0), ("b", 1.1)):
        printed = np.vectorize(lambda x: float(f"{x:.8e}"))(factor * stiffness)
        np.savez(name, K=printed, M=np.eye(6), labels=[f"{i} x" for i in range(6)])
    Path("modes.csv").write_text("# band_hz,0,18\nlabel,frequency_hz,1 x\n1,0.1,1\n")
    done = run("one", "--nominal", "a.npz", "--changed", "E=1.1:b.npz", "--data", "modes.csv")
    assert done.exit_code == 0, done.output
    assert "K = E K_E" in done.output.splitlines()


FORMATS = {calculix: (), opensees: (), npz: (), matlab: ("--keys", "Kff,Mff")}


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
    labels = () if written is calculix else ("--labels", "labels.txt")
    succeeded(run(*options(files), *FORMATS[written], *labels))
    structure = bs.load_study("frame.py").model_classes[-1].structure
    assert {parameter.name for parameter in structure.parameters} == {"lower", "upper"}
    values = {"lower": 1.3, "upper": 0.7}
    at = np.array([[values[parameter.name] for parameter in structure.parameters]])
    expected = np.sqrt(scipy.linalg.eigvalsh(stiffness(1.3, 0.7), M)) / (2.0 * np.pi)
    np.testing.assert_allclose(structure.modes(at).frequencies_hz[0], expected, rtol=1e-7)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("written", "given", "words"),
    [
        (opensees, (), "frameK.out+MASS in commands, mass= in Python"),
        (matlab, (), "as in --keys KAA,MAA"),
        (npz, ("--keys", "K"), "--keys: expected STIFFNESS,MASS, got 'K'"),
        (npz, (), "no labels, by which sensors are named: give them in a --labels file"),
    ],
)  # fmt: skip
def test_what_a_format_needs_is_said_as_the_command_takes_it(written, given, words):
    files = {name: written(name, stiffness(*factors)) for name, factors in FACTORS.items()}
    if written is opensees:  # without the masses
        files = {name: file.split("+")[0] for name, file in files.items()}
    assert_one_line_error(run(*options(files), *given), words)
    assert not Path("frame.py").exists()
