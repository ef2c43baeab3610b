"""Workers: the same values wherever they are computed, and what cannot be sent or answered."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from pools import Minimal, own_executor, points, spawning, sums

from bayes_ssi.execution import in_workers
from bayes_ssi.execution.batch import evaluate
from bayes_ssi.execution.workers import Workers, as_workers, local_workers
from bayes_ssi.ranking.study import load_study

pytestmark = pytest.mark.usefixtures("nothing_hangs")

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


def test_no_points_are_no_work():
    """Workers are not even made."""
    pool = Workers(make=lambda: pytest.fail("made"), n_workers=2)
    found = pool.evaluate(sums, np.empty((0, 2)))
    assert (found.values.shape, found.failures) == ((0,), {})
    assert pool.call_each(len, []) == []


def test_answers_of_each_item_come_in_their_order():
    executor = Minimal(2)
    done = []
    items = ["a", "bcd", "", "ef", "ghijk"]
    found = Workers(executor, n_workers=2).call_each(len, items, done.append)
    assert found == [1, 3, 0, 2, 5]
    assert sorted(done) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("n", [1, np.int64(1), np.uint8(1)])
def test_a_number_of_workers_is_any_integer(n):
    with as_workers(n) as pool:
        np.testing.assert_array_equal(pool.evaluate(sums, points(3)).values, sums(points(3)))


@pytest.mark.parametrize("n", [0, -1, np.int64(0)])
def test_less_than_one_worker_is_refused(n):
    with pytest.raises(ValueError, match=f"^workers must be at least 1, got {n}$"), as_workers(n):
        pass


@pytest.mark.parametrize("n", [True, np.True_, 2.0, np.float64(2.0), "2"])
def test_what_is_no_integer_is_refused(n):
    with pytest.raises(TypeError, match=r"^workers must be a number or an exec"), as_workers(n):
        pass
