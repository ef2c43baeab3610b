"""Modes whose identification failed a check: commands that use them say so, and end with 3."""

import json
from dataclasses import replace

import pytest
from conftest import TINY_STUDY
from identified_records import identified
from searches import by_count

import bayes_ssi as bs

CHECK = "identified from tower.csv: chi-square of the spectra is 109 times their freedom"
NOT_IDENTIFIED = (
    "identified from tower.csv: the record shows a mode at 2.5 Hz that is not identified (two "
    "modes share its peak): a model class that has it counts as missing it, and its probability is "
    "too low"
)
WORDS = "2 checks of the identified modes failed"


@pytest.fixture(scope="module")
def path(tmp_path_factory, tiny_study):
    """The tiny study, its modes read from a file whose identification failed."""
    directory = tmp_path_factory.mktemp("study")
    failed = identified(
        "tower.csv",
        doubts=(CHECK.removeprefix("identified from tower.csv: "),),
        not_identified=((2.5, "two modes share its peak"),),
    )
    data = replace(tiny_study.model_classes[0].data, identifications=(failed,))
    bs.write_modal_data(data, directory / "modes.csv")
    begin, end = TINY_STUDY.index("modes = bs.ModalData("), TINY_STUDY.index("error = bs.")
    read = f"modes = bs.read_modal_data({str(directory / 'modes.csv')!r})\n"
    (directory / "tiny.py").write_text(TINY_STUDY[:begin] + read + TINY_STUDY[end:], "utf-8")
    return directory / "tiny.py"


@pytest.fixture(scope="module")
def ranking(path):
    return bs.rank(bs.load_study(path), seed=7)


def flat(text):
    return " ".join(text.split())


def says_both(done):
    words = flat(done.stdout)
    return done.exit_code == 3 and all(each in words for each in (WORDS, CHECK, NOT_IDENTIFIED))


def test_rank(run, path, ranking, monkeypatch):
    posteriors = list(ranking.posteriors)
    monkeypatch.setattr("bayes_ssi.studies.questions.sample_all", lambda *_, **__: posteriors)
    done = run("rank", path, "--seed", 7, "--workers", 1)
    assert says_both(done)
    assert flat(done.stdout).index(WORDS) < done.stdout.index("The most probable")
    assert "one k (!)" not in done.stdout  # no check of a class failed


def test_search(run, path, fake_sampling):
    fake_sampling(by_count(0.0, 12.0))
    assert says_both(run("search", path, "--class", "one k", "--most", "1"))


def test_check(run, path):
    done = run("check", path.parent / "modes.csv")
    assert says_both(done)
    assert "No warnings" not in done.stdout
    record = json.loads(run("check", path.parent / "modes.csv", "--json").stdout)
    assert record["failed_checks"] == [CHECK, NOT_IDENTIFIED]
    assert record["remarks"] == []


def test_calibrate(run, path):
    assert says_both(run("calibrate", path, "--class", "one k", "--starts", 4))


@pytest.mark.parametrize("command", [("what-if", "--spurious", "2"), ("predict", "--draws", "20")])
def test_of_a_result(run, path, ranking, tmp_path, command):
    """Where it was accepted, they are said and no failure."""
    for accepted in (False, True):
        out = tmp_path / str(accepted)
        bs.save_result(ranking, out, study_file=str(path), accept_failed_checks=accepted)
        done = run(command[0], out, *command[1:])
        said = f"{WORDS} (accepted when the result was saved)" in flat(done.stdout)
        assert (done.exit_code == 0 and said) if accepted else says_both(done)
