"""OpenSees's printed matrices, ANSYS's full file, those of no program; units of countries."""

import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from conftest import assert_refused
from frames import LABELS, assert_is_portal, frequencies_of, portal

import bayes_ssi as bs
from bayes_ssi.structures.solver_files.exported_model import Matrices, exported_model
from bayes_ssi.structures.solver_files.model_files import SYSTEMS, in_si

# A cantilever of two beams of 3 m (EI 1.68e6, EA 2.1e9, 78.5 kg/m and 1000 kg at each node), as
# OpenSees 3.8 prints it: system FullGeneral, numberer Plain, constraints Plain, a transient
# analysis with integrator GimmeMCK 0 0 1 (K) and 1 0 0 (M), printA -file.
OPENSEES_K = """
1.49333e+06 0 0 -746667 0 -1.12e+06
0 1.4e+09 0 0 -7e+08 0
0 0 4.48e+06 1.12e+06 0 1.12e+06
-746667 0 1.12e+06 746667 0 1.12e+06
0 -7e+08 0 0 7e+08 0
-1.12e+06 0 1.12e+06 1.12e+06 0 2.24e+06

"""
OPENSEES_M = """
1235.5 0 0 0 0 0
0 1235.5 0 0 0 0
0 0 0 0 0 0
0 0 0 1117.75 0 0
0 0 0 0 1117.75 0
0 0 0 0 0 0

"""
CANTILEVER = [f"{node} {direction}" for node in (2, 3) for direction in ("x", "y", "rz")]


class TestOpenSees:
    def read(self, folder, stiffness=OPENSEES_K, mass=OPENSEES_M, **options):
        (folder / "K.out").write_text(stiffness)
        (folder / "M.out").write_text(mass)
        return bs.read_model(folder / "K.out", folder / "M.out", **options)

    def test_printed_matrices(self, tmp_path):
        model = self.read(tmp_path, labels=CANTILEVER)
        assert model.program == "matrices printed as text (OpenSees)"
        assert model.stiffness[0, 0] == 1.49333e6
        assert model.total_mass == {"x": 2353.25, "y": 2353.25}
        assert any(note.startswith("6 digits are printed") for note in model.notes)

    def test_labels_from_a_file(self, tmp_path):
        (tmp_path / "dofs.txt").write_text("2.1\n2 2\n2 rz\n3,UX\n3 U2\n3 6\n")
        assert list(self.read(tmp_path, labels=tmp_path / "dofs.txt").labels) == CANTILEVER
        (tmp_path / "dofs.txt").write_text("2.1\n2 u9\n")
        with pytest.raises(ValueError, match=r"dofs.txt: line 2: direction must be .* got 'u9'"):
            self.read(tmp_path, labels=tmp_path / "dofs.txt")

    def test_entries_may_be_rounded_to_either_side_of_the_diagonal(self, tmp_path):
        rounded = OPENSEES_K.replace("-746667 0 1.12e+06 7", "-746668 0 1.12e+06 7")
        assert self.read(tmp_path, rounded).stiffness[3, 0] == -746667.5
        with pytest.raises(ValueError, match=r"K.out must be symmetric"):
            self.read(tmp_path, rounded.replace("-746668", "-746700"))

    @pytest.mark.parametrize(
        ("spoil", "message"),
        [
            (lambda text: text[: text.index("-746667 0 1.12")], r"K.out: 3 rows of 6 numbers: tr"),
            (lambda text: text.replace("4.48e+06 ", ""), r"K.out: line 4: expected 6 numbers"),
            (lambda text: text.replace("-7e+08 0 0 7", "-7e+08 0 x 7"), r"line 6: expected 6 .* x"),
            (lambda text: text.rstrip(), r"K.out: ends within a line"),
        ],
    )  # fmt: skip
    def test_wrong_files(self, tmp_path, spoil, message, monkeypatch):
        # A long file is recognised by its beginning, which is as it should be.
        monkeypatch.setattr(
            "bayes_ssi.structures.solver_files.model_files.first_bytes", lambda _: b"1 2\n3 4\n"
        )
        assert_refused(message, self.read, tmp_path, spoil(OPENSEES_K))

    def test_another_size_and_no_mass(self, tmp_path):
        with pytest.raises(ValueError, match=r"M.out has 1 rows, .*K.out has 6; .* one model"):
            self.read(tmp_path, mass="5.0\n")
        with pytest.raises(ValueError, match=r"K.out: name the file of the mass matrix as well"):
            bs.read_model(tmp_path / "K.out")
        assert_refused(r"K.out: 2 labels for 6 rows", self.read, tmp_path, labels=["2 x", "3 x"])


class TestAnsys:
    @pytest.fixture
    def sample(self):
        """The reader's own example: a beam of bricks, restrained at one end."""
        pytest.importorskip("ansys.mapdl.reader", reason="pip install bayes_ssi[ansys]")
        import ansys.mapdl.reader.examples as examples

        return Path(examples.__file__).parent / "file.full"

    def test_sample(self, sample):
        model = bs.read_model(sample)
        assert model.size == 900
        assert "63 rows that are restrained are left out: 1 x, 1 y, 1 z, 4 x" in str(model)
        known = [1283.200, 1283.200, 5781.975, 6919.399, 6919.399]
        np.testing.assert_allclose(frequencies_of(model, "63 x", 5), known, atol=5e-4)

    def test_truncated(self, sample, tmp_path):
        (tmp_path / "cut.full").write_bytes(sample.read_bytes()[:20000])
        with pytest.raises(ValueError, match=r"cut.full: has 20000 of 801596 bytes: truncated"):
            bs.read_model(tmp_path / "cut.full")

    def test_without_the_library(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "ansys.mapdl.reader.full", None)
        monkeypatch.setitem(sys.modules, "ansys.mapdl.reader.common", None)
        (tmp_path / "job.full").write_bytes(b"\0")
        assert_refused(r'pip install "bayes_ssi\[ansys\]"', bs.read_model, tmp_path / "job.full")


