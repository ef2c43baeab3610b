"""The journal: what it gives back is what was written, or nothing."""

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest

from bayes_ssi.execution.batch import Evaluated
from bayes_ssi.execution.journal import Journal, run_of_journal

RUN = {"model class": "each k", "seed": 7}
HEADER = b'{"format": 1, "run": {"model class": "each k", "seed": 7}}\n'


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
    """A journal of some batches; where its header and each record end."""
    ends = []
    with Journal(path, RUN) as journal:
        ends.append(path.stat().st_size)
        for z, evaluated in batches:
            journal.add(z, evaluated)
            ends.append(path.stat().st_size)
    return ends


def assert_begins_with(journal, n):
    """The journal has the first ``n`` batches, exactly, and no more."""
    assert journal.n_kept == sum(len(z) for z, _ in BATCHES[:n])
    for z, evaluated in BATCHES[:n]:
        values, failures = journal.recalled(z)
        assert values.tobytes() == evaluated.values.tobytes()
        assert failures == evaluated.failures
    assert journal.recalled(BATCHES[min(n, len(BATCHES) - 1)][0]) is None


def test_round_trip(path):
    write(path)
    before = path.read_bytes()
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)
        assert journal.damage == ""
    assert path.read_bytes() == before


def test_a_journal_that_was_read_is_extended(path):
    write(path, BATCHES[:1])
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 1)
        for z, evaluated in BATCHES[1:]:
            journal.add(z, evaluated)
            assert journal.recalled(z) is None, "only what an earlier run evaluated is recalled"
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)


@pytest.mark.parametrize(
    "z",
    [
        np.nextafter(BATCHES[0][0], 1.0),
        BATCHES[0][0][::-1],
        BATCHES[0][0][:2],
        BATCHES[0][0].reshape(2, 3),
        BATCHES[1][0],
    ],
    ids=["last digit", "order", "fewer", "shape", "next batch"],
)
def test_other_coordinates_are_refused(path, z):
    write(path)
    with Journal(path, RUN) as journal:
        with pytest.raises(ValueError, match="batch 1 of this checkpoint is at other coordinates"):
            journal.recalled(z)
        assert_begins_with(journal, 3)


def test_a_journal_cut_anywhere_keeps_what_is_whole(path):
    ends = write(path)
    content = path.read_bytes()
    for cut in range(len(content)):
        path.write_bytes(content[:cut])
        whole = sum(end <= cut for end in ends[1:])
        with Journal(path, RUN) as journal:
            assert journal.damage == "", cut
            assert_begins_with(journal, whole)
            for z, evaluated in BATCHES[whole:]:
                journal.add(z, evaluated)
        assert path.read_bytes() == content, cut


def with_flipped_bit(content, position):
    damaged = bytearray(content)
    damaged[position] ^= 1 << position % 8
    return bytes(damaged)


def test_a_flipped_bit_anywhere_in_a_record_is_noticed(path):
    ends = write(path)
    content = path.read_bytes()
    for whole, (begin, end) in enumerate(pairwise(ends)):
        for position in range(begin, end):
            path.write_bytes(with_flipped_bit(content, position))
            with Journal(path, RUN) as journal:
                assert journal.damage.startswith(f"{path}: damaged after {journal.n_kept} ")
                assert_begins_with(journal, whole)


def test_a_flipped_bit_anywhere_in_the_header_is_refused(path):
    write(path)
    content = path.read_bytes()
    for position in range(len(HEADER)):
        damaged = with_flipped_bit(content, position)
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"damaged, or not a|checkpoint of another") as caught:
            Journal(path, RUN)
        assert "\n" not in str(caught.value)
        assert path.read_bytes() == damaged, "and left as it is"


@pytest.mark.parametrize("tail", [b"\0", b"\0" * 7, b"\0" * 4096, b"\xff" * 4096], ids=len)
def test_a_tail_that_was_never_written_harms_nothing(path, tail):
    """As file systems leave it when the power fails."""
    write(path)
    with path.open("ab") as file:
        file.write(tail)
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 3)


