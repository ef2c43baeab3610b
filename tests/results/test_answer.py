"""The answer in sentences: what is most probable, how sure, what it claims, why others lose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

import bayes_ssi as bs
from bayes_ssi.inference.model_class.class_record import class_record
from bayes_ssi.results.answer import answer, explained, parameters_in_words, why_it_loses
from bayes_ssi.results.search_answer import further_sentences, search_sentences
from bayes_ssi.results.wording import likelihood_in_words, quantity
from bayes_ssi.studies.appendages.candidates import PendulumPlace
from bayes_ssi.studies.ranking.comparison import Check
from bayes_ssi.studies.ranking.study import Ranking

DATA = bs.ModalData((bs.IdentifiedMode("1", 1.0), bs.IdentifiedMode("2", 2.0)), (0.0, 3.0))


@pytest.fixture
def stored(make_posterior, tmp_path):
    """Saves a ranking of classes; of each: name, log evidence, mean of k1, and its description."""

    def save(*classes, names=("k1", "k2"), weights=None, extra=None, **changes):
        candidates, posteriors = [], []
        for name, log_evidence, mean, description in classes:
            floors = [bs.Parameter(each, bs.LogNormal(1.0, 0.3), unit="kN") for each in names]
            building = bs.ShearBuilding((1.0,) * len(names), floors)
            error, told = bs.ErrorModel(0.02), {"pairing": {"1": 1}, "description": description}
            candidates.append(bs.ModelClass(name, building, DATA, error, **told))
            # A normal distribution with a standard deviation of 0.02, by its quantiles.
            quantiles = ndtri((np.arange(1000) + 0.5) / 1000.0).reshape(4, 250, 1)
            draws = mean + 0.02 * np.repeat(quantiles, len(names), axis=2)
            posteriors.append(
                make_posterior(name, log_evidence, names=names, pairing={"1": 1}, draws=draws,
                               data_digest=DATA.digest, **changes)
            )  # fmt: skip
        study = bs.Study("s", candidates, prior_weights=weights)
        comparison = bs.compare(posteriors, weights)
        ranking = Ranking(study, tuple(posteriors), comparison, 0, bs.SamplingSettings())
        return bs.save_result(ranking, tmp_path / "r", extra=extra)

    return save


def test_the_most_probable_class_by_what_it_is(stored):
    result = answer(stored(("A", 0.0, 1.0, "soft infill"), ("B", -10.0, 1.2, "")))
    assert result.verdict == (
        "The most probable of the 2 model classes is: soft infill (class 'A'). Among them it is "
        "virtually certain, with probability above 0.9999."
    )
    assert result.warnings == ()
    assert result.reasons[0].startswith(
        "It pairs 1 of 2 identified modes and takes '2' for spurious. Its parameters, "
    )
    # Median 1, 90 % within 1.645 standard deviations of 0.02.
    assert any("k1 = 1.000 kN (0.967 to 1.033)" in each for each in result.reasons)
    runner_up = result.reasons[-1]
    assert runner_up.startswith("Runner-up: class 'B' (probability below 0.0001).")
    assert "It claims k1 = 1.200 kN (1.167 to 1.233); k2 = " in runner_up


def test_no_sentence_speaks_of_bayes_factors_and_nats(stored):
    before = " ".join(answer(stored(("A", 0.0, 1.0, ""), ("B", -10.0, 1.0, ""))).paragraphs)
    assert "ln B" not in before
    assert "nats" not in before
    assert "On the parameters that both infer it agrees." in before


def test_classes_that_are_not_distinguishable_and_what_they_disagree_on(stored):
    result = answer(stored(("A", 0.0, 1.0, "one"), ("B", -0.1, 1.2, ""), ("C", -0.2, 1.0, "")))
    assert result.verdict.startswith(
        "Among 3 model classes the data do not distinguish between one (class 'A', probability "
    )
    assert "Their probability together is above 0.9999: keep them all" in result.verdict
    assert any(each.startswith("'B' pairs 1 of 2") for each in result.reasons)
    assert any("it claims k1 = 1.200 kN (1.167 to 1.233)" in each for each in result.reasons)
    assert not any("agree on" in each for each in result.reasons)


def test_classes_that_are_not_distinguishable_and_agree(stored):
    result = answer(stored(("A", 0.0, 1.0, ""), ("B", -0.1, 1.0, "")))
    (agreed,) = (each for each in result.reasons if each.startswith("They agree on k1 = 1.000 kN"))
    assert "k2" in agreed
    assert not any("claims" in each for each in result.reasons)


def test_one_class_is_not_called_probable(stored):
    result = answer(stored(("A", 0.0, 1.0, "soft infill")))
    assert result.verdict.startswith("Only one model class was sampled: soft infill (class 'A').")
    assert "probability" not in " ".join(result.paragraphs)


def test_many_parameters_are_summarised(stored):
    names = tuple(f"k{i}" for i in range(12))
    spreads = (*[0.2] * 3, *[0.95] * 4, *[0.3] * 5)
    result = stored(("A", 0.0, 1.0, ""), names=names, relative_spreads=spreads)
    text = " ".join(answer(result).reasons)
    assert "The 8 best determined of its 12 parameters" in text
    assert [f"{name} = " in text for name in names] == [spread < 0.9 for spread in spreads]
    assert "The data say next to nothing about k3, k4, k5 and k6." in text


def test_the_data_say_something_where_they_move_a_parameter_as_far_as_its_prior_is_wide(stored):
    """Medians of 1.5 are 1.4 standard deviations of the priors away."""
    far = stored(("A", 0.0, 1.5, ""), relative_spreads=(0.95, 0.95))
    assert "next to nothing" not in " ".join(answer(far).reasons)


def test_a_best_class_that_does_not_explain_the_data_comes_first(stored):
    result = stored(("A", 0.0, 1.0, ""), ("B", -9.0, 1.0, ""), failed_checks=("they differ",))
    misfit = "the data are not explained: mode '2': 9 % off. Likely cause: wrong units"
    best, other = result.comparison.classes
    best = replace(best, checks=(Check("misfit", misfit), *best.checks))
    comparison = replace(result.comparison, classes=(best, other))
    first, second = answer(replace(result, comparison=comparison)).warnings
    assert first == ("The most probable class does not explain the data.", (f"'A': {misfit}",))
    assert second[1] == ("'A': they differ", "'B': they differ")


def test_unequal_priors_are_stated(stored):
    result = answer(stored(("A", 0.0, 1.0, ""), ("B", -5.0, 1.0, ""), weights={"A": 1.0, "B": 3.0}))
    assert "(0.2500 before the test)" in result.verdict


def test_how_closely_a_class_explains_modes(tiny_result):
    modes = tiny_result.ranked_posteriors[0].configurations[0].updated.modes
    ratios = [m.after_hz[1] / tiny_result.data.mode(m.label).frequency_hz for m in modes]
    worst, lowest = max(abs(r - 1.0) for r in ratios), min(m.mac_after[1] for m in modes)
    assert (
        f"all 2 identified modes (frequencies within {100 * worst:.2g} %, MAC above "
        f"{min(np.floor(1000 * lowest), 999) / 1000:.3f})" in " ".join(answer(tiny_result).reasons)
    )


def test_all_shapes_are_at_least_as_close_as_is_said(tiny_ranking):
    """Medians of 0.9731 and 0.9999, of 2 % and 1 % in frequency: the worst of both is named."""
    posterior, data = tiny_ranking.posteriors[0], tiny_ranking.study.model_classes[0].data
    (test,) = posterior.configurations
    modes = [
        replace(mode, after_hz=(0.0, factor * data.mode(mode.label).frequency_hz, 9.0),
                mac_after=(0.5, mac, 1.0))
        for mode, factor, mac in zip(
            test.updated.modes, (0.98, 1.01), (0.9731, 0.9999), strict=True
        )
    ]  # fmt: skip
    for order in (modes, modes[::-1]):
        updated = replace(test.updated, modes=tuple(order))
        changed = replace(posterior, configurations=(replace(test, updated=updated),))
        assert explained(changed, {test.name: data}) == (
            "pairs all 2 identified modes (frequencies within 2 %, MAC above 0.973)"
        )


def answer_of(ranking, record, folder):
    return answer(bs.save_result(ranking, folder / "r", extra={"search.json": record}))


def test_a_search_says_where_how_heavy_and_at_which_frequency(found_in_case_c, tmp_path):
    record = found_in_case_c.record
    result = answer_of(found_in_case_c.ranking, record, tmp_path)
    assert result.verdict.startswith("That there is an appendage is virtually certain")
    # As probable as none is one appendage anywhere, or a motion like any mode.
    assert "was 0.2500 before the test" in result.verdict
    (appendage,) = record.matched
    first = appendage.places[0]
    hz, effective = quantity(*appendage.frequency_hz, "Hz"), appendage.effective_mass
    assert result.reasons[0].startswith(f"The appendage vibrates at {hz}, with an effective mass")
    assert f"effective mass of {quantity(*effective)}, or " in result.reasons[0]
    assert "of the modal mass, in mode 2 of the main structure" in result.reasons[0]
    assert result.reasons[1].startswith(
        "It is most probably an infill between floors 1 and 2 (probability "
    )
    assert f"where {quantity(*first.amounts['mass'])} vibrates" in result.reasons[1]
    share = quantity(*first.amounts["in_model"])
    assert f", of which a share of {share} is in the model already" in result.reasons[1]
    assert result.reasons[2].startswith("This holds for the hypotheses with one appendage")
    in_kg = search_sentences(replace(record, mass_unit="kg"), found_in_case_c.ranking.comparison)
    said = " ".join(in_kg)
    assert f"where {quantity(*first.amounts['mass'], 'kg')} vibrates" in said
    assert f"effective mass of {quantity(*effective, 'kg')}, or" in said
    assert "without appendages" in said


def test_a_search_says_in_which_tests_appendages_were_tried(found_in_case_c):
    record = found_in_case_c.record
    shared = replace(record, present_in=("with blade",), most_probability_unsampled=0.3)
    said = " ".join(search_sentences(shared, found_in_case_c.ranking.comparison))
    assert "may have up to 0.3000 of the probability together" in said
    said = " ".join(further_sentences(shared))
    assert "Appendages were tried in the test 'with blade' only." in said


def test_probabilities_of_a_search_are_those_among_all_its_hypotheses(found_in_case_c, tmp_path):
    """Not among the sampled ones alone, of which the ranking consists."""
    record = found_in_case_c.record
    second = found_in_case_c.ranking.comparison.classes[1].name
    hypotheses = {each.name: each for each in record.hypotheses}
    hypotheses[second] = replace(hypotheses[second], probability=0.0123)
    record = replace(record, hypotheses=tuple(hypotheses.values()))
    runner_up = answer_of(found_in_case_c.ranking, record, tmp_path).further[-1]
    assert f"({second!r}, probability 0.0123)." in runner_up


def test_a_search_that_gives_no_appendage(found_in_case_c, tmp_path):
    record = replace(found_in_case_c.record, probability_of_any=0.03)
    result = answer_of(found_in_case_c.ranking, record, tmp_path)
    assert result.verdict.startswith("That there is no appendage is extremely likely")
    assert result.further[0].startswith("If there is any, the appendage vibrates at ")


@pytest.mark.parametrize(
    ("fit", "information", "log_bayes_factor", "words"),
    [
        (-10.0, -3.0, -7.0, "fits the data worse, though its parameters are tuned less"),
        (-10.0, 3.0, -13.0, "fits the data worse, even with its parameters tuned more"),
        (-10.0, 0.0, -10.0, "It loses because it fits the data worse."),
        (0.5, 4.0, -3.5, "its parameters must be tuned more to fit equally well"),
        (3.0, 6.0, -3.0, "its better fit takes more tuning of its parameters"),
        (-0.8, 0.8, -1.6, "by a little in fit and by a little"),
        (3.0, 0.0, 3.0, "its prior probability is too low"),
    ],
)
def test_fit_against_complexity(make_posterior, fit, information, log_bayes_factor, words):
    best = bs.compare([make_posterior("A")]).best
    other = replace(
        best, mean_log_likelihood=best.mean_log_likelihood + fit, log_bayes_factor=log_bayes_factor,
        information_gained=best.information_gained + information,
    )  # fmt: skip
    assert words in why_it_loses(other, best)


def test_probabilities_in_the_words_of_the_ipcc():
    given = (0.995, 0.96, 0.92, 0.7, 0.55, 0.3)
    assert [likelihood_in_words(each) for each in given] == [
        "virtually certain", "extremely likely", "very likely", "likely", "more likely than not",
        "less likely than not",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("three", "text"),
    [
        ((0.935, 1.0061, 1.0952), "1.01 (0.94 to 1.10)"),
        ((2.05e11, 2.101e11, 2.151e11), "2.1e+11 (2.05e+11 to 2.15e+11)"),
        ((3.0, 3.0, 3.0), "3 (3 to 3)"),
        ((-124.0, -4.0, 130.0), "0 (-120 to 130)"),
        ((11520.0, 12340.0, 13160.0), "12300 (11500 to 13200)"),
    ],
)
def test_quantities_have_two_digits_of_their_spread(three, text):
    assert quantity(*three) == text


def test_correlations_are_not_called_sizes_of_errors(make_posterior):
    floors = (bs.Parameter("k1", bs.LogNormal(1.0, 0.3)), 1.0)
    rho = bs.Parameter("rho", bs.Uniform(0.0, 1.0))
    for error, words in (
        (bs.ErrorModel(), "Inferred sizes of prediction errors: frequency_cov = "),
        (bs.ErrorModel(between_tests=rho), "Inferred sizes and correlations of prediction errors"),
    ):
        candidate = bs.ModelClass(
            "A", bs.ShearBuilding((1.0, 1.0), floors), DATA, error, pairing={"1": 1, "2": 2}
        )
        posterior = make_posterior("A", names=candidate.parameter_names)
        sentences = parameters_in_words(posterior, class_record(candidate))
        assert sum(each.startswith(words) for each in sentences) == 1


def test_failed_checks_of_any_kind_are_warnings(stored):
    result = stored(("A", 0.0, 1.0, ""), ("B", -9.0, 1.0, ""), failed_checks=("they differ",))
    best, other = result.comparison.classes
    best = replace(best, checks=(*best.checks, Check("anything", "the moon was full")))
    comparison = replace(
        result.comparison, classes=(best, other), common_checks=(Check("else", "it rained"),)
    )
    ((sentence, items),) = answer(replace(result, comparison=comparison)).warnings
    assert sentence.startswith("4 checks failed. Do not trust the ranking until they are")
    assert set(items) == {
        "it rained", "'A': they differ", "'A': the moon was full", "'B': they differ",
    }  # fmt: skip


def test_kinds_of_appendages_that_no_candidate_fits_are_said(found_in_case_c):
    record = found_in_case_c.record
    said = " ".join(further_sentences(record))
    assert "Infills were not tried" not in said  # one of them is the answer
    assert "on a foot that may turn" not in said
    pendulums = [each for each in record.places if isinstance(each.place, PendulumPlace)]
    best = replace(record.hypotheses[0], features=(pendulums[0],))
    shared = replace(record, places=tuple(pendulums), hypotheses=(best, *record.hypotheses))
    said = " ".join(further_sentences(shared))
    assert "A pendulum's frequency is that on a foot that may turn but not move" in said
    assert "Infills were not tried: they join two places" in said
