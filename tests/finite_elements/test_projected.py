"""Models in a small basis for draws, against full solutions and flexibilities of the full model."""

import math
import pickle

import numpy as np
import pytest
from chains import spring_chain
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.structures.finite_elements.projected_structure import modes_at_places

N, MASS = 60, 1.0
LOWER, UPPER = (4000.0 * part for part in spring_chain(N, 2))
SENSORS = {f"s{i}": i for i in (5, 20, 40, 59)}
k = bs.Parameter("k", bs.LogNormal(1.0, 0.1))
m, f = bs.Parameter("m", bs.LogNormal(1.0, 0.5)), bs.Parameter("f", bs.LogNormal(1.0, 0.5))


@pytest.fixture(scope="module")
def chain():
    """A chain of springs, the upper half of which has a common factor."""
    return bs.MatrixStructure(
        [(k, UPPER), LOWER], MASS * np.eye(N), sensors=SENSORS, n_modes=4
    ).reduced()


@pytest.fixture(scope="module")
def projected(chain):
    return chain.projected(np.random.default_rng(0).lognormal(0.0, 0.05, (50, 1)), ["s40", "s20"])


def test_it_is_smaller_and_as_accurate_where_it_was_made(chain, projected):
    values = np.random.default_rng(1).lognormal(0.0, 0.05, (20, 1))
    assert len(projected.motions[0]) < chain.basis.size
    for row, frequencies in zip(values, projected.modes(values).frequencies_hz, strict=True):
        squared = eigh(LOWER + row[0] * UPPER, eigvals_only=True, subset_by_index=[0, 3])
        assert frequencies == pytest.approx(np.sqrt(squared / MASS) / (2.0 * math.pi), rel=1e-4)


def test_what_the_basis_lacks_of_the_flexibility(projected):
    """At the prior median; its own by a sketch of 160 combinations, whose error is a ninth."""
    assert projected.places == ("s40", "s20")
    motion, missing = projected.motions[0], projected.flexibilities[0]
    moved_sensors = projected.moved_sensors[0]
    flexibility = np.linalg.inv(LOWER + UPPER)
    # Under a unit force, by the basis alone; at the median the factor k is 1.
    moved = np.linalg.solve(sum(matrix for _, matrix in projected.stiffness), motion)
    lacking = flexibility[40, 40] - motion @ moved
    assert (missing**2).sum() == pytest.approx(lacking, rel=4.0 * math.sqrt(2.0 / 160))
    at_sensors = flexibility[[*SENSORS.values()], 40] - projected.at_sensors @ moved
    assert moved_sensors == pytest.approx(at_sensors, rel=1e-6, abs=1e-9 * flexibility.max())


@pytest.mark.parametrize(
    "element",
    [
        bs.Pendulum("s40", m, f, label="a"),
        bs.Pendulum({"s20": 0.6, "s40": -0.8}, m, f, label="a"),
        bs.OutOfPlaneInfill(("s20", "s40"), m, f, label="a"),
    ],
)
def test_an_element_on_it_has_the_modes_of_the_full_model(chain, projected, element):
    """Masses up to 10 % of a modal mass; but for the error of the sketched flexibility ρ.

    1/k' = 1/k + ρ, so an error of ρ changes a frequency by at most half of its share in 1/k'.
    """
    light, full = projected.with_element(element), chain.full.with_element(element)
    assert light.parameters == full.parameters
    assert light.degrees_of_freedom == full.degrees_of_freedom
    rng = np.random.default_rng(2)
    values = np.column_stack(
        [rng.lognormal(0.0, 0.05, 20), rng.uniform(0.5, 3.0, 20), rng.uniform(0.2, 1.5, 20)]
    )
    (spring,) = element.springs()
    stiffness = spring.coefficient.scale * values[:, 1] * values[:, 2] ** 2
    own = stiffness * light.vectors.flexibilities[0, 0]
    tolerance = 1e-3 + 0.5 * 4.0 * math.sqrt(2.0 / 160) * own / (1.0 + own)
    order = [["k", "m", "f"].index(p.name) for p in light.parameters]
    ours, theirs = (each.modes(values[:, order]) for each in (light, full))
    errors = np.abs(ours.frequencies_hz / theirs.frequencies_hz - 1.0).max(axis=1)
    assert (errors < tolerance).all()
    assert np.median(errors) < 1e-3
    for a, b in zip(ours.shapes[:, :4], theirs.shapes[:, :4], strict=True):
        a, b = a / np.linalg.norm(a, axis=0), b / np.linalg.norm(b, axis=0)
        assert np.abs((a * b).sum(axis=0)) == pytest.approx(np.ones(5), abs=1e-2)


