"""The retrofit of a measured railway bridge, after its temperature."""

import csv

import numpy as np
import pytest
from conftest import MODEL_CLASSES, script_of


@pytest.fixture(scope="module")
def script():
    return script_of("kw51_retrofit")


def test_the_table_is_that_of_its_source(script):
    """The source states the means of all days before and after; here, of known temperature."""
    assert [len(days.hz) for days in (script.BEFORE, script.AFTER)] == [174, 108]
    assert script.BEFORE.hz.mean() == pytest.approx(2.9239, abs=0.001)
    assert script.AFTER.hz.mean() == pytest.approx(2.9843, abs=0.001)


def test_degrees_of_the_command_are_those_of_the_groups(script):
    with (MODEL_CLASSES / "data" / "kw51_degrees.csv").open(encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    assert {name: float(value) for name, value in rows} == pytest.approx(script.DEGREES, abs=0.006)


def simulated(script, rng, n, degrees, jump=0.0, per_degree=-4e-4):
    hz = 2.92 * (1.0 + jump + per_degree * (degrees - 10.0) + 1e-3 * rng.standard_normal(n))
    return script.Days(hz, degrees)


def test_a_jump_is_measured_after_a_temperature_that_hides_it(script):
    """Days after are 10 degrees warmer, which takes 0.4 % off; the jump is 1 %."""
    rng = np.random.default_rng(0)
    first = simulated(script, rng, 40, rng.uniform(0.0, 15.0, 40))
    second = simulated(script, rng, 40, rng.uniform(10.0, 25.0, 40), jump=0.01)
    probability, (low, median, high) = script.jump_of(script.changed(first, second))
    assert probability > 0.99
    assert abs(median - 0.01) < 4.0 * (high - low) / (2.0 * 1.645)
    assert 0.0003 < 0.5 * (high - low) < 0.003
    jump, error = script.regression(first, second)
    assert abs(jump - 0.01) < 4.0 * error


def test_a_warmer_season_is_no_change(script):
    rng = np.random.default_rng(1)
    first = simulated(script, rng, 40, rng.uniform(0.0, 15.0, 40))
    second = simulated(script, rng, 40, rng.uniform(10.0, 25.0, 40))
    probability, _ = script.jump_of(script.changed(first, second))
    assert probability < 0.1
    assert script.screened(first, second).probability_of_any == pytest.approx(probability, rel=0.3)
    assert abs(second.hz.mean() / first.hz.mean() - 1.0) > 0.003


def test_groups_in_a_row_share_no_day(script):
    rng = np.random.default_rng(0)
    for pairs in (script.at_random, script.in_a_row):
        for _ in range(50):
            first, second = pairs(rng, 20)
            assert len({*first, *second}) == 40
            assert max(*first, *second) < len(script.BEFORE.hz)


def test_tests_are_groups_from_cold_to_warm(script):
    study, names, degrees = script.study_of({"all": script.BEFORE}, 3)
    assert list(degrees) == names["all"] == ["all 1", "all 2", "all 3"]
    assert sorted(degrees.values()) == list(degrees.values())
    tests = {test.name: test.data.modes[0] for test in study.model_classes[0].configurations}
    cold = script.BEFORE.hz[np.argsort(script.BEFORE.degrees)[:58]]
    assert tests["all 1"].frequency_hz == pytest.approx(cold.mean(), rel=1e-12)
    expected = cold.std(ddof=1) / np.sqrt(58) / cold.mean()
    assert tests["all 1"].frequency_cov == pytest.approx(expected, rel=1e-12)
