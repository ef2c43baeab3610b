"""Frequencies predicted with the model's errors, against the conditional normal distribution."""

import math

import numpy as np
import pytest
from searches import COARSE

import bayes_ssi as bs

SD, RHO = 0.02, 0.9
NOMINAL = np.array([1.0, 2.0, 3.0])


class Fixed(bs.Structure):
    """Frequencies that one parameter hardly changes."""

    degrees_of_freedom = ("place",)
    n_modes = 3
    parameters = (bs.Parameter("k", bs.Normal(0.0, 1.0)),)

    def __init__(self, scale=1.0):
        self.scale = scale

    def modes(self, values):
        frequencies = self.scale * NOMINAL * (1.0 + 1e-9 * values)
        return bs.Modes(frequencies, np.ones((len(values), 1, 3)))


def configurations(identified, frequency_cov):
    """Tests with these identified frequencies of the first modes, (n_tests, n)."""
    for t, frequencies in enumerate(identified):
        modes = [
            bs.IdentifiedMode(f"mode {i}", f, frequency_cov=frequency_cov)
            for i, f in enumerate(frequencies, 1)
        ]
        data, pairing = bs.ModalData(modes, (0.0, 9.0)), {m.label: int(m.label[-1]) for m in modes}
        yield bs.Configuration(f"test {t}", Fixed(), data, pairing=pairing)


@pytest.fixture(scope="module")
def sampled():
    identified = [[1.03, 2.01], [1.02, 2.03]]
    error, tests = bs.ErrorModel(SD, 0.05, RHO, 0.5), tuple(configurations(identified, 0.01))
    candidate = bs.ModelClass("fixed", configurations=tests, error=error)
    return candidate, bs.sample(candidate, settings=COARSE)


def expected(further):
    """Mean and covariance of residuals of (test, mode), from all tests' in one matrix."""
    paired = [(t, i) for t in (0, 1) for i in (1, 2)]
    residuals = np.array([1 / 1.03, 2 / 2.01, 1 / 1.02, 2 / 2.03]) - 1.0
    everything = [*paired, *further]
    t, i = np.transpose(everything)
    shared = np.where(np.equal.outer(t, t), 1.0, RHO)
    covariance = SD**2 * shared * 0.5 ** np.abs(np.subtract.outer(i, i))
    n = len(paired)
    known = covariance[:n, :n] + 0.01**2 * np.eye(n)
    gain = covariance[n:, :n] @ np.linalg.inv(known)
    return gain @ residuals, covariance[n:, n:] - gain @ covariance[:n, n:]


@pytest.mark.parametrize(
    ("state", "test", "scale", "numbers"),
    [
        (Fixed(0.9), 2, 0.9, (1, 2, 3)),
        ("test 1", 1, 1.0, (3, 2)),  # one that was not identified, and one that was
    ],
    ids=["new state", "tested state"],
)
def test_errors_are_those_given_the_residuals_of_the_tests(sampled, state, test, scale, numbers):
    candidate, posterior = sampled
    n = 20_000
    modes = {f"mode {i}": i for i in numbers}
    predicted = bs.predict_frequencies(posterior, candidate, state, modes, n, seed=1).draws
    assert predicted.shape == (n, len(numbers))
    residuals = scale * NOMINAL[np.array(numbers) - 1] / predicted - 1.0
    mean, covariance = expected([(test, i) for i in numbers])
    sds = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(residuals.mean(0), mean, atol=5.0 * sds.max() / math.sqrt(n))
    scaled = np.cov(residuals.T) / np.outer(sds, sds)
    np.testing.assert_allclose(scaled, covariance / np.outer(sds, sds), atol=7.0 / math.sqrt(n))


def test_independent_errors_are_not_expected_again(sampled):
    candidate, posterior = sampled
    alone = bs.ModelClass("alone", configurations=candidate.configurations, error=bs.ErrorModel(SD))
    predicted = bs.predict_frequencies(posterior, alone, Fixed(), {"mode 1": 1}, 20_000).draws
    assert (1.0 / predicted - 1.0).mean() == pytest.approx(0.0, abs=5.0 * SD / math.sqrt(20_000))
    assert (1.0 / predicted - 1.0).std() == pytest.approx(SD, rel=0.03)


class Unknown(Fixed):
    parameters = (bs.Parameter("other", bs.Normal(0.0, 1.0)),)


@pytest.mark.parametrize(
    ("state", "number", "message"),
    [
        (Fixed(), 4, "mode 'x' is model mode 4; the structure has modes 1 to 3"),
        ("roof", 1, "model class 'fixed' has no configuration 'roof'"),
        (Unknown(), 1, "model class 'fixed' has no parameter 'other'; choose from 'k'"),
    ],
)
def test_what_cannot_be_predicted_is_refused(sampled, state, number, message):
    candidate, posterior = sampled
    with pytest.raises(ValueError, match=message):
        bs.predict_frequencies(posterior, candidate, state, {"x": number})
