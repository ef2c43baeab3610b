"""A row of a batch gets the same log-likelihood, to the last digit, whatever comes with it.

Batches are evaluated in parts by workers: a last digit that depended on the size of a part would
make a run depend on their number.
"""

from dataclasses import replace

import numpy as np
import pytest
from conftest import MODEL_CLASSES, multiplier

import bayes_ssi as bs

STUDIES = {
    (path.stem, model_class.name): model_class
    for path in sorted(MODEL_CLASSES.glob("*.py"))
    for model_class in bs.load_study(path).model_classes
}
PARTS, MOST_PARTS = (1, 3, 7, 64), 5

ELEMENTS = {
    "in-plane infill": bs.InPlaneInfill((1, 2), multiplier("mi", 0.2), multiplier("ki", 90.0)),
    "pendulum": bs.Pendulum(3, multiplier("mp", 0.1), multiplier("fp", 2.0), multiplier("kp")),
    "out-of-plane infill": bs.OutOfPlaneInfill(
        (0, 2), multiplier("mo", 0.3), 2.5 * multiplier("fo") ** 0.5, multiplier("ko") ** 3
    ),
    "added mass": bs.AddedMass(multiplier("ma", 0.3), ((1, 0.2), (3, 0.8))),
}
FIXED = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.06)
RELATED = bs.ErrorModel(frequency_cov=0.5 * multiplier("e", 0.02), shape_sd=multiplier("e", 0.02))


def building(n_floors, *elements):
    stiffnesses = [100.0 * n_floors**2 * multiplier(f"k{i}") for i in range(n_floors)]
    structure = bs.ShearBuilding((1.0,) * n_floors, stiffnesses)
    for element in elements:
        structure = structure.with_element(element)
    return structure


def as_identified(structure, numbers, shapes=(), own_errors=False):
    """Some modes of the structure at its prior medians, 1 % off and in that order."""
    rng = np.random.default_rng(len(numbers))
    frequencies, all_shapes = structure.modes(structure.prior_medians())
    sensors = structure.degrees_of_freedom[::-1]
    modes = []
    for number in numbers:
        shape = all_shapes[0, ::-1, number - 1] + 0.01 * rng.standard_normal(len(sensors))
        if number % 2 and len(sensors) > 3:
            shape[1] = np.nan  # not measured
        with_shape = number in shapes
        modes.append(
            bs.IdentifiedMode(
                str(number),
                frequencies[0, number - 1] * (1.0 + 0.01 * rng.standard_normal()),
                shape if with_shape else None,
                frequency_cov=0.003 * number if own_errors else None,
                shape_sd=0.02 * number if own_errors and with_shape else None,
            )
        )
    band = (0.0, 1.1 * float(frequencies.max()))
    return bs.ModalData(tuple(modes), band, sensors if shapes else ())


def explained(structure, error, numbers, shapes=(), own_errors=False, spurious=()):
    data = as_identified(structure, numbers, shapes, own_errors)
    pairing = {str(number): number for number in numbers if number not in spurious}
    return bs.ModelClass("rows", structure, data, error, pairing=pairing)


def coordinates(d, n=100):
    """Prior draws, and a few rows so far out that a model breaks down or fits nothing."""
    z = np.random.default_rng(d).standard_normal((n, d))
    z[[3, 17, 99]] = [[9.0], [-30.0], [5000.0]]
    return z


def assert_rows_are_independent(model_class):
    z = coordinates(len(model_class.parameters))
    with np.errstate(all="ignore"):  # of the rows far out
        whole = model_class.log_likelihood_at(z)
        assert np.isfinite(whole).mean() > 0.95
        for size in PARTS:
            begun = range(0, len(z), size)[:MOST_PARTS]
            parts = np.concatenate([model_class.log_likelihood_at(z[i : i + size]) for i in begun])
            np.testing.assert_array_equal(parts, whole[: len(parts)], err_msg=f"parts of {size}")


@pytest.mark.parametrize("model_class", STUDIES.values(), ids=lambda m: m.name)
def test_rows_of_the_studies(model_class):
    assert_rows_are_independent(model_class)


