"""No table crops anything, whatever the width of the terminal."""

import pytest
from whole_tables import assert_every_cell_is_whole, printed

import bayes_ssi as bs
from bayes_ssi.report.tables.layout import add_row, new_table
from bayes_ssi.report.tables.mode_tables import (
    calibration_modes_table,
    calibration_table,
    modes_table,
    standard_errors_table,
)
from bayes_ssi.report.tables.ranking_tables import (
    averages_table,
    evidence_table,
    parameter_table,
    ranking_table,
)
from bayes_ssi.report.tables.search_tables import (
    appendage_place_table,
    averaged_table,
    search_table,
)
from bayes_ssi.studies.ranking.study import averaged_parameters

NAMES = ("each storey, free errors", "one factor", "Geschossdeckenverbundtragwerk 3", "壁のモデル")


@pytest.fixture
def all_tables(make_posterior, found_in_case_c, model_classes, case_c):
    parameters = ("k storey 1 / 2", "frequency_cov", "a stiffness factor of all storeys")
    posteriors = [
        make_posterior(name, -1234.5678 * i, names=parameters, failed_checks=("x",) * (i == 0))
        for i, name in enumerate(NAMES)
    ]
    comparison = bs.compare(posteriors, dict(zip(NAMES, (1.0, 2.0, 3.0, 4.0), strict=True)))
    calibration = bs.calibrate(model_classes["3"])
    open_ = bs.calibrate(model_classes["2"], n_starts=4, shape_weight=0.0, with_prior=True)
    record, of_search = found_in_case_c.record, found_in_case_c.ranking
    return (
        ranking_table(comparison, "A study of four model classes with a long title: which is it?"),
        evidence_table(posteriors),
        parameter_table(posteriors[0]),
        averages_table(averaged_parameters(posteriors, comparison)),
        calibration_table(calibration),
        calibration_modes_table(calibration),
        standard_errors_table(open_),
        modes_table(case_c),
        search_table(record, of_search.comparison, "A search"),
        appendage_place_table(record),
        averaged_table(record),
    )


@pytest.mark.parametrize("width", [60, 80, 120])
def test_every_cell_is_whole(all_tables, width):
    for table in all_tables:
        assert "…" not in "\n".join(printed(table, width))
        assert_every_cell_is_whole(table, width)


def test_what_does_not_fit_continues_below_with_the_names_repeated():
    table = new_table("", ["class"], ["first", "second", "third"])
    add_row(table, "one of two", "1.000 ± 0.001", "2.000 ± 0.001", "3.000 ± 0.001")
    assert len([line for line in printed(table, 60) if "one of two" in line]) == 1
    narrow = printed(table, 45)
    assert len([line for line in narrow if "one of two" in line]) == 2
    assert [line.split() for line in narrow if "third" in line] == [["class", "third"]]


def test_numbers_fold_where_not_even_one_column_fits():
    table = new_table("", ["class"], ["log evidence"])
    add_row(table, "name", "123456.789")
    text = "".join("".join(line.split()) for line in printed(table, 14))
    assert text.replace("name", "").endswith("123456.789")
