"""Rankings under changed settings, by closed forms and by sampling again with them."""

import math
from dataclasses import replace

import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import inadequacy_in_words

K = bs.LogNormal(1.0, 0.3)


def of(answer, name):
    return next(row for row in answer.classes if row.name == name)


def changes(row):
    return row.log_evidence_after.log_evidence - row.log_evidence_before.log_evidence


def test_nothing_is_sampled_and_a_ranking_says_the_same_as_its_directory(
    tiny_result, tiny_ranking, monkeypatch
):
    monkeypatch.delattr("bayes_ssi.inference.posterior_sampling.sample.sample_target")
    monkeypatch.setattr("bayes_ssi.structures.lumped.ShearBuilding.modes", None)
    settings = bs.ChangedSettings(priors={"k": bs.Normal(1.0, 0.2)}, frequency_cov=0.03)
    answer = bs.what_if(tiny_result.directory, settings)
    assert answer == bs.what_if(tiny_result, settings) == bs.what_if(tiny_ranking, settings)


def test_closed_forms(tiny_result):
    """Two modes detected, none spurious; twice the weight adds log 2 to a class's odds."""
    settings = bs.ChangedSettings(
        detection_probability=0.8, expected_spurious_modes=0.5, prior_weights={"each k": 2.0}
    )
    answer = bs.what_if(tiny_result, settings)
    for row in answer.classes:
        assert changes(row) == pytest.approx(2.0 * math.log(0.8 / 0.95) - 0.4, abs=1e-9)
        assert row.pareto_k == -math.inf
    one, each = (of(answer, name) for name in ("one k", "each k"))
    odds = 2.0 * each.probability_before / one.probability_before
    assert each.probability_after / one.probability_after == pytest.approx(odds, rel=1e-9)
    assert answer.changes == (
        "detection_probability: 0.95 → 0.8",
        "expected_spurious_modes: 0.1 → 0.5",
        "prior weight of 'each k': 1 → 2",
    )


def test_against_sampling_with_the_changed_settings(tiny_result, tiny_study):
    """Prior and error size at once; the prior concerns one class alone."""
    prior = bs.LogNormal(1.1, 0.2)
    answer = bs.what_if(tiny_result, bs.ChangedSettings(priors={"k2": prior}, frequency_cov=0.025))
    for candidate in tiny_study.model_classes:
        again = bs.ModelClass(
            candidate.name, candidate.structure, candidate.data,
            bs.ErrorModel(frequency_cov=0.025, shape_sd=0.05), pairing=candidate.pairing,
            priors={"k2": prior} if candidate.name == "each k" else {},
        )  # fmt: skip
        sampled, row = bs.sample(again, seed=1), of(answer, candidate.name)
        after = row.log_evidence_after
        tolerance = 4.0 * math.hypot(after.error, sampled.evidence.error)
        assert after.log_evidence == pytest.approx(sampled.evidence.log_evidence, abs=tolerance)
        for change, expected in zip(row.parameters, sampled.summary, strict=True):
            allowed = 4.0 * math.hypot(change.after.mean_error, expected.mean_error)
            assert change.after.mean == pytest.approx(expected.mean, abs=allowed)
    assert f"prior of 'k2': {K} → {prior} in 'each k'" in answer.changes


def test_the_misfit_is_that_of_the_class_with_the_changed_settings(tiny_study):
    """A shape that is 2° off: usual for an error of 0.05 in each component, not for 0.008."""
    (candidate,) = tiny_study.only(["one k"]).model_classes
    one, two = candidate.data.modes
    data = replace(candidate.data, modes=(replace(one, shape=[1.0, 1.75]), two))
    tests = [replace(candidate.configurations[0], data=data)]
    # With this error of frequencies the two modes are not close, whatever the shape error.
    errors = (replace(candidate.error, frequency_cov=0.005, shape_sd=sd) for sd in (0.05, 0.008))
    off, exact = (replace(candidate, configurations=tests, error=error) for error in errors)
    economical = bs.SamplingSettings(economical=True)
    ranking = bs.rank(bs.Study("2°", [off]), settings=economical)
    answer = bs.what_if(ranking, bs.ChangedSettings(shape_sd=0.008))
    (row,) = answer.classes
    again = bs.sample(exact, settings=economical).adequacy
    assert row.misfit_before.sds < 1.0 < 2.6 < row.misfit_after.sds
    assert row.misfit_after.sds == pytest.approx(again.overall.sds, abs=0.1)
    assert answer.misfit == f"'one k': {inadequacy_in_words(again, is_given=True)}"
    # Of two components, the squared error over σ² is that of one normal variable.
    angle = math.atan(1.75) - math.atan((1.0 + math.sqrt(5.0)) / 2.0)
    expected = (1.0 - 0.5 * 3.841 * 0.008**2) ** 2
    assert f"MAC {math.cos(angle) ** 2:.3f} where {expected:.3f} was expected" in answer.misfit


def test_no_probability_is_given_where_a_class_must_be_sampled_again(tiny_result):
    answer = bs.what_if(tiny_result, bs.ChangedSettings(priors={"k": bs.LogNormal(5.0, 0.05)}))
    row = of(answer, "one k")
    assert "Pareto k is" in row.problem
    assert row.log_evidence_after is None
    assert row.parameters[0].after is None
    assert of(answer, "each k").log_evidence_after is not None
    assert answer.best_after is None
    assert [each.probability_after for each in answer.classes] == [None, None]
    assert answer.problems == (f"'one k': {row.problem}",)


def test_a_class_too_improbable_to_matter_need_not_be_sampled_again(tiny_ranking):
    weights = {"one k": 1e-12, "each k": 1.0}
    improbable = replace(tiny_ranking, study=replace(tiny_ranking.study, prior_weights=weights))
    answer = bs.what_if(improbable, bs.ChangedSettings(priors={"k": bs.LogNormal(5.0, 0.05)}))
    assert answer.best_after is of(answer, "each k")
    assert answer.best_after.probability_after == pytest.approx(1.0, abs=1e-9)
    assert answer.problems == ()
    assert answer.remarks == (f"'one k': {of(answer, 'one k').problem}",)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"priors": {"k9": K}}, "prior: no parameter 'k9'; choose from 'k', 'k1', 'k2'"),
        ({"prior_weights": {"two k": 1.0}}, "unknown model class 'two k'"),
        ({"detection_probability": 1.0}, "strictly between 0 and 1"),
        ({"frequency_cov": -0.1}, "must be positive and finite"),
    ],
)
def test_settings_of_no_class_are_refused(tiny_result, settings, words):
    assert_refused(words, bs.what_if, tiny_result, bs.ChangedSettings(**settings))


def test_an_error_size_that_every_class_infers_and_a_change_of_nothing_are_refused(tiny_study):
    inferred = [replace(c, error=bs.ErrorModel()) for c in tiny_study.model_classes]
    with pytest.raises(ValueError, match=r"frequency_cov: it is inferred .* 'frequency_cov'"):
        bs.ChangedSettings(frequency_cov=0.02).check(inferred)
    assert_refused("nothing is changed; give", bs.ChangedSettings)
