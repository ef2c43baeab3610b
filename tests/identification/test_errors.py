"""Error model and identification model: defaults, and what is refused."""

import math

import pytest

from bayes_ssi.identification.error_model import ErrorModel, IdentificationModel
from bayes_ssi.parameters import Parameter
from bayes_ssi.priors.families import HalfNormal, LogNormal, Normal


def test_defaults():
    error, identification = ErrorModel(), IdentificationModel()
    assert error == ErrorModel()
    assert {error.frequency_cov.name, error.shape_sd.name} == {"frequency_cov", "shape_sd"}
    assert identification == IdentificationModel(0.95, 0.1)


@pytest.mark.parametrize(
    "value",
    [
        0.01,
        1,
        Parameter("e", LogNormal(0.01, 1.0)),
        0.01 * Parameter("e", LogNormal(1.0, 1.0)),
        Parameter("e", HalfNormal(0.02)),
    ],
)
@pytest.mark.parametrize("name", ["frequency_cov", "shape_sd"])
def test_numbers_and_parameters_are_accepted(name, value):
    assert getattr(ErrorModel(**{name: value}), name) == value


@pytest.mark.parametrize("value", [0.0, -0.01, math.nan, math.inf])
@pytest.mark.parametrize("name", ["frequency_cov", "shape_sd"])
def test_error_sizes_that_are_not_positive_are_refused(name, value):
    with pytest.raises(ValueError, match=f"ErrorModel: {name} must be positive .* got {value!r}"):
        ErrorModel(**{name: value})


@pytest.mark.parametrize("name", ["frequency_cov", "shape_sd"])
def test_an_error_size_that_can_be_negative_is_refused(name):
    with pytest.raises(ValueError, match=f"ErrorModel: {name} must be positive, but .* 'e'"):
        ErrorModel(**{name: Parameter("e", Normal(0.01, 0.01))})


@pytest.mark.parametrize("value", ["1 %", None, True])
@pytest.mark.parametrize("name", ["frequency_cov", "shape_sd"])
def test_error_sizes_that_are_no_numbers_are_refused(name, value):
    with pytest.raises(TypeError, match=f"ErrorModel: {name} must be a number.* got {value!r}"):
        ErrorModel(**{name: value})


@pytest.mark.parametrize("value", [0.0, 1.0, -0.1, 1.1, math.nan])
def test_detection_probability_lies_strictly_between_0_and_1(value):
    with pytest.raises(ValueError, match=f"detection_probability must lie .* got {value!r}"):
        IdentificationModel(detection_probability=value)


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_expected_spurious_modes_are_positive_and_finite(value):
    with pytest.raises(ValueError, match=f"expected_spurious_modes must be .* got {value!r}"):
        IdentificationModel(expected_spurious_modes=value)
