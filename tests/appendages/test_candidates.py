"""Candidates of a search: floors, sensors, a user's list, and the hypotheses made of them."""

import math

import numpy as np
import pytest
from conftest import assert_refused
from scipy.linalg import eigh
from searches import ONE, by_count

import bayes_ssi as bs
from bayes_ssi.report.tables.search_tables import search_notes
from bayes_ssi.studies.appendages.baselines import choose_baselines, hypothesis, scale_of
from bayes_ssi.studies.appendages.candidates import PendulumPlace, places_of
from bayes_ssi.studies.search.family import compact, prior_draws

K = np.array([[1600.0, -700.0, 0.0], [-700.0, 1100.0, -400.0], [0.0, -400.0, 400.0]])
MASSES = (3.0, 2.0, 1.5)
LABELS = ["node 1 x", "node 2 x", "node 2 y"]
k = bs.Parameter("k", bs.LogNormal(1.0, 0.1))


def matrices(sensors=None):
    """Three degrees of freedom, two of them at one node."""
    geometry = bs.Geometry({"node 1": (0.0, 0.0, 3.0), "node 2": (4.0, 0.0, 3.0)})
    return bs.MatrixStructure(
        [(k, K)], np.diag(MASSES), labels=LABELS, sensors=sensors, n_modes=3, geometry=geometry
    )


def baseline(structure, sensors=LABELS, name="b"):
    modes = (bs.IdentifiedMode("1", 1.1, [0.3, 0.6, 0.7][: len(sensors)]),
             bs.IdentifiedMode("2", 2.9, [0.6, 0.2, -0.7][: len(sensors)]))  # fmt: skip
    data = bs.ModalData(modes, (0.0, 6.0), tuple(sensors))
    return bs.ModelClass(name, structure, data, bs.ErrorModel(0.01, 0.05), pairing="any")


def test_sensors_are_the_places_of_a_structure_without_floors():
    places = choose_baselines(bs.Study("s", [baseline(matrices())])).appendages("b")
    assert [place.name for place in places] == [f"pendulum {label}" for label in LABELS]
    assert places[2].coordinates == (4.0, 0.0, 3.0)
    assert places[2].direction == (0.0, 1.0, 0.0)


def test_floors_and_storeys_in_x_and_y_are_those_of_a_building_in_space():
    building = bs.ShearBuilding3D((1.0, 1.0), (1.0, 1.0), (9.0, 9.0), (9.0, 9.0), (9.0, 9.0))
    places = places_of(building.candidates(()))
    assert [place.name for place in places] == [
        *(f"pendulum floor {floor} {axis}" for floor in (1, 2) for axis in "xy"),
        *(f"infill {storey} {axis}" for storey in ("0-1", "1-2") for axis in "xy"),
    ]
    carrying = building
    for place in places:
        carrying = carrying.with_element(place.element(0.1, 2.0))
    assert len(carrying.appendages) == 8


@pytest.mark.parametrize("make", [matrices, lambda: matrices().reduced()])
def test_a_hypothesis_in_a_direction_has_the_modes_of_the_augmented_matrices(make):
    """By scipy, with the row of the pendulum written by hand."""
    bare = baseline(make())
    place = PendulumPlace(bs.Candidate("edge", {"node 2 x": 0.6, "node 2 y": 0.8}))
    made = hypothesis(bare, (place,))
    ratio, frequency, factor = 0.1, 2.0, 1.1
    values = {"k": factor, "mass ratio, pendulum edge": ratio, "frequency, pendulum edge": 2.0}
    modes = made.structure.modes(np.array([[values[name] for name in made.parameter_names]]))
    mass = ratio * scale_of(bare).mass
    w = np.array([0.0, -0.6, -0.8, 1.0])
    stiffness = np.zeros((4, 4))
    stiffness[:3, :3] = factor * K
    stiffness += mass * (2.0 * math.pi * frequency) ** 2 * np.outer(w, w)
    squared = eigh(stiffness, np.diag([*MASSES, mass]), eigvals_only=True)
    expected = np.sqrt(squared) / (2.0 * math.pi)
    np.testing.assert_allclose(modes.frequencies_hz[0], expected, rtol=1e-8)


def test_the_scale_of_masses_without_floors_is_the_median_modal_mass():
    """Of the two lowest modes, as two were identified, at the two sensors."""
    sensors = LABELS[:2]
    structure = matrices(sensors)
    _, shapes = eigh(K, np.diag(MASSES))
    lowest = shapes[:, :2] / np.abs(shapes[:2, :2]).max(axis=0)
    modal_masses = np.einsum("dm,d,dm->m", lowest, MASSES, lowest)
    scale = scale_of(baseline(structure, sensors))
    assert scale.name == "median modal mass"
    assert scale.mass == pytest.approx(np.median(modal_masses), rel=1e-9)


