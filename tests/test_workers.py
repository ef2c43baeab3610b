"""Workers: the same values wherever they are computed, and what becomes of workers that die."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections import OrderedDict
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest
from click.testing import CliRunner

import bayes_ssi as bs
from bayes_ssi import dispatch, in_workers
from bayes_ssi.cli import main
from bayes_ssi.evaluation import evaluate
from bayes_ssi.study import load_study
from bayes_ssi.workers import Workers, as_workers, local_workers

DIED = "the worker that evaluated it died"
# Too short to pass its checks, and as good as any to be compared.
COARSE = bs.SamplingSettings(log_evidence_error=0.2, particles=64, searches=1, max_steps=5)


@pytest.fixture(autouse=True)
def _nothing_hangs():
    """Ends a test that waits for workers in vain."""

    def give_up(*_):
        raise AssertionError("no end in sight")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def two_workers():
    with local_workers(2) as pool:
        yield pool


def points(n, d=2):
    return np.random.default_rng(5).standard_normal((n, d))


def sums(z):
    return z.sum(axis=1)


class Minimal(Executor):
    """As little of an executor as some packages have: ``submit``, and arguments are pickled.

    ``stores`` are the models that its workers hold; the workers take turns.
    """

    def __init__(self, n_workers=1):
        self.payloads = []
        self.stores = [OrderedDict() for _ in range(n_workers)]
        self.before = in_workers._models

    def submit(self, function, /, *arguments):
        function, arguments = pickle.loads(pickle.dumps((function, arguments)))
        self.payloads += [a for a in arguments if isinstance(a, bytes)]
        in_workers._models = self.stores[0]
        self.stores.append(self.stores.pop(0))
        future = Future()
        try:
            future.set_result(function(*arguments))
        except (ValueError, ArithmeticError) as error:
            future.set_exception(error)
        finally:
            in_workers._models = self.before
        return future


@contextmanager
def own_executor(executor):
    with executor, as_workers(executor) as pool:
        yield pool


def spawning(n):
    return ProcessPoolExecutor(n, mp_context=multiprocessing.get_context("spawn"))


POOLS = {
    "1 process": lambda: local_workers(1),
    "2 processes": lambda: local_workers(2),
    "3 processes": lambda: local_workers(3),
    "threads": lambda: own_executor(ThreadPoolExecutor(2)),
    "spawned processes": lambda: own_executor(spawning(2)),
    "submit alone": lambda: own_executor(Minimal()),
}


@pytest.mark.parametrize("make", POOLS.values(), ids=POOLS)
def test_values_do_not_depend_on_who_computes_them(model_classes, make):
    candidate = model_classes["3"]
    z = points(64, len(candidate.parameters))
    with make() as pool:
        for n in (1, 2, 7, 64):
            found = pool.evaluate(candidate.log_likelihood_at, z[:n])
            here = evaluate(candidate.log_likelihood_at, z[:n])
            assert np.isfinite(here.values).all()
            assert found.values.tobytes() == here.values.tobytes()
            assert found.failures == {}


def test_later_batches_do_not_carry_the_model():
    executor = Minimal(2)
    pool = Workers(executor, n_workers=2)
    pool.evaluate(sums, points(64))
    assert len(executor.payloads) <= 4
    executor.payloads.clear()
    pool.evaluate(sums, points(64))
    pool.evaluate(sums, points(7))
    assert executor.payloads == []


def test_a_worker_that_lacks_the_model_asks_for_it():
    executor = Minimal(2)
    pool = Workers(executor, n_workers=2)
    pool.evaluate(sums, points(64))
    executor.payloads.clear()
    executor.stores[0].clear()  # as a worker that took the place of another
    np.testing.assert_array_equal(pool.evaluate(sums, points(64)).values, sums(points(64)))
    assert 1 <= len(executor.payloads) <= 4  # the parts that went to this worker
    executor.payloads.clear()
    pool.evaluate(sums, points(64))
    assert executor.payloads == []


def test_models_in_turn_are_not_mixed_up():
    pool = Workers(Minimal(), n_workers=1)
    z = points(5)
    for power in (1, 2, 1, *range(1, in_workers.MODELS_KEPT + 2), 1):
        found = pool.evaluate(lambda z, power=power: sums(z) ** power, z).values
        np.testing.assert_array_equal(found, sums(z) ** power)


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
    found = two_workers.evaluate(candidate.log_likelihood_at, z)
    assert found.values.tobytes() == candidate.log_likelihood_at(z).tobytes()
    assert np.isfinite(found.values).all()
    assert found.failures == {}


def test_a_model_that_cannot_be_sent_is_refused_in_one_line(two_workers):
    lock = threading.Lock()
    with pytest.raises(ValueError, match="cannot be sent to a worker: TypeError: ") as caught:
        two_workers.evaluate(lambda z: sums(z) if lock else z, points(3))
    assert "\n" not in str(caught.value)


def missing_package(name):
    raise ModuleNotFoundError(f"No module named {name!r}")


class NeedsMore:
    """A model that is sent, but can be made here only."""

    def __call__(self, z):
        return sums(z)

    def __reduce__(self):
        return missing_package, ("elsewhere",)


def test_a_model_that_a_worker_cannot_rebuild_is_refused():
    pool = Workers(Minimal())
    with pytest.raises(ValueError, match="ModuleNotFoundError: No module named 'elsewhere'"):
        pool.evaluate(NeedsMore(), points(3))


def test_rows_that_raise_are_nan_and_say_why(two_workers):
    def function(z):
        class TwoArgumentsError(Exception):  # cannot be unpickled
            def __init__(self, first, second):
                super().__init__(f"{first} {second}")

        if (z > 10.0).any():
            raise TwoArgumentsError("no", "modes")
        return sums(z)

    z = points(33)
    z[[4, 32]] = 11.0
    found = two_workers.evaluate(function, z)
    expected = np.where(z[:, 0] > 10.0, np.nan, sums(z))
    np.testing.assert_array_equal(found.values, expected)
    assert found.failures == dict.fromkeys((4, 32), "TwoArgumentsError: no modes")


def test_rows_that_are_nan_need_no_reason(two_workers):
    z = points(33)
    found = two_workers.evaluate(lambda z: np.where(z[:, 0] > 0, sums(z), np.nan), z)
    np.testing.assert_array_equal(found.values, np.where(z[:, 0] > 0, sums(z), np.nan))
    assert found.failures == {}


def test_answers_of_the_wrong_shape_are_refused(two_workers):
    with pytest.raises(ValueError, match=r"one value for each of 2 points, got shape \(2, 2\)"):
        two_workers.evaluate(lambda z: z, points(16))


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


def test_an_executor_that_was_given_and_breaks_is_not_replaced():
    with (
        spawning(1) as executor,
        as_workers(executor) as pool,
        pytest.raises(ValueError, match="the executor that was given does not replace it: Broken"),
    ):
        pool.evaluate(dies, points(3))


def test_an_executor_that_is_shut_down_is_refused():
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with (
        as_workers(executor) as pool,
        pytest.raises(ValueError, match="cannot schedule new futures after shutdown"),
    ):
        pool.evaluate(sums, points(3))


def test_an_executor_that_was_given_is_not_shut_down():
    with ThreadPoolExecutor(1) as executor:
        with as_workers(executor) as pool:
            pool.evaluate(sums, points(3))
        assert executor.submit(int, "7").result() == 7


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


class Late(Executor):
    """An executor whose answer comes after so many seconds."""

    def __init__(self, seconds):
        self.seconds = seconds

    def submit(self, function, /, *arguments):
        future = Future()
        timer = threading.Timer(
            self.seconds, lambda: future.cancelled() or future.set_result(function(*arguments))
        )
        timer.daemon = True
        timer.start()
        return future


def test_a_cluster_that_replaces_its_workers_is_waited_for(monkeypatch):
    monkeypatch.setattr(dispatch, "CHECK_SECONDS", 0.2)
    answers = iter([False, False])
    pool = Workers(Late(1.0), alive=lambda: next(answers, True))
    assert pool.evaluate(sums, np.ones((1, 2))).values == [2.0]


def test_a_cluster_that_has_lost_all_workers_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(dispatch, "CHECK_SECONDS", 0.05)
    pool = Workers(Late(50.0), alive=lambda: False)
    with pytest.raises(ValueError, match="workers: none is left"):
        pool.evaluate(sums, np.ones((1, 2)))


NO_WARNINGS = """
import os

