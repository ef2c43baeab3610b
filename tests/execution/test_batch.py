"""Evaluation of batches, in which the model may fail at some rows."""

import numpy as np
import pytest

from bayes_ssi.inference.workers.workers import evaluate


class Fragile:
    """z ↦ 2 z, but it raises where a batch holds one of the values in ``bad``; counts its calls."""

    def __init__(self, *bad, error=ValueError):
        self.bad = bad
        self.error = error
        self.n_calls = 0

    def __call__(self, z):
        self.n_calls += 1
        for value in z[:, 0]:
            if value in self.bad:
                raise self.error(f"no modes at {value:g}")
        return 2.0 * z[:, 0]


def reason(value):
    """The message of a failure, with the line of this file that raised it."""
    line = Fragile.__call__.__code__.co_firstlineno + 4
    return f"ValueError: no modes at {value} (test_batch.py, line {line})"


def rows(n):
    return np.arange(float(n))[:, None]


@pytest.mark.parametrize("n", range(1, 10))
def test_only_the_rows_that_raise_are_nan(n):
    for bad in (*((row,) for row in range(n)), {0, n // 2, n - 1}):
        values, failures = evaluate(Fragile(*bad), rows(n))
        expected = 2.0 * np.arange(n)
        expected[list(bad)] = np.nan
        np.testing.assert_array_equal(values, expected)
        assert failures == {row: reason(row) for row in bad}


@pytest.mark.parametrize(
    ("bad", "n_calls"), [([], 1), ([700], 21), ([0], 21), ([700, 701], 21), (range(1024), 2047)]
)
def test_the_rows_at_fault_are_found_by_splitting(bad, n_calls):
    """1024 rows are split ten times; both parts are evaluated each time."""
    function = Fragile(*bad)
    assert set(evaluate(function, rows(1024)).failures) == set(bad)
    assert function.n_calls == n_calls


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_an_interrupt_is_no_failure(error):
    with pytest.raises(error):
        evaluate(Fragile(3, error=error), rows(8))


def test_an_answer_of_nan_or_infinity_is_an_answer():
    answer = np.array([np.nan, -np.inf, 1.0])
    values, failures = evaluate(lambda _: answer, rows(3))
    np.testing.assert_array_equal(values, answer)
    assert failures == {}


@pytest.mark.parametrize("shape", [(), (2,), (4,), (3, 1), (1, 3)])
def test_answers_of_the_wrong_shape_are_refused(shape):
    with pytest.raises(ValueError, match="expected one value for each of 3 points, got shape") as e:
        evaluate(lambda _: np.zeros(shape), rows(3))
    assert str(e.value).endswith(str(shape))
