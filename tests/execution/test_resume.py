"""A command that is killed at any time and given again ends with the same result."""

import errno
import os
import signal
from pathlib import Path

import pytest
from conftest import TINY_STUDY, assert_one_line_error, succeeded

from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.results.stored_result import load_result

NOTHING_LOST = "no evaluation is lost, the same command resumes the run"
RESUMED = "an earlier run was interrupted; it is resumed as far as it was the same"


class Command:
    """``rank`` of the tiny study into a directory ``r``, alone in its parent directory."""

    def __init__(self, run, directory):
        self.place = directory / "results"
        self.result = self.place / "r"
        study_file = directory / "tiny.py"
        study_file.write_text(TINY_STUDY, encoding="utf-8")
        self.arguments = ("rank", str(study_file), "--seed", "7", "--out", str(self.result))
        self.run = lambda *options: run(*self.arguments, *options)

    @property
    def left(self):
        return sorted(path.name for path in self.place.iterdir())

    def assert_resumed_to(self, ranking, *options):
        assert succeeded(self.run(*options)).stderr.splitlines()[0] == RESUMED
        assert self.left == ["r"], "and nothing else is left"
        stored = load_result(self.result)
        assert stored.comparison == ranking.comparison
        for a, b in zip(stored.posteriors, ranking.posteriors, strict=True):
            for array in ("draws", "log_likelihoods", "frequencies_hz", "maxima"):
                assert getattr(a, array).tobytes() == getattr(b, array).tobytes()
            assert (a.evidence, a.n_evaluations) == (b.evidence, b.n_evaluations)
        assert (self.result / "figures" / "moving_shapes.json").exists()


@pytest.fixture
def command(run, tmp_path):
    return Command(run, tmp_path)


def in_batch(number, happens):
    """When a batch is half written, ``happens`` is called with the database."""
    keep, written = Cache.keep, []

    def keep_some(cache, *batch):
        if len(written) == number:
            cache._database.execute("BEGIN")
            keep(cache, *batch)
            happens(cache._database)
        keep(cache, *batch)
        written.append(batch)

    return keep_some


def fill_the_disk(database):
    database.execute("ROLLBACK")
    database.execute("PRAGMA max_page_count = 1")


def interrupt(_):
    signal.raise_signal(signal.SIGINT)


def cannot_be_written(path, *_):
    raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))


def test_interrupts_and_full_disks_are_said_in_a_line_and_lose_nothing(
    command, tiny_ranking, monkeypatch
):
    with monkeypatch.context() as patch:
        patch.setattr(Cache, "keep", in_batch(30, interrupt))
        stopped = command.run()
    assert stopped.exit_code == 130
    last = stopped.stderr.splitlines()[-1]
    assert last.startswith("Interrupted; resume with: bayes-ssi rank ")
    for function, happens, file in (
        ("bayes_ssi.inference.workers.cache.Cache.keep", in_batch(30, fill_the_disk), ""),
        ("bayes_ssi.results.stored_result.save_draws", cannot_be_written, "/posteriors/one_k.nc"),
        ("bayes_ssi.plots.moving_shapes.save_scenes", lambda *_: cannot_be_written("x"), ""),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(function, happens)
            full = command.run()
        assert full.exit_code == 2
        first, *_, last = full.stderr.splitlines()
        assert first == RESUMED
        assert last.startswith("Error: ")
        assert last.endswith(f"; {NOTHING_LOST}")
        assert not file or last.startswith(f"Error: {command.result}{file}: File too large; ")
        assert command.left == [".r.checkpoint"]
    command.assert_resumed_to(tiny_ranking)


def test_a_result_that_was_there_or_appears_in_the_meantime_is_not_overwritten(
    command, monkeypatch
):
    def appears(database):
        database.execute("ROLLBACK")
        command.result.mkdir()

    def kept():
        return [p.read_bytes() for p in sorted((command.place / ".r.checkpoint").iterdir())]

    with monkeypatch.context() as patch:
        patch.setattr(Cache, "keep", in_batch(3, appears))
        refused = command.run()
    assert refused.exit_code == 2
    assert "exists already and is not overwritten" in refused.stderr.splitlines()[-1]
    before = kept()
    assert len(before) == 2
    assert_one_line_error(command.run(), "exists already and is not overwritten")
    assert list(command.result.iterdir()) == []
    assert kept() == before, "and nothing is lost"


def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def at_second_rename(patch):
    """The old result is out of the way, the new one not in its place."""
    rename, renamed = Path.rename, []

    def second_kills(path, target):
        if renamed:
            die()
        renamed.append(rename(path, target))

    patch.setattr(Path, "rename", second_kills)


def instead_of(function):
    return lambda patch: patch.setattr(function, die)


MOMENTS = (
    ((), lambda patch: patch.setattr(Cache, "keep", in_batch(0, die))),
    ((), lambda patch: patch.setattr(Cache, "keep", in_batch(60, die))),
    ((), instead_of("bayes_ssi.results.stored_result.save_draws")),
    ((), instead_of("pathlib.Path.rename")),
    ((), instead_of("bayes_ssi.inference.workers.run.Checkpoint.remove")),
    (("--overwrite",), at_second_rename),
)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes of Unix")
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded")
def test_killed_at_any_moment(command, tiny_ranking):
    """While it samples and writes, and while an old result is replaced."""
    for options, arrange in MOMENTS:
        child = os.fork()
        if not child:
            signal.alarm(100)
            with pytest.MonkeyPatch.context() as patch:
                arrange(patch)
                command.run(*options)
            os._exit(0)
        assert os.waitpid(child, 0)[1] == signal.SIGKILL
        if not options and command.result.exists():
            assert_one_line_error(command.run(), "exists already and is not overwritten")
            assert len(load_result(command.result).posteriors) == 2, "killed when all was done"
    assert command.left == [".r.checkpoint", ".r.partial", ".r.replaced"]
    command.assert_resumed_to(tiny_ranking)
