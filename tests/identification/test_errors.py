"""Error model and identification model: defaults, and what is refused."""

import math

import pytest

from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.priors import LogNormal, Normal, Uniform


def test_defaults():
    error = ErrorModel()
    assert {error.frequency_cov.name, error.shape_sd.name} == {"frequency_cov", "shape_sd"}
    assert IdentificationModel() == IdentificationModel(0.95, 0.1)


@pytest.mark.parametrize("name", ["frequency_cov", "shape_sd"])
@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (0.0, ValueError, "must be positive .* got 0.0"),
        (math.inf, ValueError, "must be positive .* got inf"),
        (Parameter("e", Normal(0.01, 0.01)), ValueError, "must be positive, but .* 'e'"),
        ("1 %", TypeError, "must be a number.* got '1 %'"),
    ],
)
def test_impossible_error_sizes_are_refused(name, value, error, message):
    with pytest.raises(error, match=f"ErrorModel: {name} {message}"):
        ErrorModel(**{name: value})


UNIFORM = Parameter("r", Uniform(0.0, 1.0))


@pytest.mark.parametrize("name", ["between_tests", "between_modes"])
@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (1.0, ValueError, "must be at least 0 and below 1, got 1.0"),
        (-0.1, ValueError, "must be at least 0 and below 1, got -0.1"),
        (math.nan, ValueError, "must be at least 0 and below 1, got nan"),
        (Parameter("r", Uniform(-0.1, 0.5)), ValueError, "must be .*, which 'r' .* can leave"),
        (Parameter("r", LogNormal(0.1, 0.3)), ValueError, "must be .*, which 'r' .* can leave"),
        (2.0 * UNIFORM, ValueError, "must be .*, which 'r' .* can leave"),
        (0.9 / UNIFORM, ValueError, "must be .*, which 'r' .* can leave"),
        ("half", TypeError, "must be a number.* got 'half'"),
    ],
)
def test_impossible_correlations_are_refused(name, value, error, message):
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
