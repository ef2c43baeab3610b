"""Parameters, products of them and their evaluation for a batch; and their priors."""

import math

import numpy as np
import pytest
from conftest import assert_refused
from scipy import stats

from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.parameters.parameters import (
    Parameter,
    ProductTable,
    as_product,
    collect_parameters,
    positive_product,
)
from bayes_ssi.parameters.priors import (
    HalfNormal,
    LogNormal,
    LogUniform,
    NearOne,
    Normal,
    Prior,
    TruncatedNormal,
    Uniform,
    Widened,
    prior_from_text,
)

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
    np.testing.assert_array_equal(batch, [table.evaluate(row[None])[0] for row in VALUES])


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
    assert_refused("two different parameters are named 'a'", collect_parameters, [a, b, other])


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
    assert_refused("mass must be positive and finite, got", positive_product, value, "mass")


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


LOG_SD_03 = math.sqrt(math.log(1.09))


class OneMinus:
    """One minus a variable of a distribution in scipy."""

    def __init__(self, distribution):
        self.support = lambda: tuple(1.0 - end for end in distribution.support()[::-1])
        self.ppf = lambda probability: 1.0 - distribution.isf(probability)
        self.cdf = lambda value: distribution.sf(1.0 - value)
        self.logpdf = lambda value: distribution.logpdf(1.0 - value)


# Each prior, the same distribution in scipy, and an interval that holds all but nothing of it.
CASES = {
    "normal": (Normal(2.0, 0.5), stats.norm(2.0, 0.5), (-8.0, 12.0)),
    "lognormal": (LogNormal(3.0, 0.3), stats.lognorm(LOG_SD_03, scale=3.0), (0.0, 60.0)),
    "uniform": (Uniform(-1.0, 5.0), stats.uniform(-1.0, 6.0), (-1.0, 5.0)),
    "log-uniform": (LogUniform(0.1, 20.0), stats.loguniform(0.1, 20.0), (0.1, 20.0)),
    "near one": (NearOne(1e-3), OneMinus(stats.loguniform(1e-3, 1.0)), (0.0, 0.999)),
    "truncated": (
        TruncatedNormal(1.0, 0.8, 0.2, 3.0),
        stats.truncnorm(-1.0, 2.5, 1.0, 0.8),
        (0.2, 3.0),
    ),
    "positive": (TruncatedNormal(1.0, 0.8), stats.truncnorm(-1.25, np.inf, 1.0, 0.8), (0.0, 12.0)),
    "upper tail": (TruncatedNormal(0.0, 1.0, 6.0, 8.0), stats.truncnorm(6.0, 8.0), (6.0, 8.0)),
    "lower tail": (
        TruncatedNormal(0.0, 1.0, -math.inf, -5.0),
        stats.truncnorm(-np.inf, -5.0),
        (-12.0, -5.0),
    ),
    "half-normal": (HalfNormal(0.7), stats.halfnorm(scale=0.7), (0.0, 9.0)),
}
PROBABILITIES = np.array([1e-9, 1e-4, 0.01, 0.2, 0.5, 0.77, 0.99, 0.9999])


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


