"""CalculiX's files of a tower of bricks, made by a script, and Abaqus's of a portal frame."""

import csv
import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import assert_refused
from frames import LABELS, PLACES, assert_is_portal, frequencies_of, lower_entries, portal

import bayes_ssi as bs

DATA = Path(__file__).parent / "data"


@pytest.fixture
def tower(tmp_path):
    """The files of the tower, unpacked."""
    for ending in ("dof", "inp"):
        shutil.copy(DATA / f"tower.{ending}", tmp_path)
    for packed in DATA.glob("tower.*.xz"):
        (tmp_path / packed.stem).write_bytes(lzma.decompress(packed.read_bytes()))
    return tmp_path


def test_frequencies_are_those_that_the_program_prints(tower):
    with (DATA / "frequencies.csv").open() as file:
        printed = {row[0]: row[1:] for row in csv.reader(file)}
    model = bs.read_model(tower / "tower.mas")
    assert model.size == 1764
    # Seven digits are printed.
    np.testing.assert_allclose(
        frequencies_of(model, "340 x", 6), np.array(printed["tower"], float), rtol=6e-7
    )
    assert model.labels[:2] == ("5 x", "5 y")
    assert model.labels[-1] == "internal 592 z"
    assert model.geometry.nodes["340"] == (0.5, 0.7, 12.0)


def test_mass_and_units(tower):
    model = bs.read_model(tower / "tower.sti", units="N, m")
    # 2500 kg/m³ · 0.5 · 0.7 · 12 m³, less the share of the restrained nodes: a third of the lowest
    # layer at themselves, a third between them and the nodes above.
    whole = 2500.0 * 0.5 * 0.7 * 12.0
    for direction in "xyz":
        assert model.total_mass[direction] == pytest.approx(whole * (1.0 - 2.0 / 3.0 / 84.0))
    assert model.units == "N, m, kg"
    with pytest.raises(ValueError, match=r"units must be one of 'N, m', 'N, mm',.*got 'SI'"):
        bs.read_model(tower / "tower.sti", units="SI")
    assert "1.042e+07 kg in N, mm" in bs.read_model(tower / "tower.sti").notes[-1]


def test_exponents_of_fortran(tmp_path):
    for ending, text in {"dof": "1.1\n2.1\n", "sti": "1 1 3.0D+02\n1 2 -1.5d2\n2 2 1.5D+02\n",
                         "mas": "1 1 2.0D-01\n1 2 0.0D+00\n2 2 0.1\n"}.items():  # fmt: skip
        (tmp_path / f"a.{ending}").write_text(text)
    model = bs.read_model(tmp_path / "a.sti")
    np.testing.assert_array_equal(model.stiffness.toarray(), [[300.0, -150.0], [-150.0, 150.0]])
    np.testing.assert_array_equal(model.mass.toarray(), [[0.2, 0.0], [0.0, 0.1]])


def cut_lines(path, keep):
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:keep]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: cut_lines(f / "tower.sti", 900), r"tower.sti: 900 entries, the other .* trunc"),
        (lambda f: cut_lines(f / "tower.dof", 900), r"sti: line \d+: row .* 1 to 900, got 901"),
        (lambda f: (f / "tower.dof").write_text("1.1\n12\n"), r"dof: line 2: "),
        (lambda f: (f / "tower.dof").write_text("1.1\n1.7\n"), r"dof: line 2: "),
        (lambda f: (f / "tower.mas").unlink(), r"tower.mas \(mass\) must stand in the same folder"),
        (lambda f: (f / "tower.inp").write_text("*NODE\n1, a\n"), r"inp: line 2: expected whole"),
        (
            lambda f: (f / "tower.inp").write_text(
                "*NODE\n1, 0\n*ELEMENT, TYPE=S4\n1, 1, 2\n2, 1, 2, 3, 4\n"
            ),
            r"inp: line 5: expected whole numbers of nodes and elements",
        ),
    ],
)  # fmt: skip
def test_wrong_files_are_refused_in_one_line(tower, spoil, message):
    spoil(tower)
    assert_refused(message, bs.read_model, tower / "tower.sti")