@pytest.mark.parametrize(
    ("error", "shapes"),
    [(FIXED, ()), (FIXED, (1, 2, 3)), (RELATED, (2,)), (bs.ErrorModel(), (1, 2, 3))],
    ids=["fixed, bare", "fixed, all shapes", "tied, a shape", "free, all shapes"],
)
@pytest.mark.parametrize("element", ELEMENTS.values(), ids=ELEMENTS)
def test_rows_with_every_kind_of_element(element, shapes, error):
    assert_rows_are_independent(explained(building(3, element), error, (3, 1, 2), shapes))


@pytest.mark.parametrize("error", [FIXED, bs.ErrorModel()], ids=["fixed", "free"])
def test_rows_with_errors_of_their_own_and_spurious_modes(error):
    structure = building(4, *ELEMENTS.values())
    model_class = explained(structure, error, (5, 1, 4, 2), (1, 4), own_errors=True, spurious=(2,))
    assert_rows_are_independent(model_class)


@pytest.mark.parametrize("pairing", ["given", "any"])
@pytest.mark.parametrize("error", [FIXED, bs.ErrorModel()], ids=["fixed", "free"])
def test_rows_with_joint_errors(error, pairing):
    structure = building(4)
    data = as_identified(structure, (1, 2, 3), (1, 3))
    factor = 0.01 * np.random.default_rng(0).standard_normal((15, 15))
    data = replace(data, covariance=factor @ factor.T)
    if pairing == "given":
        pairing = {str(number): number for number in (1, 2, 3)}
    assert_rows_are_independent(bs.ModelClass("rows", structure, data, error, pairing=pairing))


@pytest.mark.parametrize("joint", [(), "b", "ab"], ids=["independent", "one joint", "two joint"])
@pytest.mark.parametrize("between_modes", [0.0, 0.5], ids=["tests", "tests and modes"])
@pytest.mark.parametrize("error", [FIXED, bs.ErrorModel()], ids=["fixed", "free"])
def test_rows_with_correlated_errors(error, between_modes, joint):
    rho = 0.8 if error is FIXED else bs.Parameter("rho", bs.Uniform(0.0, 1.0))
    error = replace(error, between_tests=rho, between_modes=between_modes)
    tests = []
    for name, numbers in (("a", (1, 2, 3)), ("b", (3, 1)), ("c", (2, 4, 1))):
        structure = building(4)
        data = as_identified(structure, numbers, numbers, own_errors=name not in joint)
        if name in joint:
            factor = 0.01 * np.random.default_rng(0).standard_normal((5 * len(numbers),) * 2)
            data = replace(data, covariance=factor @ factor.T)
        pairing = {str(number): number for number in numbers}
        tests.append(bs.Configuration(name, structure, data, pairing=pairing))
    assert_rows_are_independent(bs.ModelClass("rows", configurations=tests, error=error))


def test_rows_of_a_fixed_structure():
    structure = bs.ShearBuilding((1.0,) * 3, (900.0,) * 3)
    assert_rows_are_independent(explained(structure, bs.ErrorModel(), (1, 2, 3), (1, 3)))


TWELVE = tuple(range(1, 13))


@pytest.mark.parametrize("error", [FIXED, bs.ErrorModel()], ids=["fixed", "free"])
@pytest.mark.parametrize(
    ("numbers", "shapes"),
    [(TWELVE, ()), ((1,), ()), ((1, 2), (1,)), ((1, 2), (1, 2)), (TWELVE, TWELVE)],
    ids=["many pairs", "many missed", "many sensors", "two shapes", "many shapes"],
)
def test_rows_of_a_tall_building(numbers, shapes, error):
    """Sums of eight terms and more, which numpy may add up in different orders."""
    assert_rows_are_independent(explained(building(12), error, numbers, shapes))


def test_rows_that_break_down_leave_the_others_alone():
    model_class = explained(building(3), FIXED, (1, 2, 3), (1, 2, 3))
    z = coordinates(3)
    with np.errstate(all="ignore"):
        whole = model_class.log_likelihood_at(z)
        failed = np.isnan(whole)
        assert failed.any()
        np.testing.assert_array_equal(model_class.log_likelihood_at(z[~failed]), whole[~failed])
