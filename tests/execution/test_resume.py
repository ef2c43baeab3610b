"""A command that is killed at any time and given again ends with the same result."""

import multiprocessing
import os
import shutil
import signal
import time
from pathlib import Path

import pytest
from conftest import TINY_STUDY

from bayes_ssi.cli import main
from bayes_ssi.inference.workers.journal import Journal
from bayes_ssi.results.stored_result import load_result, save_result

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs signals of Unix")


def die(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)


def instead_of(function):
    def arrange(patch):
        patch.setattr(function, die)

    return arrange


def in_batch(number, happens=die):
    """When a batch is half written into the journal."""

    def arrange(patch):
        add, written = Journal.add, []

        def add_some(journal, *batch):
            if len(written) == number:
                journal._database.execute("BEGIN")
                add(journal, *batch)
                happens(journal)
            add(journal, *batch)
            written.append(batch)

        patch.setattr(Journal, "add", add_some)

    return arrange


def interrupt(_):
    signal.raise_signal(signal.SIGINT)


def fill_the_disk(journal):
    journal._database.execute("ROLLBACK")
    journal._database.execute("PRAGMA max_page_count = 1")


def where_files_have_at_most(n_bytes):
    """As on a full disk, whose moment no other test can choose: file by file."""

    def arrange(_):
        import resource  # not on Windows

        resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))

    return arrange


def after_the_first_unlink(patch):
    unlink = Path.unlink

    def unlink_and_die(path, missing_ok=False):
        unlink(path, missing_ok)
        die()

    patch.setattr(Path, "unlink", unlink_and_die)


def when_the_old_result_is_half_removed(patch):
    rmtree = shutil.rmtree

    def remove_half_and_die(path, *arguments, **options):
        if (Path(path) / "result.json").exists():
            (Path(path) / "result.json").unlink()
            die()
        rmtree(path, *arguments, **options)

    patch.setattr(shutil, "rmtree", remove_half_and_die)


WRITING_A_JOURNAL = {
    "it is made": instead_of("bayes_ssi.inference.workers.journal.to_record"),
    "half of the first batch": in_batch(0),
    "half of the 60th batch": in_batch(60),
}
ALL_IS_SAMPLED = {
    "all is sampled": instead_of("bayes_ssi.inference.workers.run.Checkpoint.begin_saving")
}
SAVING = {
    "some files are written": instead_of("bayes_ssi.results.stored_result.save_draws"),
    "most files are written": instead_of("bayes_ssi.results.stored_result._write_comparison_csv"),
    "shapes are written": instead_of("bayes_ssi.plots.moving_shapes.save_scenes"),
    "all files are written": instead_of("pathlib.Path.rename"),
    "the result is in its place": instead_of("bayes_ssi.results.stored_result.load_result"),
    "everything is done": instead_of("bayes_ssi.inference.workers.run.Checkpoint.remove"),
    "the journal is removed": after_the_first_unlink,
}
REPLACING = {
    "the old result is half removed": when_the_old_result_is_half_removed,
    "the old result is removed": instead_of("pathlib.Path.rename"),
}
STOPS = {"an interrupt": in_batch(30, interrupt), "a full disk": in_batch(30, fill_the_disk)}
# Bytes that some files of the result exceed: all records, result.json, figures, draws.
LIMITS = {n_bytes: where_files_have_at_most(n_bytes) for n_bytes in (700, 17_000, 20_000, 100_000)}
NOTHING_LOST = "no evaluation is lost, the same command resumes the run"
MOMENTS = {**LIMITS, **WRITING_A_JOURNAL, **ALL_IS_SAMPLED, **SAVING, **REPLACING, **STOPS}

# Forked from one process that has imported what the command needs: that takes it longest.
forks = multiprocessing.get_context("forkserver")
forks.set_forkserver_preload(
    ["pytest", "arviz", "emcee", "h5netcdf.legacyapi",
     "rich.progress", "bayes_ssi.plots.moving_shapes",
     "bayes_ssi.results.stored_result", "bayes_ssi.report.tables.ranking_tables",
     "bayes_ssi.studies.questions"]
)  # fmt: skip


