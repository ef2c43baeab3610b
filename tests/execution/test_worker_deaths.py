"""What becomes of points whose workers die, and of workers when a run ends."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from pools import Crew, Death, Late, points, spawning, sums

from bayes_ssi.execution import dispatch, futures
from bayes_ssi.execution.workers import Workers, as_workers, local_workers

pytestmark = pytest.mark.usefixtures("nothing_hangs")

DIED = "the worker that evaluated it died"


def test_a_part_whose_worker_dies_once_is_tried_again(tmp_path):
    marker = tmp_path / "died"

    def function(z):
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return sums(z)

    z = points(30)
    with local_workers(1) as pool:
        found = pool.evaluate(function, z)
    assert marker.exists()
    np.testing.assert_array_equal(found.values, sums(z))
    assert found.failures == {}


def test_a_point_at_which_workers_always_die_is_nan_and_the_others_are_right():
    def function(z):
        if (z == 11.0).any():
            os._exit(1)
        return sums(z)

    z = points(7)
    z[3] = 11.0
    expected = sums(z)
    expected[3] = np.nan
    with local_workers(1) as pool:
        found = pool.evaluate(function, z)
        again = pool.evaluate(function, z[:3])  # the workers are of use afterwards
    np.testing.assert_array_equal(found.values, expected)
    assert found.failures == {3: DIED}
    np.testing.assert_array_equal(again.values, expected[:3])


def dies(_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_workers_that_always_die_end_the_run(monkeypatch):
    monkeypatch.setattr(dispatch, "MAX_DEATHS", 2)
    with local_workers(1) as pool, pytest.raises(ValueError, match="workers: died 3 times, the"):
        pool.evaluate(dies, points(8))


def deadly_at(*rows):
    """A model that is the first coordinate, and kills its worker where that is one of these."""

    def function(z):
        if np.isin(z[:, 0], rows).any():
            raise Death
        return z[:, 0]

    return function


def numbered(n):
    return np.arange(float(n))[:, None]


def assert_all_but(found, rows, n):
    expected = np.arange(float(n))
    expected[list(rows)] = np.nan
    np.testing.assert_array_equal(found.values, expected)
    assert found.failures == dict.fromkeys(rows, DIED)


@pytest.mark.parametrize("n_workers", [1, 2, 16])
@pytest.mark.parametrize("row", [0, 1, 517, 1022, 1023])
def test_a_deadly_point_does_not_make_its_batch_serial(n_workers, row):
    """1024 points are cut in quarters five times; each of the 21 groups has all workers."""
    crew = Crew(n_workers)
    found = crew.workers.evaluate(deadly_at(row), numbered(1024))
    assert_all_but(found, [row], 1024)
    assert 2 <= crew.n_deaths <= 6
    assert len(crew.sizes) <= 21 * 4 * n_workers


def test_points_at_which_workers_die_are_found_each_by_itself():
    rows = [3, 4, 5, 60, 61, 99]
    crew = Crew()
    assert_all_but(crew.workers.evaluate(deadly_at(*rows), numbered(100)), rows, 100)


def test_twenty_deadly_points_are_survived_and_no_more():
    rows = list(range(0, 1000, 50))
    crew = Crew()
    assert_all_but(crew.workers.evaluate(deadly_at(*rows), numbered(1000)), rows, 1000)
    with pytest.raises(ValueError, match=r"^workers: died at 21 points, the last time with Broken"):
        crew.workers.evaluate(deadly_at(7), numbered(10))


def test_deadly_points_of_many_batches_add_up():
    crew = Crew()
    for row in range(20):
        assert_all_but(crew.workers.evaluate(deadly_at(row), numbered(30)), [row], 30)
    with pytest.raises(ValueError, match=r"^workers: died at 21 points"):
        crew.workers.evaluate(deadly_at(0), numbered(30))


def test_a_model_that_always_kills_ends_the_run_soon():
    crew = Crew()
    with pytest.raises(ValueError, match=r"^workers: died at 21 points"):
        crew.workers.evaluate(deadly_at(*range(2000)), numbered(2000))
    assert crew.n_deaths < 50


def test_a_point_that_is_a_batch_is_tried_again_too(tmp_path):
    def function(z):
        if not (tmp_path / "died").exists():
            (tmp_path / "died").touch()
            raise Death
        return z[:, 0]

    assert_all_but(Crew().workers.evaluate(function, numbered(1)), [], 1)


def test_deaths_that_no_point_explains_end_the_run(tmp_path):
    """One a batch, at the first try."""
    marker = tmp_path / "died"

    def function(z):
        if not marker.exists():
            marker.touch()
            raise Death
        return z[:, 0]

    crew = Crew()
    for _ in range(20):
        marker.unlink(missing_ok=True)
        assert_all_but(crew.workers.evaluate(function, numbered(9)), [], 9)
    marker.unlink()
    with pytest.raises(ValueError, match=r"^workers: died 21 times, the last time with Broken"):
        crew.workers.evaluate(function, numbered(9))


def test_a_call_that_always_kills_ends_the_run():
    crew = Crew()

    def call(item):
        if item == 2:
            raise Death
        return item

    with pytest.raises(ValueError, match=r"^workers: died 21 times"):
        crew.workers.call_each(call, range(4))
    assert crew.n_deaths == 21


def test_a_call_whose_worker_dies_once_is_made_again(tmp_path):
    def call(item):
        if item == 2 and not (tmp_path / "died").exists():
            (tmp_path / "died").touch()
            raise Death
        return 10 * item

    done = []
    assert Crew().workers.call_each(call, range(5), done.append) == [0, 10, 20, 30, 40]
    assert sorted(done) == [0, 1, 2, 3, 4]


def test_an_executor_that_was_given_and_breaks_is_not_replaced():
    with (
        spawning(1) as executor,
        as_workers(executor) as pool,
        pytest.raises(ValueError, match="the executor that was given does not replace it: Broken"),
    ):
        pool.evaluate(dies, points(3))


def process_ids(z):
    return np.full(len(z), float(os.getpid()))


def is_running(process):
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    return True


def test_processes_started_here_are_ended():
    with local_workers(2) as pool:
        processes = set(pool.evaluate(process_ids, points(64)).values)
        assert all(map(is_running, processes))
        assert os.getpid() not in processes
    assert not any(map(is_running, processes))


def test_processes_are_ended_after_an_error_too():
    processes = []

    def fail():
        with as_workers(1) as pool:
            processes.extend(pool.evaluate(process_ids, points(64)).values)
            pool.evaluate(lambda z: z, points(64))

    with pytest.raises(ValueError, match="expected one value"):
        fail()
    assert not any(map(is_running, processes))


def test_an_interrupted_run_does_not_wait_for_what_is_under_way():
    def interrupt():
        time.sleep(0.3)  # the evaluation is under way by then
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    def sleeps(z):
        time.sleep(50.0)
        return sums(z)

    with local_workers(1) as pool:
        processes = set(pool.evaluate(process_ids, points(64)).values)
        threading.Thread(target=interrupt).start()
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            pool.evaluate(sleeps, points(64))
    assert time.monotonic() - begun < 15.0
    assert not any(map(is_running, processes))


def test_a_cluster_that_replaces_its_workers_is_waited_for(monkeypatch):
    monkeypatch.setattr(futures, "CHECK_SECONDS", 0.2)
    answers = iter([False, False])
    pool = Workers(Late(1.0), alive=lambda: next(answers, True))
    assert pool.evaluate(sums, np.ones((1, 2))).values == [2.0]


def test_a_cluster_that_has_lost_all_workers_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(futures, "CHECK_SECONDS", 0.05)
    pool = Workers(Late(50.0), alive=lambda: False)
    with pytest.raises(ValueError, match="workers: none is left"):
        pool.evaluate(sums, np.ones((1, 2)))


NO_WARNINGS = """
import os

import numpy as np

from bayes_ssi.execution.workers import local_workers


def main():
    def function(z):
        if (z == 3.0).all():
            os._exit(1)
        return z[:, 0]

    with local_workers(1) as pool:
        print(*pool.evaluate(function, np.arange(5.0)[:, None]).values)


main()
"""


def test_no_warnings_and_nothing_left_behind():
    """Not at the end of the process either, when resources that were forgotten are told."""
    command = [sys.executable, "-X", "dev", "-W", "error", "-c", NO_WARNINGS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout == "0.0 1.0 2.0 nan 4.0\n"
