"""Ranking: probabilities, Bayes factors, classes that differ too little, and what is refused."""

import math

import pytest
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.inference.criticism.misfit import AtEdge
from bayes_ssi.studies.ranking.comparison import bayes_factor_scale


@pytest.mark.parametrize(
    ("twice_log_bayes_factor", "words"),
    [
        (0.0, "not worth more than a bare mention"), (1.99, "not worth more than a bare mention"),
        (2.01, "positive"), (5.99, "positive"), (6.01, "strong"), (9.99, "strong"),
        (10.01, "very strong"), (500.0, "very strong"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_scale_of_kass_and_raftery(twice_log_bayes_factor, words, sign):
    assert bayes_factor_scale(0.5 * sign * twice_log_bayes_factor) == words


def test_the_numerical_study(make_posterior):
    """Probabilities and Bayes factors that follow from the four log evidences."""
    log_evidences = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}
    comparison = bs.compare([make_posterior(name, value) for name, value in log_evidences.items()])
    assert [row.name for row in comparison.classes] == ["3", "1-a", "2", "1-b"]
    assert comparison.best.name == "3"
    total = sum(math.exp(value) for value in log_evidences.values())
    for row in comparison.classes:
        assert row.log_evidence == log_evidences[row.name]
        assert row.probability == pytest.approx(math.exp(row.log_evidence) / total, rel=1e-12)
        assert row.log_bayes_factor == pytest.approx(row.log_evidence - 16.067)
    assert [row.against for row in comparison.classes] == ["best", *["very strong"] * 3]
    assert comparison.classes[1].log_bayes_factor_error == pytest.approx(math.hypot(0.01, 0.01))
    assert comparison.best.log_bayes_factor_error == 0.0
    assert comparison.not_distinguishable == ()
    assert comparison.data_digest == "0123456789abcdef"


@pytest.mark.parametrize(
    ("difference", "error", "distinguishable", "against"),
    [
        (0.9, 0.001, False, "not distinguishable"),  # precisely known, but too small
        (1.1, 0.001, True, "positive"),
        (4.0, 1.0, True, "strong"),
        (4.0, 1.5, False, "not distinguishable"),  # below two errors, 2 √2 · 1.5
        (0.0, 0.01, False, "not distinguishable"),
    ],
)
def test_indistinguishable_classes(make_posterior, difference, error, distinguishable, against):
    comparison = bs.compare(
        [make_posterior("a", -difference, error), make_posterior("b", 0.0, error)]
    )
    # With equal evidences, the class given first is the best.
    other = comparison.classes[1]
    assert (other.distinguishable, other.against) == (distinguishable, against)
    assert comparison.not_distinguishable == (() if distinguishable else (other.name,))


def test_what_a_row_says(make_posterior):
    checks = ("the ensembles differ",)
    worse = make_posterior("worse", -2.0, 0.02, names=("a", "b", "c"), failed_checks=checks)
    comparison = bs.compare([worse, make_posterior("better", 1.0)])
    row = comparison.classes[1]
    assert (row.name, row.error, row.n_parameters) == ("worse", 0.02, 3)
    assert row.mean_log_likelihood == pytest.approx(1.0)
    assert row.information_gained == pytest.approx(3.0)
    assert row.failed_checks == checks
    assert comparison.failed_checks == ("'worse': the ensembles differ",)


@pytest.mark.parametrize("shift", [-1e4, 1e4])
def test_probabilities_do_not_depend_on_a_common_constant(make_posterior, shift):
    here = bs.compare([make_posterior("a", 0.0), make_posterior("b", 1.0)])
    there = bs.compare([make_posterior("a", shift), make_posterior("b", 1.0 + shift)])
    for a, b in zip(here.classes, there.classes, strict=True):
        assert b.probability == pytest.approx(a.probability, rel=1e-9)


@pytest.mark.parametrize(
    ("log_evidence", "text"),
    [(0.0, "0.5000"), (-2.0, "0.1192"), (2.0, "0.8808"), (-20.0, "< 0.0001"), (20.0, "> 0.9999")],
)
def test_a_probability_is_never_rounded_to_a_certainty(make_posterior, log_evidence, text):
    comparison = bs.compare([make_posterior("a", log_evidence), make_posterior("b", 0.0)])
    (row,) = [row for row in comparison.classes if row.name == "a"]
    assert row.probability_text == text


def test_prior_weights_multiply_the_evidences(make_posterior):
    posteriors = [make_posterior("a", 0.0), make_posterior("b", math.log(2.0))]
    comparison = bs.compare(posteriors, {"a": 6.0, "b": 1.0})
    probability = {row.name: row.probability for row in comparison.classes}
    assert probability == {"a": pytest.approx(0.75), "b": pytest.approx(0.25)}
    # The most probable class is the best; Bayes factors are the data's alone.
    assert comparison.best.name == "a"
    assert comparison.classes[1].log_bayes_factor == pytest.approx(math.log(2.0))
    scaled = bs.compare(posteriors, {"a": 60.0, "b": 10.0})
    assert [row.probability for row in scaled.classes] == pytest.approx([0.75, 0.25])
    held_down = bs.compare([posteriors[0], make_posterior("b", 5.0)], {"a": 1.0, "b": 1e-6})
    assert [row.name for row in held_down.classes] == ["a", "b"]
    assert held_down.classes[1].against == "prior probability only"
    assert not held_down.has_equal_priors
    assert bs.compare(posteriors, {"a": 0.1 + 0.2, "b": 0.3}).has_equal_priors  # not in floats


def test_what_an_unseen_region_can_be_and_one_class_alone(make_posterior):
    words = bs.compare([make_posterior("3", 16.0), make_posterior("1-a", 0.0)]).unseen
    assert "another solution that fills less than 0.075 % of the prior" in words
    (row,) = bs.compare([make_posterior("a", -5.0)]).classes
    assert (row.probability, row.against, row.probability_text) == (1.0, "best", "> 0.9999")


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"a": 1.0}, "prior weight of 'b' must be positive and finite, got None"),
        ({"a": 1.0, "b": 0.0}, "prior weight of 'b' must be positive and finite, got 0.0"),
        ({"a": -1.0, "b": 1.0}, "prior weight of 'a' must be positive and finite, got -1.0"),
        ({"a": math.inf, "b": 1.0}, "prior weight of 'a' must be positive and finite, got inf"),
        ({"a": math.nan, "b": 1.0}, "prior weight of 'a' must be positive and finite, got nan"),
        ({"a": 1.0, "b": 1.0, "c": 1.0}, "unknown model class 'c'; choose from 'a', 'b'"),
    ],
)
def test_bad_prior_weights_are_refused(make_posterior, weights, message):
    assert_refused(message, bs.compare, [make_posterior("a"), make_posterior("b")], weights)


