"""Nastran's punched matrices and SAP2000's text, written here for a portal frame."""

from pathlib import Path

import numpy as np
import pytest
from conftest import assert_refused
from frames import LABELS, PLACES, assert_is_portal, frequencies_of, lower_entries, portal

import bayes_ssi as bs


def punched(name, matrix):
    """A symmetric matrix, a column entry for each column of its lower triangle."""
    lines = [f"DMIG    {name:<8}{0:>8}{6:>8}{2:>8}{0:>8}"]
    for column in range(len(matrix)):
        node, component = PLACES[column]
        rows = [(i, value) for i, j, value in lower_entries(matrix) if j == column]
        if rows:
            lines.append(f"DMIG*   {name:<16}{node:>16}{component:>16}")
        for row, value in rows:
            node, component = PLACES[row]
            # Sixteen characters hold nine digits.
            lines.append(f"*       {node:>16}{component:>16}{value:>16.9E}".replace("E", "D"))
    return lines


def rounded(matrix):
    return np.array([[float(f"{each:.9E}") for each in row] for row in matrix])


def write(path, *blocks):
    grids = [
        "$ BOUNDARY GRID DATA",
        "GRID*                  2               0 0.000000000E+00 0.000000000E+00",
        "*        3.500000000E+00               0",
        "GRID           7       0     6.0     0.0     3.5      10",
    ]
    path.write_text("\n".join([*grids, *(line for block in blocks for line in block), ""]))
    return path


K, M = (punched(name, matrix) for name, matrix in zip(("KAAX", "MAAX"), portal(), strict=True))
COMPLEX = [K[0].replace("6       2", "6       4"), *K[1:]]
RECTANGULAR = [K[0].replace("6       2", "9       2"), *K[1:]]
OTHER = [*punched("KGG", np.eye(6)), *punched("MGG", np.eye(6))]


def test_punched_matrices(tmp_path):
    stiffness, mass = portal()
    model = bs.read_model(write(tmp_path / "frame.pch", K, M))
    assert model.labels == LABELS
    np.testing.assert_array_equal(model.stiffness.toarray(), rounded(stiffness))
    np.testing.assert_array_equal(model.mass.toarray(), rounded(mass))
    assert model.geometry.nodes == {"2": (0.0, 0.0, 3.5), "7": (6.0, 0.0, 3.5)}
    assert any("1 points move in coordinate systems of their own" in note for note in model.notes)


def test_small_and_free_fields_and_scalar_points(tmp_path):
    """2.5+3 is 2500; a point without a component is a scalar one."""
    lines = [
        "DMIG    KGG            0       6       1",
        "DMIG    KGG            2       1               2       1   2.5+3",
        "               9       0  -1.0+3",
        *("DMIG,KGG,9,0,,9,0,1.0+3", "DMIG,MGG,0,6,1"),
        *("DMIG,MGG,2,1,,2,1,3.0", "DMIG,MGG,9,0,,9,0,1.0"),
    ]
    model = bs.read_model(write(tmp_path / "frame.bdf", lines))
    assert model.labels == ("2 x", "9")
    np.testing.assert_array_equal(model.stiffness.toarray(), [[2500.0, -1000.0], [-1000.0, 1000.0]])


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ([K], r"name its stiffness and mass, as in --keys .*; it holds 'KAAX'$"),
        ([K, M, OTHER], r"name its stiffness and mass, as in --keys .*'MAAX', 'KGG', 'MGG'$"),
        ([COMPLEX, M], r"KAAX must be real \(type 1 or 2\), got 4"),
        ([RECTANGULAR, M], r"KAAX must be symmetric \(form 6\) or square \(1\), got 9"),
        ([K, K[1:3], M], r"KAAX: 1 entries are stated twice"),
        ([K, M[:2], [M[2].replace("D", "x")]], r"line \d+: not a DMIG entry: DMIG MAAX 2 1"),
        ([K[1:], M], r"line 5: not a DMIG entry: DMIG KAAX 2 1"),
        ([], r"frame.pch: no DMIG entry; was the punch of matrices requested\?"),
    ],
)
def test_wrong_punches_are_refused_in_one_line(tmp_path, blocks, message):
    assert_refused(message, bs.read_model, write(tmp_path / "frame.pch", *blocks))


@pytest.fixture
def samples():
    """The files that pyyeti's own tests read."""
    pyyeti = pytest.importorskip("pyyeti", reason="pip install pyyeti")
    return Path(pyyeti.__file__).parent / "tests"


