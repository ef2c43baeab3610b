"""Predictions from a result directory and a study file, without sampling."""

import json
import shutil

import numpy as np
import pytest
import searches
from conftest import TINY_STUDY, assert_refused, screen_quickly
from searches import PENDULUM_1

import bayes_ssi as bs
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.results.predictions.posterior_draws import thinned_draws
from bayes_ssi.results.result_files import write_digests
from bayes_ssi.studies.appendages.candidates import SearchSettings, appendages_among

ROOF = bs.Output("acceleration", ("floor 2",))
FREQUENCIES = np.linspace(0.2, 2.0, 20)


@pytest.fixture
def saved(tiny_ranking, tmp_path, tiny_study_file):
    return bs.save_result(
        tiny_ranking, tmp_path / "result", study_file=str(tiny_study_file)
    ).directory


def test_a_stored_result_predicts_without_sampling(saved, tiny_study_file, monkeypatch):
    monkeypatch.delattr("bayes_ssi.inference.posterior_sampling.sample.sample_target")
    by_record = bs.load_predictions(saved, n_draws=50)
    named = bs.load_predictions(saved, tiny_study_file, n_draws=50)
    for name in ("one k", "each k"):
        both = (each.of(name) for each in (by_record, named))
        actual = [each.transfer_functions(FREQUENCIES, ROOF, 0.02).draws for each in both]
        assert actual[0].shape == (50, 1, 20)
        np.testing.assert_array_equal(*actual)
    average = by_record.of()
    probabilities = {row.name: row.probability for row in by_record.stored.comparison.classes}
    assert average.n_draws == 50
    for each in average.classes:
        assert len(each.values) == pytest.approx(50 * probabilities[each.name], abs=1)
    assert_refused("no model class 'two k'; choose from 'one k', 'each k'", by_record.of, "two k")


@pytest.mark.parametrize("ranked", [("brace or wall", "x"), ("x",)])
def test_classes_whose_pairing_was_inferred(tmp_path, tiny_study_file, ranked):
    """Classes that differ in their pairing alone become one when it is inferred."""
    text = tiny_study_file.read_text("utf-8")
    one = text[text.index("        bs.ModelClass(") : text.index('        bs.ModelClass("each k"')]
    alike = "".join(one.replace("one k", name) for name in ("brace or wall", "x", "wall"))
    tiny_study_file.write_text(text.replace(one, alike), "utf-8")
    study = bs.load_study(tiny_study_file).only(ranked).with_any_pairing()
    (name,) = study.names
    assert study.stands_for == {name: ranked}
    ranking = bs.rank(study, settings=searches.COARSE)
    bs.save_result(ranking, tmp_path / "any", study_file=str(tiny_study_file))
    predicted = bs.load_predictions(tmp_path / "any", n_draws=5)
    assert predicted.model_classes[name].pairing == "any"
    assert predicted.of(name).n_draws == 5


def test_the_study_file_is_not_there(saved, tiny_study_file):
    tiny_study_file.unlink()
    with pytest.raises(ValueError, match=r"result: its study file '.*tiny.py' is not there; say"):
        bs.load_predictions(saved)
    assert_refused(r"tiny.py: no such file", bs.load_predictions, saved, tiny_study_file)


def test_the_study_file_defines_other_classes(saved, tiny_study_file):
    text = tiny_study_file.read_text("utf-8")
    tiny_study_file.write_text(text.replace('"each k"', '"both k"'), "utf-8")
    words = r"tiny.py: not the study of .*: no model class 'each k'; choose from"
    assert_refused(words, bs.load_predictions, saved)


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """A search on the tiny study's second class, at one place."""
    directory = tmp_path_factory.mktemp("search")
    (directory / "tiny.py").write_text(TINY_STUDY, "utf-8")
    (baseline,) = bs.load_study(directory / "tiny.py").only(["each k"]).model_classes
    settings = SearchSettings(
        mass_ratio=bs.LogNormal(0.04, 0.5), number_weights=(1.0, 0.5), most_unsampled=0.0
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: (PENDULUM_1,))
        screen_quickly(patch)
        actual = bs.search(baseline, settings, settings=searches.COARSE)
    extra, file = {"search.json": actual.record}, str(directory / "tiny.py")
    bs.save_result(actual.ranking, directory / "result", study_file=file, extra=extra)
    return actual, directory / "result"


