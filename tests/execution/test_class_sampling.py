"""Several classes with workers: whole or shared, the same results, and how many are chosen."""

import json
import logging
import os
import threading
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import COARSE, assert_one_line_error
from delegating import DelegatingStructure

import bayes_ssi as bs
from bayes_ssi.inference.workers.run import Checkpoint
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.studies.ranking import class_sampling as module
from bayes_ssi.studies.ranking.class_sampling import (
    ProgressFile,
    _side_by_side,
    automatic_workers,
    chosen_workers,
    holds_user_code,
    sample_all,
)

pytestmark = pytest.mark.usefixtures("nothing_hangs")


@pytest.fixture(autouse=True)
def _four_cores_and_few_parts(monkeypatch):
    """A batch in fewer parts is there sooner: these take longer to send than the model."""
    monkeypatch.setattr(Workers, "parts_per_worker", 1)
    monkeypatch.setattr(module, "usable_cores", lambda: 4)
    monkeypatch.setattr(module, "can_copy", lambda: True)


def with_structure(candidate, kind, name="x"):
    old = candidate.structure
    return replace(candidate, name=name, structure=kind(old.masses, old.stiffnesses))


def test_completed_steps_are_logged(tiny_study, caplog, capfd):
    run = bs.Run()
    run.report("a class", "searches", 1.0)  # as by default, without any output
    assert capfd.readouterr() == ("", "")
    with caplog.at_level(logging.INFO, "bayes_ssi"):
        bs.rank(tiny_study.only(["one k"]), settings=COARSE, run=run)
    assert "one k: evidence 100 %" in caplog.messages
    assert all(message.endswith(" 100 %") for message in caplog.messages)


@pytest.fixture
def shared(monkeypatch):
    """Names of the classes whose evaluations workers share."""
    names, evaluate = set(), Workers.evaluate

    def noted(self, function, z):
        names.add(function.__self__.name)
        return evaluate(self, function, z)

    monkeypatch.setattr(Workers, "evaluate", noted)
    return names