@pytest.mark.parametrize("whole", [0, 1, 2])
def test_a_damaged_journal_can_be_extended(path, whole):
    ends = write(path)
    content = path.read_bytes()
    path.write_bytes(with_flipped_bit(content, ends[whole] + 30))
    with Journal(path, RUN) as journal:
        for z, evaluated in BATCHES[whole:]:
            journal.add(z, evaluated)
    assert path.read_bytes() == content
    with Journal(path, RUN) as journal:
        assert journal.damage == ""
        assert_begins_with(journal, 3)


@pytest.mark.parametrize(
    ("run", "difference"),
    [
        ({**RUN, "seed": 8}, "seed 7 there and 8 here"),
        ({**RUN, "model class": "3", "seed": 0},
         'model class "each k" there and "3" here, seed 7 there and 0 here'),
        ({**RUN, "searches": 4}, "searches null there and 4 here"),
        ({"seed": 7}, 'model class "each k" there and null here'),
        ({**RUN, "model class": "x" * 80}, f'"each k" there and "{"x" * 56}... here'),
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


def test_another_format_is_refused(path):
    path.write_text(json.dumps({"format": 99, "run": RUN}) + "\n")
    with pytest.raises(ValueError, match="another run, with format 99 there and 1 here"):
        Journal(path, RUN)


@pytest.mark.parametrize(
    "content",
    [
        b"weeks of measurements",
        b"weeks of measurements\n1, 2, 3\n",
        b"\xff\xfe\n",
        b"[]\n",
        b'{"format": 1, "run": null}\n',
        HEADER[:-1] + b"x",
    ],
    ids=range(6),
)
def test_a_file_that_is_no_journal_is_refused_and_left_alone(path, content):
    path.write_bytes(content)
    with pytest.raises(ValueError, match="damaged, or not a checkpoint; remove it") as caught:
        Journal(path, RUN)
    assert str(caught.value).startswith(f"{path}: ")
    assert path.read_bytes() == content


def test_a_journal_in_use_is_refused(path):
    pytest.importorskip("fcntl")
    with Journal(path, RUN) as journal:
        journal.add(*BATCHES[0])
        with pytest.raises(ValueError, match=r"a\.journal: another run is using this checkpoint"):
            Journal(path, RUN)
        journal.add(*BATCHES[1])
    with Journal(path, RUN) as journal:
        assert_begins_with(journal, 2)


def test_a_journal_that_was_refused_is_not_in_use(path):
    write(path)
    with pytest.raises(ValueError, match="another run, with seed"):
        Journal(path, {**RUN, "seed": 8})
    Journal(path, RUN).close()


@contextmanager
def process_with_a_journal(path, *lines):
    """Another process that opens the journal and then runs some lines, until it is ended."""
    code = (
        "import os, time",
        "from bayes_ssi.execution.journal import Journal",
        f"journal = Journal({str(path)!r}, {RUN!r})",
        *lines,
        "time.sleep(60)",
    )
    command = [sys.executable, "-c", "\n".join(code)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_process_that_is_killed_uses_its_journal_no_more(path):
    pytest.importorskip("fcntl")
    with process_with_a_journal(path, "print('open', flush=True)") as process:
        assert process.stdout.readline() == b"open\n"
        with pytest.raises(ValueError, match="another run is using this checkpoint"):
            Journal(path, RUN)
        process.send_signal(signal.SIGKILL)
        process.wait()
    Journal(path, RUN).close()


def test_children_of_a_process_that_was_killed_do_not_use_its_journal(path):
    """As those of a pool that is forked after the journal was opened."""
    pytest.importorskip("fcntl")
    lines = ("if os.fork():", "    time.sleep(60)", "print(os.getpid(), flush=True)")
    with process_with_a_journal(path, *lines) as process:
        child = int(process.stdout.readline())
        process.kill()
        process.wait()
        try:
            Journal(path, RUN).close()
        finally:
            os.kill(child, signal.SIGKILL)


def test_what_run_a_journal_is_of_can_be_read_by_others(path):
    with Journal(path, RUN):
        assert run_of_journal(path) == RUN


@pytest.mark.parametrize("content", [b"", b"\n", HEADER[:-9], b"\xff\n", b"{}\n", b"null\n"])
def test_what_is_no_journal_is_of_no_run(path, content):
    path.write_bytes(content)
    assert run_of_journal(path) == {}
