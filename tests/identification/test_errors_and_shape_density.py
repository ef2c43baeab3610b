"""Error and identification models, and the normaliser of the density of shapes."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, simpson
from scipy.special import ive

from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.shape_density import (
    _log_integral,
    _series,
    log_shape_normaliser,
    log_shape_survival,
    log_sphere_area,
)
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.priors import LogNormal, Normal, Uniform


def test_defaults():
    error = ErrorModel()
    assert {error.frequency_cov.name, error.shape_sd.name} == {"frequency_cov", "shape_sd"}
    assert IdentificationModel() == IdentificationModel(0.95, 0.1)


UNIFORM = Parameter("r", Uniform(0.0, 1.0))
SIZES, CORRELATIONS = ("frequency_cov", "shape_sd"), ("between_tests", "between_modes")
LEAVES = "must be .*, which 'r' .* can leave"


@pytest.mark.parametrize(
    ("names", "value", "error", "message"),
    [
        (SIZES, 0.0, ValueError, "must be positive .* got 0.0"),
        (SIZES, math.inf, ValueError, "must be positive .* got inf"),
        (SIZES, Parameter("e", Normal(0.01, 0.01)), ValueError, "must be positive, but .* 'e'"),
        (SIZES, "1 %", TypeError, "must be a number.* got '1 %'"),
        (CORRELATIONS, 1.0, ValueError, "must be at least 0 and below 1, got 1.0"),
        (CORRELATIONS, -0.1, ValueError, "must be at least 0 and below 1, got -0.1"),
        (CORRELATIONS, math.nan, ValueError, "must be at least 0 and below 1, got nan"),
        (CORRELATIONS, Parameter("r", Uniform(-0.1, 0.5)), ValueError, LEAVES),
        (CORRELATIONS, Parameter("r", LogNormal(0.1, 0.3)), ValueError, LEAVES),
        (CORRELATIONS, 2.0 * UNIFORM, ValueError, LEAVES),
        (CORRELATIONS, 0.9 / UNIFORM, ValueError, LEAVES),
        (CORRELATIONS, "half", TypeError, "must be a number.* got 'half'"),
    ],
)
def test_impossible_sizes_and_correlations_of_errors_are_refused(names, value, error, message):
    for name in names:
        with pytest.raises(error, match=f"ErrorModel: {name} {message}"):
            ErrorModel(**{name: value})


@pytest.mark.parametrize("value", [0.0, 0.9, UNIFORM, 0.5 * UNIFORM, UNIFORM**2])
def test_possible_correlations(value):
    assert ErrorModel(between_tests=value).is_correlated == (value != 0.0)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("detection_probability", [0.0, 1.0, -0.1, 1.1, math.nan]),
        ("expected_spurious_modes", [0.0, -1.0, math.inf, math.nan]),
    ],
)
def test_impossible_identification_models_are_refused(name, values):
    for value in values:
        with pytest.raises(ValueError, match=f"{name} must .* got {value!r}"):
            IdentificationModel(**{name: value})


SIZES = [1e-4, 0.003, 0.02, 0.05, 0.1]


def normaliser(shape_sd, d):
    return float(log_shape_normaliser(np.array(shape_sd), d))


def test_sphere_area():
    for d, area in ((1, 2.0), (2, 2.0 * math.pi), (3, 4.0 * math.pi), (8, math.pi**4 / 3.0)):
        assert log_sphere_area(d) == pytest.approx(math.log(area), rel=1e-13)


@pytest.mark.parametrize("shape_sd", [0.02, 0.1, 0.5, 1.0, 4.0])
@pytest.mark.parametrize("d", [2, 3, 4, 7, 20])
def test_quadrature_of_the_definition(d, shape_sd):
    def integrand(t):
        return math.exp(-(1.0 - math.cos(t)) / shape_sd**2) * math.sin(t) ** (d - 2)

    breaks = [b for b in shape_sd * np.array([1.0, 3.0, 6.0, 12.0]) if b < 0.5 * math.pi]
    pieces = [quad(integrand, a, b, epsabs=0.0) for a, b in pairwise([0.0, *breaks, 0.5 * math.pi])]
    integral = sum(value for value, _ in pieces)
    area = 2.0 * math.pi ** ((d - 1) / 2) / math.gamma((d - 1) / 2)
    assert normaliser(shape_sd, d) == pytest.approx(math.log(2.0 * area * integral), abs=1e-8)


@pytest.mark.parametrize("shape_sd", [*SIZES, 0.3, 1.0, 10.0])
def test_three_sensors_in_closed_form(shape_sd):
    exact = 4.0 * math.pi * shape_sd**2 * -math.expm1(-1.0 / shape_sd**2)
    assert normaliser(shape_sd, 3) == pytest.approx(math.log(exact), abs=1e-11)


@pytest.mark.parametrize("shape_sd", SIZES)
@pytest.mark.parametrize("d", [2, 3, 5, 10, 50])
def test_small_errors_give_two_von_mises_fisher_densities(d, shape_sd):
    # Mardia and Jupp (2000): one has the normaliser (2 pi)^(d/2) I_(d/2-1)(k) / k^(d/2-1).
    k = 1.0 / shape_sd**2
    one = 0.5 * d * math.log(2.0 * math.pi) + math.log(ive(0.5 * d - 1.0, k))
    one += (1.0 - 0.5 * d) * math.log(k)
    assert normaliser(shape_sd, d) == pytest.approx(math.log(2.0) + one, abs=1e-9)


@pytest.mark.parametrize("d", [2, 3, 10, 50, 500])
def test_huge_errors_give_the_uniform_density(d):
    assert normaliser(1e4, d) == pytest.approx(log_sphere_area(d), abs=1e-7)


def test_a_batch_of_errors_equals_one_by_one():
    sizes = np.array([[1e-4, 0.01, 0.05], [0.3, 1.0, 10.0]])
    batch = log_shape_normaliser(sizes, 5)
    assert batch.shape == (2, 3)
    one_by_one = [[normaliser(size, 5) for size in row] for row in sizes]
    np.testing.assert_allclose(batch, one_by_one, rtol=1e-13)


@pytest.mark.parametrize("d", [2, 3, 5, 8, 20, 50, 300])
def test_series_and_quadrature_meet(d):
    """Both are right on either side of where one takes over from the other."""
    _, largest = _series(d)
    sizes = math.sqrt(largest) * np.array([0.2, 0.5, 0.9, 0.999, 1.001])
    exact = math.log(2.0) + log_sphere_area(d - 1) + _log_integral(np.zeros(()), sizes, d)
    np.testing.assert_allclose(log_shape_normaliser(sizes, d), exact, rtol=1e-12, atol=5e-11)


@pytest.mark.parametrize("shape_sd", [1e-3, 0.05, 0.3, 1.0, 5.0])
@pytest.mark.parametrize("d", [2, 3, 5, 20, 300])
def test_probability_of_a_larger_distance(d, shape_sd):
    def log_integral(start):
        """By Simpson's rule, over where the integrand is not negligible."""
        ends = start, 0.5 * math.pi
        for _ in range(2):
            t = np.linspace(*ends, 20001)
            with np.errstate(divide="ignore"):
                log_sine = (d - 2) * np.log(np.sin(t)) if d > 2 else 0.0
            level = -2.0 * (np.sin(0.5 * t) / shape_sd) ** 2 + log_sine
            kept = np.flatnonzero(level > level.max() - 60.0)
            ends = t[max(0, kept[0] - 1)], t[min(len(t) - 1, kept[-1] + 1)]
        return level.max() + math.log(simpson(np.exp(level - level.max()), x=t))

    typical = 0.5 * (d - 1) * shape_sd**2
    for distance in (0.2 * typical, typical, 3.0 * typical, 10.0 * typical):
        if distance < 0.999:
            start = 2.0 * math.asin(math.sqrt(0.5 * distance))
            log_p = log_shape_survival(np.array(distance), np.array(shape_sd), d)
            assert float(log_p) == pytest.approx(
                log_integral(start) - log_integral(0.0), rel=1e-7, abs=1e-9
            )


def test_probability_of_distances_far_out():
    # Three sensors: the distance is exponential, cut off at 1.
    for distance, sd in ((0.5, 0.01), (0.9, 0.02), (0.3, 0.6)):
        cut = math.exp(-1.0 / sd**2)
        expected = -distance / sd**2 + math.log1p(-math.exp((distance - 1.0) / sd**2))
        log_p = log_shape_survival(np.array([distance]), np.array([[sd]]), 3)
        assert log_p.shape == (1, 1)
        assert log_p[0, 0] == pytest.approx(expected - math.log1p(-cut), rel=1e-9)
    assert log_shape_survival(np.array([1.0]), np.array([0.05]), 5)[0] == -np.inf
    assert log_shape_survival(np.zeros(1), np.array([0.05]), 5)[0] == pytest.approx(0.0, abs=1e-12)
