"""Classes whose modes are known at posterior draws: the same likelihoods, and nothing is solved."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.posterior.posterior import draws_with_shapes, known_at_draws

SHORT = bs.SamplingSettings(log_evidence_error=1.0, particles=48, searches=1, max_steps=10)


def two_tests(case_c, frame, augmented, fixed_error):
    """A class of two tests; the second has more modes, other sensors and a spurious mode."""
    some = bs.ModalData(
        tuple(replace(m, shape=m.shape[:2] if m.label != "1" else None) for m in case_c.modes),
        case_c.band_hz,
        case_c.sensors[:2],
    )
    return bs.ModelClass(
        "two tests",
        error=fixed_error,
        configurations=[
            bs.Configuration("bare", frame, case_c, pairing={"1": 1, "3": 3}),
            bs.Configuration("filled", augmented, some, pairing={"1": 1, "2b": 3, "2a": 2}),
        ],
    )


def changed(model_class):
    identification = bs.IdentificationModel(0.8, 0.7)
    error = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.07)
    return replace(model_class, identification=identification, error=error)


@pytest.fixture(params=["any pairing", "inferred errors", "two tests", "correlated errors"])
def model_class(request, case_c, frame, augmented, fixed_error):
    if request.param == "two tests":
        return two_tests(case_c, frame, augmented, fixed_error)
    if request.param == "correlated errors":
        repeated = replace(fixed_error, between_tests=0.5)
        return replace(two_tests(case_c, frame, augmented, fixed_error), error=repeated)
    pairing = "any" if request.param == "any pairing" else {"1": 1, "3": 4}
    error = bs.ErrorModel() if request.param == "inferred errors" else fixed_error
    return bs.ModelClass("a", augmented, case_c, error, pairing=pairing)


def test_likelihoods_are_those_of_the_structure(model_class):
    posterior = bs.sample(model_class, settings=SHORT)
    values = posterior.values[draws_with_shapes(len(posterior.values))]
    known = known_at_draws(model_class, posterior)
    assert known.parameters == model_class.parameters
    np.testing.assert_array_equal(known.log_likelihood(values), model_class.log_likelihood(values))
    if "frequency_cov" not in model_class.parameter_names:
        np.testing.assert_array_equal(
            changed(known).log_likelihood(values[5:9]),
            changed(model_class).log_likelihood(values[5:9]),
        )
    with pytest.raises(ValueError, match="known at the stored draws only"):
        known.log_likelihood(values + 1.0)