import numpy as np

from bayes_ssi.workers import local_workers


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


def assert_same_posteriors(one, other):
    for name in ("draws", "log_likelihoods", "frequencies_hz", "maxima"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    for name in ("evidence", "regions", "n_evaluations", "failed_checks"):
        assert getattr(one, name) == getattr(other, name)


@pytest.fixture(scope="module")
def one_k(tiny_study):
    return tiny_study.only(["one k"])


def test_ranking_does_not_depend_on_workers(one_k):
    (here,) = bs.rank(one_k, 7, COARSE).posteriors
    (there,) = bs.rank(one_k, 7, COARSE, workers=2).posteriors
    assert_same_posteriors(here, there)


def test_sampling_does_not_depend_on_workers(two_workers, one_k):
    (candidate,) = one_k.model_classes
    here = bs.sample(candidate, 7, COARSE)
    assert_same_posteriors(here, bs.sample(candidate, 7, COARSE, workers=two_workers))


@pytest.mark.parametrize("run", ["rank", "sample"])
@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (0, ValueError, "workers must be at least 1, got 0"),
        (True, TypeError, "workers must be a number or an executor, got True"),
        ("x", TypeError, "workers must be a number or an executor, got 'x'"),
    ],
)
def test_workers_that_make_no_sense_are_refused(one_k, run, given, error, message):
    what = one_k if run == "rank" else one_k.model_classes[0]
    with pytest.raises(error, match=message):
        getattr(bs, run)(what, 7, COARSE, workers=given)


