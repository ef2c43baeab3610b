"""Workers: the same values in any process, what cannot be sent or evaluated, their deaths."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from pools import Crew, Death, Minimal, numbered, points, spawning, sums, workers_of

from bayes_ssi.inference.workers.workers import Workers, as_workers, can_copy, evaluate
from bayes_ssi.studies.ranking.study import load_study

pytestmark = pytest.mark.usefixtures("nothing_hangs")

WORKERS = {
    "threads": lambda: workers_of(ThreadPoolExecutor(2)),
    "submit alone": lambda: workers_of(Minimal()),
}


@pytest.fixture(scope="module")
def two_workers():
    """Two processes of this machine, whose threads end with these tests: they hinder copies."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("OMP_NUM_THREADS", raising=False)
        with Workers(n_workers=2) as pool:
            yield pool


@pytest.fixture(params=["processes", *WORKERS])
def workers(request, two_workers):
    if request.param == "processes":
        yield two_workers
    else:
        with WORKERS[request.param]() as pool:
            yield pool


def test_values_do_not_depend_on_who_computes_them(model_classes, workers):
    for candidate in (model_classes["3"], model_classes["1-a"], model_classes["3"]):
        z = points(64, len(candidate.parameters))
        for n in (1, 7, 64):
            there = workers.evaluate(candidate.log_likelihood_at, z[:n])
            here = evaluate(candidate.log_likelihood_at, z[:n])
            assert np.isfinite(here.values).all()
            assert there.values.tobytes() == here.values.tobytes()
            assert there.failures == {}
    assert workers.call_each(len, ["a", "bcd", "", "ef"]) == [1, 3, 0, 2]


class Counted:
    """A model that counts in a file how often it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __call__(self, z):
        return sums(z)

    def __setstate__(self, state):
        self.__dict__.update(state)
        time.sleep(0.05)  # long enough for another thread to begin as well
        with open(self.path, "a") as file:
            file.write("x")


def test_a_worker_unpickles_a_model_only_once(tmp_path, workers):
    model = Counted(tmp_path / "count")
    for _ in range(3):
        workers.evaluate(model, points(64))
    assert 1 <= len(model.path.read_text()) <= 1 + (workers.executor is None)


OWN_STRUCTURE = """
FACTOR = 0.9


def lowered(frequencies_hz):
    return FACTOR * frequencies_hz


class Heavier(bs.ShearBuilding):
    def modes(self, values):
        frequencies_hz, shapes = super().modes(values)
        return lowered(frequencies_hz), shapes