def assert_same(ones, others):
    for one, other in zip(ones, others, strict=True):
        for name in ("draws", "log_likelihoods", "frequencies_hz", "maxima"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        for name in ("name", "evidence", "regions", "n_evaluations", "failed_checks"):
            assert getattr(one, name) == getattr(other, name)


@pytest.fixture(scope="module")
def alone(tiny_study):
    return sample_all(tiny_study.model_classes, 7, COARSE)


def test_as_many_classes_as_workers_go_whole(tiny_study, alone, copied_workers, shared, tmp_path):
    """Their evaluations are kept, and a run that is begun again makes none."""
    calls, checkpoint = [], Checkpoint(tmp_path / "c")
    run = bs.Run(copied_workers, checkpoint, progress=lambda *call: calls.append(call))
    assert_same(bs.rank(tiny_study, 7, COARSE, run).posteriors, alone)
    assert shared == set()
    for name in tiny_study.names:
        reports = [call for call in calls if call[0] == name]
        assert reports.count((name, "evidence", 1.0)) == 1
        assert reports[-1] == (name, "evidence", 1.0)
    kept = [path.read_bytes() for path in sorted(checkpoint.directory.iterdir())]
    assert len(kept) == 2
    assert_same(sample_all(tiny_study.model_classes, 7, COARSE, run), alone)
    assert [path.read_bytes() for path in sorted(checkpoint.directory.iterdir())] == kept


def test_workers_report_their_progress(tiny_study, tmp_path, monkeypatch, copied_workers):
    """Through files, of which the last report is read; where there is no directory, nothing."""
    calls = []

    def try_each(_, __, items, ___, meanwhile):
        assert items[0][2].read() is None
        for report in (("a", "searches", 0.25), ("a", "ensembles", 0.5), ("a", "evidence", 1.0)):
            meanwhile()
            items[0][2](*report)
            meanwhile()
        return {}

    monkeypatch.setattr(Workers, "try_each", try_each)
    run = bs.Run(copied_workers, progress=lambda *call: calls.append(call))
    items = [(candidate, None) for candidate in tiny_study.model_classes]
    assert _side_by_side(items, bs.sample, run) == {}
    assert calls == [("a", "searches", 0.25), ("a", "ensembles", 0.5)], "its end is known anyway"
    ProgressFile(tmp_path / "nowhere" / "0")("a", "searches", 0.25)


def test_fewer_classes_share_their_evaluations_unless_they_are_small(tiny_study, alone, shared):
    small, other = tiny_study.model_classes
    other = replace(other, structure=DelegatingStructure(other.structure))
    run = bs.Run(Workers(n_workers=3, copies=True))
    assert_same(sample_all([small, other], 7, COARSE, run), alone)
    assert shared == {other.name}


class DiesOnce(bs.ShearBuilding):
    """Kills the process that it is first evaluated in, unless that is the tests' own."""

    def modes(self, values):
        marker = os.environ["DIES_ONCE"]
        if str(os.getpid()) != os.environ["DIES_NOT"] and not os.path.exists(marker):
            open(marker, "w").close()
            os._exit(1)
        return super().modes(values)


def test_classes_whose_worker_died_are_sampled(tiny_study, alone, tmp_path, monkeypatch, shared):
    monkeypatch.setenv("DIES_ONCE", str(tmp_path / "died"))
    monkeypatch.setenv("DIES_NOT", str(os.getpid()))
    classes = [with_structure(each, DiesOnce, each.name) for each in tiny_study.model_classes]
    assert_same(sample_all(classes, 7, COARSE, bs.Run(Workers(n_workers=2, copies=True))), alone)
    assert (tmp_path / "died").exists()
    assert shared


def test_a_relative_checkpoint_is_where_the_run_was_started(tmp_path, monkeypatch):
    """Independently of the working directory of the workers, as on a cluster."""
    monkeypatch.chdir(tmp_path)
    for checkpoint in (Checkpoint("a"), bs.Run(checkpoint="a").checkpoint):
        assert checkpoint.directory == tmp_path / "a"


class Fails(bs.ShearBuilding):
    def modes(self, _):
        raise ArithmeticError("no")


def test_errors_of_a_class_in_a_worker_are_its_own(tiny_study, copied_workers):
    failing = with_structure(tiny_study.model_classes[0], Fails, "fails")
    both = [failing, tiny_study.model_classes[1]]
    with pytest.raises(ValueError, match="model class 'fails': structure Fails fails at the prior"):
        sample_all(both, 7, COARSE, bs.Run(copied_workers))


class Fragile(bs.ShearBuilding):
    """A structure that fails where its stiffness is more than 1.8 times the median."""

    def modes(self, values):
        if (values[:, 0] > 1.8).any():
            raise ArithmeticError("too stiff")
        return super().modes(values)


def test_one_class_shares_its_evaluations_and_their_failures(copied_workers, tiny_study, shared):
    fragile = with_structure(tiny_study.model_classes[0], Fragile, "fragile")
    here, there = (bs.sample(fragile, 7, COARSE, bs.Run(each)) for each in (None, copied_workers))
    assert_same([there], [here])
    assert shared == {"fragile"}
    (failed,) = [check for check in there.failed_checks if "the model failed" in check]
    how_often, where = failed.split("; the first time at k = ")
    n_failed, n_evaluations = (int(word) for word in how_often.split() if word.isdigit())
    assert 0 < n_failed < n_evaluations == there.n_evaluations
    value, reason = where.split(": ", 1)
    assert float(value) > 1.8
    assert reason.startswith("ArithmeticError: too stiff (test_class_sampling.py, line ")


# ArviZ: there are more chains than steps.
@pytest.mark.filterwarnings("ignore:(More chains|Found chain):UserWarning")
def test_the_command_does_the_same_with_workers(run, alone, tiny_study_file, tmp_path, monkeypatch):
    settings = "bayes_ssi.inference.sampling.settings.SamplingSettings"
    monkeypatch.setattr(settings, lambda **_: COARSE)
    result = run(
        "rank", tiny_study_file, "--class", "one k", "--seed", 7, "--workers", 2,
        "--accept-failed-checks", "--out", tmp_path / "r",
    )  # fmt: skip
    assert (result.exit_code, result.stderr) == (0, "sampled one k\n")
    (row,) = json.loads((tmp_path / "r" / "comparison.json").read_text())["classes"]
    assert row["log_evidence"] == alone[0].evidence.log_evidence


@pytest.mark.parametrize(
    ("workers", "words"), [("0", "0 is not in the range"), ("two", "'two' is not a valid integer")]
)
def test_options_that_make_no_sense_end_in_one_line(run, tiny_study_file, workers, words):
    assert_one_line_error(run("rank", tiny_study_file, "--workers", workers), words)


@pytest.fixture
def n_workers():
    """The number of workers for some classes; 0 for none."""

    def number(classes, n_classes=None):
        workers = automatic_workers(classes, n_classes or len(classes))
        return workers.n_workers if workers else 0

    return number


def own_modes(k):
    return np.array([k]), np.ones((3, 1))


@pytest.fixture
def of_a_function(case_c):
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    structure = bs.FunctionStructure(own_modes, {"k": k}, n_modes=1, sensors=case_c.sensors)
    return bs.ModelClass("function", structure, case_c, pairing={"1": 1})


def test_as_many_as_are_busy(model_classes, n_workers, monkeypatch):
    classes = list(model_classes.values())
    assert n_workers(classes) == 4
    assert n_workers(classes[:3]) == 3
    assert n_workers(classes[:1]) == 0
    assert n_workers(classes[:1], n_classes=7) == 4, "hypotheses built on one class"
    monkeypatch.setattr(module, "usable_cores", lambda: 1)
    assert n_workers(classes) == 0
    # New processes for few small classes cost more than they save.
    monkeypatch.setattr(module, "usable_cores", lambda: 4)
    monkeypatch.setattr(module, "can_copy", lambda: False)
    assert (n_workers(classes[:3]), n_workers(classes)) == (0, 4)


def test_a_users_own_code_stays_in_this_process(model_classes, of_a_function, n_workers):
    classes = list(model_classes.values())
    assert n_workers([*classes, of_a_function]) == 0
    own = replace(classes[0], name="own", structure=DelegatingStructure(classes[0].structure))
    assert n_workers([*classes, own]) == 0
    # Unless workers are asked for; these are no copies of a process that ran the user's code.
    chosen = chosen_workers([*classes, own], 2)
    assert (chosen.n_workers, chosen.copies) == (2, False)
    assert chosen_workers(classes, 99).n_workers == 4
    assert chosen_workers(classes, 2).copies


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        ([np.arange(3.0), "text", {"k": bs.LogNormal(1.0, 0.3)}, partial(np.sum, axis=0)], False),
        ([own_modes], True),
        ({"k": lambda x: x}, True),
        (threading.Lock(), True),
    ],
    ids=["data", "function", "lambda", "cannot be pickled"],
)
def test_what_is_a_users_own_code(what, expected):
    assert holds_user_code(what) is expected
