"""Tables of many tests of one structure."""

import numpy as np
import pytest
from whole_tables import assert_every_cell_is_whole

import bayes_ssi as bs
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.plots import plot_population
from bayes_ssi.report.tables.prediction_tables import (
    hierarchy_notes,
    population_table,
    populations_table,
)
from bayes_ssi.results.hierarchy.hierarchy_record import CovariateScale, SingleTestSummary
from bayes_ssi.results.hierarchy.populations import Population, RankedPopulation


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


def cells(table):
    return [list(column.cells) for column in table.columns]


def test_populations_are_in_the_units_of_the_parameters(made):
    (_, centre, change, spread, following) = (str(column[0]) for column in cells(
        population_table(made, 20.0)
    ))  # fmt: skip
    assert centre == "110 to 110"
    assert change == "0.4 to 0.4"
    assert spread == "2 to 2"
    low, high = map(float, following.split(" to "))  # N(114, 2²), from 1000 draws
    assert (low, high) == pytest.approx((114.0 - 3.29, 114.0 + 3.29), abs=0.5)


def test_tables_fit_a_narrow_terminal(made):
    for table in (populations_table(made), population_table(made, 20.0)):
        assert_every_cell_is_whole(table, 60)


def test_a_ranking_of_populations_and_its_notes(made):
    assert [str(column[0]) for column in cells(populations_table(made))] == [
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
    figure = plot_population(made)
    (ax,) = figure.axes
    assert [bar.lines[0].get_xdata()[0] for bar in ax.containers] == [0.0, 10.0, 20.0]
    (line,) = [line for line in ax.lines if len(line.get_xdata()) > 2]
    # 100 + 20 (0.5 + 0.2 (x - 10)/10)
    np.testing.assert_allclose(line.get_ydata(), 106.0 + 0.4 * line.get_xdata(), rtol=1e-12)
    assert ax.get_ylabel() == "k (N/m)"