@pytest.mark.parametrize("rounding", [0.0, 1e-15])
def test_a_mode_that_moves_the_sensors_by_rounding_alone_has_no_modal_mass(rounding):
    """Of a mode in x and one in y, the sensor in x sees the first: its mass is that of its node."""
    stiffness = np.diag([100.0, 200.0])
    stiffness[0, 1] = stiffness[1, 0] = 100.0 * rounding
    structure = bs.MatrixStructure(
        [(k, stiffness)], np.diag([3.0, 2.0]), labels=["node x", "node y"], n_modes=2
    )
    modes = tuple(bs.IdentifiedMode(str(i), 0.5 * i) for i in (1, 2))
    data = bs.ModalData(modes, (0.0, 6.0), ("node x",))
    scale = scale_of(bs.ModelClass("c", structure, data, bs.ErrorModel(0.01), pairing="any"))
    assert scale.mass == pytest.approx(3.0, rel=1e-9)


def test_the_scale_of_a_building_is_its_mean_floor_mass():
    """Rotational inertia is no mass of a floor, and a parameter counts at its median."""
    space = bs.ShearBuilding3D((3.0, 1.0), (5.0, 5.0), (9.0, 9.0), (9.0, 9.0), (9.0 * k, 9.0))
    plane = bs.ShearBuilding((1.0, 10.0 * k, 1.0), (9.0, 9.0, 9.0))
    for building, mean, axis in ((space, 2.0, " x"), (plane, 4.0, "")):
        scale = scale_of(baseline(building, [f"floor 1{axis}", f"floor 2{axis}"]))
        assert (scale.mass, scale.name) == (pytest.approx(mean), "mean floor mass")


@pytest.mark.parametrize("reduced", [False, True])
def test_a_place_that_no_sensor_sees_is_tried_and_said(fake_sampling, reduced):
    """A second, separate oscillator has no sensor; a mixture of the two is seen."""
    fake_sampling(by_count(0.0, 1.0))
    apart = np.zeros((4, 4))
    apart[:3, :3], apart[3, 3] = K, 500.0
    structure = bs.MatrixStructure(
        [(k, apart)], np.diag([*MASSES, 1.0]), labels=[*LABELS, "node 3 x"], n_modes=4
    )
    candidates = [
        bs.Candidate("apart", "node 3 x"),
        bs.Candidate("both", {"node 3 x": 0.6, "node 2 y": 0.8}),
        bs.Candidate("tie", "node 3 x", to="node 2 x"),
    ]
    made = baseline(structure.reduced() if reduced else structure)
    result = bs.search(made, ONE, candidates=candidates)
    observed = {each.place.name: each.is_observed for each in result.record.places}
    assert observed == {"pendulum apart": False, "pendulum both": True, "infill tie": True}
    (note,) = [note for note in search_notes(result.record) if "says nothing" in note]
    assert note.endswith("which move in no mode that a sensor sees: pendulum apart.")


def test_a_reduced_structure_with_elements_is_searched_as_it_is(fake_sampling):
    fake_sampling(by_count(0.0, 1.0))
    loaded = matrices().reduced().with_element(bs.AddedMass(0.1, (("node 1 x", 1.0),)))
    assert len(bs.search(baseline(loaded), ONE).record.hypotheses) == 4
    chosen = choose_baselines(bs.Study("s", [baseline(loaded)]))
    assert compact(chosen["b"], prior_draws).structure is loaded


def two_tests():
    bare = baseline(matrices())
    test = bare.configurations[0]
    other = bs.Configuration("with mast", test.structure, test.data, pairing="any")
    first = bs.Configuration("bare", test.structure, test.data, pairing="any")
    return bs.ModelClass("b", error=bare.error, configurations=[first, other])


@pytest.mark.parametrize(
    ("present_in", "counts"), [(None, [1, 1]), (["with mast"], [0, 1]), (["bare"], [1, 0])]
)
def test_an_appendage_is_in_all_tests_or_in_some(fake_sampling, present_in, counts):
    fake_sampling(lambda made: float(len(made.parameters)))
    result = bs.search(two_tests(), ONE, present_in=present_in)
    assert result.record.present_in == (None if present_in is None else tuple(present_in))
    for made in result.ranking.study.model_classes[1:]:
        assert [len(test.structure.appendages) for test in made.configurations] == counts
        assert len(made.parameters) == 4  # k, and three shared by the tests


def test_appendages_are_in_the_tests_whose_structures_have_their_places(fake_sampling):
    """The other structure describes torsion alone."""
    fake_sampling(lambda made: float(len(made.parameters)))
    sideways, twisting = baseline(matrices()), baseline(bs.ShearBuilding((1.0,), (k,)), ())
    tests = [
        bs.Configuration(name, own.structure, own.data, pairing="any")
        for name, own in (("sideways", sideways), ("torsion", twisting))
    ]
    result = bs.search(bs.ModelClass("b", error=sideways.error, configurations=tests), ONE)
    assert result.record.present_in == ("sideways",)
    for made in result.ranking.study.model_classes[1:]:
        assert [len(test.structure.appendages) for test in made.configurations] == [1, 0]