def test_decks_may_include_others(tower):
    whole = (tower / "tower.inp").read_text()
    (tower / "mesh.msh").write_text(f"{whole}*ELEMENT, TYPE=B31\n900, 4, 8\n")
    (tower / "tower.inp").write_text("** the mesh\n*include, input=mesh.msh\n*STEP\n")
    geometry = bs.read_model(tower / "tower.sti").geometry
    assert geometry.nodes["340"] == (0.5, 0.7, 12.0)
    assert geometry.lines == (("4", "8"),)
    assert len(geometry.faces) == 84 * 4 + 2  # of 84 bricks on top of one another
    (tower / "mesh.msh").unlink()
    model = bs.read_model(tower / "tower.sti")
    assert model.geometry is None
    assert any("no coordinates: tower.inp" in note for note in model.notes)


def test_what_is_not_recognised_is_listed(tmp_path):
    (tmp_path / "model.rst").write_text("results\n")
    with pytest.raises(ValueError, match=r"not recognised .* CalculiX matrix storage \(\.sti, "):
        bs.read_model(tmp_path / "model.rst")


# Node 1 is restrained, and node -4 is a multiplier of Abaqus's own.
RESTRAINED = ["1,1, 1,1, 1.000000000000000e+36", "1,3, 1,3, 1.000000000000000e+36"]


def labelled(entries):
    places = [f"{node},{number}" for node, number in PLACES]
    return [f"{places[i]}, {places[j]}, {float(value)!r}" for i, j, value in entries]


def written(folder, *, stiffness=None, mass=None, name="Frame"):
    k, m = portal()
    k, m = (labelled(lower_entries(matrix)) for matrix in (k, m))
    stiffness = [*RESTRAINED, *k] if stiffness is None else stiffness
    mass = ["1,1, 1,1, 500.0", *m] if mass is None else mass
    (folder / f"{name}_STIF2.mtx").write_text("\n".join([*stiffness, ""]))
    (folder / f"{name}_MASS2.mtx").write_text("\n".join([*mass, ""]))
    return folder / f"{name}_STIF2.mtx"


def test_read_back_exactly_without_held_rows(tmp_path):
    """What is 1e36 must not hide other entries in the check for symmetry."""
    path = written(tmp_path)
    (tmp_path / "Frame.inp").write_text("*Node\n 1, 0., 0., 0.\n 2, 0., 0., 3.5\n 7, 6., 0., 3.5\n")
    model = bs.read_model(path)
    assert_is_portal(model)
    assert model.geometry.nodes["7"] == (6.0, 0.0, 3.5)
    assert any(note == "2 rows that are restrained are left out: 1 x, 1 z" for note in model.notes)


def test_both_triangles_own_nodes_and_no_labels(tmp_path):
    k, _ = portal()
    whole = labelled([(i, j, k[i, j]) for i, j in np.argwhere(k)])
    assert_is_portal(bs.read_model(written(tmp_path, stiffness=["1,1, 1,1, 1e36", *whole])))
    half = labelled(lower_entries(k))
    model = bs.read_model(written(tmp_path, stiffness=[*RESTRAINED, *half, "-4,1, -4,1, 7.0"]))
    assert model.labels[0] == "internal 4 x"
    # An own node is no point that moves.
    assert model.total_mass["x"] == 5e3
    k, m = (
        [f"{i + 1}, {j + 1}, {value!r}" for i, j, value in lower_entries(each)] for each in portal()
    )
    assert_is_portal(bs.read_model(written(tmp_path, stiffness=k, mass=m), labels=LABELS))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"mass": ["3,1, 3,1, 2.0"]}, r"MASS2.mtx: node 3, degree of freedom 1 is not in the stif"),
        ({"mass": ["2,1, 2,1"]}, r"MASS2.mtx: line 1: expected row node, .* got 2 1 2 1"),
        ({"stiffness": ["2,1, 2,1, 1.0", "2,1, 2.5,1, 1"]}, r"STIF2.mtx: line 2: node and degree"),
        ({"stiffness": ["2,1, 7,1, 1.0", "7,1, 2,1, 2.0"], "mass": ["2,1, 2,1, 5"]},
         r"STIF2.mtx must be symmetric"),
    ],
)  # fmt: skip
def test_wrong_matrices_of_abaqus_are_refused_in_one_line(tmp_path, changed, message):
    assert_refused(message, bs.read_model, written(tmp_path, **changed))


def test_the_file_of_the_mass_is_found_by_its_name_or_asked_for(tmp_path):
    written(tmp_path).rename(tmp_path / "other.mtx")
    with pytest.raises(ValueError, match=r"other.mtx: name the file of the stiffness, job_STIFn"):
        bs.read_model(tmp_path / "other.mtx")
    assert_is_portal(bs.read_model(tmp_path / "other.mtx", tmp_path / "Frame_MASS2.mtx"))
