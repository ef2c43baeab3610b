"""Abaqus's matrices, written here from their description for a portal frame."""

import numpy as np
import pytest
from frames import LABELS, PLACES, assert_is_portal, lower_entries, portal

import bayes_ssi as bs

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


def test_both_triangles_and_own_nodes(tmp_path):
    k, _ = portal()
    whole = labelled([(i, j, k[i, j]) for i, j in np.argwhere(k)])
    path = written(tmp_path, stiffness=["1,1, 1,1, 1e36", *whole])
    assert_is_portal(bs.read_model(path))
    half = labelled(lower_entries(k))
    model = bs.read_model(written(tmp_path, stiffness=[*RESTRAINED, *half, "-4,1, -4,1, 7.0"]))
    assert model.labels[0] == "internal 4 x"
    # An own node is no point that moves.
    assert model.total_mass["x"] == 5e3


def test_without_labels(tmp_path):
    k, m = (
        [f"{i + 1}, {j + 1}, {value!r}" for i, j, value in lower_entries(each)] for each in portal()
    )
    model = bs.read_model(written(tmp_path, stiffness=k, mass=m), labels=LABELS)
    assert_is_portal(model)


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
def test_wrong_files_are_refused_in_one_line(tmp_path, changed, message):
    path = written(tmp_path, **changed)
    with pytest.raises(ValueError, match=message) as refused:
        bs.read_model(path)
    assert "\n" not in str(refused.value)


def test_the_file_of_the_mass_is_found_by_its_name_or_asked_for(tmp_path):
    path = written(tmp_path)
    path.rename(tmp_path / "other.mtx")
    with pytest.raises(ValueError, match=r"other.mtx: name the file of the stiffness, job_STIFn"):
        bs.read_model(tmp_path / "other.mtx")
    assert_is_portal(bs.read_model(tmp_path / "other.mtx", tmp_path / "Frame_MASS2.mtx"))