def test_punches_are_read_as_the_library_reads_them(samples):
    from pyyeti import nastran

    sample = samples / "nastran_dmig_data" / "matrix_factory.pch"
    known = nastran.rddmig(str(sample))["ident"]
    model = bs.read_model(sample, keys=("ident", "IDENT"))
    np.testing.assert_array_equal(model.stiffness.toarray(), known)
    # Scalar points have no component.
    names = ("", " x", " y", " z", " rx", " ry", " rz")
    assert model.labels == tuple(f"{node}{names[number]}" for node, number in known.index)
    with pytest.raises(ValueError, match=r"matrix_factory.pch: RANDM must be symmetric"):
        bs.read_model(sample, keys=("randm", "ident"))


def test_two_files_of_one_matrix_each(tmp_path):
    k, m = write(tmp_path / "k.pch", K), write(tmp_path / "m.pch", M)
    assert bs.read_model(k, m).labels == LABELS
    assert_refused(r"KAAX is in .*k.pch as well", bs.read_model, k, k)


HEADINGS = {
    "TXE": "Joint\tU1\tU2\tU3\tR1\tR2\tR3",
    "TXK": "Row\tColumn\tStiffness",
    "TXM": "Row\tColumn\tMass",
    "TXC": "Constraint\tEquation\tCoefficient",
}
# Joints 1 and 4 are clamped; the frame stands in the plane of U1, U3 and R2.
EQUATIONS = [
    "1\t0\t0\t0\t0\t0\t0",
    "2\t1\t0\t2\t0\t3\t0",
    "Top right\t4\t0\t5\t0\t6\t0",
    "4\t0\t0\t0\t0\t0\t0",
]
CONSTRAINED = {"TXE": [*EQUATIONS, "5\t4\t0\t0\t0\t0\t0", "6\t-1\t0\t0\t0\t0\t0"],
               "TXC": ["-1\t1\t1.0", "-1\t3\t-3.0"]}  # fmt: skip
JOINT_LABELS = ("2 x", "2 z", "2 ry", "Top right x", "Top right z", "Top right ry")


def lines_of(matrix):
    return [f"{row + 1}\t{column + 1}\t{value!r}" for row, column, value in lower_entries(matrix)]


def text_files(folder, **changed):
    stiffness, mass = portal()
    files = {"TXE": EQUATIONS, "TXK": lines_of(stiffness), "TXM": lines_of(mass), **changed}
    for ending, lines in files.items():
        text = "\r\n".join([HEADINGS[ending], *lines, ""])
        (folder / f"Portal.{ending}").write_bytes(text.encode())
    (folder / "Portal.TXA").write_text("description of the files\n")
    return folder


@pytest.mark.parametrize("ending", ["TXA", "TXE", "TXK", "txm"])
def test_read_back_exactly(tmp_path, ending):
    text_files(tmp_path)
    if ending == "txm":
        (tmp_path / "Portal.TXM").rename(tmp_path / "Portal.txm")
    model = bs.read_model(tmp_path / f"Portal.{ending}")
    assert_is_portal(model, JOINT_LABELS)
    assert model.total_mass == {"x": 5e3, "z": 5e3}
    # The rotations carry no mass: they follow statically.
    stiffness, mass = portal()
    free, followed = [0, 1, 3, 4], [2, 5]
    condensed = stiffness[np.ix_(free, free)] - stiffness[np.ix_(free, followed)] @ np.linalg.solve(
        stiffness[np.ix_(followed, followed)], stiffness[np.ix_(followed, free)]
    )
    lowest = np.linalg.eigvals(condensed / np.diag(mass)[free][:, None]).real.min()
    assert frequencies_of(model, "2 x", 1)[0] == pytest.approx(np.sqrt(lowest) / (2.0 * np.pi))


def test_constraints_tie_displacements_to_rows(tmp_path):
    """A joint that shares an equation, and one of a diaphragm: u = u_2 - 3 θ."""
    text_files(tmp_path, **CONSTRAINED)
    model = bs.read_model(tmp_path / "Portal.TXK")
    assert dict(model.dependent) == {"5 x": {"Top right x": 1.0}, "6 x": {"2 x": 1.0, "2 ry": -3.0}}
    assert any("constraints tie" in note for note in model.notes)
    # In mm, the rotation moves by 3 mm per radian.
    in_si = bs.read_model(tmp_path / "Portal.TXK", units="N, mm")
    assert in_si.dependent["6 x"] == {"2 x": 1.0, "2 ry": pytest.approx(-3e-3)}