def test_coordinates_give_the_distribution_function(case):
    prior, scipy_prior, (low, high) = case
    values = scipy_prior.ppf(PROBABILITIES)
    cdf = stats.norm.cdf(prior.to_normal(values))
    np.testing.assert_allclose(cdf, scipy_prior.cdf(values), rtol=1e-7)
    for probability in (0.05, 0.5, 0.8):
        value = scipy_prior.ppf(probability)
        assert prior.quantile(probability) == pytest.approx(value, rel=1e-9)
        assert prior.probability_below(value) == pytest.approx(probability, rel=1e-9)
    assert prior.probability_below(low - 50.0) == pytest.approx(0.0, abs=1e-12)
    assert prior.probability_below(high + 1000.0) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("prior", "z"),
    [
        (Normal(0.0, 0.1), [-30.0, -8.0, 8.0, 30.0]),
        (LogNormal(2.0, 0.3), [-30.0, -8.0, 8.0, 30.0]),
        (Uniform(0.0, 1.0), [-37.0, -20.0, -8.0, 4.0]),
        (Uniform(-1.0, 0.0), [-4.0, 8.0, 20.0, 37.0]),
        (LogUniform(1.0, 100.0), [-5.0, -3.0, 3.0, 5.0]),
        (TruncatedNormal(0.0, 1.0), [-5.0, 5.0, 8.0, 30.0]),
        (TruncatedNormal(0.0, 1.0, 20.0, 30.0), [-5.0, -3.0, 0.0, 3.0, 8.0]),
        (TruncatedNormal(0.0, 1.0, -math.inf, 3.0), [-30.0, -8.0, 0.0, 3.0]),
        (HalfNormal(2.0), [-5.0, -3.0, 3.0, 8.0, 30.0]),
        (HalfNormal(2.0), [-30.0, -20.0, -8.0]),
    ],
    ids=str,
)
def test_round_trip_in_the_tails(prior, z):
    np.testing.assert_allclose(prior.to_normal(prior.from_normal(z)), z, rtol=1e-6, atol=1e-9)


def test_coordinates_in_the_far_tails_are_those_of_the_tail_probability():
    # P(x < 1e-30) = 1e-30 for a uniform, 2 x pdf(0) x 1e-30 for a half-normal.
    assert Uniform(0.0, 1.0).to_normal(1e-30) == pytest.approx(stats.norm.ppf(1e-30), rel=1e-10)
    tiny = stats.norm.ppf(2.0 * stats.norm.pdf(0.0) * 1e-10)
    assert HalfNormal(1.0).to_normal(1e-10) == pytest.approx(tiny, rel=1e-8)
    # P(x > 8) = 2 P(normal > 8) for a half-normal.
    far = stats.norm.isf(2.0 * stats.norm.sf(8.0))
    assert HalfNormal(1.0).to_normal(8.0) == pytest.approx(far, rel=1e-10)


@pytest.mark.parametrize("name", ["uniform", "log-uniform", "truncated", "upper tail"])
def test_no_coordinate_leaves_the_bounds(name):
    prior, _, (low, high) = CASES[name]
    values = prior.from_normal(np.linspace(-45.0, 45.0, 1801))
    assert values.min() == pytest.approx(low, rel=1e-12)
    assert values.max() == pytest.approx(high, rel=1e-12)
    assert np.all((values >= low) & (values <= high))
    assert np.all(np.diff(values) >= 0.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Normal(math.nan, 1.0), "Normal: mean must be a finite number, got nan"),
        (lambda: Normal("1", 1.0), "Normal: mean must be a finite number, got '1'"),
        (lambda: Normal(0.0, 0.0), "Normal: sd must be positive, got 0.0"),
        (lambda: LogNormal(-1.0, 0.3), "LogNormal: median must be positive, got -1.0"),
        (lambda: LogNormal(1.0, 0.0), "LogNormal: cov must be positive, got 0.0"),
        (lambda: Uniform(2.0, 1.0), "Uniform: lower must be less than upper, .*lower=2.0"),
        (lambda: Uniform(1.0, 1.0), "Uniform: lower must be less than upper, .*upper=1.0"),
        (lambda: Uniform(0.0, math.inf), "Uniform: upper must be a finite number, got inf"),
        (lambda: LogUniform(0.0, 1.0), "LogUniform: lower must be positive, got 0.0"),
        (lambda: LogUniform(2.0, 1.0), "LogUniform: lower must be less than upper"),
        (lambda: NearOne(0.0), "NearOne: least must be positive, got 0.0"),
        (lambda: TruncatedNormal(1.0, -1.0), "TruncatedNormal: sd must be positive, got -1.0"),
        (lambda: TruncatedNormal(1.0, 1.0, math.nan), "TruncatedNormal: bounds must be numbers"),
        (lambda: TruncatedNormal(1.0, 1.0, 2.0, 1.0), "TruncatedNormal: lower must be less than"),
        (lambda: TruncatedNormal(0.0, 1.0, 40.0, 41.0), "TruncatedNormal: .*holds no probability"),
        (lambda: HalfNormal(math.inf), "HalfNormal: scale must be a finite number, got inf"),
        (lambda: HalfNormal(-2.0), "HalfNormal: scale must be positive, got -2.0"),
    ],
)
def test_improper_priors_are_refused(build, message):
    assert_refused(message, build)


