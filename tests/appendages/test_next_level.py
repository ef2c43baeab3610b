"""Which hypotheses with several appendages are tried, and which are not."""

import math

import pytest
from searches import PENDULUM_3, by_count, places_of_building

from bayes_ssi.report.tables.search_tables import search_notes
from bayes_ssi.studies.appendages.candidates import SearchSettings
from bayes_ssi.studies.questions import search

# Log evidences of one appendage; the others add nothing and lose 4 nats.
ALONE = {"pendulum 1": 3.0, "pendulum 2": 3.0, "infill 1-2": 2.0, "infill 2-3": 2.0}


def alone(made):
    parts = made.name.split(" + ")
    return 0.0 if made.name == "no appendage" else sum(ALONE.get(part, -4.0) for part in parts)


def test_two_are_tried_wherever_they_would_be_probable_and_with_the_best(bare, fake_sampling):
    """Two of the four that help, and the best with every other; not the two that do not."""
    levels = fake_sampling(alone)
    record = search(bare, SearchSettings(branches=1)).record
    pairs = {frozenset(name.split(" + ")) for name in levels[2]}
    assert len(pairs) == len(levels[2]) == 8
    assert {frozenset((a, b)) for a in ALONE for b in ALONE if a != b} <= pairs
    assert record.n_not_tried == math.comb(6, 2) - 8
    assert sum(row.probability for row in record.hypotheses) == pytest.approx(1.0)


def test_what_is_not_tried_has_the_probability_that_parts_alone_let_expect(bare, fake_sampling):
    fake_sampling(alone)
    result = search(bare, SearchSettings(branches=1))
    tried = {row.name for row in result.record.hypotheses}
    names = [place.name for place in places_of_building(bare.structure)]
    pairs = [f"{a} + {b}" for i, a in enumerate(names) for b in names[i + 1 :]]
    weight = 0.2 / len(pairs)
    masses = {"no appendage": 1.0} | {name: math.exp(ALONE.get(name, -4.0)) / 6 for name in names}
    masses |= {p: weight * math.exp(sum(ALONE.get(n, -4.0) for n in p.split(" + "))) for p in pairs}
    left = sum(mass for name, mass in masses.items() if name not in tried)
    expected = left / sum(masses.values())
    assert result.record.expected_not_tried == pytest.approx(expected, rel=1e-9)
    (note,) = [note for note in search_notes(result.record) if note.startswith("Not tried")]
    assert note.startswith("Not tried: 7 with several appendages")


def test_nothing_is_said_where_all_are_tried(bare, fake_sampling):
    fake_sampling(by_count(0.0, 9.0, 8.0))
    result = search(bare)
    assert (result.record.n_not_tried, result.record.expected_not_tried) == (0, 0.0)
    assert not any(note.startswith("Not tried") for note in search_notes(result.record))


def test_of_too_many_the_best_are_tried(bare, fake_sampling, monkeypatch):
    """The best nine, and the best single one with the place that adds nothing."""
    monkeypatch.setattr("bayes_ssi.studies.search.family_search.MOST_EXPECTED", 9)
    levels = fake_sampling(lambda made: 9.0 if made.name == PENDULUM_3.name else alone(made) + 5.0)
    search(bare, SearchSettings(branches=1))
    assert len(levels[2]) == 10
    assert sum("pendulum 3" in name for name in levels[2]) == 5
    assert "infill 1-2 + infill 2-3" not in levels[2]


def test_where_the_answer_rests_on_many_twelve_are_sampled(bare, fake_sampling):
    """And no appendage. What approximations of the others may be off by is said."""
    fake_sampling(lambda _: 0.0, lambda made: 0.1 * len(made.structure.appendages))
    result = search(bare, SearchSettings(number_weights=(1.0, 6.0, 15.0), branches=6))
    assert len(result.record.hypotheses) == 22
    assert sum(row.is_sampled for row in result.record.hypotheses) == 13
    note = "≈: off by +0.00 to +0.20 nats where hypotheses were sampled."
    assert note in search_notes(result.record)
