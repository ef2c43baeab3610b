"""Results on disk: read back equal, never overwritten, refused in one line where damaged."""

import csv
import json
import re
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from conftest import assert_refused
from searches import COARSE

import bayes_ssi as bs
from bayes_ssi.foundations.codec import to_record
from bayes_ssi.foundations.text_files import file_names
from bayes_ssi.inference.posterior.posterior import draws_with_shapes
from bayes_ssi.results.stored_result import ResultRecord, load_result, save_result
from bayes_ssi.results.stored_what_if import recorded_class


@pytest.fixture
def directory(tiny_result, tmp_path):
    """A copy of a result."""
    return shutil.copytree(tiny_result.directory, tmp_path / "result")


def assert_equal_posteriors(a, b):
    for item in fields(a):
        left, right = getattr(a, item.name), getattr(b, item.name)
        if item.name == "importance_draws":
            continue  # they are saved for others, and not read back
        if item.name == "datum_terms":
            for own in ("data", "identified", "identified_hz", "predicted_hz"):
                np.testing.assert_array_equal(getattr(left, own), getattr(right, own), err_msg=own)
            # Of a constant term, some millionths of a nat are moved to another.
            np.testing.assert_allclose(left.log_likelihoods, right.log_likelihoods, atol=2e-5)
        elif isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right, err_msg=item.name)
        else:
            assert left == right, item.name


def public(one):
    return {name for name in dir(one) if not name.startswith("_")}


def test_a_result_has_the_same_attributes_before_and_after_it_is_saved(tiny_ranking, tiny_result):
    saved = tiny_result
    loaded = load_result(saved.directory)
    assert public(tiny_ranking) == public(saved) == public(loaded)
    assert public(tiny_ranking.record) == public(saved.record)
    data = tiny_ranking.study.model_classes[0].data
    for again in (saved, loaded):
        for name in public(again) - {"directory", "study", "record"}:
            before, after = getattr(tiny_ranking, name), getattr(again, name)
            if name in ("posteriors", "ranked_posteriors"):
                for a, b in zip(after, before, strict=True):
                    assert_equal_posteriors(a, b)
                    assert a.summary == b.summary
            elif name == "posterior":
                assert_equal_posteriors(before("one k"), after("one k"))
            elif name == "to_frame":
                assert before().equals(after())
            elif name == "summary":
                assert before() == after()
            elif name in ("tests", "data"):
                assert str(before) == str(after)
            else:
                assert before == after, name
        assert (again.data.digest, again.data.source) == (data.digest, data.source)
    only_saved = {"created", "command", "study_file", "draws", "data"}
    for item in fields(saved.record):
        if item.name not in only_saved:
            before, after = (getattr(each.record, item.name) for each in (tiny_ranking, saved))
            assert to_record(before) == to_record(after), item.name
    ranked = [posterior.name for posterior in saved.ranked_posteriors]
    assert ranked == [row.name for row in saved.comparison.classes]
    assert saved.study is None
    assert tiny_ranking.directory is None
    for one in (tiny_ranking, saved):
        with pytest.raises(ValueError, match="no model class '3'; choose from 'one k', 'each k'"):
            one.posterior("3")


def test_what_a_directory_holds(directory):
    assert {p.relative_to(directory).as_posix() for p in directory.rglob("*.*")} == {
        "result.json", "data.csv", "comparison.json", "comparison.csv", "digests.json",
        "posteriors/one_k.nc", "posteriors/each_k.nc",
        "posteriors/one_k.npz", "posteriors/each_k.npz",
    }  # fmt: skip


