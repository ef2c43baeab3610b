"""``bayes-ssi search``: its options, what it saves, and resuming after an interruption."""

import json
import math
import shutil

import pytest
from conftest import assert_one_line_error, succeeded
from searches import INFILL_01, INFILL_12, PENDULUM_1, by_count

import bayes_ssi as bs
from bayes_ssi.foundations.codec import to_record

ONE_K = ("--class", "one k")
pytestmark = pytest.mark.usefixtures("coarse_command", "quick_screening")


@pytest.fixture
def one_place(monkeypatch):
    """Few hypotheses are soon saved."""
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: (PENDULUM_1,))


def test_search_saves_a_result(run, tiny_study_file, tmp_path, fake_sampling, monkeypatch):
    monkeypatch.setattr(
        "bayes_ssi.studies.appendages.baselines.places_of", lambda _: (PENDULUM_1, INFILL_01)
    )
    levels = fake_sampling(by_count(0.0, 1.0, 2.0))
    out = tmp_path / "r"
    result = run("search", tiny_study_file, *ONE_K, "--out", out, "--seed", 3, "--verbose")
    assert result.exit_code == 0, result.output
    *levels, rivals = levels
    assert rivals == ["each k"]
    assert len(levels) == 3
    for words in (
        "Appendages hidden in 'one k'",
        "no appendage",
        "naive mean",
        "Appendages by place, averaged over all hypotheses",
        f"Saved in {out}. Everything, with figures, on one page: bayes-ssi report {out}",
    ):
        assert words in " ".join(result.stdout.split())
    record = json.loads((out / "search.json").read_text(encoding="utf-8"))
    assert len(record["hypotheses"]) == sum(map(len, levels))
    stored = bs.load_result(out)
    assert stored.record.seed == 3
    assert len(stored.posteriors) == len(record["hypotheses"])


@pytest.mark.usefixtures("one_place")
def test_a_baseline_is_named_and_results_go_to_runs(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(1.0, 0.0))
    result = run("search", tiny_study_file, "--class", "each k")
    assert "Appendages hidden in 'each k'" in result.stdout
    assert (tmp_path / "work" / "runs" / "results" / "tiny_search" / "search.json").is_file()


@pytest.mark.usefixtures("one_place")
def test_all_classes_of_a_study_are_baselines(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(lambda made: 2.0 * made.name.startswith("each k")
                  - len(made.structure.appendages))  # fmt: skip
    result = succeeded(run("search", tiny_study_file, "--verbose", "--out", tmp_path / "r"))
    text = " ".join(result.stdout.split())
    assert "Appendages hidden in 'Two storeys'" in text
    e = math.exp
    share = e(2.0) / (1.0 + e(2.0))
    assert f"'each k' ({share:.4f}) and 'one k' ({1.0 - share:.4f})" in text
    record = json.loads((tmp_path / "r" / "search.json").read_text(encoding="utf-8"))
    expected = {
        f"{baseline}: {name}": own * factor / (1.0 + e(-1.0))
        for baseline, own in (("each k", share), ("one k", 1.0 - share))
        for name, factor in (("no appendage", 1.0), ("pendulum 1", e(-1.0)))
    }
    found = {row["name"]: row["probability"] for row in record["hypotheses"]}
    assert found == pytest.approx(expected)


@pytest.mark.usefixtures("one_place")
@pytest.mark.parametrize(
    ("options", "lead", "warned", "noted"),
    [
        (ONE_K, 6.0, True, False),
        (ONE_K, 4.0, False, False),
        ((), 6.0, False, True),  # the average has all but 0.002 on the better one
    ],
)
def test_a_baseline_that_another_class_beats_is_said_aloud(
    run, tiny_study_file, tmp_path, fake_sampling, options, lead, warned, noted
):
    fake_sampling(lambda made: lead * made.name.startswith("each k"))
    result = run("search", tiny_study_file, *options, "--verbose", "--out", tmp_path / "r")
    text = " ".join(result.stdout.split())
    assert result.exit_code == 0, result.output
    assert ("(!) The answer rests on a baseline that another class beats by far." in text) == warned
    said = f"(!) 'one k': without any appendage, 'each k' beats it by {lead:.1f} nats."
    assert (said in text) == noted


@pytest.mark.parametrize(("most", "n_levels"), [(1, 2), (3, 4)])
def test_the_largest_number_of_appendages(
    run, tiny_study_file, tmp_path, fake_sampling, most, n_levels, monkeypatch
):
    places = (PENDULUM_1, INFILL_01, INFILL_12)
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: places)
    levels = fake_sampling(by_count(0.0, 1.0, 2.0, 3.0, 4.0))
    options = (*ONE_K, "--most", most, "--out", tmp_path / "r")
    assert run("search", tiny_study_file, *options).exit_code == 0
    *levels, rivals = levels
    assert rivals == ["each k"]
    assert len(levels) == n_levels


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--most", 0), ()),
        (("--most", 100_000), ()),
        (("--mass", 0.0, 1.0), ()),
        (("--frequency", 3.0, 1.0), ()),
        (("--frequency", 0.0, 1.0), ()),
        (("--error", -1.0), ()),
        (("--class", "no k"), ("no model class 'no k'", "'one k', 'each k'")),
        (("--in", "with mast"), ("'one k' has one configuration", "'with mast'")),
    ],
)
def test_bad_options_of_a_search_are_refused(run, tiny_study_file, options, words, fake_sampling):
    levels = fake_sampling(by_count(0.0, 0.0))
    assert_one_line_error(run("search", tiny_study_file, *options), *words)
    assert levels == []


