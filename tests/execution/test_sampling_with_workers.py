"""Sampling with workers: the same results, of one class and of a whole study."""

import os
from pathlib import Path

import pytest
from conftest import COARSE, assert_one_line_error
from pools import spawning

import bayes_ssi as bs
from bayes_ssi.execution.workers import Workers
from bayes_ssi.ranking.checkpoint import Checkpoint
from bayes_ssi.ranking.class_sampling import sample_all

pytestmark = pytest.mark.usefixtures("nothing_hangs")


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


def test_a_relative_checkpoint_is_where_the_run_was_started(tiny_study, tmp_path, monkeypatch):
    """Whatever the working directory of its workers, as those of a cluster."""
    two = tiny_study.model_classes[:2]
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.chdir(here)
    with spawning(1, os.chdir, there) as executor:
        pool = Workers(executor)
        assert pool.call_each(os.path.abspath, ["x"]) == [str(there / "x")]
        for checkpoint in ("a", Path("b"), Checkpoint("c")):
            found = sample_all(two, 7, COARSE, None, pool, checkpoint)
            assert [each.name for each in found] == [each.name for each in two]
    assert list(there.iterdir()) == []
    names = sorted(path.relative_to(here).parts[0] for path in here.rglob("one_k-*.journal"))
    assert names == ["a", "b", "c"]


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


# ArviZ: there are more chains than steps.
@pytest.mark.filterwarnings("ignore:(More chains|Found chain):UserWarning")
@pytest.mark.usefixtures("no_figures")
def test_the_command_gives_the_same_with_workers(run, tiny_study_file, tmp_path, monkeypatch):
    monkeypatch.setattr("bayes_ssi.sampling.settings.SamplingSettings", lambda **_: COARSE)
    arguments = ("rank", tiny_study_file, "--only", "one k", "--accept-failed-checks", "--out")
    assert run(*arguments, tmp_path / "here").exit_code == 0
    assert run(*arguments, tmp_path / "there", "--workers", 2).exit_code == 0
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
    assert_one_line_error(run("rank", tiny_study_file, *options), words)
