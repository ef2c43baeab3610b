"""The smallest loss that two tests would have shown."""

from dataclasses import replace

import numpy as np
import pytest
from searches import exact_modes
from test_changes import BUILDING, ERROR, PRIOR, SENSORS, K, model_class

import bayes_ssi as bs
from bayes_ssi.studies.changes.changes_family import choose_changes
from bayes_ssi.studies.changes.visible_loss import (
    log_bayes_factor,
    simulated_tests,
    smallest_loss,
    smallest_losses,
)
from bayes_ssi.studies.search.family_search import screened_hypotheses

# At the prior medians, in a band that holds the modes with large errors.
MODES = exact_modes(BUILDING, SENSORS, (0.0, 9.0), frequency_cov=0.002, shape_sd=0.01)


def test_nine_in_ten_are_above_where_the_normal_distribution_has_them():
    """Log odds of ½ (x/s + n)² - 8 with normal n: nine in ten exceed 2 from s (√20 + 1.2816) on."""
    s, rng = 0.05, np.random.default_rng(0)
    losses = np.geomspace(0.15, 0.5, 4000)
    log_odds = 0.5 * (losses / s + rng.standard_normal(4000)) ** 2 - 8.0
    smallest = smallest_loss(losses, log_odds, 2.0, -8.0)
    assert smallest == pytest.approx(s * (np.sqrt(20.0) + 1.2816), rel=0.01)


def test_a_loss_that_no_test_would_show_has_no_smallest():
    losses, rng = np.linspace(0.1, 0.9, 50), np.random.default_rng(0)
    assert smallest_loss(losses, rng.normal(-3.0, 0.5, 50), 2.0, -5.0) is None


def test_simulated_tests_share_the_errors_that_the_class_says():
    """Frequencies of 10 % error, of which 96 % is shared: 2 % differences times the root of two."""
    same = model_class(a=MODES, b=MODES)
    error = replace(ERROR, frequency_cov=0.1, shape_sd=0.1, between_tests=0.96)
    same = replace(same, error=error)
    z, rng = np.zeros(3), np.random.default_rng(1)
    hz, shapes = [], []
    for _ in range(400):
        before, after = simulated_tests(same, z, rng)
        hz.append([test.data.mode("1").frequency_hz for test in (before, after)])
        shapes.append([test.data.mode("1").shape for test in (before, after)])
    logs = np.log(hz)
    spread = np.sqrt(0.1**2 + 0.002**2)
    assert logs.std() == pytest.approx(spread, rel=0.1)
    apart = np.sqrt(2.0 * (0.04 * 0.1**2 + 0.002**2))
    assert np.diff(logs, axis=1).std() == pytest.approx(apart, rel=0.1)
    of_shapes = np.sqrt(2.0 * (0.04 * 0.1**2 + 0.01**2))
    assert np.diff(shapes, axis=1).std() == pytest.approx(of_shapes, rel=0.1)


def test_losses_beyond_the_smallest_visible_are_seen_and_smaller_ones_are_not():
    """As 60 more tests of that loss say: 0.9 ± 0.04, and ± 0.05 for the scatter of the smallest."""
    building = bs.ShearBuilding((1.0,), [K * bs.Parameter("k1", PRIOR)])
    data = exact_modes(building, (), (0.0, 9.0), frequency_cov=0.002).without_shapes()
    both = [bs.Configuration(name, building, data, pairing={"1": 1}) for name in "ab"]
    error = bs.ErrorModel(0.01, between_tests=0.9)
    tests = bs.ModelClass("building", error=error, configurations=both)
    losses = bs.ChangeSettings(losses_only=True)
    family = choose_changes(bs.Study("s", [tests]), ["a"], ["b"], losses)
    family.features["building"] = family.features["building"][:1]
    hypotheses, _ = screened_hypotheses(family, 0, bs.Run(), most_full=0)
    (nothing,) = [each for key, each in hypotheses.items() if not key.features]
    visible = smallest_losses(family, nothing, 0, bs.Run())
    ((place, smallest),) = visible.items()
    assert 0.01 < smallest < 0.2
    unchanged, screened, baseline = nothing.model_class, nothing.screened, nothing.key.baseline
    changed = family.hypothesis(unchanged, (place,), place.name)
    odds = 9.0 * family.prior_weight(baseline, 0) / family.prior_weight(baseline, 1)
    rng = np.random.default_rng(99)
    draws = rng.choice(screened.z, 60, p=screened.weights)

    def share_shown(loss, n):
        factors = [log_bayes_factor(changed, unchanged, z, loss, rng, {}) for z in draws[:n]]
        return np.mean(np.array(factors) > np.log(odds))

    assert share_shown(smallest, 60) == pytest.approx(0.9, abs=3.0 * np.hypot(0.04, 0.05))
    assert share_shown(0.5 * smallest, 20) < 0.35
