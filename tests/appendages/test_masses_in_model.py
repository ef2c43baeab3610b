"""An appendage's mass may be in the model already: it then vibrates in place of being added."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.studies.appendages.baselines import choose_baselines, hypothesis

TWO_PI = 2.0 * math.pi
MASSES, STIFFNESSES = np.array([1.0, 2.0, 0.5]), (100.0, 90.0, 80.0)


def solved(stiffness, mass):
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / TWO_PI


@pytest.fixture
def building():
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.1))
    return bs.ShearBuilding(tuple(MASSES), tuple(each * k for each in STIFFNESSES))


def matrices(n_own):
    """Stiffness and masses of the building, and room for appendages."""
    k1, k2, k3 = STIFFNESSES
    chain = np.array([[k1 + k2, -k2, 0.0], [-k2, k2 + k3, -k3], [0.0, -k3, k3]])
    return np.pad(chain, (0, n_own)), np.diag(np.append(MASSES, np.zeros(n_own)))


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_a_pendulum_leaves_its_floor(building, share):
    structure = building.with_element(bs.Pendulum(2, 0.4, 1.5, in_model=share))
    stiffness, mass = matrices(1)
    w = np.array([0.0, -1.0, 0.0, 1.0])
    stiffness += 0.4 * (TWO_PI * 1.5) ** 2 * np.outer(w, w)
    mass[1, 1], mass[3, 3] = 2.0 - share * 0.4, 0.4
    found = structure.modes(np.array([[1.0]])).frequencies_hz[0]
    np.testing.assert_allclose(found, solved(stiffness, mass), rtol=1e-12)


def test_an_infill_given_as_mass_vibrates_in_place_of_being_added(building):
    infill = bs.OutOfPlaneInfill((1, 2), 0.4, 1.5)
    given = building.with_element(infill.as_mass())
    other = given.with_element(replace(infill, label="the same", in_model=1.0))
    stiffness, mass = matrices(1)
    v = np.array([-0.5, -0.5, 0.0, 1.0])
    stiffness += 0.2 * (TWO_PI * 1.5) ** 2 * np.outer(v, v)
    mass += np.diag([0.1, 0.1, 0.0, 0.2])
    found = other.modes(np.array([[1.0]])).frequencies_hz[0]
    np.testing.assert_allclose(found, solved(stiffness, mass), rtol=1e-12)


def test_more_than_a_floor_has_cannot_leave_it(building):
    structure = building.with_element(bs.Pendulum(3, 0.6, 1.5, in_model=1.0))
    assert np.isnan(structure.modes(np.array([[1.0]])).frequencies_hz).all()


def test_a_share_is_between_none_and_all():
    with pytest.raises(ValueError, match=r"in_model must be at least 0 and below 1, got 1\.5"):
        bs.Pendulum(1, 0.1, 2.0, in_model=1.5)
    with pytest.raises(ValueError, match="as mass, it is in the model already"):
        bs.Pendulum(1, 0.1, 2.0, in_model=0.5).as_mass()


def test_masses_that_can_leave_places(building):
    """1 / (wᵀ M⁻¹ w), of a floor and of the mean of two; the same of matrices where M is lumped."""
    pair = ((1, 0.5), (2, 0.5))
    np.testing.assert_allclose(building.place_masses((2, pair)), [2.0, 1.0 / (0.25 + 0.125)])
    stiffness, mass = matrices(0)
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.1))
    model = bs.MatrixStructure([(k, stiffness)], mass, labels=("a", "b", "c"), n_modes=2)
    diagonal = (("a", 0.6), ("c", 0.8))
    expected = [2.0, 0.36 * 1.0 + 0.64 * 0.5]
    np.testing.assert_allclose(model.place_masses(("b", diagonal)), expected)
    np.testing.assert_allclose(model.reduced().place_masses(("b", diagonal)), expected)


def baselines_of(structure, data, candidates=None):
    study = bs.Study("s", [bs.ModelClass("b", structure, data, pairing={})])
    return choose_baselines(study, None, candidates)


def test_where_a_search_finds_the_mass(building, case_c):
    """Nine in ten masses are below 0.29: 0.001 · 500^0.9 of the mean floor of 1.08."""
    heavy = replace(building, masses=(1.0, 2.0, 0.25))
    given = heavy.with_element(bs.Pendulum(2, 0.2, 1.5, label="tank").as_mass())
    family = baselines_of(given, case_c)
    places = {place.name: place for place in family.appendages("b")}
    assert {name: place.in_model for name, place in places.items()} == {
        "pendulum 1": None, "pendulum 2": 1.0, "pendulum 3": 0.0,
        "infill 0-1": None, "infill 1-2": None, "infill 2-3": None,
    }  # fmt: skip
    said = "a pendulum on floor 2, which is given as mass ('tank')"
    assert places["pendulum 2"].description == said
    for name, has_share in (("pendulum 1", True), ("pendulum 2", False)):
        made = hypothesis(family["b"], [places[name]])
        assert (f"share in the model, {name}" in made.parameter_names) == has_share


def test_an_element_given_as_mass_is_a_place_of_its_own(building, case_c):
    mast = bs.Pendulum({"floor 1": 0.6, "floor 3": 0.8}, 0.2, 1.5, label="mast").as_mass()
    family = baselines_of(building.with_element(mast), case_c)
    (place,) = [each for each in family.appendages("b") if each.given_as == "mast"]
    assert place.name == "pendulum 0.6 floor 1 + 0.8 floor 3"
    (only,) = baselines_of(building, case_c, [bs.Candidate("roof", 3)]).appendages("b")
    assert only.name == "pendulum roof"


@pytest.mark.parametrize(("own", "given"), [(0.06, 0.04), (0.3, 0.0)])
def test_no_more_than_a_place_has_vibrates_of_what_the_model_has(case_c, own, given):
    """Of a floor, with or without a tank, that has less than half of the mean floor mass."""
    building = bs.ShearBuilding((1.0, 1.0, own), STIFFNESSES)
    if given:
        building = building.with_element(bs.Pendulum(3, given, 1.5, label="tank").as_mass())
    family = baselines_of(building, case_c)
    (place,) = [each for each in family.appendages("b") if each.name == "pendulum 3"]
    made = family.hypothesis(family["b"], (place,), "tank")
    (ratio,) = [each for each in made.parameters if "mass ratio" in each.name]
    assert ratio.prior.upper * family.scales["b"].mass == pytest.approx(own + given, rel=2e-3)
    heaviest = np.array([[0.0 if "freq" in each.name else 6.0 for each in made.parameters]])
    assert np.isfinite(made.log_likelihood_at(heaviest)).all()
