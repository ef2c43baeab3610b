"""Studies: what they accept, how they are loaded from a file, and ranking them."""

import math
from dataclasses import replace

import pytest
from searches import COARSE

import bayes_ssi as bs


def test_classes_keep_their_order(model_classes):
    study = bs.Study("s", list(model_classes.values()))
    assert study.names == ("1-a", "1-b", "2", "3")
    assert isinstance(study.model_classes, tuple)


def test_only_keeps_the_order_of_the_study(model_classes):
    weights = {"1-a": 1.0, "1-b": 2.0, "2": 3.0, "3": 4.0}
    study = bs.Study("s", model_classes.values(), prior_weights=weights, description="why")
    part = study.only(["3", "1-b"])
    assert part.names == ("1-b", "3")
    assert part.prior_weights == {"1-b": 2.0, "3": 4.0}
    assert (part.name, part.description) == ("s", "why")
    assert bs.Study("s", model_classes.values()).only(["2"]).prior_weights is None
    with pytest.raises(ValueError, match="study 's': no model class '4'; choose from '1-a', '1-b'"):
        study.only(["3", "4"])


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda _: [], ValueError, "study 's': no model class"),
        (lambda c: [c["3"], c["2"], c["3"]], ValueError, "two model classes are named '3'"),
        (lambda c: [c["3"], "2"], TypeError, "study 's': '2' is not a ModelClass"),
    ],
)
def test_studies_that_make_no_sense_are_refused(model_classes, make, error, message):
    with pytest.raises(error, match=message):
        bs.Study("s", make(model_classes))


@pytest.mark.parametrize(
    ("weights", "other_data", "message"),
    [
        ({"1-a": 1.0}, False, "prior weight"),
        (None, True, "study 's': model classes '1-a' and 'other' explain diff"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_anything_is_sampled(
    model_classes, weights, other_data, message
):
    first, second = model_classes["1-a"], model_classes["1-b"]
    if other_data:
        second = replace(second, name="other", data=second.data.without_shapes())
    run = bs.Run(progress=lambda *_: pytest.fail("sampling begins"))
    with pytest.raises(ValueError, match=message):
        bs.rank(bs.Study("s", [first, second], prior_weights=weights), run=run)


def test_rank(tiny_ranking, tiny_study):
    assert tiny_ranking.study is tiny_study
    assert tiny_ranking.seed == 7
    assert tiny_ranking.settings == bs.SamplingSettings()
    assert [posterior.name for posterior in tiny_ranking.posteriors] == ["one k", "each k"]
    comparison = tiny_ranking.comparison
    assert {row.name for row in comparison.classes} == {"one k", "each k"}
    for posterior in tiny_ranking.posteriors:
        (row,) = [row for row in comparison.classes if row.name == posterior.name]
        assert row.log_evidence == posterior.evidence.log_evidence
        assert posterior.failed_checks == ()


def test_a_class_does_not_depend_on_the_others(tiny_ranking, tiny_study):
    alone = bs.rank(tiny_study.only(["each k"]), seed=7).posteriors[0]
    among_others = tiny_ranking.posteriors[1]
    assert alone.evidence == among_others.evidence
    assert (alone.draws == among_others.draws).all()


def test_prior_weights_enter_a_ranking_that_is_otherwise_the_same(tiny_ranking, tiny_study):
    weighted = bs.Study("w", tiny_study.model_classes, prior_weights={"one k": 1.0, "each k": 1e6})
    again = bs.rank(weighted, seed=7)
    for posterior, before in zip(again.posteriors, tiny_ranking.posteriors, strict=True):
        assert posterior.evidence == before.evidence
        assert (posterior.draws == before.draws).all()
    after = {row.name: row.probability for row in again.comparison.classes}
    before = {row.name: row.probability for row in tiny_ranking.comparison.classes}
    odds = before["each k"] / before["one k"]
    assert math.log(after["each k"] / after["one k"]) == pytest.approx(math.log(1e6 * odds))


def test_settings_reach_the_sampling(tiny_study):
    settings = bs.SamplingSettings(max_steps=20)
    ranking = bs.rank(tiny_study.only(["one k"]), settings=settings)
    posterior = ranking.posteriors[0]
    assert posterior.draws.shape[1] + posterior.burn_in == 20
    assert ranking.settings is settings


@pytest.mark.usefixtures("screening_for_appendages")
def test_progress_names_class_and_step(tiny_study):
    seen = []
    run = bs.Run(progress=lambda *call: seen.append(call))
    bs.rank(tiny_study, settings=COARSE, run=run)
    # Last, whether an appendage on the most probable class explains the data as well.
    names = list(dict.fromkeys(name for name, _, _ in seen))
    assert names == ["one k", "each k", "all hypotheses"]
    assert [call for call in seen if call[0] == "each k"][-1] == ("each k", "evidence", 1.0)
    assert seen[-1][2] == pytest.approx(1.0)