def test_a_class_with_an_appendage_of_its_own_is_no_baseline_where_others_have_none(fake_sampling):
    fake_sampling(by_count(0.0, 1.0, 2.0))
    bare = baseline(matrices())
    mast = bs.Pendulum("node 2 y", 0.1, 2.0, label="mast")
    own = baseline(matrices().with_element(mast), name="own")
    record = bs.search(bs.Study("s", [bare, own]), ONE).record
    assert [each.name for each in record.baselines] == ["b"]
    assert record.left_out == {"own": "model class 'own' carries an appendage of its own, 'mast'"}
    record = bs.search(bs.Study("s", [own]), ONE).record
    assert [each.name for each in record.baselines] == ["own"]


EDGE = {"node 2 x": 0.6, "node 2 y": 0.8}


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: [bs.Candidate("a", "node 9 x")], ValueError,
         r"'b': candidate 'a': the structure has no degree of freedom or sensor 'node 9 x'"),
        (lambda: [bs.Candidate("a", {"node 1 x": 0.0})], ValueError,
         "candidate 'a': place is a direction of zeros"),
        (lambda: [bs.Candidate("a", 0)], ValueError, "candidate 'a': place is the ground"),
        (lambda: [bs.Candidate("a", EDGE, to=EDGE)], ValueError, "candidate 'a': both ends"),
        (lambda: [bs.Candidate("a", EDGE, coordinates=(1.0, 2.0))], ValueError,
         "candidate 'a': coordinates: must have three finite coordinates"),
        (lambda: [bs.Candidate(" ", EDGE)], ValueError, "name must be text and not empty"),
        (lambda: [bs.Candidate("a", EDGE), bs.Candidate("b", dict(reversed(EDGE.items())))],
         ValueError, "'a' and 'b' are one place"),
        (lambda: [bs.Candidate("a", EDGE), bs.Candidate("a", "node 1 x")], ValueError,
         "two are named 'a'"),
        (list, ValueError, "the list is empty"),
        (lambda: ["node 1 x"], TypeError, "search: candidates must be"),
    ],
)  # fmt: skip
def test_bad_candidates_are_refused(make, error, message):
    with pytest.raises(error, match=message):
        bs.search(baseline(matrices()), ONE, candidates=make())


@pytest.mark.parametrize(
    ("present_in", "message"),
    [(["roof"], "no configuration 'roof'"), ([], "present_in: names no test")],
)
def test_a_test_that_does_not_exist_is_refused(present_in, message):
    assert_refused(message, bs.search, two_tests(), ONE, present_in=present_in)


def write(tmp_path, text):
    path = tmp_path / "places.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_candidates_from_a_file(tmp_path):
    text = """# drawn on sheet 4
name, place, x, y, z, x_coord, y_coord, z_coord, to
roof edge, node 7, 3, 4, , 12, 0, 9.5,
mast, node 9 x
brace, node 9 x, , , , , , , 0
"""
    assert bs.read_candidates(write(tmp_path, text)) == (
        bs.Candidate("roof edge", {"node 7 x": 0.6, "node 7 y": 0.8},
                     coordinates=(12.0, 0.0, 9.5), direction=(0.6, 0.8, 0.0)),
        bs.Candidate("mast", "node 9 x"),
        bs.Candidate("brace", "node 9 x", to=0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("name,place\n", "no candidate below the column names name,place"),
        ("name,node\na,b\n", "no column 'place'"),
        ("name,place,weight\na,b,1\n", "unknown column 'weight'"),
        ("name,place,name\na,b,1\n", "two columns 'name'"),
        ("name,place\na,b,c\n", "line 2: 3 cells for 2 columns"),
        ("name,place,x,y,z\na,node 1,0,0,0\n", "line 2: x, y, z: a direction of zeros"),
        ("name,place,x\na,node 1,up\n", "line 2: x: 'up' is not a number"),
        ("name,place,x_coord\na,b,1\n", "line 2: x_coord, y_coord, z_coord: give all three"),
        ("name,place\n,b\n", "line 2: Candidate: name must be text and not empty"),
        ("name,place\na,\n", "line 2: candidate 'a': place must be a floor, the label"),
        ("name,place\na,b\nc,b\n", "'a' and 'c' are one place"),
        ("name,place\na,b\na,c\n", "two are named 'a'"),
    ],
)
def test_a_bad_file_of_candidates_is_refused(tmp_path, text, message):
    assert_refused(message, bs.read_candidates, write(tmp_path, text))
