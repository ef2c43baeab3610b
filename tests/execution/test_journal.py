"""The journal: it returns what was written, or nothing."""

import os
import signal
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from bayes_ssi.inference.workers.journal import DamagedJournalError, Journal
from bayes_ssi.inference.workers.workers import Evaluated

RUN = {"model class": "each k", "seed": 7}


def batch(seed, values, failures=None):
    z = np.random.default_rng(seed).standard_normal((len(values), 2))
    return z, Evaluated(np.array(values), failures or {})


BATCHES = [
    batch(0, [-1.5, np.nan, -np.inf], {1: "ValueError: no modes, θ = 0"}),
    batch(1, [0.1 + 0.2]),
    batch(2, [np.nan, 5e-324], {0: "worker died"}),
]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.journal"


def write(path, batches=BATCHES):
    with Journal(path, RUN) as journal:
        for z, evaluated in batches:
            journal.add(z, evaluated)


def assert_begins_with(journal, n):
    """The journal has the first ``n`` batches, exactly, and no more."""
    assert journal.n_kept == sum(len(z) for z, _ in BATCHES[:n])
    assert journal.is_empty == (n == 0)
    for z, evaluated in BATCHES[:n]:
        values, failures = journal.recalled(z)
        assert values.tobytes() == evaluated.values.tobytes()
        assert failures == evaluated.failures
    assert journal.recalled(BATCHES[min(n, len(BATCHES) - 1)][0]) is None


@pytest.mark.parametrize("n", range(4))
def test_a_journal_that_was_read_is_extended(path, n):
    write(path, BATCHES[:n])
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, n)
        for z, evaluated in BATCHES[n:]:
            journal.add(z, evaluated)
            assert journal.recalled(z) is None, "only what an earlier run evaluated is recalled"
    before = path.read_bytes()
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    "z",
    [
        BATCHES[0][0] + 1e-6 * np.eye(3, 2),
        BATCHES[0][0][::-1],
        BATCHES[0][0][:, ::-1],
        BATCHES[0][0][:2],
        BATCHES[0][0].reshape(2, 3),
        BATCHES[1][0],
    ],
    ids=["two coordinates", "order", "columns", "fewer", "shape", "next batch"],
)
def test_batches_at_other_coordinates_and_all_that_follow_are_computed_again(path, z):
    write(path)
    said = []
    with Journal(path, RUN, said.append) as journal:
        assert journal.recalled(z) is None
        assert said == [
            f"{path}: 3 of 3 batches are computed again: they were made on another kind of "
            "processor, whose rounding led elsewhere"
        ]
        for each in BATCHES:
            journal.add(*each)
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)


@pytest.mark.parametrize("rounding", [1e-15, 1e-10])
def test_batches_at_the_same_coordinates_but_for_rounding_are_recalled(path, rounding):
    write(path)
    noise = np.random.default_rng(3).standard_normal((3, 2))
    with Journal(path, RUN) as journal:
        for z, evaluated in BATCHES:
            values, failures = journal.recalled(z + rounding * noise[: len(z)])
            np.testing.assert_array_equal(values, evaluated.values)
            assert failures == evaluated.failures


def test_a_suggestion_is_no_batch_of_coordinates(path):
    with Journal(path, RUN) as journal:
        journal.add_suggestion(np.ones((2, 1)), 5)
    with Journal(path, RUN) as journal:
        assert journal.recalled(np.ones((2, 1))) is None


@pytest.mark.parametrize(
    ("run", "difference"),
    [
        ({**RUN, "seed": 8}, "seed 7 there and 8 here"),
        ({**RUN, "model class": "3", "seed": np.int64(0)},
         'model class "each k" there and "3" here, seed 7 there and 0 here'),
        ({**RUN, "searches": 4}, "searches null there and 4 here"),
        ({"seed": 7}, 'model class "each k" there and null here'),
        ({**RUN, "model class": "x" * 80}, f'"each k" there and "{"x" * 56}... here'),
        ({**RUN, "format": 99}, "format 6 there and 99 here"),
    ],
)  # fmt: skip
def test_the_journal_of_another_run_is_refused(path, run, difference):
    write(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="the checkpoint of another run, with ") as caught:
        Journal(path, run)
    assert str(caught.value).startswith(f"{path}: ")
    assert f"{difference}; finish that one, or begin again" in str(caught.value)
    assert path.read_bytes() == before
    Journal(path, RUN).close()


def test_a_damaged_journal_is_refused_and_left_alone(path):
    write(path)
    whole = path.read_bytes()
    for content in (b"weeks\n", whole[:5000], whole[:4096] + bytes(len(whole) - 4096)):
        path.write_bytes(content)
        with pytest.raises(DamagedJournalError, match="damaged, or not a checkpoint") as caught:
            Journal(path, RUN)
        assert str(caught.value).startswith(f"{path}: ")
        assert path.read_bytes() == content


@pytest.mark.parametrize("column", ["numbers", "failures"])
def test_damaged_log_likelihoods_and_all_that_follow_are_computed_again(path, column):
    write(path)
    with sqlite3.connect(path) as database:
        (stored,) = database.execute(f"SELECT {column} FROM batches WHERE number = 2").fetchone()
        changed = stored.replace(b"4", b"5") if column == "numbers" else '{"0": "x"}'
        assert changed != stored
        database.execute(f"UPDATE batches SET {column} = ? WHERE number = 2", [changed])
    database.close()
    with Journal(path, RUN) as journal:
        assert journal.recalled(BATCHES[0][0]) is not None
        assert journal.recalled(BATCHES[1][0]) is None
        for each in BATCHES[1:]:
            journal.add(*each)
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)


def test_a_journal_that_cannot_be_written_is_refused(path):
    with pytest.raises(OSError, match=r"a\.journal: unable to open database file"):
        Journal(path / path.name, RUN)


USES_ITS_JOURNAL = """
import os, sys, time
from bayes_ssi.inference.workers.journal import Journal
journal = Journal(sys.argv[1], {"model class": "each k", "seed": 7})
if os.fork():
    time.sleep(60)
print(os.getpid(), flush=True)
time.sleep(60)
"""


def test_a_process_that_is_killed_uses_its_journal_no_more(path):
    """Nor do its children, such as a pool that is forked after the journal was opened."""
    command = [sys.executable, "-c", USES_ITS_JOURNAL, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        child = int(process.stdout.readline())
        try:
            with pytest.raises(ValueError, match="another run is using this checkpoint"):
                Journal(path, RUN)
            process.kill()
            process.wait()
            Journal(path, RUN).close()
        finally:
            process.kill()
            os.kill(child, signal.SIGKILL)
