"""The target: what it counts, and what it refuses."""

import numpy as np
import pytest
from scipy import stats

from bayes_ssi.inference.sampling.target import (
    FARTHEST,
    SuggestedStarts,
    Target,
    log_standard_normal,
)
from bayes_ssi.inference.workers.cache import POINTS_TO_CHECK, Cache
from bayes_ssi.parameters.priors import LogNormal


class Fragile:
    """A model that raises below zero and returns NaN beyond ten; it records batch sizes."""

    def __init__(self):
        self.asked = []

    def __call__(self, z):
        self.asked.append(len(z))
        if (z[:, 0] < 0).any():
            raise ArithmeticError("no equilibrium")
        return np.where(z[:, 0] > 10.0, np.nan, z[:, 0])


LINE = Fragile.__call__.__code__.co_firstlineno + 3
NO_EQUILIBRIUM = f"ArithmeticError: no equilibrium (test_target.py, line {LINE})"


def column(*values):
    return np.array(values, dtype=float)[:, None]


def test_log_standard_normal():
    z = np.random.default_rng(1).standard_normal((6, 3))
    expected = stats.multivariate_normal(np.zeros(3)).logpdf(z)
    np.testing.assert_allclose(log_standard_normal(z), expected, rtol=1e-13)


def test_parameters_never_overflow_however_heavy_the_tails_of_proposals():
    """Mixtures propose points a thousand prior standard deviations out; warnings are errors."""
    target = Target(lambda z: -(LogNormal(1.0, 1.0).from_normal(z[:, 0]) ** 2), 2)
    far = np.array([[0.5, -2000.0], [1000.0, 0.0], [0.5, 0.0]])
    values = target.log_likelihood(far)
    np.testing.assert_array_equal(values, [-np.inf, -np.inf, target.log_likelihood(far[2:])[0]])
    assert np.isfinite(values[2])
    assert (target.n_evaluations, target.n_failed) == (2, 0)
    assert stats.norm.pdf(FARTHEST + 1.0) == 0.0


@pytest.mark.parametrize(("first", "reason"), [(-2.0, NO_EQUILIBRIUM), (30.0, "the answer is NaN")])
def test_the_first_failure_is_kept_with_its_reason(first, reason):
    target = Target(Fragile(), 1)
    batch = column(1.0, first, 3.0, -5.0, 20.0)
    values = target.log_likelihood(batch)
    np.testing.assert_array_equal(values, [1.0, -np.inf, 3.0, -np.inf, -np.inf])
    batch[:] = 0.0
    target.log_likelihood(column(-7.0))
    assert target.first_failure == ([first], reason)
    assert (target.n_evaluations, target.n_failed) == (6, 4)


def test_infinite_likelihood_is_refused_though_others_failed():
    target = Target(lambda z: np.where(z[:, 0] > 0, np.inf, np.nan), 1)
    with pytest.raises(ValueError, match=r"\+inf at coordinates \[2\.\]"):
        target.log_likelihood(column(-1.0, 2.0))


def test_a_repeated_run_counts_what_is_recalled(tmp_path):
    """Log-likelihoods and suggested starts; draws that follow these are the same."""
    batch, suggested = column(1.0, 2.0, -3.0, 30.0, 4.0), []

    def suggest(rng):
        suggested.append(rng.standard_normal((3, 1)))
        return SuggestedStarts(suggested[0], 40)

    def results():
        model, rng = Fragile(), np.random.default_rng(5)
        with Cache(tmp_path / "x") as cache:
            target = Target(model, 1, cache=cache, suggest_starts=suggest)
            values, starts = target.log_likelihood(batch), target.suggested(rng)
        np.testing.assert_array_equal(starts, suggested[0])
        counts = (target.n_evaluations, target.n_failed, target.first_failure)
        assert counts == (45, 2, ([-3.0], NO_EQUILIBRIUM))
        return values.tobytes(), rng.random(), model.asked

    first, again = results(), results()
    assert again[:2] == first[:2]
    assert len(suggested) == 1
    # Only the first points, to see that the model is still the same, in two parts down to the one
    # that raises.
    assert again[2] == [POINTS_TO_CHECK, 1, 2, 1, 1]
    assert Target(Fragile(), 2).suggested(np.random.default_rng(0)).shape == (0, 2)


def test_likelihood_zero_is_no_failure_and_no_point_is_no_evaluation():
    target = Target(lambda z: np.full(len(z), -np.inf), 1)
    target.log_likelihood(np.zeros((4, 1)))
    assert target.n_failed == 0
    assert Target(lambda _: 1 / 0, 2).log_likelihood(np.empty((0, 2))).shape == (0,)