def test_a_compact_structure_is_certified(chain, monkeypatch):
    """Of the ten vectors, as many as a batch takes with two elements are kept."""
    module = "bayes_ssi.structures.finite_elements.matrix_structure"
    monkeypatch.setattr(f"{module}.BATCHED_WITH_ELEMENTS", 7)
    values = np.random.default_rng(0).lognormal(0.0, 0.05, (50, 1))
    compact = chain.compact(values).with_element(bs.Pendulum("s40", m, f, label="a"))
    whole = chain.with_element(bs.Pendulum("s40", m, f, label="a"))
    assert compact.basis.n_before == 7 < whole.basis.n_before
    assert compact.n_full_solutions == whole.n_full_solutions
    each = np.random.default_rng(1).lognormal(0.0, 0.05, (5, 3))
    ours, theirs = compact.modes(each).frequencies_hz, whole.full.modes(each).frequencies_hz
    errors = np.abs(ours / theirs - 1.0)
    assert errors.max() < 1e-3
    assert (errors <= compact.bounds(each).frequency + 1e-11).all()


@pytest.mark.parametrize(
    "elements",
    [
        [bs.Pendulum(place, m, f, label="a") for place in ("s40", "s20")],
        [bs.OutOfPlaneInfill(ends, m, f, label="a") for ends in ((0, "s20"), ("s20", "s40"))],
    ],
)
def test_alternative_places_are_those_of_each_structure(projected, elements):
    each = [projected.with_element(element) for element in elements]
    values = np.random.default_rng(4).lognormal(0.0, 0.05, (6, 3))
    which = np.array([0, 1, 1, 0, 1, 0])
    modes = modes_at_places(each)(values, which)
    for i, number in enumerate(which):
        alone = each[number].modes(values[[i]])
        assert np.array_equal(modes.frequencies_hz[i], alone.frequencies_hz[0])
        assert np.array_equal(modes.shapes[i], alone.shapes[0])


def test_a_mass_with_parameters_is_kept_as_it_is():
    """Coordinates of unit mass are those of all values only where the mass is known."""
    mass = [(bs.Parameter("density", bs.LogNormal(1.0, 0.1)), MASS * np.eye(N))]
    model = bs.MatrixStructure(LOWER + UPPER, mass, sensors=SENSORS, n_modes=4)
    light = model.reduced().projected(np.ones((1, 1)), ["s40"])
    carrying = light.with_element(bs.Pendulum("s40", 2.0, 0.4, label="a"))
    ours = carrying.modes(np.array([[1.2]])).frequencies_hz
    theirs = model.with_element(bs.Pendulum("s40", 2.0, 0.4, label="a")).modes(np.array([[1.2]]))
    assert ours == pytest.approx(theirs.frequencies_hz, rel=2e-3)


def test_other_places_are_refused(projected):
    with pytest.raises(ValueError, match=r"a: no place 's5'; choose from 's40', 's20'"):
        projected.with_element(bs.Pendulum("s5", m, f, label="a"))


def test_only_places_with_elements_go_to_other_processes(projected):
    """A search has hundreds of places and as many hypotheses."""
    carrying = projected.with_element(bs.Pendulum("s40", m, f))
    sent = pickle.loads(pickle.dumps(carrying))
    assert sent.places == ("s40",)
    assert carrying.places == ("s40", "s20")
    values = np.array([[1.1, 0.8, 1.3]])
    for here, there in zip(carrying.modes(values), sent.modes(values), strict=True):
        assert np.array_equal(here, there)
