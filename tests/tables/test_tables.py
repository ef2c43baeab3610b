"""Tables and notes for a terminal, of rankings and of many tests: none crops anything."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm
from whole_tables import assert_every_cell_is_whole, printed

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import Adequacy, PValue
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.inference.posterior.posterior import Region
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.plots import plot_population
from bayes_ssi.report.tables import mode_tables as of_modes
from bayes_ssi.report.tables import ranking_tables as of_rankings
from bayes_ssi.report.tables.layout import add_row, new_table
from bayes_ssi.report.tables.prediction_tables import (
    hierarchy_notes,
    population_table,
    populations_table,
)
from bayes_ssi.report.tables.ranking_tables import comparison_notes, ranking_table, region_notes
from bayes_ssi.report.tables.search_tables import baseline_notes, baseline_table, place_table
from bayes_ssi.results.hierarchy.hierarchy_record import CovariateScale, SingleTestSummary
from bayes_ssi.results.hierarchy.populations import Population, RankedPopulation
from bayes_ssi.studies.ranking.changed_settings import ChangedClass, ParameterChange
from bayes_ssi.studies.ranking.comparison import Check
from bayes_ssi.studies.ranking.study import averaged_parameters
from bayes_ssi.studies.ranking.variations import ParameterSpread


def cells(table, row):
    """The words of the row that begins with ``row``."""
    (actual,) = [line.split() for line in printed(table) if line.split()[: len(row)] == row]
    return actual[len(row) :]


def test_ranking(make_posterior):
    misfit = Adequacy(PValue.of(math.log(2.0) + norm.logsf(3.26)), (), (), ())
    worse = make_posterior("1-a", 0.248, 0.003, adequacy=misfit)
    table = ranking_table(bs.compare([worse, make_posterior("3", 16.067, 0.004)]), "Case (c)")
    assert printed(table)[0] == "Case (c)"
    assert cells(table, ["3"]) == ["16.067", "±", "0.004", "0.00", ">", "0.9999", "-"]
    expected = ["0.248", "±", "0.003", "-15.82", "<", "0.0001", "no", "(3.3", "sd)"]
    assert cells(table, ["1-a"]) == expected


def test_a_failed_check_marks_its_class_and_a_remark_none(make_posterior):
    doubtful = make_posterior("b", -1.0, failed_checks=("the ensembles differ",))
    actual = bs.compare([make_posterior("a"), doubtful])
    assert [line for line in printed(ranking_table(actual)) if "b (!)" in line]
    assert comparison_notes(actual)[-1].startswith("(!): a check failed")
    comparison = bs.compare([make_posterior("a")])
    (row,) = comparison.classes
    remark = Check("setting", "the band's end", fails=False)
    rough = replace(row, checks=(remark,), misfit_sds=0.4, is_rough=True)
    noted = replace(comparison, classes=(rough,))
    assert not [line for line in printed(ranking_table(noted)) if "(!)" in line]
    assert [line for line in printed(ranking_table(noted)) if "no (0.4 sd)" in line]
    last = "".join(comparison_notes(noted)[-2:])
    assert last == "What does not change the answer:  'a': the band's end"


def test_notes_name_the_scale(make_posterior):
    actual = bs.compare([make_posterior("a"), make_posterior("b", -0.1)])
    misfit, evidence, unseen = comparison_notes(actual)
    assert evidence == "Words for evidence: scale of Kass and Raftery (1995)."
    # A standard-normal variable is farther from zero one time in a hundred.
    assert misfit.endswith("one right class in a hundred is beyond 2.6 sd.")
    assert unseen == actual.unseen


def test_prior_probabilities_have_a_column_where_they_differ(make_posterior):
    both = [make_posterior("a"), make_posterior("b")]
    table = ranking_table(bs.compare(both, {"a": 3.0, "b": 1.0}))
    assert cells(table, ["a"])[-3:] == ["0.7500", "0.7500", "-"]
    assert "prior" not in "\n".join(printed(ranking_table(bs.compare(both))))


def test_evidence_and_its_checks(make_posterior):
    table = of_rankings.evidence_table([make_posterior("x", 1.5)])
    assert cells(table, ["x"]) == ["4.50", "3.00", "1.500", "±", "0.010"]


def test_parameters(make_posterior):
    posterior = make_posterior("x", names=("k1",))
    (row,) = posterior.summary
    numbers = (row.mean, row.sd, row.quantile_05, row.median, row.quantile_95)
    expected = [f"{number:.4g}" for number in numbers]
    assert cells(of_rankings.parameter_table(posterior), ["k1"]) == [*expected, "0.25"]
    assert printed(of_rankings.parameter_table(posterior))[0] == "Parameters of 'x'"


def test_the_shift_of_a_changed_mean_has_its_sign_and_its_unit():
    """From 1.0 ± 0.2 to 1.3, by hand: 0.3 / 0.2; from 2.0 ± 0.5 to 1.0: -1.0 / 0.5."""

    def spread(name, mean, sd):
        return ParameterSpread(name, mean, sd, mean - 1.645 * sd, mean, mean + 1.645 * sd, 0.0)

    known = Estimate(-1.0, 0.01)
    up = ParameterChange(spread("up", 1.0, 0.2), spread("up", 1.3, 0.4))
    down = ParameterChange(spread("down", 2.0, 0.5), spread("down", 1.0, 0.1))
    parameters = (up, down, ParameterChange(spread("unknown", 1.0, 0.2), None))
    changed = ChangedClass("A", known, known, 0.5, 0.5, 0.1, "", None, None, "", parameters)
    table = of_rankings.changed_parameters_table(changed)
    shifts = [cells(table, [name])[-1] for name in ("up", "down", "unknown")]
    assert shifts == ["+1.50", "-2.00", "-"]


def test_a_baseline_that_another_class_beats():
    baselines = [
        SimpleNamespace(name=name, prior_probability=p, probability=q, log_evidence=z)
        for name, p, q, z in (("one", 1.0, 1.0, -9.5), ("rival", 0.0, 0.0, -3.25))
    ]
    best, beaten, left_out = baselines[1], baselines[:1], {"odd": "it has a mast"}
    record = SimpleNamespace(
        baselines=baselines, best_without_appendages=best, beaten=beaten, left_out=left_out
    )
    table = baseline_table(record)
    assert cells(table, ["one", "(!)"])[-2:] == ["-9.50", "-6.25"]
    assert cells(table, ["rival"]) == ["-", "-", "-3.25", "0.00"]
    beaten[0].probability = 0.0
    assert baseline_notes(record) == [
        "(!) 'one': without any appendage, 'rival' beats it by 6.2 nats.",
        "Left out: it has a mast",
    ]
    beaten[0].probability = 0.01  # of those that the answer names
    assert baseline_notes(record) == ["Left out: it has a mast"]


def test_losses_are_in_percent():
    amounts = {"loss, k1": (0.1, 0.125, 0.15)}
    place = SimpleNamespace(name="k1", amounts=amounts, probability=0.9, smallest_visible=0.031)
    place.place = place
    record = SimpleNamespace(
        amount=("loss", "loss (%)"), feature="change", has_visible=True, scale=100.0,
        places_by_probability=[place],
    )  # fmt: skip
    assert " ".join(cells(place_table(record), ["k1"])) == "k1 0.9000 12.5 (10.0 to 15.0) 3.1"


def test_regions(make_posterior):
    regions = (Region(0.75, 0.01, 4, (1.0, 2.0)), Region(0.25, 0.01, 4, (3.0, 4.0)))
    assert region_notes(make_posterior("x")) == []
    ((title, notes),) = region_notes(make_posterior("x", regions=regions))
    assert title == "The posterior of 'x' has 2 separate regions:"
    assert notes == ["75.0 ± 1.0 % around k1 = 1, k2 = 2", "25.0 ± 1.0 % around k1 = 3, k2 = 4"]


def test_calibration(model_classes):
    actual = bs.calibrate(model_classes["1-a"], shape_weight=0.0)
    table = of_modes.calibration_table(actual)
    assert "'1-a'" in printed(table)[0]
    assert cells(table, ["before"])[:3] == ["1", "1", "1"]
    assert cells(table, ["1"])[-2:] == ["0.000", "13.0"]
    row = cells(of_modes.calibration_modes_table(actual), ["2a", "2"])
    assert row[:3] == ["2.604", "2.737", "2.604"]
    assert float(row[3]) == pytest.approx(actual.before.modes[1].mac, abs=5e-5)


def test_identified_modes(case_c):
    first = replace(case_c.mode("1"), frequency_cov=0.002, damping=0.015)
    bare = replace(case_c.mode("3"), shape=None)
    part = replace(case_c.mode("2a"), shape=np.array([1.0, math.nan, 1.0j]))
    table = of_modes.modes_table(replace(case_c, modes=(first, bare, part), source="test of May"))
    assert printed(table)[0] == "test of May"
    assert cells(table, ["1"]) == ["0.98276", "0.2", "1.5", "3", "of", "3", "-", "0.0"]
    assert cells(table, ["2a"]) == ["2.6043", "-", "-", "2", "of", "3", "-", "45.0"]
    assert cells(table, ["3"]) == ["3.9841", "-", "-", "-", "-", "-"]


@pytest.mark.parametrize("name", ["k[east]", "[bold]", "[/]"])
def test_names_with_brackets_are_shown_literally(make_posterior, case_c, name):
    """Square brackets are no markup."""
    posterior = make_posterior(name, names=(name,))
    label = replace(case_c.mode("1"), label=name)
    for table in (
        ranking_table(bs.compare([posterior]), name),
        of_rankings.evidence_table([posterior]),
        of_rankings.parameter_table(posterior),
        of_modes.modes_table(replace(case_c, modes=(label,), source=name)),
    ):
        shown = [line for line in printed(table) if name in line]
        assert len(shown) >= 1
        assert all("\x1b" not in line for line in shown)


NAMES = ("each storey, free errors", "one factor", "Geschossdeckenverbundtragwerk 3", "壁のモデル")


@pytest.fixture
def all_tables(make_posterior, model_classes, case_c):
    parameters = ("k storey 1 / 2", "frequency_cov", "a stiffness factor of all storeys")
    posteriors = [
        make_posterior(name, -1234.5678 * i, names=parameters, failed_checks=("x",) * (i == 0))
        for i, name in enumerate(NAMES)
    ]
    comparison = bs.compare(posteriors, dict(zip(NAMES, (1.0, 2.0, 3.0, 4.0), strict=True)))
    calibration = bs.calibrate(model_classes["3"])
    open_ = bs.calibrate(model_classes["2"], n_starts=4, shape_weight=0.0, with_prior=True)
    return (
        ranking_table(comparison, "A study of four model classes with a long title: which is it?"),
        of_rankings.evidence_table(posteriors),
        of_rankings.parameter_table(posteriors[0]),
        of_rankings.averages_table(averaged_parameters(posteriors, comparison)),
        of_modes.calibration_table(calibration),
        of_modes.calibration_modes_table(calibration),
        of_modes.standard_errors_table(open_),
        of_modes.modes_table(case_c),
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


@pytest.fixture
def made():
    """A spread of 0.1 exactly, a slope of 0.2 over a standard deviation of 10 °C."""
    parameter = ParameterRecord("k", "N/m", bs.Normal(100.0, 20.0), False)
    population = Population("varies", ("k",), True, True, bs.PopulationPriors())
    draws = np.tile([0.5, 0.2, 0.1], (400, 1))
    ranked = RankedPopulation(population, -3.0, 0.1, 0.0, draws, ("bad",))
    tests = tuple(
        SingleTestSummary(str(i), 10.0 * i, -1.0, ((90.0, 100.0, 110.0),)) for i in range(3)
    )
    scale = CovariateScale("temperature", 10.0, 10.0)
    return bs.Hierarchy("frame", (parameter,), ("k",), tests, scale, (ranked,), 0, (), ("odd",))


def columns_of(table):
    return [list(column.cells) for column in table.columns]


def test_populations_are_in_the_units_of_the_parameters(made):
    (_, centre, change, spread, following) = (str(column[0]) for column in columns_of(
        population_table(made, 20.0)
    ))  # fmt: skip
    assert centre == "110 to 110"
    assert change == "0.4 to 0.4"
    assert spread == "2 to 2"
    low, high = map(float, following.split(" to "))  # N(114, 2²), from 1000 draws
    assert (low, high) == pytest.approx((114.0 - 3.29, 114.0 + 3.29), abs=0.5)


def test_a_ranking_of_populations_and_its_notes(made):
    for table in (populations_table(made), population_table(made, 20.0)):
        assert_every_cell_is_whole(table, 60)
    assert [str(column[0]) for column in columns_of(populations_table(made))] == [
        "varies (!)", "-3.00 ± 0.10", "0.00", "> 0.9999", "best",
    ]  # fmt: skip
    notes = hierarchy_notes(made, 20.0)
    assert notes[1].endswith("standard deviation 10; centre at the average, next test at 20.")
    assert notes[2:] == [
        "Remark: odd.",
        "Failed checks; do not trust the ranking until they are understood:",
        "  (!) 'varies': bad",
    ]


@pytest.mark.usefixtures("close_figures")
def test_the_picture_shows_every_test_and_the_population(made):
    (ax,) = plot_population(made).axes
    assert [bar.lines[0].get_xdata()[0] for bar in ax.containers] == [0.0, 10.0, 20.0]
    (line,) = [line for line in ax.lines if len(line.get_xdata()) > 2]
    # 100 + 20 (0.5 + 0.2 (x - 10)/10)
    np.testing.assert_allclose(line.get_ydata(), 106.0 + 0.4 * line.get_xdata(), rtol=1e-12)
    assert ax.get_ylabel() == "k (N/m)"