class Fragile(bs.ShearBuilding):
    """A structure that fails where its stiffness is more than 1.5 times the median."""

    def modes(self, values):
        if (values[:, 0] > 1.5).any():
            raise ArithmeticError("too stiff")
        return super().modes(values)


def test_failures_in_workers_are_told(two_workers, tiny_study):
    old = tiny_study.model_classes[0]
    fragile = bs.ModelClass(
        "fragile", Fragile(old.structure.masses, old.structure.stiffnesses), old.data, old.error,
        pairing=old.pairing,
    )  # fmt: skip
    study = bs.Study("s", [fragile])
    (here,) = bs.rank(study, 7, COARSE).posteriors
    (there,) = bs.rank(study, 7, COARSE, workers=two_workers).posteriors
    assert_same_posteriors(here, there)
    (told,) = [check for check in there.failed_checks if "the model failed" in check]
    how_often, where = told.split("; the first time at k = ")
    n_failed, n_evaluations = (int(word) for word in how_often.split() if word.isdigit())
    assert 0 < n_failed < n_evaluations == there.n_evaluations
    value, reason = where.split(": ", 1)
    assert float(value) > 1.5
    assert reason == "ArithmeticError: too stiff"


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


# ArviZ: there are more chains than steps.
@pytest.mark.filterwarnings("ignore:(More chains|Found chain):UserWarning")
def test_the_command_gives_the_same_with_workers(run, tiny_study_file, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_ssi.plots.save_figures", lambda directory, *_: directory.mkdir())
    monkeypatch.setattr("bayes_ssi.sampling.SamplingSettings", lambda **_: COARSE)
    arguments = ("rank", tiny_study_file, "--only", "one k", "--accept-failed-checks", "--out")
    assert run(*arguments, "here").exit_code == 0
    assert run(*arguments, "there", "--workers", 2).exit_code == 0
    here, there = ((tmp_path / name / "comparison.json").read_bytes() for name in ("here", "there"))
    assert here == there


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--workers", "0"], "0 is not in the range"),
        (["--workers", "two"], "'two' is not a valid integer"),
        (["--workers", "2", "--dask", "x"], "--workers and --dask: give one of them"),
    ],
)
def test_options_that_make_no_sense_end_in_one_line(run, tiny_study_file, options, words):
    result = run("rank", tiny_study_file, *options)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("Error: ")
    assert words in line
