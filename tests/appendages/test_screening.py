"""Approximate evidences of hypotheses, and which of them are sampled."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from searches import INFILL_12, PENDULUM_1, screened

import bayes_ssi as bs
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.inference.sampling.target import Target
from bayes_ssi.studies.appendages.baselines import hypothesis
from bayes_ssi.studies.search import approximate_evidence as module
from bayes_ssi.studies.search.approximate_evidence import FULL, QUICK, screen, with_more_draws
from bayes_ssi.studies.search.ladder import most_probability_unsampled, screen_best, to_sample


def estimates(*log_masses, error=0.0):
    return {name: Estimate(mass, error) for name, mass in zip("abcdef", log_masses, strict=False)}


def test_the_least_probable_are_left_out_as_long_as_together_they_are_below_the_share():
    """Of 1.109, the last two have 0.009, of which an error of 0.69 nats is half."""
    approximate = estimates(0.0, math.log(0.1), math.log(5e-3), math.log(4e-3), error=0.231)
    assert to_sample(approximate, {}, 0.0085) == ["a", "b"]
    assert to_sample(approximate, {}, 0.0075) == ["a", "b", "c"]
    assert to_sample(approximate, {}, 0.0) == ["a", "b", "c", "d"]
    assert to_sample(approximate, {"a": 0.0, "b": math.log(0.1)}, 0.0085) == []
    # The most probable is sampled however well its evidence is known.
    assert to_sample(estimates(0.0, math.log(0.01)), {}, 0.5) == ["a"]


def test_an_evidence_of_unknown_accuracy_is_sampled():
    """A nat is three standard errors: the bound is e times the approximation, or 1.16 times it."""
    assert to_sample(estimates(0.0, math.log(0.008)), {}, 0.01) == ["a"]
    assert to_sample(estimates(0.0, math.log(0.008), error=1.0 / 3.0), {}, 0.01) == ["a", "b"]
    assert to_sample(estimates(0.0, math.log(0.1)), {}, 0.01) == ["a", "b"]


def test_others_may_be_as_much_too_low_as_the_worst_of_those_sampled():
    approximate = estimates(0.0, -1.0, math.log(0.016))
    assert to_sample(approximate, {"a": 0.0, "b": -1.0}, 0.01) == []
    low = {"a": 0.0, "b": 0.0}  # 1 nat more than was thought: the bound of "c" is 0.016 e of 2
    assert to_sample(approximate, low, 0.01) == ["c"]
    bound = 0.016 * math.e
    assert most_probability_unsampled(approximate, low) == pytest.approx(bound / (2.0 + bound))
    assert most_probability_unsampled(approximate, low | {"c": -4.0}) == 0.0


@pytest.fixture(scope="module")
def none(bare):
    """The class without appendages, screened."""
    return screen((hypothesis(bare, ()), None), 0)


@pytest.fixture(scope="module")
def screenings(bare, none):
    """A hypothesis of one appendage, screened with much effort and with little."""
    candidate = hypothesis(bare, (INFILL_12,)), none
    return candidate, *(screen(candidate, 1, effort) for effort in (FULL, QUICK))


def test_screening_agrees_with_sampling_where_another_hypothesis_is_better(bare, none):
    """Of a pendulum on floor 1, which was sampled in full twice, to 0.005 nats."""
    candidate = hypothesis(bare, [replace(PENDULUM_1, in_model=None)])
    result = screen((candidate, none), 5)
    assert result.log_evidence == pytest.approx(2.858, abs=0.3)
    assert result.laplace == pytest.approx(result.log_evidence, abs=1.0)
    means = result.weights @ candidate.values(result.z)
    sampled, sds = (0.987, 0.921, 1.029, 0.030, 2.775, 0.468), (0.05, 0.04, 0.03, 0.009, 0.14, 0.29)
    np.testing.assert_array_less(np.abs(means - sampled), 0.3 * np.array(sds))


@pytest.mark.parametrize("place", [(), (INFILL_12,)])
def test_screening_agrees_with_sampling(bare, none, found_in_case_c, place):
    """Within the few tenths of a nat that decide what is sampled; sampling is right to 0.1."""
    candidate = hypothesis(bare, [replace(each, in_model=None) for each in place])
    result = screen((candidate, none), 5) if place else none
    sampled = {each.name: each for each in found_in_case_c.ranking.posteriors}
    posterior = sampled[candidate.name]
    assert result.log_evidence == pytest.approx(posterior.evidence.log_evidence, abs=0.3)
    assert result.laplace == pytest.approx(result.log_evidence, abs=1.0)
    sampled = posterior.values.mean(axis=0)
    values = candidate.values(result.z)
    assert result.weights @ values == pytest.approx(sampled, abs=3.0 * posterior.values.std() / 10)


def test_a_narrow_resonance_is_screened_wherever_it_lies_in_the_band(bare, none):
    """The scan leaves out no part of the band: the same evidence with other draws."""
    candidate = hypothesis(bare, (INFILL_12,))
    assert np.ptp([screen((candidate, none), seed).log_evidence for seed in range(2)]) < 0.3


def by_name(**log_evidences):
    return lambda model_class: log_evidences.get(model_class.name.replace(" ", "_"), -30.0)


def test_only_what_matters_is_sampled_and_all_is_reported(bare, fake_sampling):
    fake_sampling(by_name(pendulum_1=5.0, no_appendage=-9.0))
    result = bs.search(bare, bs.SearchSettings(number_weights=(1.0, 1.0)))
    assert fake_sampling.sampled == [["no appendage", "pendulum 1"]]
    rows = result.record.hypotheses
    assert len(rows) == 7
    assert {row.name for row in rows if row.is_sampled} == {"no appendage", "pendulum 1"}
    assert result.record.n_unsampled == 5
    assert sum(row.probability for row in rows) == pytest.approx(1.0)
    assert sum(row.prior_probability for row in rows) == pytest.approx(1.0)
    assert all(each.amounts["frequency_hz"][0] < each.amounts["frequency_hz"][2]
               for row in rows for each in row.features)  # fmt: skip


def test_more_are_sampled_where_screening_proves_too_low(bare, fake_sampling):
    """Pendulum 2 seems 7 nats below pendulum 1; that is 5 nats too low for others, too."""
    screened = by_name(pendulum_1=0.0, pendulum_2=-7.0, no_appendage=-5.0)
    fake_sampling(by_name(pendulum_1=0.0, pendulum_2=-7.0, no_appendage=0.0), screened)
    bs.search(bare, bs.SearchSettings(number_weights=(1.0, 1.0)))
    assert fake_sampling.sampled == [["no appendage", "pendulum 1"], ["pendulum 2"]]


@pytest.fixture
def efforts(monkeypatch):
    """Screening has known results; the efforts with their numbers of hypotheses are listed."""
    calls = []

    def screen_all(hypotheses, seed, run, effort):
        del seed, run
        calls.append((effort, len(hypotheses)))
        return [screened(each, each.height, 0.0 if effort.is_full else each.error)
                for each, _ in hypotheses]  # fmt: skip

    monkeypatch.setattr("bayes_ssi.studies.search.ladder.screen_all", screen_all)
    monkeypatch.setattr("bayes_ssi.studies.search.ladder.looks_at", lambda *_: {})
    return calls


def of_heights(*heights, error=0.0):
    """Hypotheses that have these log evidences."""
    return [
        (SimpleNamespace(parameter_names=(str(i),), height=height, error=error), None)
        for i, height in enumerate(heights)
    ]


def test_of_many_hypotheses_only_the_better_ones_are_screened_in_full(efforts):
    """Of forty, one has 0.95 of what all have, one 0.05 and the others a millionth."""
    heights = [0.0, math.log(0.05), *[math.log(1e-6)] * 38]
    results = screen_best(of_heights(*heights), [1.0] * 40, 1, 0, bs.Run())
    assert [each.log_evidence for each in results] == heights
    assert efforts == [(QUICK, 40), (FULL, 2)]
    efforts.clear()
    screen_best(of_heights(*heights[:30]), [1.0] * 30, 1, 0, bs.Run())
    assert efforts == [(FULL, 30)]


@pytest.mark.usefixtures("efforts")
@pytest.mark.parametrize(("height", "n_screened"), [(0.0, 3), (-11.7, 3), (-12.1, 2), (-20.0, 2)])
def test_what_a_look_leaves_out_is_out_of_reach(monkeypatch, height, n_screened):
    """Greatest likelihoods are 5 nats above evidences, a thousandth is 6.9 below all.

    Two hypotheses are screened at once.
    """
    hypotheses = of_heights(0.0, height, height)
    looks = {i: replace(screened(each, each.height + 5.0), laplace=math.nan)
             for i, (each, _) in enumerate(hypotheses)}  # fmt: skip
    monkeypatch.setattr("bayes_ssi.studies.search.ladder.looks_at", lambda *_: looks)
    results = screen_best(hypotheses, [1.0] * 3, 1, 0, bs.Run(), most_full=2)
    assert sum(not math.isnan(each.laplace) for each in results) == n_screened
    assert [each.log_evidence for each in results] == pytest.approx([0.0, height, height])


def test_quick_screening_agrees_with_full_screening(screenings):
    _, full, quick = screenings
    assert quick.log_evidence == pytest.approx(full.log_evidence, abs=0.5)
    assert quick.n_evaluations < 0.3 * full.n_evaluations


def test_those_that_matter_together_are_drawn_until_their_error_is_small(monkeypatch, efforts):
    """Of forty rough ones, those with a thousandth each and not those with a millionth."""
    drawn = []

    def with_more_draws(items, seed, run):
        del seed, run
        drawn.extend(made.parameter_names for made, _ in items)
        return [replace(one, log_evidence=one.log_evidence - 0.1, error=0.05) for _, one in items]

    monkeypatch.setattr("bayes_ssi.studies.search.ladder.with_more_draws", with_more_draws)
    heights = [0.0, *[math.log(1e-3)] * 5, *[math.log(1e-6)] * 34]
    results = screen_best(of_heights(*heights, error=0.3), [1.0] * 40, 2, 0, bs.Run())
    assert efforts == [(QUICK, 40), (FULL, 1)]
    assert drawn == [(str(i),) for i in range(6)]
    assert [each.error for each in results] == [0.0, *[0.05] * 5, *[0.3] * 34]
    lower = [height - 0.1 for height in heights[1:6]]
    assert [each.log_evidence for each in results] == [0.0, *lower, *heights[6:]]


def test_more_draws_make_a_rough_evidence_accurate(screenings):
    (candidate, _), full, quick = screenings
    rough = replace(quick, log_evidence=-99.0, error=1.0)
    (better,) = with_more_draws([(candidate, rough)], 2, bs.Run())
    assert better.error <= module.WANTED_ERROR
    assert abs(better.log_evidence - full.log_evidence) < 3.0 * math.hypot(better.error, full.error)
    assert better.n_evaluations <= quick.n_evaluations + module.MOST_DRAWS
    means = [each.weights @ candidate.values(each.z) for each in (better, full)]
    np.testing.assert_allclose(*means, rtol=0.1)


def test_a_few_of_many_alike_are_not_sampled():
    """Of five alike none has the permitted probability of a quarter; limits are kept."""
    alike = estimates(*[0.0] * 5)
    assert len(to_sample(alike, {}, 0.25, 2)) == 1  # something must be
    assert to_sample(alike, {"a": 0.0}, 0.25, 2) == []
    unequal = estimates(0.0, 1.0, -1.0)
    assert to_sample(unequal, {}, 0.05, 2) == ["b", "a"]
    assert to_sample(unequal, {"b": 1.0, "a": 0.0}, 0.05, 2) == []


def test_in_full_narrow_regions_to_which_residuals_lead_are_climbed_to(monkeypatch):
    """1e-9 of the prior, beside a broad region in which all searches end."""
    monkeypatch.setattr(module, "_scan", lambda *_: None)

    def log_likelihood(z):
        return np.logaddexp(-0.5 * (z**2).sum(1), 30.0 - ((z - 2.0) ** 2).sum(1) / 2e-8)

    for effort, is_reached in ((FULL, True), (QUICK, False)):
        target = Target(log_likelihood, 2, suggest_starts=lambda _: (np.full((1, 2), 2.0001), 1))
        seeds = tuple(np.random.SeedSequence(0).spawn(2))
        z = module._maxima(target, (None, "a simpler one"), seeds, effort).z
        assert (np.abs(z - 2.0).max(axis=1) < 1e-4).any() == is_reached
