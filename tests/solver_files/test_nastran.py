"""Nastran's punched matrices; pyyeti's own samples where it is installed."""

from pathlib import Path

import numpy as np
import pytest
from frames import LABELS, PLACES, lower_entries, portal

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
    path = write(tmp_path / "frame.pch", K, M)
    model = bs.read_model(path)
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
def test_wrong_files_are_refused_in_one_line(tmp_path, blocks, message):
    path = write(tmp_path / "frame.pch", *blocks)
    with pytest.raises(ValueError, match=message) as refused:
        bs.read_model(path)
    assert "\n" not in str(refused.value)


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
    with pytest.raises(ValueError, match=r"KAAX is in .*k.pch as well"):
        bs.read_model(k, k)
