"""Calls that are begun and waited for: in other processes, or here where there are none."""

import os
import time
from pathlib import Path

import pytest

import bayes_ssi as bs
from bayes_ssi.inference.workers.local_workers import LocalWorkers

pytestmark = pytest.mark.usefixtures("nothing_hangs")


def write_process(path):
    path.write_text(str(os.getpid()))


def die_elsewhere(arguments):
    path, here = arguments
    if os.getpid() != here:
        os._exit(1)
    path.write_text("here")


@pytest.mark.parametrize("workers", [None, 2])
def test_all_calls_are_made_by_the_end_of_the_block(tmp_path, workers):
    run, paths = bs.Run(workers), [tmp_path / name for name in "abc"]
    with run.working(), run.side_by_side() as begin:
        for path in paths:
            begin(write_process, path)
    here = {path.read_text() for path in paths} == {str(os.getpid())}
    assert here is (workers is None)


def test_a_call_whose_process_died_is_made_here(tmp_path):
    run = bs.Run(1)
    with run.working(), run.side_by_side() as begin:
        begin(die_elsewhere, (tmp_path / "a", os.getpid()))
    assert (tmp_path / "a").read_text() == "here"


@pytest.mark.parametrize("workers", [None, 1])
def test_a_file_that_cannot_be_written_is_named(tmp_path, workers):
    run = bs.Run(workers)
    with pytest.raises(FileNotFoundError) as caught, run.working(), run.side_by_side() as begin:
        begin(write_process, tmp_path / "none" / "a")
    assert Path(caught.value.filename) == tmp_path / "none" / "a"


def test_nothing_is_left_under_way_after_an_error():
    with LocalWorkers(1) as workers:
        (process,) = workers.call_each(_process, [0])
        with pytest.raises(ZeroDivisionError), bs.Run(workers).side_by_side() as begin:
            _begin_and_fail(begin)
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
        assert workers.call_each(_process, [0]) != [process], "others have started"


def _process(_):
    return os.getpid()


def _wait(seconds):
    time.sleep(seconds)


def _begin_and_fail(begin):
    begin(_wait, 60.0)
    raise ZeroDivisionError