@pytest.mark.usefixtures("one_place")
def test_priors_of_the_command_line_are_used(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(1.0, 0.0))
    arguments = (*ONE_K, "--mass", 0.2, 0.5, "--frequency", 1.5, 2.5, "--out", tmp_path / "r")
    assert run("search", tiny_study_file, *arguments).exit_code == 0
    text = (tmp_path / "r" / "result.json").read_text(encoding="utf-8")
    (one,) = [c for c in json.loads(text)["model_classes"] if c["name"] == "pendulum 1"]
    priors = {p["name"]: p["prior"] for p in one["parameters"]}
    assert priors["mass ratio, pendulum 1"] == to_record(bs.LogUniform(0.2, 0.5))
    assert priors["frequency, pendulum 1"] == to_record(bs.LogUniform(1.5, 2.5))


def test_candidates_of_a_file_are_tried(run, tiny_study_file, tmp_path, fake_sampling):
    levels = fake_sampling(by_count(1.0, 0.0))
    candidates = tmp_path / "places.csv"
    candidates.write_text("name,place\nroof,floor 2\n", encoding="utf-8")
    arguments = (*ONE_K, "--candidates", candidates, "--out", tmp_path / "r")
    assert run("search", tiny_study_file, *arguments).exit_code == 0
    assert levels[:2] == [["no appendage"], ["pendulum roof"]]
    candidates.write_text("name,place\nroof,floor 9\n", encoding="utf-8")
    refused = run("search", tiny_study_file, *ONE_K, "--candidates", candidates, "--overwrite")
    assert_one_line_error(refused, "model class 'one k': candidate 'roof': ", "'floor 9'")


def stop(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.usefixtures("no_motions")
def test_an_interrupted_search_is_resumed_and_leaves_no_checkpoint(
    run, tiny_study_file, tmp_path, monkeypatch
):
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: (INFILL_01,))
    monkeypatch.setattr(
        "bayes_ssi.studies.search.family_search.to_sample",  # every hypothesis
        lambda approximate, sampled, *_: [each for each in approximate if each not in sampled],
    )
    out = tmp_path / "r"
    arguments = ("search", tiny_study_file, *ONE_K, "--error", 0.5, "--accept-failed-checks",
                 "--out", out)  # fmt: skip

    with monkeypatch.context() as patch:
        patch.setattr("bayes_ssi.studies.search.family_search.ranked", stop)
        stopped = run(*arguments)
    assert stopped.exit_code == 130
    assert "Interrupted; resume with: bayes-ssi search " in stopped.stderr
    # As if hypotheses had been sampled that are not tried the next time.
    kept, *_ = (tmp_path / ".r.checkpoint").iterdir()
    shutil.copy(kept, kept.with_name("with_two_appendages"))
    assert "an earlier run was interrupted; it is resumed" in succeeded(run(*arguments)).stderr
    assert not (tmp_path / ".r.checkpoint").exists()
    assert {p.name for p in bs.load_result(out).posteriors} == {"no appendage", "infill 0-1"}


@pytest.mark.usefixtures("one_place")
def test_a_failed_check_of_a_search_has_exit_code_3(run, tiny_study_file, tmp_path, fake_sampling):
    fake_sampling(by_count(0.0, 1.0), failed_checks=("the ensembles differ",))
    result = run("search", tiny_study_file, "--out", tmp_path / "r")
    assert result.exit_code == 3
    assert "Do not trust the ranking until" in result.stdout
    assert (tmp_path / "r" / "search.json").is_file()
