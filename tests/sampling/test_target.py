"""The target: what it counts, and what it refuses."""

import numpy as np
import pytest
from scipy import stats

from bayes_ssi.inference.sampling.target import (
    FARTHEST,
    POINTS_TO_CHECK,
    SuggestedStarts,
    Target,
    log_standard_normal,
)
from bayes_ssi.inference.workers.journal import Journal
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


def test_likelihood_zero_is_no_failure():
    target = Target(lambda z: np.full(len(z), -np.inf), 1)
    target.log_likelihood(np.zeros((4, 1)))
    assert target.n_failed == 0


def test_parameters_never_overflow_however_heavy_the_tails_of_proposals():
    """Mixtures propose points a thousand prior standard deviations out; warnings are errors."""
    size = LogNormal(1.0, 1.0)
    target = Target(lambda z: -(size.from_normal(z[:, 0]) ** 2), 2)
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


def test_a_repeated_run_counts_what_its_journal_recalls(tmp_path):
    batches = [column(1.0, 2.0, -3.0, 30.0, 4.0), column(5.0, 6.0), column(7.0)]
    model, again = Fragile(), Fragile()
    with Journal(tmp_path / "x", {}) as journal:
        first = Target(model, 1, journal=journal)
        values = [first.log_likelihood(batch) for batch in batches[:2]]
    with Journal(tmp_path / "x", {}) as journal:
        second = Target(again, 1, journal=journal)
        for batch, expected in zip(batches, [*values, [7.0]], strict=True):
            np.testing.assert_array_equal(second.log_likelihood(batch), expected)
    assert (second.n_evaluations, second.n_failed) == (8, 2)
    assert second.first_failure == first.first_failure == ([-3.0], NO_EQUILIBRIUM)
    # Only the first points, to see that the model is still the same, in two parts down to the one
    # that raises; and what the journal does not have.
    assert again.asked == [POINTS_TO_CHECK, 1, 2, 1, 1, len(batches[2])]


def test_suggested_starts_are_recalled_and_counted(tmp_path):
    asked = []

    def suggest(rng):
        asked.append(rng)
        return SuggestedStarts(rng.standard_normal((3, 2)), 40)

    results = []
    for _ in range(2):
        rng = np.random.default_rng(5)
        with Journal(tmp_path / "x", {}) as journal:
            assert journal.n_kept == (44 if asked else 0)
            target = Target(lambda z: -z[:, 0], 2, journal=journal, suggest_starts=suggest)
            target.log_likelihood(np.zeros((4, 2)))
            results.append((target.suggested(rng), rng.random()))
        assert target.n_evaluations == 44
    assert len(asked) == 1
    np.testing.assert_array_equal(results[0][0], results[1][0])
    assert results[0][0].shape == (3, 2)
    assert results[0][1] == results[1][1]
    assert Target(lambda z: z[:, 0], 2).suggested(rng).shape == (0, 2)


def test_an_empty_batch_does_not_reach_the_function():
    target = Target(lambda _: 1 / 0, 2)
    assert target.log_likelihood(np.empty((0, 2))).shape == (0,)
