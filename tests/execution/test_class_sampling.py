"""Several classes with workers: whole classes or shared evaluations, progress, and deaths."""

import os
import time
from typing import ClassVar

import pytest
from conftest import COARSE

import bayes_ssi as bs
from bayes_ssi.execution.workers import Workers, local_workers
from bayes_ssi.ranking import class_sampling
from bayes_ssi.ranking.checkpoint import Checkpoint
from bayes_ssi.ranking.class_sampling import SLOW, _seconds_per_evaluation, sample_all
from bayes_ssi.ranking.progress_files import ProgressFile, ProgressReader

pytestmark = pytest.mark.usefixtures("nothing_hangs")


def with_structure(candidate, kind, name="x"):
    old = candidate.structure
    return candidate.with_structure(kind(old.masses, old.stiffnesses), name)


@pytest.fixture
def batches(monkeypatch):
    """Names the sizes of batches that workers share."""
    sizes, evaluate = [], Workers.evaluate

    def counted(self, function, z):
        sizes.append(len(z))
        return evaluate(self, function, z)

    monkeypatch.setattr(Workers, "evaluate", counted)
    return sizes


def evidences(posteriors):
    return {posterior.name: posterior.evidence for posterior in posteriors}


@pytest.fixture(scope="module")
def alone(tiny_study):
    return sample_all(tiny_study.model_classes, 7, COARSE)


def test_fast_classes_go_to_workers_as_a_whole(
    tiny_study, alone, two_workers, batches, monkeypatch
):
    monkeypatch.setattr(class_sampling, "_seconds_per_evaluation", lambda _: 0.5 * SLOW)
    told = []
    found = sample_all(
        tiny_study.model_classes, 7, COARSE, lambda *what: told.append(what), two_workers
    )
    assert batches == []
    assert [posterior.name for posterior in found] == list(tiny_study.names)
    assert evidences(found) == evidences(alone)
    for name in tiny_study.names:
        own = [(step, done) for each, step, done in told if each == name]
        assert own[-1] == ("evidence", 1.0)
        assert own.count(own[-1]) == 1


def test_slow_classes_share_their_evaluations(tiny_study, alone, two_workers, batches, monkeypatch):
    first = tiny_study.model_classes[0]
    monkeypatch.setattr(
        class_sampling, "_seconds_per_evaluation", lambda each: 1.0 if each is first else 0.0
    )
    found = sample_all(tiny_study.model_classes, 7, COARSE, None, two_workers)
    assert sum(batches) > 100
    assert evidences(found) == evidences(alone)


def test_one_class_shares_its_evaluations(tiny_study, two_workers, batches):
    sample_all(tiny_study.model_classes[:1], 7, COARSE, None, two_workers)
    assert batches


class DiesOnce(bs.ShearBuilding):
    """Kills the process that it is first evaluated in, unless that is the tests' own."""

    def modes(self, values):
        marker = os.environ["DIES_ONCE"]
        if str(os.getpid()) != os.environ["DIES_NOT"] and not os.path.exists(marker):
            open(marker, "w").close()
            os._exit(1)
        return super().modes(values)


def test_classes_whose_worker_died_are_sampled_all_the_same(
    tiny_study, tmp_path, monkeypatch, batches
):
    monkeypatch.setenv("DIES_ONCE", str(tmp_path / "died"))
    monkeypatch.setenv("DIES_NOT", str(os.getpid()))
    classes = [with_structure(each, DiesOnce, each.name) for each in tiny_study.model_classes]
    with local_workers(2) as pool:
        found = sample_all(classes, 7, COARSE, None, pool)
    assert (tmp_path / "died").exists()
    assert batches
    expected = sample_all(classes, 7, COARSE)
    assert evidences(found) == evidences(expected)


def test_classes_in_workers_go_on_from_their_checkpoints(tiny_study, alone, tmp_path, two_workers):
    """And it is said here which do, since workers say nothing."""
    told = []
    checkpoint = Checkpoint(tmp_path / "c", say=told.append)
    first, second = tiny_study.model_classes
    sample_all([first], 7, COARSE, None, None, checkpoint)
    assert told == []
    found = sample_all([first, second], 7, COARSE, None, two_workers, checkpoint)
    assert told == [f"continues an earlier run of {first.name!r}"]
    assert evidences(found) == evidences(alone)


class Sleeps(bs.ShearBuilding):
    calls: ClassVar = []

    def modes(self, values):
        self.calls.append(len(values))
        time.sleep(2.0 * SLOW * len(values))
        return super().modes(values)


class SleepsLong(Sleeps):
    calls: ClassVar = []

    def modes(self, values):
        time.sleep(0.25)
        return super().modes(values)


class Fails(bs.ShearBuilding):
    def modes(self, _):
        raise ArithmeticError("no")


def test_what_an_evaluation_costs(tiny_study):
    candidate = tiny_study.model_classes[0]
    # The least of several: other work may come between.
    assert 0.0 < min(_seconds_per_evaluation(candidate) for _ in range(5)) < SLOW
    assert _seconds_per_evaluation(with_structure(candidate, Sleeps)) > SLOW
    assert Sleeps.calls == [1, 1, 32]
    assert _seconds_per_evaluation(with_structure(candidate, SleepsLong)) > 0.2
    assert SleepsLong.calls == [1]
    assert _seconds_per_evaluation(with_structure(candidate, Fails)) == 0.0


def test_errors_of_a_class_in_a_worker_are_its_own(tiny_study, two_workers):
    failing = with_structure(tiny_study.model_classes[0], Fails, "fails")
    both = [failing, tiny_study.model_classes[1]]
    with pytest.raises(ValueError, match="model class 'fails': structure Fails fails at the prior"):
        sample_all(both, 7, COARSE, None, two_workers)


def test_progress_is_passed_on_once_and_ends_with_the_answer(tmp_path):
    told = []
    reader = ProgressReader(str(tmp_path), ["a", "b"], lambda *what: told.append(what))
    write = reader.file(1)
    reader.tell()
    assert told == []
    write("b", "searches", 0.25)
    reader.tell()
    reader.tell()
    assert told == [("b", "searches", 0.25)]
    write("b", "searches", 0.5)  # too soon after the other one
    reader.tell()
    write("b", "tempered start", 0.0)  # another step is told at once
    reader.tell()
    write("b", "evidence", 1.0)
    reader.tell()
    assert told[1:] == [("b", "tempered start", 0.0)]
    reader.end(1)
    reader.tell()
    assert told[2:] == [("b", "evidence", 1.0)]


def test_progress_without_a_common_file_system_is_not_told(tmp_path):
    ProgressFile(str(tmp_path / "elsewhere" / "0"))("a", "searches", 0.5)
    assert list(tmp_path.iterdir()) == []


def test_progress_comes_while_others_work(tmp_path, two_workers):
    """Workers say how far they are before they end."""
    told = []
    reader = ProgressReader(str(tmp_path), ["a"], lambda *what: told.append(what))
    found = two_workers.try_each(_works, [reader.file(0)], reader.end, reader.tell)
    assert found == {0: "done"}
    assert told[-1] == ("a", "evidence", 1.0)
    assert ("a", "searches", 0.0) in told[:-1]


def _works(report):
    report("a", "searches", 0.0)
    time.sleep(0.8)
    return "done"
