"""Evaluation of points whose workers die."""

import os
import signal

import numpy as np
import pytest
from pools import Crew, Death, numbered, points, spawning, sums, workers_of

from bayes_ssi.inference.workers.workers import Workers, can_copy

pytestmark = pytest.mark.usefixtures("nothing_hangs")

DIED = "the worker that evaluated it died"


def test_dead_processes_are_replaced_and_their_points_isolated(tmp_path):
    marker = tmp_path / "died"

    def function(z):
        if not marker.exists():  # once, wherever that is
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if (z == 11.0).any():  # and always
            os._exit(1)
        return sums(z)

    z = points(30)
    z[3] = 11.0
    expected = sums(z)
    expected[3] = np.nan
    with Workers(n_workers=2) as pool:
        there = pool.evaluate(function, z)
        again = pool.evaluate(function, z[:3])
    assert marker.exists()
    np.testing.assert_array_equal(there.values, expected)
    assert there.failures == {3: DIED}
    np.testing.assert_array_equal(again.values, expected[:3])


def deadly_at(*rows):
    """A model that is the first coordinate, and kills its worker where that is one of these."""

    def function(z):
        if np.isin(z[:, 0], rows).any():
            raise Death
        return z[:, 0]

    return function


def assert_all_but(there, rows, n):
    expected = np.arange(float(n))
    expected[list(rows)] = np.nan
    np.testing.assert_array_equal(there.values, expected)
    assert there.failures == dict.fromkeys(rows, DIED)


@pytest.mark.parametrize("n_workers", [1, 2, 16])
@pytest.mark.parametrize("row", [0, 517, 1023])
def test_a_deadly_point_does_not_make_its_batch_serial(n_workers, row):
    """1024 points are cut in quarters five times; each of the 21 groups has all workers."""
    crew = Crew(n_workers)
    assert_all_but(crew.evaluate(deadly_at(row), numbered(1024)), [row], 1024)
    assert 2 <= crew.n_deaths <= 6
    assert crew.n_calls <= 21 * 4 * n_workers


@pytest.mark.parametrize("rows", [[3, 4, 5, 60, 61, 99], range(0, 100, 5)])
def test_points_at_which_workers_die_are_isolated(rows):
    assert_all_but(Crew().evaluate(deadly_at(*rows), numbered(100)), rows, 100)


def test_deaths_of_many_batches_add_up():
    crew = Crew()
    for row in range(20):
        assert_all_but(crew.evaluate(deadly_at(row), numbered(30)), [row], 30)
    with pytest.raises(ValueError, match=r"^workers: died 101 times, the last time with Broken"):
        crew.evaluate(deadly_at(*range(2000)), numbered(2000))
    assert crew.n_deaths == crew.most_deaths + 1


def test_a_point_or_call_whose_worker_dies_is_tried_again(tmp_path):
    def dies_once():
        if not (tmp_path / "died").exists():
            (tmp_path / "died").touch()
            raise Death

    def function(z):
        dies_once()
        return z[:, 0]

    def call(item):
        if item == 2:
            dies_once()
        return 10 * item

    assert_all_but(Crew().evaluate(function, numbered(1)), [], 1)
    (tmp_path / "died").unlink()
    assert Crew().call_each(call, range(5)) == [0, 10, 20, 30, 40]


def test_an_executor_that_was_given_and_breaks_is_not_replaced():
    with (
        workers_of(spawning(1)) as pool,
        pytest.raises(ValueError, match="the executor that was given does not replace it: Broken"),
    ):
        pool.evaluate(lambda _: os._exit(1), points(3))


@pytest.mark.skipif(not can_copy(), reason="makes copies of this process")
def test_a_worker_that_is_killed_while_the_pool_starts_ends_the_run(monkeypatch):
    def killed():
        os.kill(os.getpid(), signal.SIGKILL)

    with monkeypatch.context() as patched:
        patched.setattr("bayes_ssi.inference.workers.workers.end_with_parent", killed)
        # Also where a thread of an earlier pool has not ended yet.
        patched.setattr("bayes_ssi.inference.workers.workers.can_copy", lambda: True)
        pool = Workers(n_workers=2, copies=True)
        with (
            pytest.raises(ValueError, match=r"^workers: one of 2 died while they started; is"),
            pool,
        ):
            pass
    # Nothing of them is left, and the next ones start.
    with pool:
        np.testing.assert_array_equal(pool.evaluate(sums, points(5)).values, sums(points(5)))
