"""Predictions from a result directory and a study file, without sampling."""

import re
import shutil

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi import study as study_module
from bayes_ssi.response import Output
from bayes_ssi.results import save_result
from bayes_ssi.stored_predictions import load_predictions

ROOF = Output("acceleration", ("floor 2",))
FREQUENCIES = np.linspace(0.2, 2.0, 20)


@pytest.fixture
def saved(tiny_ranking, tmp_path, tiny_study_file):
    return save_result(tiny_ranking, tmp_path / "result", study_file=str(tiny_study_file)).directory


def test_a_stored_result_predicts_without_sampling(saved, tiny_study_file, monkeypatch):
    def refuse(*_):
        raise AssertionError("sampled")

    monkeypatch.setattr(study_module, "sample", refuse)
    by_record = load_predictions(saved, n_draws=50)
    named = load_predictions(saved, tiny_study_file, n_draws=50)
    for name in ("one k", "each k"):
        found = [
            each.of_class(name).transfer_functions(FREQUENCIES, ROOF, 0.02).draws
            for each in (by_record, named)
        ]
        assert found[0].shape == (50, 1, 20)
        np.testing.assert_array_equal(*found)
    average = by_record.average()
    probabilities = {row.name: row.probability for row in by_record.stored.comparison.classes}
    assert average.n_draws == 50
    for each in average.classes:
        assert len(each.values) == pytest.approx(50 * probabilities[each.name], abs=1)
    with pytest.raises(ValueError, match="no model class 'two k'; choose from 'one k', 'each k'"):
        by_record.of_class("two k")


def test_classes_whose_pairing_was_inferred(tmp_path, tiny_study_file):
    text = tiny_study_file.read_text("utf-8")
    # Two classes that differ in their pairing alone become one when it is inferred.
    text = text.replace('bs.ShearBuilding((1.0, 1.0), (K * k1, K * k2)), modes, error,\n'
                        "                      pairing=pairing)",
                        'bs.ShearBuilding((1.0, 1.0), (K * k, K * k)), modes, error,\n'
                        '                      pairing={"1": 1})')  # fmt: skip
    tiny_study_file.write_text(text, "utf-8")
    study = study_module.load_study(tiny_study_file).with_any_pairing()
    ranking = bs.rank(study, settings=bs.SamplingSettings(log_evidence_error=0.1))
    assert study.names == ("one k or each k",)
    save_result(ranking, tmp_path / "any", study_file=str(tiny_study_file))
    found = load_predictions(tmp_path / "any", n_draws=20).of_class("one k or each k")
    assert found.frequencies_hz("2").draws.mean() == pytest.approx(1.618, rel=0.02)


def test_the_study_file_is_not_there(saved, tiny_study_file):
    tiny_study_file.unlink()
    with pytest.raises(ValueError, match=r"result: its study file '.*tiny.py' is not there; say"):
        load_predictions(saved)
    with pytest.raises(ValueError, match=r"tiny.py: no such file"):
        load_predictions(saved, tiny_study_file)


def test_the_study_file_defines_other_classes(saved, tiny_study_file):
    text = tiny_study_file.read_text("utf-8")
    tiny_study_file.write_text(text.replace('"each k"', '"both k"'), "utf-8")
    with pytest.raises(
        ValueError, match=r"no model class 'each k', which .* is of; it defines 'one k', 'both k'"
    ):
        load_predictions(saved)


def test_the_result_of_a_search(saved, tiny_study_file):
    text = tiny_study_file.read_text("utf-8")
    tiny_study_file.write_text(text.replace('"each k"', '"both k"'), "utf-8")
    (saved / "search.json").write_text("{}", "utf-8")
    with pytest.raises(ValueError, match="the result of a search; its hypothesis 'each k' is in"):
        load_predictions(saved)


def test_the_study_file_has_changed(saved, tiny_study_file):
    text = tiny_study_file.read_text("utf-8")
    tiny_study_file.write_text(text.replace("(K * k, K * k)", "(K * k, 2 * K * k)"), "utf-8")
    predicted = load_predictions(saved)
    with pytest.raises(ValueError, match="model class 'one k' is not the one that was sampled"):
        predicted.of_class("one k")
    assert predicted.of_class("each k").n_draws == 1000


@pytest.mark.parametrize(
    "missing", ["result.json", "comparison.json", "data.csv", "posteriors/one_k.nc", "posteriors"]
)
def test_a_result_that_is_incomplete(saved, missing):
    path = saved / missing
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(ValueError, match=re.escape(str(saved))) as caught:
        load_predictions(saved)
    assert "\n" not in str(caught.value)


def test_a_directory_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match="none: not a result directory"):
        load_predictions(tmp_path / "none")
