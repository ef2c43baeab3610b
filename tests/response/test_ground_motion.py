"""Ground motion: what is refused, and what is warned of."""

import math

import numpy as np
import pytest

from bayes_ssi.structures.response import GroundMotion


@pytest.mark.parametrize(
    ("samples", "dt", "message"),
    [
        ([], 0.01, "two samples or more, got 0"),
        ([1.0], 0.01, "two samples or more, got 1"),
        ([[1.0, 2.0]], 0.01, r"two samples or more, got \(1, 2\)"),
        ([1.0, math.inf, math.nan], 0.01, "sample 2 is not finite: inf"),
        (["a", "b"], 0.01, "must be a list of numbers"),
        ([1.0, 2.0], 0.0, "dt must be positive and finite"),
        ([1.0, 2.0], math.nan, "dt must be positive and finite"),
        ([1.0, 2.0], None, "dt must be positive and finite"),
    ],
)
def test_invalid_records(samples, dt, message):
    with pytest.raises(ValueError, match=message):
        GroundMotion(samples, dt)


def test_a_peak_beyond_any_earthquake_and_modes_above_half_the_sampling_rate_are_reported():
    (text,) = GroundMotion([0.0, 1961.33], 0.01, "roof").warnings(np.array([1.0]))
    assert text.startswith("record roof: its peak, 200 g, is beyond")
    assert GroundMotion([0.0, 39.2], 0.01).warnings(np.array([1.0])) == []
    motion = GroundMotion([0.0, 1.0], 0.05, "slow")
    (text,) = motion.warnings(np.array([1.0, 9.9, 10.1, 30.0]))
    assert "carry frequencies up to 10 Hz; mode 3 of the structure, at 10.1 Hz" in text
    assert motion.warnings(np.array([1.0, 9.9])) == []