def in_the_process(arguments, stderr, moment):
    for path, stream in ((os.devnull, 1), (stderr, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    patch = pytest.MonkeyPatch()
    patch.setattr("bayes_ssi.studies.questions.appendage_checks", lambda *_: ())
    if moment is not None:
        MOMENTS[moment](patch)
    main(arguments)


class Command:
    """``rank`` of the tiny study into a directory ``r``, alone in its parent directory."""

    def __init__(self, directory):
        self.study_file = directory / "tiny.py"
        self.study_file.write_text(TINY_STUDY, encoding="utf-8")
        self.stderr_file = directory / "stderr.txt"
        self.place = directory / "results"
        self.result = self.place / "r"
        self.checkpoint = self.place / ".r.checkpoint"
        self.started = []

    def arguments(self, *options):
        only = () if "--class" in options else ("--class", "one k")
        return ["rank", str(self.study_file), "--out", str(self.result), *only, *options]

    def start(self, *options, moment=None):
        arguments = (self.arguments(*options), self.stderr_file, moment)
        self.started.append(forks.Process(target=in_the_process, args=arguments))
        self.started[-1].start()
        return self.started[-1]

    def run(self, *options, moment=None):
        """The exit code; negative where a signal ended it."""
        return exit_code(self.start(*options, moment=moment))

    def dies(self, *options, moment):
        assert self.run(*options, moment=moment) == -signal.SIGKILL, moment

    @property
    def stderr(self):
        return self.stderr_file.read_text(encoding="utf-8")

    @property
    def journals(self):
        return {path.name: path.read_bytes() for path in self.checkpoint.glob("*.journal")}

    def wait_for_journals_of(self, size):
        give_up = time.monotonic() + 60.0
        while total_size(self.checkpoint) <= size:
            assert time.monotonic() < give_up
            time.sleep(0.001)

    def assert_result_is(self, other):
        assert [path.name for path in self.place.iterdir()] == ["r"], "and nothing else is left"
        for name in ("comparison.json", "comparison.csv", "data.csv"):
            assert (self.result / name).read_bytes() == (other / name).read_bytes()
        figures = sorted(path.name for path in (self.result / "figures").iterdir())
        assert figures == ["moving_shapes.json"]
        saved, expected = load_result(self.result), load_result(other)
        for a, b in zip(saved.posteriors, expected.posteriors, strict=True):
            assert a.name == b.name
            for array in ("draws", "log_likelihoods", "frequencies_hz", "maxima"):
                assert getattr(a, array).tobytes() == getattr(b, array).tobytes()
            assert a.evidence == b.evidence
            assert (a.n_evaluations, a.failed_checks) == (b.n_evaluations, b.failed_checks)

    def assert_one_line_error(self, words):
        (line,) = self.stderr.splitlines()
        assert line.startswith("Error: ")
        assert words in line


def exit_code(process):
    process.join()
    return process.exitcode


def total_size(checkpoint):
    return sum(path.stat().st_size for path in checkpoint.glob("*.journal"))


@pytest.fixture
def command(tmp_path):
    command = Command(tmp_path)
    yield command
    for process in command.started:
        process.kill()
        process.join()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """The result of a command that is not killed."""
    command = Command(tmp_path_factory.mktemp("uninterrupted"))
    assert command.run() == 0
    return command.result


@pytest.fixture(scope="module")
def sampled(tmp_path_factory):
    """The checkpoint of a command that was killed when all was sampled."""
    command = Command(tmp_path_factory.mktemp("sampled"))
    command.dies(moment="all is sampled")
    return command.checkpoint


@pytest.fixture
def sampled_command(command, sampled):
    shutil.copytree(sampled, command.checkpoint)
    return command


def with_old_result(command, uninterrupted):
    shutil.copytree(uninterrupted, command.result)
    (command.result / "comparison.json").write_text("old")
    return command


def test_killed_again_and_again(command, sampled, tiny_ranking, tmp_path):
    options = ("--seed", "7", "--class", "one k,each k")
    for share in (0.0, 0.7, 1.4):
        process = command.start(*options)
        command.wait_for_journals_of(share * total_size(sampled))
        process.kill()
        assert exit_code(process) == -signal.SIGKILL
    assert command.run(*options) == 0
    command.assert_result_is(save_result(tiny_ranking, tmp_path / "expected").directory)


def test_killed_while_the_journal_is_written(command, uninterrupted):
    for moment in WRITING_A_JOURNAL:
        command.dies(moment=moment)
    assert command.run() == 0
    command.assert_result_is(uninterrupted)


def test_killed_at_every_moment_of_saving(sampled_command, uninterrupted):
    for moment in SAVING:
        sampled_command.dies(moment=moment)
    assert sampled_command.run() == 0
    sampled_command.assert_result_is(uninterrupted)


def test_killed_while_an_old_result_is_replaced(sampled_command, uninterrupted):
    command = with_old_result(sampled_command, uninterrupted)
    for moment in REPLACING:
        command.dies("--overwrite", moment=moment)
    assert command.run("--overwrite") == 0
    command.assert_result_is(uninterrupted)


def test_killed_while_its_own_result_is_replaced(sampled_command, uninterrupted):
    for moment in ("the result is in its place", "the old result is half removed"):
        sampled_command.dies(moment=moment)
    assert sampled_command.run() == 0
    sampled_command.assert_result_is(uninterrupted)


def test_interrupts_and_full_disks_are_said_in_a_line_and_lose_nothing(command, uninterrupted):
    for _ in range(2):
        assert command.run(moment="an interrupt") == 130
        last = command.stderr.splitlines()[-1]
        assert last.startswith("Interrupted; resume with: bayes-ssi rank ")
        assert command.run(moment="a full disk") == 2
        last = command.stderr.splitlines()[-1]
        assert last.endswith(f".journal: No space left on device; {NOTHING_LOST}")
    assert command.run() == 0
    assert command.stderr.startswith("model class 'one k': resumes after ")
    command.assert_result_is(uninterrupted)


def test_files_of_a_result_that_cannot_be_written_lose_nothing(sampled_command, uninterrupted):
    for n_bytes in LIMITS:
        assert sampled_command.run(moment=n_bytes) == 2
        last = sampled_command.stderr.splitlines()[-1]
        assert last.startswith(f"Error: {sampled_command.result}")
        assert last.endswith(f": File too large; {NOTHING_LOST}")
        assert [path.name for path in sampled_command.place.iterdir()] == [".r.checkpoint"]
    assert sampled_command.run() == 0
    sampled_command.assert_result_is(uninterrupted)


def test_a_result_that_was_there_before_is_not_overwritten(sampled_command, uninterrupted):
    command = with_old_result(sampled_command, uninterrupted)
    before = command.journals
    assert command.run() == 2
    command.assert_one_line_error("exists already and is not overwritten")
    assert (command.result / "comparison.json").read_text() == "old"
    assert command.journals == before


def test_a_result_that_appears_in_the_meantime_is_not_overwritten(command, sampled):
    process = command.start()
    command.wait_for_journals_of(0)
    command.result.mkdir()
    assert exit_code(process) == 2
    assert "exists already and is not overwritten" in command.stderr
    assert list(command.result.iterdir()) == []
    assert total_size(command.checkpoint) == total_size(sampled), "and nothing is lost"


def test_the_result_of_other_classes_is_not_overwritten(sampled_command):
    """Not even where the run of those was killed after it had written its result."""
    sampled_command.dies(moment="everything is done")
    assert sampled_command.run("--class", "each k") == 2
    sampled_command.assert_one_line_error("exists already and is not overwritten")
    assert load_result(sampled_command.result).comparison.best.name == "one k"
