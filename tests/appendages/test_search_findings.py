"""What a search finds, sampled coarsely, and its tables and notes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from searches import COARSE, INFILL_12, exact_modes
from whole_tables import assert_every_cell_is_whole, printed

import bayes_ssi as bs
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.report.tables.search_tables import (
    appendage_place_table,
    averaged_table,
    search_notes,
    search_table,
)
from bayes_ssi.results.wording import quantity
from bayes_ssi.studies.appendages.appendage_search import SearchRecord
from bayes_ssi.studies.ranking.comparison import probability_text


def test_the_hidden_infill_is_found_where_it_is_with_its_mass_and_frequency(found_in_case_c):
    record = found_in_case_c.record
    assert found_in_case_c.ranking.comparison.best.name == "infill 1-2"
    assert record.place("infill 1-2").probability > 0.99
    assert record.probability_of_any > 0.99
    (infill,) = record.hypothesis("infill 1-2").features
    low, middle, high = infill.amounts["mass"]
    assert low < 0.075 < high
    assert middle == pytest.approx(0.075, abs=0.01)
    # How much of its mass leaves the floors is not known, which widens the interval.
    low, middle, high = infill.amounts["frequency_hz"]
    assert low < 2.8019 < high
    assert middle == pytest.approx(2.8019, abs=(high - low) / 3.29)  # a standard deviation
    (modes,) = found_in_case_c.ranking.posterior("infill 1-2").configurations
    assert list(modes.pairing.values()) == [1, 2, 3, 4]


@pytest.mark.usefixtures("quick_screening")
def test_no_appendage_is_detected_on_a_bare_frame(frame, fixed_error):
    data = exact_modes(frame, frame.degrees_of_freedom, (0.0, 6.0))
    np.testing.assert_allclose(data.frequencies_hz, [1.0, 2.80193774, 4.04891734], atol=1e-8)
    baseline = bs.ModelClass("bare", frame, data, fixed_error, pairing={})
    result = bs.search(baseline, bs.SearchSettings(number_weights=(1.0, 1.0)), settings=COARSE)
    assert result.ranking.comparison.best.name == "no appendage"
    assert result.record.probability_of_any < 0.2


@pytest.mark.usefixtures("quick_screening", "no_motions")
def test_workers_do_not_change_a_bit(tiny_study, monkeypatch, copied_workers):
    """Of two hypotheses that are screened, and the one that is sampled."""
    monkeypatch.setattr("bayes_ssi.studies.appendages.baselines.places_of", lambda _: (INFILL_12,))
    one = bs.SearchSettings(number_weights=(1.0, 1.0), most_sampled=1)
    here, there = (
        bs.search(tiny_study.model_classes[0], one, 3, COARSE, bs.Run(workers))
        for workers in (None, copied_workers)
    )
    assert here.record == there.record
    assert len(here.record.hypotheses) == 2
    for own, other in zip(here.ranking.posteriors, there.ranking.posteriors, strict=True):
        assert own.evidence == other.evidence
        assert own.draws.tobytes() == other.draws.tobytes()
        assert own.configurations == other.configurations


def table_of(found):
    return search_table(found.record, found.ranking.comparison, found.ranking.study.name)


def test_improbable_hypotheses_are_not_on_the_first_screen(found_in_case_c):
    record = found_in_case_c.record
    improbable = [row for row in record.hypotheses[:8] if row.features and row.probability < 1e-4]
    assert improbable
    table = search_table(record, found_in_case_c.ranking.comparison, "A search", 1e-4)
    names = list(map(str, table.columns[0].cells))
    assert len(names) == len(list(table_of(found_in_case_c).columns[0].cells)) - len(improbable)
    assert any(name.startswith("no appendage") for name in names)
    assert not {row.name for row in improbable} & set(names)


@pytest.fixture
def of_a_tall_building(fake_sampling):
    """Twenty storeys, masses in kg, two appendages: the longest names and numbers."""
    fake_sampling(lambda made: 10.0 * made.name.startswith("pendulum 20")
                  + 9.0 * ("infill 19-20" in made.name) - 5.0)  # fmt: skip
    k = bs.Parameter("stiffness multiplier of all storeys", bs.LogNormal(1.0, 0.3))
    structure = bs.ShearBuilding((3.2e5,) * 20, [2.5e8 * k] * 20)
    data = bs.ModalData((bs.IdentifiedMode("1", 0.98),), (0.0, 6.0))
    tower = bs.ModelClass("tower", structure, data, bs.ErrorModel(0.01), pairing={})
    return bs.search(bs.Study("tower", [tower], mass_unit="kg"))


def test_tables_cut_nothing_in_narrow_and_wide_terminals(of_a_tall_building):
    record = of_a_tall_building.record
    tables = averaged_table(record), appendage_place_table(record), table_of(of_a_tall_building)
    for table, width in itertools.product(tables, (60, 80, 120)):
        assert "…" not in "\n".join(printed(table, width))
        assert_every_cell_is_whole(table, width)
    assert max(map(len, search_notes(record))) <= 80


def test_hypotheses_are_in_the_order_of_their_probability(found_in_case_c):
    table = table_of(found_in_case_c)
    rows = found_in_case_c.record.hypotheses
    shown = [str(cell).removesuffix(" (!)") for cell in table.columns[0].cells]
    probabilities = {row.name: row.probability for row in rows}
    assert len(shown) == 8  # of ten
    ordered = sorted(probabilities.values(), reverse=True)
    assert [probabilities[name] for name in shown] == ordered[:8]
    priors = dict(zip(shown, map(str, table.columns[1].cells), strict=True))
    # A half; of the other, three motions and appendages at six places have half each.
    assert priors["no appendage"] == "0.5000"
    assert priors["motion like mode 2"] == "0.0833"
    assert priors["infill 1-2"] == "0.0417"


def test_masses_have_the_study_s_unit_and_places_that_no_row_shows_are_summed(of_a_tall_building):
    record = of_a_tall_building.record
    assert record.mass_unit == of_a_tall_building.ranking.study.mass_unit == "kg"
    headings = [str(column.header) for column in appendage_place_table(record).columns]
    assert "vibrating mass (kg)" in headings
    older = {key: value for key, value in to_record(record).items() if key != "mass_unit"}
    assert from_record(SearchRecord, older) == replace(record, mass_unit="")
    names, probabilities, *_ = ([*map(str, c.cells)] for c in appendage_place_table(record).columns)
    assert len(record.matched) == 2
    assert len(names) == 18
    for last, appendage in zip((8, 17), record.matched, strict=True):
        rest = [place.probability for place in appendage.places[8:]]
        assert names[last] == f"{len(rest)} others"
        assert probabilities[last] == probability_text(sum(rest))


def test_every_place_has_its_probability_mass_and_frequency(found_in_case_c):
    """Among the hypotheses with one appendage: those at a place are those of one hypothesis."""
    table = appendage_place_table(found_in_case_c.record)
    names, probabilities, masses, frequencies = ([*map(str, c.cells)] for c in table.columns)
    assert names[0] == "infill 1-2"
    assert len(names) == 6
    (row,) = [row for row in found_in_case_c.record.hypotheses if row.name == "infill 1-2"]
    with_one = found_in_case_c.record.probability_of_any  # at most one
    assert probabilities[0] == probability_text(row.probability / with_one)
    (infill,) = row.features
    assert masses[0] == quantity(*infill.amounts["mass"])
    assert frequencies[0] == quantity(*infill.amounts["frequency_hz"])


def test_the_table_always_shows_no_appendage_and_counts_what_it_leaves_out(of_a_tall_building):
    """Eight by probability, and no appendage in addition; what was not sampled has a sign."""
    record, table = of_a_tall_building.record, table_of(of_a_tall_building)
    rows, notes = record.hypotheses, search_notes(record)
    assert "no appendage" not in [row.name for row in rows[:8]]
    assert "-5.00" in "\n".join(printed(table))
    assert f"{len(rows) - 9} less probable hypotheses are in the saved result." in notes
    sampled = {row.name for row in of_a_tall_building.ranking.comparison.classes}
    signed = {
        str(name): str(evidence).startswith("≈")
        for name, evidence in zip(table.columns[0].cells, table.columns[3].cells, strict=True)
    }
    assert set(signed.values()) == {True, False}
    assert all(signed[name] == (name not in sampled) for name in signed)
    (note,) = [note for note in notes if "not sampled" in note]
    assert note.startswith(f"≈: not sampled, {len(rows) - len(sampled)} of {len(rows)} hypotheses")
