"""Sensors between degrees of freedom, on matrices and functions as on buildings."""

import pickle

import numpy as np
import pytest
import scipy.linalg

import bayes_ssi as bs
from bayes_ssi.studies.appendages.baselines import choose_baselines, hypothesis

K = np.array([[300.0, -200.0, 0.0], [-200.0, 400.0, -200.0], [0.0, -200.0, 200.0]])
NAMES = ("a", "b", "c")
HALFWAY = bs.Sensor("halfway", {"a": 0.5, "b": 0.5})
SLOPED = bs.Sensor("sloped", {"b": 0.6, "c": -0.8})


def stiff():
    return bs.Parameter("k", bs.LogNormal(1.0, 0.3))


def matrices():
    return bs.MatrixStructure([(stiff(), K)], np.eye(3), labels=NAMES, n_modes=3)


def solved(k):
    return k * K, np.eye(3)


def function():
    return bs.FunctionStructure(solved, {"k": stiff()}, n_modes=3, sensors=NAMES)


def frequencies_and_shapes(structure, sensors, value=1.3):
    frequencies, shapes = structure.modes(np.array([[value]]))
    return frequencies[0], structure.sensor_matrix(sensors).apply(shapes)[0]


@pytest.mark.parametrize("make", [matrices, function])
def test_they_measure_combinations_of_the_modes(make):
    structure = make().with_sensors([HALFWAY]).with_sensors([SLOPED])
    frequencies, shapes = frequencies_and_shapes(structure, ("halfway", "c", "sloped"))
    values, vectors = scipy.linalg.eigh(1.3 * K)
    np.testing.assert_allclose(frequencies, np.sqrt(values) / (2.0 * np.pi))
    rows = np.array([[0.5, 0.5, 0.0], [0.0, 0.0, 1.0], [0.0, 0.6, -0.8]])
    np.testing.assert_allclose(np.abs(shapes), np.abs(rows @ vectors), atol=1e-9)
    assert not make().sensors
    assert structure.description()["combined sensors"].startswith("halfway = 0.5 a + 0.5 b; ")
    again = pickle.loads(pickle.dumps(structure))
    np.testing.assert_array_equal(frequencies_and_shapes(again, ("halfway",))[1], shapes[:1])


@pytest.mark.parametrize("make", [matrices, function])
@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (bs.Sensor("a", {"b": 1.0}), "another sensor or degree of freedom has that label"),
        (bs.Sensor("d", {"e": 1.0}), "the structure has no degree of freedom 'e'"),
    ],
)
def test_what_is_not_on_the_structure_is_refused(make, sensor, message):
    with pytest.raises(ValueError, match=message):
        make().with_sensors([sensor])


def test_they_stay_on_a_reduced_model_with_an_element():
    structure = matrices().with_sensors([HALFWAY])
    tank = bs.Pendulum("c", mass=0.1, frequency=2.0, label="tank")
    exact = structure.with_element(tank)
    reduced = structure.reduced().with_element(tank)
    sensors = ("halfway", "tank")
    both = (frequencies_and_shapes(each, sensors) for each in (exact, reduced))
    for one, other in zip(*both, strict=True):
        np.testing.assert_allclose(np.abs(one), np.abs(other), rtol=1e-5, atol=1e-7)


def test_a_search_hangs_appendages_on_what_they_measure():
    structure = matrices().with_sensors([HALFWAY, SLOPED])
    frequencies, shapes = frequencies_and_shapes(structure, ("halfway", "sloped"), 1.0)
    sensors = ("halfway", "sloped")
    data = bs.ModalData.from_arrays(frequencies, shapes, (0.0, 6.0), sensors)
    candidate = bs.ModelClass("points", structure, data, pairing="any")
    family = choose_baselines(bs.Study("points", [candidate]))
    places = family.appendages("points")
    assert [place.name for place in places] == ["pendulum a", "pendulum b", "pendulum c"]
    carrying = hypothesis(candidate, places[:1])
    medians = np.array([[p.prior.quantile(0.5) for p in carrying.parameters]])
    assert np.isfinite(carrying.log_likelihood(medians)).all()


def test_a_sensor_on_an_appendage_stays_where_it_becomes_a_mass():
    """It then moves with the mean of the two floors, or with the floor that carries it."""
    frame = bs.ShearBuilding(masses=(1.0, 1.0, 1.0), stiffnesses=(200.0, 200.0, 200.0))
    infill = bs.OutOfPlaneInfill(between=(1, 2), mass=0.1, frequency=2.0)
    tank = bs.Pendulum(on=3, mass=0.05, frequency=1.5, label="tank")
    whole = frame.with_element(infill).with_element(tank)
    rigid = frame.with_element(infill.as_mass()).with_element(tank.as_mass())
    sensors = ("infill 1-2", "tank", "floor 2")
    assert set(whole.appendages) == {"infill 1-2", "tank"}
    assert not rigid.appendages
    rows = rigid.sensor_matrix(sensors).apply(np.eye(3), axis=0)
    np.testing.assert_allclose(rows, [[0.5, 0.5, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match="'tank'"):
        frame.sensor_matrix(["tank"])