study = bs.Study(
    "own structure",
    [bs.ModelClass("own", Heavier((1.0, 1.0), (K * k, K * k)), modes, error, pairing=pairing)],
)
"""


def test_a_structure_may_be_defined_in_the_study_file(two_workers, tiny_study_file):
    with tiny_study_file.open("a") as file:
        file.write(OWN_STRUCTURE)
    (candidate,) = load_study(tiny_study_file).model_classes
    z = points(20, 1)
    there = two_workers.evaluate(candidate.log_likelihood_at, z)
    assert there.values.tobytes() == candidate.log_likelihood_at(z).tobytes()
    assert np.isfinite(there.values).all()


def test_a_model_that_cannot_be_sent_or_rebuilt_is_refused_in_one_line(two_workers):
    lock = threading.Lock()
    with pytest.raises(ValueError, match="cannot be sent to a worker: TypeError: ") as caught:
        two_workers.evaluate(lambda z: sums(z) if lock else z, points(3))
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="ModuleNotFoundError: No module named 'elsewhere'"):
        two_workers.evaluate(NeedsMore(), points(3))


def missing_package(name):
    raise ModuleNotFoundError(f"No module named {name!r}")


class NeedsMore:
    """A model that can be sent, but not rebuilt in another process."""

    def __call__(self, z):
        return sums(z)

    def __reduce__(self):
        return missing_package, ("elsewhere",)


def test_rows_that_raise_are_nan_and_say_why(two_workers):
    def function(z):
        class TwoArgumentsError(Exception):  # cannot be unpickled
            def __init__(self, first, second):
                super().__init__(f"{first} {second}")

        if (z > 10.0).any():
            raise TwoArgumentsError("no", "modes")
        return np.where(z[:, 0] > 0, sums(z), np.nan)

    z = points(33)
    z[[4, 32]] = 11.0
    there = two_workers.evaluate(function, z)
    right = (z[:, 0] > 0) & (z[:, 0] < 10.0)
    np.testing.assert_array_equal(there.values, np.where(right, sums(z), np.nan))
    assert set(there.failures) == {4, 32}
    for reason in there.failures.values():
        # The file, or the function where its pickle does not keep the file.
        place = r"\((test_workers\.py|function), line "
        assert re.match(f"TwoArgumentsError: no modes {place}", reason)


def test_an_executor_that_was_given_is_not_shut_down():
    with ThreadPoolExecutor(1) as executor:
        with as_workers(executor) as workers:
            workers.evaluate(sums, points(3))
        assert executor.submit(int, "7").result() == 7
    with pytest.raises(ValueError, match="cannot schedule new futures after shutdown"):
        workers.evaluate(sums, points(3))


def test_no_points_are_no_work():
    values, failures = Workers(n_workers=2).evaluate(sums, np.empty((0, 2)))
    assert (values.shape, failures) == ((0,), {})


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (0, ValueError, "^workers must be at least 1, got 0$"),
        (np.int64(-1), ValueError, "^workers must be at least 1, got -1$"),
        *[(x, TypeError, "^workers must be a number or an exec") for x in (True, 2.0, "2")],
    ],
)
def test_workers_that_make_no_sense_are_refused(given, error, message):
    with pytest.raises(error, match=message):
        as_workers(given)


def is_running(process):
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    return True


def test_processes_are_kept_until_the_outermost_exit_whatever_happens():
    """Nor does an interrupted run wait for what is under way."""

    def interrupt():
        time.sleep(0.3)  # the evaluation is under way by then
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    def sleeps(z):
        time.sleep(50.0)
        return sums(z)

    def ids():
        return set(workers.evaluate(lambda z: 0.0 * z[:, 0] + os.getpid(), points(64)).values)

    with Workers(n_workers=1) as workers:
        with workers:
            processes = ids()
        assert os.getpid() not in processes
        with pytest.raises(ValueError, match="expected one value"), workers:
            workers.evaluate(lambda z: z, points(64))
        processes |= ids()
        assert any(map(is_running, processes))
        threading.Thread(target=interrupt).start()
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            workers.evaluate(sleeps, points(64))
        assert time.monotonic() - begun < 15.0
        processes |= ids()
    assert not any(map(is_running, processes))


ENDS_AT_ONCE = """
import os
import numpy as np
from bayes_ssi.inference.workers.workers import Workers

workers = Workers(n_workers=1)
process = workers.evaluate(lambda z: np.full(len(z), float(os.getpid())), np.zeros((1, 1)))
print(process.values[0], flush=True)
os.kill(os.getpid(), 9)
"""


def test_workers_end_with_the_process_that_started_them():
    command = [sys.executable, "-c", ENDS_AT_ONCE]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL
    while is_running(float(done.stdout)):
        time.sleep(0.05)


def n_threads(z):
    from threadpoolctl import threadpool_info

    limits = [each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"]
    return np.full(len(z), float(max(limits)))


def test_blas_works_in_one_thread_in_workers(two_workers):
    assert two_workers.evaluate(n_threads, points(1)).values == [1.0]


def test_no_thread_is_left_when_workers_stop(monkeypatch):
    """One that still gives back a semaphore when the process ends leaves it half removed."""
    from loky.backend.queues import Queue

    feed = Queue._feed

    def slowly(*args):
        feed(*args)
        time.sleep(0.2)

    monkeypatch.setattr(Queue, "_feed", staticmethod(slowly))
    before = set(threading.enumerate())
    with Workers(n_workers=1) as workers:
        workers.evaluate(sums, points(3))
        assert set(threading.enumerate()) > before
    assert set(threading.enumerate()) == before


WORK_AND_DIE = """
import os
import sys
import numpy as np
from bayes_ssi.inference.workers.workers import Workers

def function(z):
    if (z == 3.0).all():
        os._exit(1)
    return np.full(len(z), float("a module of this process" in sys.modules))

sys.modules["a module of this process"] = sys
for copies in (True, False):
    with Workers(n_workers=2, copies=copies) as workers:
        print(*workers.try_each(function, [np.zeros(1), np.ones(1)]).values())
        print(*np.isnan(workers.evaluate(function, np.arange(5.0)[:, None]).values))
        print(*workers.call_each(function, [np.zeros(1), np.ones(1)]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux only")
def test_copies_have_what_this_process_has_imported_and_nothing_is_left_behind():
    """Others, such as those that replace them where one dies, have not.

    There is no warning, at the end of the process either, which warns of forgotten resources.
    """
    command = [sys.executable, "-X", "dev", "-W", "error", "-c", WORK_AND_DIE]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    lost = "False False False True False\n[0.] [0.]\n"
    assert done.stdout == f"[1.] [1.]\n{lost}[0.] [0.]\n{lost}"


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