@pytest.mark.parametrize("factor", [1.7, 0.5])
def test_a_widened_prior_moves_quantiles_along_the_normal_coordinate(case, factor):
    """And its density is the slope of its distribution function."""
    prior, scipy_prior, _ = case
    widened = Widened(prior, factor)
    probabilities = stats.norm.cdf(factor * stats.norm.ppf(PROBABILITIES[2:-2]))
    quantiles = [widened.quantile(p) for p in PROBABILITIES[2:-2]]
    np.testing.assert_allclose(quantiles, scipy_prior.ppf(probabilities), rtol=1e-7)
    middle = np.array([widened.quantile(p) for p in (0.1, 0.4, 0.8)])
    step = 1e-5 * (widened.quantile(0.6) - widened.quantile(0.4))
    above, below = stats.norm.cdf(widened.to_normal([middle + step, middle - step]))
    slope = (above - below) / (2.0 * step)
    np.testing.assert_allclose(np.exp(widened.log_density(middle)), slope, rtol=1e-5)


def test_widened_priors_refuse_what_is_no_prior_or_factor():
    assert_refused("Widened: factor must be positive", Widened, Normal(0.0, 1.0), 0.0)
    with pytest.raises(TypeError, match="Widened: prior must be a prior"):
        Widened(1.0, 2.0)


def test_every_family_is_tested_and_its_record_gives_it_again():
    priors = [prior for prior, *_ in CASES.values()] + [Widened(LogNormal(2.0, 0.5), 3.0)]
    assert {type(prior) for prior in priors} == set(Prior.__subclasses__())
    for prior in priors:
        assert from_record(Prior, to_record(prior)) == prior


def test_log_densities_and_supports_are_those_of_scipy(case):
    prior, scipy_prior, (low, high) = case
    values = np.append(np.linspace(low - 1.0, high + 1.0, 41), 0.0)
    with np.errstate(divide="ignore"):
        expected = scipy_prior.logpdf(values)
    np.testing.assert_allclose(prior.log_density(values), expected, rtol=1e-9, atol=1e-9)
    for each in (prior, Widened(prior, 2.0)):
        np.testing.assert_allclose(each.support, scipy_prior.support(), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "prior"),
    [
        ("LogNormal(1, 0.5)", LogNormal(1.0, 0.5)),
        (" Normal(mean=-2, sd=1e-3) ", Normal(-2.0, 1e-3)),
        ("TruncatedNormal(1, 0.5, upper=inf, lower=0.2)", TruncatedNormal(1.0, 0.5, 0.2, math.inf)),
    ],
)
def test_priors_from_text(text, prior):
    assert prior_from_text(text) == prior


NO_NUMBERS = ("1", "1, cov=0.3, cov2=1", "'1', 0.5", "True, 0.5", "2**3, 0.5", "*x", "**x")
NO_CALLS = ("", "Gamma(1, 2)", "LogNormal", "LogNormal(1, 0.5); 1", "__import__('os').abort()")


@pytest.mark.parametrize("text", [*NO_CALLS, *(f"LogNormal({each})" for each in NO_NUMBERS)])
def test_text_that_names_no_prior_is_refused(text):
    assert_refused(r"such as 'LogNormal\(1, 0.5\)'; choose from Normal, Log", prior_from_text, text)


def test_numbers_of_a_prior_from_text_are_checked():
    with pytest.raises(ValueError, match=r"LogNormal: cov must be positive, got -0\.5"):
        prior_from_text("LogNormal(1, -0.5)")