class TestMatricesOfNoProgram:
    def test_npz_with_labels(self, tmp_path):
        stiffness, mass = portal()
        path = tmp_path / "frame.npz"
        np.savez(path, K=stiffness, M=mass, labels=np.array(LABELS), damping=mass)
        assert_is_portal(bs.read_model(path))

    def test_mat(self, tmp_path):
        stiffness, mass = portal()
        path = tmp_path / "frame.mat"
        scipy.io.savemat(path, {"Kff": sp.csc_array(stiffness), "Mff": mass, "Kgg": mass})
        assert_is_portal(bs.read_model(path, labels=LABELS))
        assert_is_portal(bs.read_model(path, keys=("Kff", "Mff"), labels=LABELS))
        cells = np.array(LABELS, dtype=object)[:, None]
        scipy.io.savemat(tmp_path / "cells.mat", {"K": stiffness, "M": mass, "labels": cells})
        assert_is_portal(bs.read_model(tmp_path / "cells.mat"))
        with pytest.raises(ValueError, match=r"frame.mat: no matrix 'Kaa'; it holds 'Kff', 'Mff'"):
            bs.read_model(path, keys=("Kaa", "Mff"))
        with pytest.raises(ValueError, match=r"Kgg has 6 rows|there is no mass|Mff"):
            bs.read_model(path, keys=("Kgg", "absent"))

    @pytest.mark.parametrize("triangle", [None, np.tril, np.triu])
    def test_two_files_whole_or_one_triangle(self, tmp_path, triangle):
        stiffness, mass = portal()
        for name, matrix in (("K", stiffness), ("M", mass)):
            stated = matrix if triangle is None else triangle(matrix)
            symmetry = "general" if triangle is not None else None
            scipy.io.mmwrite(tmp_path / f"{name}.mmf", sp.coo_array(stated), symmetry=symmetry,
                             precision=17)  # fmt: skip
            (tmp_path / f"{name}.mmf.mtx").rename(tmp_path / f"{name}.txt")
        model = bs.read_model(tmp_path / "K.txt", tmp_path / "M.txt", labels=LABELS)
        assert_is_portal(model)
        assert any("K.txt states one triangle" in note for note in model.notes) == bool(triangle)

    def test_damaged(self, tmp_path):
        (tmp_path / "frame.npz").write_bytes(b"PK\x03\x04 no archive")
        with pytest.raises(ValueError, match=r"frame.npz: cannot .* BadZipFile: File is not a zip"):
            bs.read_model(tmp_path / "frame.npz")
        np.savez(tmp_path / "vectors.npz", K=np.ones(3), M=np.ones(3))
        words = r"vectors.npz: K must be a matrix .* got shape \(3,\)"
        assert_refused(words, bs.read_model, tmp_path / "vectors.npz")


# Newtons and metres in the units, by their definitions.
IN_UNITS = {
    "N, mm": (1.0, 1e-3), "kN, m": (1e3, 1.0), "kgf, cm": (9.80665, 0.01),
    "kip, in": (4448.2216152605, 0.0254), "lbf, ft": (4.4482216152605, 0.3048),
}  # fmt: skip


@pytest.mark.parametrize("units", IN_UNITS)
def test_forces_moments_and_masses(units):
    """Forces per displacement, moments per radian and what couples them have other units each."""
    force, length = IN_UNITS[units]
    stiffness, mass = portal()
    turns = np.array([label.endswith("ry") for label in LABELS])
    work = np.where(turns, length * force, force)  # what a row balances: moments or forces
    moved = np.where(turns, 1.0, length)  # what a column moves by 1: radians or lengths
    kilograms = force / length
    exported = Matrices(
        [matrix * moved / work[:, None] for matrix in (stiffness, mass)],
        ("K", "M"),
        labels=LABELS,
        geometry=bs.Geometry(
            {"2": (0.0, 0.0, 3.5 / length), "7": (6.0 / length, 0.0, 3.5 / length)}
        ),
    )
    model = exported_model("test", exported)
    assert model.total_mass["x"] == pytest.approx(5e3 / kilograms)
    back = in_si(model, units)
    np.testing.assert_allclose(back.stiffness.toarray(), stiffness, rtol=1e-12)
    np.testing.assert_allclose(back.mass.toarray(), mass, rtol=1e-12)
    assert back.geometry.nodes["7"] == pytest.approx((6.0, 0.0, 3.5))
    assert back.geometry.unit == "m"


def test_without_labels_lengths_cannot_be_turned():
    model = exported_model("test", Matrices(portal(), ("K", "M")))
    assert in_si(model, "kN, m").stiffness[0, 0] == 1e3 * portal()[0][0, 0]
    assert_refused(r"units 'N, mm': labels are needed to say which rows", in_si, model, "N, mm")
    assert set(IN_UNITS) <= set(SYSTEMS)