def test_the_record_documents_how_the_result_was_made(tiny_result):
    record = json.loads((tiny_result.directory / "result.json").read_text(encoding="utf-8"))
    assert record["study"] == "Two storeys"
    assert record["study_file"] == str(tiny_result.directory.with_name("tiny.py"))
    assert record["seed"] == 7
    assert record["settings"]["log_evidence_error"] == 0.01
    assert record["versions"].keys() >= {"python", "numpy", "scipy", "emcee", "arviz"}
    assert record["versions"]["numpy"] == np.__version__
    assert record["data_digest"] == tiny_result.data.digest
    assert [entry["name"] for entry in record["model_classes"]] == ["one k", "each k"]
    prior = record["model_classes"][0]["parameters"][0]["prior"]
    assert prior == {"distribution": "LogNormal", "median": 1.0, "cov": 0.3}


def test_the_ranking_as_a_spreadsheet_reads_it(tiny_result):
    with (tiny_result.directory / "comparison.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row, expected in zip(rows, tiny_result.comparison.classes, strict=True):
        assert row["name"] == expected.name
        assert float(row["log_evidence"]) == expected.log_evidence
        assert float(row["probability"]) == expected.probability


def test_a_result_is_overwritten_on_request_alone(tiny_ranking, directory):
    (directory / "figures").mkdir()
    before = (directory / "result.json").read_bytes()
    with pytest.raises(FileExistsError, match="exists already and is not overwritten"):
        save_result(tiny_ranking, directory)
    assert (directory / "result.json").read_bytes() == before
    assert save_result(replace(tiny_ranking, seed=8), directory, overwrite=True).record.seed == 8
    assert not (directory / "figures").exists()


def test_overwriting_spares_what_is_no_part_of_the_result(tiny_ranking, directory):
    (directory / "report").mkdir()
    (directory / "note.txt").write_text("weeks of work")
    (directory / ".DS_Store").touch()
    with pytest.raises(FileExistsError, match=r"result: note\.txt would be lost; move it first"):
        save_result(tiny_ranking, directory, overwrite=True)
    assert (directory / "note.txt").read_text() == "weeks of work"


def test_overwriting_spares_a_directory_that_is_no_result(tiny_ranking, tmp_path):
    precious = tmp_path / "measurements" / "test_1.dat"
    precious.parent.mkdir()
    precious.write_text("weeks of work")
    with pytest.raises((ValueError, OSError), match="measurements"):
        save_result(tiny_ranking, precious.parent, overwrite=True)
    assert precious.read_text() == "weeks of work"


@pytest.mark.parametrize("overwrite", [False, True])
def test_failed_writing_leaves_nothing(tiny_ranking, directory, tmp_path, monkeypatch, overwrite):
    if not overwrite:
        shutil.rmtree(directory)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*.*") if p.is_file()}

    def disk_full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("bayes_ssi.results.stored_result._write_comparison_csv", disk_full)
    with pytest.raises(OSError, match="no space left"):
        save_result(tiny_ranking, directory, overwrite=overwrite)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*.*") if p.is_file()} == before
    assert len(list(tmp_path.iterdir())) == (1 if overwrite else 0)


def test_class_names_need_not_be_file_names():
    names = ["a/b", "a:b", "A?B", "..", "θ", "a_b", 300 * "k" + "a", 300 * "k" + "b"]
    files = file_names(names, "nc")
    assert len({file.lower() for file in files.values()}) == len(names)
    for file in files.values():
        assert file.endswith(".nc")
        assert len(file) < 255
        assert not set(file) & set('/\\:*?"<>|')
        assert not file.startswith("..")


def test_prior_weights_are_recorded(tiny_ranking, tmp_path):
    weights = {"one k": 2.0, "each k": 1.0}
    weighted = replace(tiny_ranking, study=replace(tiny_ranking.study, prior_weights=weights))
    assert save_result(weighted, tmp_path / "r").record.prior_weights == weights


@pytest.mark.parametrize("r_hat", [np.inf, np.nan])
def test_a_result_with_a_diagnostic_that_is_no_number_can_be_saved(tiny_ranking, tmp_path, r_hat):
    """That is when the failed check must reach the user."""
    posteriors = tuple(replace(p, r_hat=r_hat) for p in tiny_ranking.posteriors)
    saved = save_result(replace(tiny_ranking, posteriors=posteriors), tmp_path / "r")
    np.testing.assert_equal(saved.posteriors[0].r_hat, r_hat)


def edited(*keys, value=None):
    """Sets an item of a JSON file, or removes it if the value is None."""

    def edit(path):
        record = inner = json.loads(path.read_text(encoding="utf-8"))
        for key in keys[:-1]:
            inner = inner[key]
        inner.pop(keys[-1]) if value is None else inner.update({keys[-1]: value})
        path.write_text(json.dumps(record), encoding="utf-8")

    return edit


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def with_text(old, new):
    def replace_text(path):
        text = path.read_text("utf-8")
        assert old in text
        path.write_text(text.replace(old, new), "utf-8")

    return replace_text


def with_other_draws(path):
    import h5py

    with h5py.File(path, "r+") as file:
        file["posterior"]["k"][0, 0] = 2.0


RESULT, COMPARISON = "result.json", "comparison.json"


@pytest.mark.parametrize(
    ("file", "damage", "message"),
    [
        (RESULT, Path.unlink, "not a result directory: no result.json"),
        (RESULT, cut, "result.json: damaged: "),
        (RESULT, lambda path: path.write_bytes(b"\xff\xfe\0"), "result.json: damaged: "),
        (RESULT, lambda path: path.write_text("[1, 2]"), "result.json: damaged: not a record"),
        (RESULT, edited("format", value=99),
         f"of format 99, this version reads format {ResultRecord.format}"),
        (RESULT, edited("posteriors"), "result.json: posteriors: missing"),
        (COMPARISON, Path.unlink, "comparison.json: no such file; the result is incomplete"),
        ("posteriors/one_k.nc", Path.unlink, "one_k.nc: no such file; the result is incomplete"),
        ("data.csv", Path.unlink, "data.csv: no such file; the result is incomplete"),
        ("data.csv", with_text("1.618", "1.619"), "data.csv: changed after"),
        ("digests.json", Path.unlink, "no digests.json"),
        # Numbers that were edited, and are as good as any other.
        (COMPARISON, edited("classes", 0, "probability", value=0.99), "comparison.json: changed"),
        (RESULT, edited("posteriors", 0, "evidence", "log_evidence", value=-1.0),
         "result.json: changed after"),
        ("posteriors/one_k.nc", with_other_draws, "one_k.nc: changed after"),
    ],
)  # fmt: skip
def test_a_damaged_directory_is_refused_in_one_line(directory, file, damage, message):
    damage(directory / file)
    assert_refused(f"{re.escape(str(directory))}.*{re.escape(message)}", load_result, directory)


def test_recorded_classes_have_the_likelihoods_of_the_study(tmp_path, tiny_ranking):
    """Also with inferred errors, products, and priors that a class replaces."""
    tiny = tiny_ranking.study.model_classes[0]
    ratio = bs.Parameter("ratio", bs.LogNormal(1.0, 0.5))
    own = bs.ModelClass(
        "own", tiny.structure, tiny.data, bs.ErrorModel(shape_sd=0.05 * ratio), pairing="any",
        identification=bs.IdentificationModel(0.9, 0.3), priors={"k": bs.Normal(1.0, 0.1)},
    )  # fmt: skip
    ranking = bs.rank(bs.Study("s", [tiny, own]), settings=COARSE)
    stored = save_result(ranking, tmp_path / "r")
    for model_class, posterior in zip(ranking.study.model_classes, ranking.posteriors, strict=True):
        recorded = recorded_class(stored, model_class.name)
        assert recorded.parameters == model_class.parameters
        assert recorded.error == model_class.error
        values = posterior.values[draws_with_shapes(len(posterior.values))]
        ours, theirs = (each.log_likelihood(values) for each in (recorded, model_class))
        np.testing.assert_array_equal(ours, theirs)