def test_the_result_of_a_search_predicts_averages_over_hypotheses(searched):
    actual, directory = searched
    predicted = bs.load_predictions(directory, n_draws=40)
    assert set(predicted.model_classes) == {
        "no appendage", "pendulum 1", "motion like mode 1", "motion like mode 2",
    }  # fmt: skip
    for hypothesis in actual.record.hypotheses:
        built = predicted.model_classes[hypothesis.name]
        places = appendages_among(each.place for each in hypothesis.features)
        assert built.structure.appendages == tuple(f"appendage {place.name}" for place in places)
        (sampled,) = (c for c in actual.ranking.study.model_classes if c.name == hypothesis.name)
        assert class_record(built) == class_record(sampled)
    average = predicted.of()
    probabilities = {row.name: row.probability for row in actual.ranking.comparison.classes}
    assert average.n_draws == 40
    for each in average.classes:
        assert len(each.values) == pytest.approx(40 * probabilities[each.name], abs=1)
    draws = predicted.of("pendulum 1").transfer_functions(FREQUENCIES, ROOF, 0.02).draws
    assert draws.shape == (40, 1, 20)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: record.pop("baselines"), "search.json: baselines: missing"),
        (lambda record: record["search_settings"]["mass_ratio"].update(distribution="None"),
         "no distribution 'None'"),
        (lambda record: record["baselines"][0].update(classes=["no k"]),
         "tiny.py: not the study of .*: no model class 'no k'"),
        (lambda record: [feature["place"].get("candidate", {}).update(place=7)
                         for row in record["hypotheses"] for feature in row["features"]],
         "floor"),
    ],
)  # fmt: skip
def test_the_record_of_a_search_is_damaged(searched, tmp_path, change, message):
    copy = shutil.copytree(searched[1], tmp_path / "copy")
    record = json.loads((copy / "search.json").read_text("utf-8"))
    change(record)
    (copy / "search.json").write_text(json.dumps(record), "utf-8")
    write_digests(copy)
    assert_refused(message, bs.load_predictions, copy)


@pytest.fixture(scope="module")
def of_two_tests(tmp_path_factory):
    """The tiny building bare, and with a known mass of 0.5 on its roof, as two configurations."""
    path = tmp_path_factory.mktemp("two") / "two.py"
    path.write_text(TINY_STUDY.split("study = bs.Study(")[0] + """
building = bs.ShearBuilding((1.0, 1.0), (K * k1, K * k2))
heavy = building.with_element(bs.AddedMass(0.5, ((2, 1.0),)))
heavier = bs.ModalData((bs.IdentifiedMode("1", 0.55), bs.IdentifiedMode("2", 1.5)), (0.0, 3.0))
study = bs.Study("Two tests", [
    bs.ModelClass("each k", error=error, configurations=[
        bs.Configuration("bare", building, modes, pairing=pairing),
        bs.Configuration("heavy", heavy, heavier, pairing={"1": 1}),
    ])
])
""", "utf-8")  # fmt: skip
    ranking = bs.rank(bs.load_study(path), settings=searches.COARSE)
    return bs.save_result(ranking, path.with_suffix(""), study_file=str(path)).directory, ranking


def test_several_configurations_each_predict_their_own(of_two_tests):
    directory, ranking = of_two_tests
    (posterior,) = ranking.posteriors
    rows = np.arange(30) * len(posterior.values) // 30
    for name, columns, pairing in (
        ("bare", slice(0, 2), {"1": 1, "2": 2}), ("heavy", slice(2, 4), {"1": 1}),
    ):  # fmt: skip
        predicted = bs.load_predictions(directory, n_draws=30, configuration=name)
        for of in (predicted.of("each k"), predicted.of()):
            (each,) = of.classes
            assert each.pairing == pairing
            stored = posterior.frequencies_hz.reshape(-1, 4)[rows, columns]
            np.testing.assert_allclose(each.frequencies_hz, stored, rtol=1e-9)
        assert predicted.data.labels == ("1", "2")
        _, mass = each.structure.matrices(each.values)
        assert mass.sum() == (2.0 if name == "bare" else 2.5)


def test_a_configuration_must_be_chosen(of_two_tests, saved):
    directory, _ = of_two_tests
    with pytest.raises(ValueError, match="has 2 configurations; choose one of 'bare', 'heavy'"):
        bs.load_predictions(directory)
    with pytest.raises(ValueError, match="no configuration 'x'; choose from 'bare', 'heavy'"):
        bs.load_predictions(directory, configuration="x")
    with pytest.raises(ValueError, match="one configuration, without a name; got 'x'"):
        bs.load_predictions(saved, configuration="x")


def test_configurations_that_have_changed(of_two_tests, tmp_path):
    directory, ranking = of_two_tests
    text, path = directory.with_suffix(".py").read_text("utf-8"), tmp_path / "changed.py"
    path.write_text(text.replace('"bare"', '"empty"'), "utf-8")
    with pytest.raises(ValueError, match="no configuration 'empty'; choose from 'bare', 'heavy'"):
        bs.load_predictions(directory, path, configuration="empty")
    (model_class,) = bs.load_study(path).model_classes
    with pytest.raises(ValueError, match="no stored configuration 'empty'; choose from 'bare'"):
        thinned_draws(ranking.posteriors[0], model_class, configuration="empty")