def test_rows_for_displacements_that_constraints_move(tmp_path):
    """The modes stay, and the rows move as the constraints say, whatever the spring."""
    text_files(tmp_path, **CONSTRAINED)
    model = bs.read_model(tmp_path / "Portal.TXK")
    plain = bs.MatrixStructure(model.stiffness, model.mass, labels=model.labels, n_modes=3)
    expected, shapes = (each[0] for each in plain.modes(np.empty((1, 0))))
    for spring in (None, 1e5):
        more = model.with_rows(["6 x", "5 x"], spring)
        assert more.labels == (*JOINT_LABELS, "6 x", "5 x")
        assert not more.dependent
        assert more.total_mass == model.total_mass
        structure = bs.MatrixStructure(more.stiffness, more.mass, labels=more.labels, n_modes=3)
        frequencies, moved = (each[0] for each in structure.modes(np.empty((1, 0))))
        np.testing.assert_allclose(frequencies, expected, rtol=1e-10)
        by_hand = (shapes[0] - 3.0 * shapes[2]) / shapes[3]
        np.testing.assert_allclose(moved[6] / moved[3], by_hand, rtol=1e-7)
        np.testing.assert_allclose(moved[7], moved[3], rtol=1e-9)
    assert_refused(r"no constraint moves '2 x'", model.with_rows, ["2 x"])


def test_a_record_may_continue_in_lines_without_a_tab(tmp_path):
    text_files(tmp_path, TXE=[EQUATIONS[0], "2\t1\t0\t2\t0\t3", "0", *EQUATIONS[2:]])
    assert bs.read_model(tmp_path / "Portal.TXE").labels[:3] == ("2 x", "2 z", "2 ry")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"TXE": EQUATIONS[:2]}, r"Portal.TXK: line 7: row and column must be from 1 to 3, got 4"),
        ({"TXE": [*EQUATIONS, "5\t7\t0\t0\t0\t0\t0"]}, r"TXK: ends with row 6 of 7: truncated"),
        ({"TXE": [EQUATIONS[1], EQUATIONS[2][:-4]]}, r"TXE: line 3: expected a joint and six"),
        ({"TXE": [EQUATIONS[1].replace("3", "x")]}, r"TXE: line 2: joint 2: .* whole, got 'x'"),
        ({"TXE": ["2\t1\t0\t-4\t0\t2\t0"], "TXC": ["-1\t1\t1"]}, r"TXE: line 2: .*constraint -4"),
        ({"TXE": ["2\t0\t0\t-4\t0\t2\t0"]}, r"Portal.TXC \(constraints\) must stand in the same"),
        ({"TXE": ["2\t1\t0\t3\t0\t4\t0"]}, r"TXE: no joint has equation 2; truncated\?"),
        ({"TXM": ["1\t1\t2.0", "1\t1\t2.0"]}, r"TXM: 1 entries are stated twice"),
        ({"TXM": ["1\t1\t2.0", "2\t1"]}, r"TXM: line 3: expected row, column, value, got 2 1"),
        ({"TXM": ["1\t1\tnan"]}, r"TXM: line 2: expected row, column, value, got 1 1 nan"),
        ({"TXM": ["1.5\t1\t2.0"]}, r"TXM: line 2: row and column must be a whole number, got 1.5"),
        ({"TXM": ["1\t1\t-2.0"]}, r"TXM: row 1 has the negative mass -2"),
        ({"TXK": ["1\t1\t-2.0", "6\t6\t1.0"]}, r"TXK: row 1 has the negative stiffness -2"),
        ({"TXM": ["1\t1\t0.0"]}, r"TXM: there is no mass"),
        ({"TXM": []}, r"TXM: no line of numbers \(row, column, value\); truncated\?"),
    ],
)  # fmt: skip
def test_wrong_text_is_refused_in_one_line(tmp_path, changed, message):
    text_files(tmp_path, **changed)
    assert_refused(message, bs.read_model, tmp_path / "Portal.TXK")


def test_a_cut_off_number_is_refused(tmp_path):
    text_files(tmp_path)
    (tmp_path / "Portal.TXK").write_bytes((tmp_path / "Portal.TXK").read_bytes()[:-5])
    assert_refused(r"Portal.TXK: ends within a line", bs.read_model, tmp_path / "Portal.TXE")


@pytest.mark.parametrize("missing", ["TXE", "TXK", "TXM"])
def test_a_missing_file_is_named(tmp_path, missing):
    text_files(tmp_path)
    (tmp_path / f"Portal.{missing}").unlink()
    with pytest.raises(ValueError, match=rf"Portal.{missing} \(.*\) must stand in the same folder"):
        bs.read_model(tmp_path / "Portal.TXA")
