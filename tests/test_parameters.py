"""Parameters, products of them, and their evaluation for a batch."""

import math

import numpy as np
import pytest

from bayes_ssi.parameters.parameters import (
    Parameter,
    ProductTable,
    as_product,
    collect_parameters,
    positive_product,
)
from bayes_ssi.parameters.priors import HalfNormal, LogNormal, Normal, Uniform

a = Parameter("a", LogNormal(2.0, 0.3))
b = Parameter("b", LogNormal(3.0, 0.3))
VALUES = np.array([[2.0, 3.0], [0.5, 7.0]])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (5.0, [5.0, 5.0]),
        (np.int64(5), [5.0, 5.0]),
        (a, [2.0, 0.5]),
        (4.0 * a, [8.0, 2.0]),
        (a * 4, [8.0, 2.0]),
        (np.float64(4.0) * a, [8.0, 2.0]),
        (a / 4.0, [0.5, 0.125]),
        (a * b, [6.0, 3.5]),
        (b * a, [6.0, 3.5]),
        (a * a, [4.0, 0.25]),
        (2.0 * a**3, [16.0, 0.25]),
        ((2.0 * a) ** 3, [64.0, 1.0]),
        (a**-1, [0.5, 2.0]),
        (a**0.5 * b**2, [9.0 * math.sqrt(2.0), 49.0 * math.sqrt(0.5)]),
        (6.0 * a * b / 3.0, [12.0, 7.0]),
    ],
)
def test_products_evaluate_as_arithmetic(value, expected):
    table = ProductTable((as_product(value),), (a, b))
    np.testing.assert_allclose(table.evaluate(VALUES)[:, 0], expected, rtol=1e-14)


def test_table_evaluates_many_products_and_batch_equals_one_by_one():
    table = ProductTable(tuple(map(as_product, (7.0, a, a * b**2, 2.0 * b))), (a, b))
    batch = table.evaluate(VALUES)
    np.testing.assert_allclose(batch, [[7.0, 2.0, 18.0, 6.0], [7.0, 0.5, 24.5, 14.0]])
    rows = [table.evaluate(row[None])[0] for row in VALUES]
    np.testing.assert_array_equal(batch, rows)


def test_median_of_a_product():
    # The medians of a and b are 2 and 3.
    assert as_product(5.0 * a**2 * b).median == pytest.approx(60.0, rel=1e-12)
    assert as_product(5.0).median == 5.0


def test_parameters_are_collected_once_in_order_of_appearance():
    assert collect_parameters([b, a, Parameter("b", LogNormal(3.0, 0.3)), a]) == (b, a)
    assert as_product(a * b * a).parameters == (a, b)


@pytest.mark.parametrize(
    "other", [Parameter("a", LogNormal(2.0, 0.5)), Parameter("a", LogNormal(2.0, 0.3), unit="N")]
)
def test_two_parameters_of_one_name_are_refused(other):
    with pytest.raises(ValueError, match="two different parameters are named 'a'"):
        collect_parameters([a, b, other])


@pytest.mark.parametrize(
    ("name", "prior", "error", "message"),
    [
        (1, LogNormal(1.0, 0.3), ValueError, "name must be text and not empty, got 1"),
        ("", LogNormal(1.0, 0.3), ValueError, "name must be text and not empty"),
        ("k", 1.0, TypeError, "Parameter 'k': prior must be a prior distribution, got 1.0"),
        ("k", LogNormal, TypeError, "Parameter 'k': prior must .* choose from .*Normal, LogNormal"),
    ],
)
def test_wrong_parameters_are_refused(name, prior, error, message):
    with pytest.raises(error, match=message):
        Parameter(name, prior)


@pytest.mark.parametrize("value", ["5", None, True, [1.0], 1j])
def test_values_that_are_no_numbers_are_refused(value):
    with pytest.raises(TypeError, match="mass must be a number, a Parameter or a number times it"):
        as_product(value, "mass")


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan, -2.0 * a, 0.0 * a])
def test_numbers_that_are_not_positive_are_refused(value):
    with pytest.raises(ValueError, match="mass must be positive and finite, got"):
        positive_product(value, "mass")


@pytest.mark.parametrize(
    ("prior", "share"),
    [(Normal(1.0, 0.5), "0.023"), (Normal(0.0, 1.0), "0.5"), (Uniform(-1.0, 3.0), "0.25")],
)
def test_priors_that_can_be_negative_are_refused(prior, share):
    product = as_product(3.0 * Parameter("k1", prior))
    with pytest.raises(ValueError, match=f"mass .*'k1'.* with probability {share}; choose"):
        positive_product(product, "mass")


@pytest.mark.parametrize(
    "prior", [Normal(1.0, 0.1), Uniform(0.0, 1.0), HalfNormal(1.0), LogNormal(1.0, 2.0)]
)
def test_priors_that_are_all_but_positive_are_accepted(prior):
    assert prior.probability_below(0.0) < 1e-6
    positive_product(Parameter("k1", prior), "mass")
