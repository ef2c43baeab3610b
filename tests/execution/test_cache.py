"""Batches in which the model may fail, and the cache of what earlier runs evaluated."""

import errno
import os
import signal

import numpy as np
import pytest
from conftest import assert_refused

from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.workers import Evaluated, evaluate


def batch(seed, values, failures=None):
    values = np.array(values)
    z = np.random.default_rng(seed).standard_normal((len(values), 2))
    return z, Evaluated(values, failures or {})


BATCHES = [
    batch(0, [-1.5, np.nan, -np.inf], {1: "ValueError: no modes, θ = 0"}),
    batch(1, [0.1 + 0.2]),
    batch(2, [[np.nan, 1.0], [5e-324, 2.0]], {0: "worker died"}),
]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a"


def write(path):
    with Cache(path) as cache:
        model = cache.new_model()
        for z, evaluated in BATCHES:
            cache.keep(model, z, evaluated)
            assert cache.recalled(model, z) is None, "only what an earlier run evaluated"
        return model


def test_batches_are_recalled_exactly_and_in_any_order(path):
    model = write(path)
    with Cache(path) as cache:
        for z, evaluated in reversed(BATCHES):
            values, failures = cache.recalled(model, z)
            assert (values.shape, values.tobytes()) == (
                evaluated.values.shape, evaluated.values.tobytes()
            )  # fmt: skip
            assert failures == evaluated.failures
            cache.keep(model, z, evaluated)  # once more, which changes nothing
    assert list(path.parent.iterdir()) == [path]


def test_other_points_and_other_models_are_not_recalled(path):
    """Nor is what this run evaluated: a model that is noisy is asked again."""
    model = write(path)
    (z, _), (other, evaluated), _ = BATCHES
    with Cache(path) as cache:
        cache.keep(model, 2.0 * other, evaluated)
        assert cache.recalled(model, 2.0 * other) is None
        for points in (z + 1e-15, z[::-1], z[:, ::-1], z[:2], z.reshape(2, 3), z.ravel(), -other):
            assert cache.recalled(model, points) is None
        assert cache.recalled(model + 1, z) is None


def test_a_model_is_asked_for_what_is_new_and_once_whether_it_is_the_same(path):
    asked = []

    def model(z):
        asked.append(len(z))
        return Evaluated(z.sum(axis=1), {})

    batches = [np.full((5, 2), 1.0), np.full((4, 2), 2.0)]
    for expected in ([5, 4], [3]):
        asked.clear()
        with Cache(path) as cache:
            number = cache.new_model()
            for z in batches:
                np.testing.assert_array_equal(cache.evaluated(number, z, model).values, z.sum(1))
        assert asked == expected
    message = f"^{path}: the model gives other values than when this checkpoint was made; remove"
    with Cache(path) as cache, pytest.raises(ValueError, match=message):
        cache.evaluated(cache.new_model(), batches[1], lambda z: Evaluated(1.00001 * z.sum(1), {}))


def test_a_file_that_is_no_cache_is_refused_and_left_alone(path):
    write(path)
    whole = path.read_bytes()
    for content in (b"weeks\n", whole[:5000], whole[:4096] + bytes(len(whole) - 4096)):
        path.write_bytes(content)
        assert_refused(f"^{path}: damaged, or not a checkpoint; remove it", Cache, path)
        assert path.read_bytes() == content
    with pytest.raises(OSError, match="unable to open database file"):
        Cache(path / path.name)


def test_a_full_disk_is_an_error_of_the_file_that_loses_nothing(path):
    model = write(path)
    large = Evaluated(np.ones(10_000), {})
    with Cache(path) as cache:
        cache._database.execute("PRAGMA max_page_count = 1")
        with pytest.raises(OSError, match="No space left") as caught:
            cache.keep(model, np.ones((10_000, 1)), large)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    with Cache(path) as cache:
        assert all(cache.recalled(model, z) is not None for z, _ in BATCHES)


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded")
def test_a_process_that_is_killed_uses_its_cache_no_more(path):
    """Nor do its children, such as a pool that is forked after the cache was opened."""
    opened, told = os.pipe()
    child = os.fork()
    if not child:
        with Cache(path):
            grandchild = os.fork()
            if grandchild:
                os.write(told, str(grandchild).encode())
            signal.pause()
    grandchild = int(os.read(opened, 20))
    try:
        assert_refused(f"^{path}: another run is using this checkpoint$", Cache, path)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        write(path)
    finally:
        os.kill(grandchild, signal.SIGKILL)


def test_a_cache_that_nothing_was_written_into_leaves_no_file(path):
    with Cache(path):
        pass
    assert not path.exists()


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


def rows(n):
    return np.arange(float(n))[:, None]


@pytest.mark.parametrize("n", range(1, 10))
def test_only_the_rows_that_raise_are_nan(n):
    for bad in (*((row,) for row in range(n)), {0, n // 2, n - 1}):
        values, failures = evaluate(Fragile(*bad), rows(n))
        expected = 2.0 * np.arange(n)
        expected[list(bad)] = np.nan
        np.testing.assert_array_equal(values, expected)
        place = f"(test_cache.py, line {Fragile.__call__.__code__.co_firstlineno + 4})"
        assert failures == {row: f"ValueError: no modes at {row} {place}" for row in bad}


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
