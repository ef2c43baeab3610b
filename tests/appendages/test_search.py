"""The search for hidden appendages: its hypotheses, their levels and its findings."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from searches import (
    ALL,
    COARSE,
    INFILL_01,
    INFILL_12,
    ONE,
    PENDULUM_1,
    PENDULUM_3,
    by_count,
    places_of_building,
    screened,
)

import bayes_ssi as bs
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.plots.place_plots import plot_places
from bayes_ssi.report.tables.search_tables import search_notes
from bayes_ssi.studies.appendages.appendage_search import SearchRecord
from bayes_ssi.studies.appendages.baselines import hypothesis
from bayes_ssi.studies.appendages.candidates import KINDS, AppendagePlace, SearchSettings

WEIGHTS, PRIOR = "number_weights must be two or more positive numbers", "must be a prior, got"


@pytest.mark.parametrize(
    ("option", "value", "error", "message"),
    [
        *[("number_weights", weights, ValueError, WEIGHTS)
          for weights in ((), (1.0,), (1.0, 0.0), (math.inf, 1.0), (1.0, math.nan))],
        *[("most_unsampled", share, ValueError, "most_unsampled must be at least 0 and below 1")
          for share in (-0.1, 1.0, math.nan)],
        ("branches", 0, ValueError, "branches must be at least 1, got 0"),
        ("mass_ratio", None, TypeError, PRIOR),
        ("frequency", (1.0, 2.0), TypeError, PRIOR),
    ],
)  # fmt: skip
def test_bad_settings_are_refused(option, value, error, message):
    with pytest.raises(error, match=message):
        SearchSettings(**{option: value})


class Wall(bs.Structure):
    """A structure without floors."""

    parameters = (bs.Parameter("k", bs.Uniform(1.0, 2.0)),)
    degrees_of_freedom = ("floor 1", "floor 2", "floor 3")
    n_modes = 1

    def modes(self, values):
        return bs.Modes(values[:, :1], np.ones((len(values), 1, 1)))


def test_classes_without_floors_are_left_out(bare, fake_sampling):
    plate = bs.ModelClass("plate", Wall(), bare.data, pairing={})
    fake_sampling(by_count(0.0, 1.0))
    study = bs.Study("s", [plate, bare])
    record = bs.search(study, ONE).record
    assert [each.name for each in record.baselines] == ["bare"]
    assert record.left_out == {
        "plate": "model class 'plate': a search needs a structure that carries elements, such as a "
        "ShearBuilding or MatrixStructure, got Wall"
    }
    for given, names in ((plate, None), (study, ["plate"])):
        with pytest.raises(ValueError, match=r"^model class 'plate': a search needs .* got Wall$"):
            bs.search(given, ONE, baselines=names)
    with pytest.raises(ValueError, match="no model class 'tower'"):
        bs.search(study, ONE, baselines=["tower"])


def test_classes_that_differ_in_their_pairing_are_one_baseline(bare, fake_sampling):
    fake_sampling(by_count(0.0, 1.0))
    other = replace(bare, name="other", configurations=bare.with_any_pairing("x").configurations)
    weights = {"bare": 1.0, "other": 2.0}
    record = bs.search(bs.Study("s", [bare, other], prior_weights=weights), ONE).record
    (baseline,) = record.baselines
    assert (baseline.name, baseline.classes) == ("bare or other", ("bare", "other"))
    assert baseline.prior_probability == pytest.approx(1.0)


# Hypotheses


@pytest.mark.parametrize(
    ("places", "elements"),
    [
        ((), ()),
        ((PENDULUM_3,), (bs.Pendulum(3, 0.2, 2.5),)),
        ((INFILL_01,), (bs.OutOfPlaneInfill((0, 1), 0.4, 2.5),)),
        ((PENDULUM_1, INFILL_12),
         (bs.Pendulum(1, 0.2, 2.5), bs.OutOfPlaneInfill((1, 2), 0.4, 2.5))),
    ],
)  # fmt: skip
def test_a_hypothesis_is_the_structure_with_the_elements_on_it(frame, bare, places, elements):
    """A mass ratio of 0.1 and a mean floor mass of 2 are a vibrating mass of 0.2."""
    frame = replace(frame, masses=(1.0, 2.0, 3.0))
    made = hypothesis(replace(bare, structure=frame), places)
    assert made.name == (" + ".join(place.name for place in places) or "no appendage")
    values = {"k1": 1.1, "k2": 0.9, "k3": 1.2}
    for place in places:
        values |= {f"mass ratio, {place.name}": 0.1, f"frequency, {place.name}": 2.5}
    assert set(made.parameter_names) == set(values)
    modes = made.structure.modes(np.array([[values[name] for name in made.parameter_names]]))
    for element in elements:
        frame = frame.with_element(element)
    expected = frame.modes(np.array([[1.1, 0.9, 1.2]]))
    np.testing.assert_allclose(modes.frequencies_hz, expected.frequencies_hz, rtol=1e-11)


@pytest.mark.parametrize(
    ("given", "frequency"),
    [
        # From half the lowest identified frequency to the end of the band.
        ({}, bs.LogUniform(0.5 * 0.98275928, 6.0)),
        ({"mass_ratio": bs.Uniform(0.01, 0.2), "frequency": bs.LogUniform(2.0, 3.0)},
         bs.LogUniform(2.0, 3.0)),
    ],
)  # fmt: skip
def test_priors_are_those_of_the_band_or_of_the_user(bare, given, frequency):
    settings = SearchSettings(**given)
    made = hypothesis(bare, (PENDULUM_1,), settings)
    priors = {parameter.name: parameter.prior for parameter in made.parameters}
    assert priors["frequency, pendulum 1"] == frequency
    assert priors["mass ratio, pendulum 1"] == settings.mass_ratio


@pytest.mark.parametrize("frequency", [bs.LogUniform(8.0, 20.0), bs.Normal(9.0, 1.0)])
def test_a_frequency_outside_the_band_is_refused(bare, fake_sampling, frequency):
    levels = fake_sampling(by_count(0.0, 0.0))
    with pytest.raises(ValueError, match=r"'bare'.* frequency, .* outside the band 0 to 6 Hz"):
        bs.search(bare, SearchSettings(frequency=frequency))
    assert levels == []


@dataclass(frozen=True)
class RoofPlace(AppendagePlace):
    """Another kind of appendage: a mast of half the mass ratio on the roof."""

    word, title, marker, is_outside = "mast", "mast on the roof", "^", True

    @classmethod
    def fits(cls, candidate):
        return candidate.place == 3

    @property
    def description(self):
        return "a mast"

    def element(self, vibrating_mass, frequency):
        return bs.Pendulum(self.candidate.place, 0.5 * vibrating_mass, frequency, label=self.label)


def test_another_kind_of_appendage_is_one_class(bare, fake_sampling, monkeypatch):
    monkeypatch.setattr("bayes_ssi.studies.appendages.candidates.KINDS", (*KINDS, RoofPlace))
    levels = fake_sampling(by_count(0.0, 1.0, 2.0))
    result = bs.search(bare, ONE)
    assert "mast 3" in levels[1]
    assert {made.pairing for made in result.ranking.study.model_classes} == {"any"}
    record = result.record
    assert from_record(SearchRecord, json.loads(json.dumps(to_record(record)))) == record
    ax = plot_places(record)
    assert len(ax.patches) == sum(not each.place.is_common for each in record.places) == 7
    assert "mast 3" in [tick.get_text() for tick in ax.get_yticklabels()]


# Levels and weights


@pytest.mark.parametrize(
    ("log_evidences", "settings", "n_tried"),
    [
        ((0.0, 9.0, 20.0), ONE, [1, 6]),
        # Two are not tried where one does not help, nor three where two do not.
        ((1.0, 0.0, 50.0), SearchSettings(), [1, 6]),
        ((0.0, 9.0, 8.0, 50.0), SearchSettings(number_weights=(1.0,) * 4), [1, 6, 15]),
    ],
)
def test_levels_end_where_more_do_not_help(bare, fake_sampling, log_evidences, settings, n_tried):
    levels = fake_sampling(by_count(*log_evidences))
    bs.search(bare, settings)
    assert [len(level) for level in levels] == n_tried


@pytest.mark.parametrize(
    ("heights", "branches", "n_tried"),
    [
        ({"infill 1-2": 5.0}, 1, 5),
        # Five further places for each of the two best, their common pair counted once.
        ({"infill 1-2": 5.0, "pendulum 3": 4.0, "no appendage": 0.0}, 2, 9),
    ],
)
def test_two_are_tried_on_the_best_ones(bare, fake_sampling, heights, branches, n_tried):
    levels = fake_sampling(lambda made: heights.get(made.name, -1.0))
    bs.search(bare, SearchSettings(branches=branches))
    assert len(levels) == 3
    assert len(set(levels[2])) == len(levels[2]) == n_tried
    assert all(any(best in name for best in heights) for name in levels[2])
    assert "pendulum 3 + infill 1-2" in levels[2]


# Log evidences of one appendage; the others add nothing and lose 4 nats.
ALONE = {"pendulum 1": 3.0, "pendulum 2": 3.0, "infill 1-2": 2.0, "infill 2-3": 2.0}


def alone(made):
    parts = made.name.split(" + ")
    return 0.0 if made.name == "no appendage" else sum(ALONE.get(part, -4.0) for part in parts)


def test_two_are_tried_wherever_they_would_be_probable_and_with_the_best(bare, fake_sampling):
    """Two of the four that help, and the best with every other; not the two that do not."""
    levels = fake_sampling(alone)
    record = bs.search(bare, SearchSettings(branches=1)).record
    pairs = {frozenset(name.split(" + ")) for name in levels[2]}
    assert len(pairs) == len(levels[2]) == 8
    assert {frozenset((a, b)) for a in ALONE for b in ALONE if a != b} <= pairs
    assert record.n_not_tried == math.comb(6, 2) - 8
    assert sum(row.probability for row in record.hypotheses) == pytest.approx(1.0)


def test_what_is_not_tried_has_the_probability_that_parts_alone_let_expect(bare, fake_sampling):
    fake_sampling(alone)
    result = bs.search(bare, SearchSettings(branches=1))
    tried = {row.name for row in result.record.hypotheses}
    names = [place.name for place in places_of_building(bare.structure)]
    pairs = [f"{a} + {b}" for i, a in enumerate(names) for b in names[i + 1 :]]
    weight = 0.2 / len(pairs)
    masses = {"no appendage": 1.0} | {name: math.exp(ALONE.get(name, -4.0)) / 6 for name in names}
    masses |= {p: weight * math.exp(sum(ALONE.get(n, -4.0) for n in p.split(" + "))) for p in pairs}
    left = sum(mass for name, mass in masses.items() if name not in tried)
    assert result.record.expected_not_tried == pytest.approx(left / sum(masses.values()), rel=1e-9)
    (note,) = [note for note in search_notes(result.record) if note.startswith("Not tried")]
    assert note.startswith("Not tried: 7 with several appendages")


def test_nothing_is_said_where_all_are_tried(bare, fake_sampling):
    fake_sampling(by_count(0.0, 9.0, 8.0))
    result = bs.search(bare)
    assert (result.record.n_not_tried, result.record.expected_not_tried) == (0, 0.0)
    assert not any(note.startswith("Not tried") for note in search_notes(result.record))


def test_of_too_many_the_best_are_tried(bare, fake_sampling, monkeypatch):
    """The best nine, and the best single one with the place that adds nothing."""
    monkeypatch.setattr("bayes_ssi.studies.search.family_search.MOST_EXPECTED", 9)
    levels = fake_sampling(lambda made: 9.0 if made.name == PENDULUM_3.name else alone(made) + 5.0)
    bs.search(bare, SearchSettings(branches=1))
    assert len(levels[2]) == 10
    assert sum("pendulum 3" in name for name in levels[2]) == 5
    assert "infill 1-2 + infill 2-3" not in levels[2]


def test_where_the_answer_rests_on_many_twelve_are_sampled(bare, fake_sampling):
    """And no appendage. What approximations of the others may be off by is said."""
    fake_sampling(lambda _: 0.0, lambda made: 0.1 * len(made.structure.appendages))
    result = bs.search(bare, SearchSettings(number_weights=(1.0, 6.0, 15.0), branches=6))
    assert len(result.record.hypotheses) == 22
    assert sum(row.is_sampled for row in result.record.hypotheses) == 13
    note = "≈: off by +0.00 to +0.20 nats where hypotheses were sampled."
    assert note in search_notes(result.record)


def test_probabilities_of_places_are_sums_over_hypotheses(bare, fake_sampling):
    log_evidence = by_count(0.0, 1.0, 3.0)
    fake_sampling(log_evidence)
    result = bs.search(bare, ALL)
    study = result.ranking.study
    masses = {
        each.name: study.prior_weights[each.name] * math.exp(log_evidence(each))
        for each in study.model_classes
    }
    expected = {name: mass / sum(masses.values()) for name, mass in masses.items()}
    places = {h.name: [each.place for each in h.features] for h in result.record.hypotheses}
    for place in places_of_building(bare.structure):
        total = sum(share for name, share in expected.items() if place in places[name])
        assert result.record.place(place.name).probability == pytest.approx(total, rel=1e-9)
    without = expected["no appendage"]
    assert result.record.probability_of_any == pytest.approx(1.0 - without, rel=1e-9)


def test_progress_and_seed_reach_the_sampling(bare, monkeypatch, make_posterior):
    calls = []

    def screen(hypothesis, target, seed, effort):
        del target, seed, effort
        return screened(hypothesis[0], 0.0)

    def sample_all(candidates, seed, settings, run, refinement, known_starts):
        del refinement, known_starts
        calls.append((seed, settings, run.checkpoint.directory.name))
        run.report(candidates[0].name, "evidence", 1.0)
        return [make_posterior(c.name, names=c.parameter_names) for c in candidates]

    monkeypatch.setattr("bayes_ssi.studies.search.approximate_evidence._screened", screen)
    monkeypatch.setattr("bayes_ssi.studies.search.family_search.sample_all", sample_all)
    said = []
    run = bs.Run(checkpoint="there", progress=lambda *what: said.append(what))
    result = bs.search(bare, ONE, 5, COARSE, run)
    assert calls == [(5, COARSE, "there")]
    assert said[-1] == ("no appendage", "evidence", 1.0)
    assert said[0] == ("all hypotheses", "screening 1", 1.0)
    # Six places side by side, then three motions.
    assert said[1:3] == [("all hypotheses", "screening 9", share) for share in (0.5, 1.0)]
    assert (result.ranking.seed, result.ranking.settings) == (5, COARSE)