@pytest.mark.parametrize(
    ("names", "digest", "message"),
    [
        ("ab", "fedcba9876543210",
         "'a' and 'b' explain different data .*0123456789abcdef and fedcba9876543210"),
        ("aba", "0123456789abcdef", "two model classes are named 'a'"),
        ("", "", "no posterior to compare"),
    ],
)  # fmt: skip
def test_what_cannot_be_compared_is_refused(make_posterior, names, digest, message):
    posteriors = [make_posterior(name) for name in names]
    posteriors[1:2] = [make_posterior(name, data_digest=digest) for name in names[1:2]]
    assert_refused(message, bs.compare, posteriors)


@pytest.mark.parametrize(("log_evidence", "flagged"), [(-2.0, True), (-8.0, False)])
def test_an_edge_check_is_flagged_for_probable_classes_only(make_posterior, log_evidence, flagged):
    leaning = make_posterior("leaning", log_evidence, edges=(AtEdge("leans on an edge", 0, "k1"),))
    comparison = bs.compare([make_posterior("upright", 0.0), leaning])
    assert comparison.failed_checks == (("'leaning': leans on an edge",) if flagged else ())


@pytest.mark.parametrize(("behind", "fails"), [(4.0, True), (14.0, True), (15.0, False)])
def test_a_failed_check_fails_a_result_only_where_its_class_matters(make_posterior, behind, fails):
    """A class 14.6 nats behind would have 1 % with an evidence 10 nats higher: ln 0.01 = -4.6."""
    doubtful = make_posterior("doubtful", -behind, failed_checks=("too few draws",))
    comparison = bs.compare([make_posterior("best", 0.0), doubtful])
    said = comparison.failed_checks if fails else comparison.remarks
    assert len(comparison.failed_checks) + len(comparison.remarks) == 1
    assert said[0].startswith("'doubtful': too few draws")
