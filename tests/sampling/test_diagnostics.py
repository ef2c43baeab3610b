"""Autocorrelation times against closed forms."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_ssi.inference.sampling.diagnostics import autocorrelation_times


def autoregressive(rho, n_steps=20_000, n_walkers=16, seed=1):
    """A stationary chain of unit variance with correlation ``rho`` between steps."""
    rng = np.random.default_rng(seed)
    noise = math.sqrt(1.0 - rho**2) * rng.standard_normal((n_steps + 500, n_walkers))
    return lfilter([1.0], [1.0, -rho], noise, axis=0)[500:, :, None]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 0.95])
def test_autocorrelation_time_of_an_autoregressive_chain(rho):
    times = autocorrelation_times(autoregressive(rho))
    assert times.shape == (1,)
    assert times[0] == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.06)


def test_each_coordinate_has_its_own_time():
    chain = np.concatenate([autoregressive(0.9), autoregressive(0.3, seed=2)], axis=-1)
    times = autocorrelation_times(chain)
    np.testing.assert_allclose(times, [19.0, 13.0 / 7.0], rtol=0.06)


def test_an_alternating_chain_counts_as_independent_at_best():
    assert autocorrelation_times(autoregressive(-0.9))[0] == 1.0


@pytest.mark.parametrize("value", [3.0, 0.1, 7.7])  # of some, the mean is rounded
def test_a_coordinate_that_does_not_move(value):
    chain = np.concatenate([autoregressive(0.5), np.full((20_000, 16, 1), value)], axis=-1)
    times = autocorrelation_times(chain)
    assert times[0] == pytest.approx(3.0, rel=0.06)
    assert times[1] == 1.0


def test_a_walker_that_never_moves_leaves_the_times_finite():
    chain = autoregressive(0.5, n_steps=200)
    chain[:, 0] = 2.5
    assert np.isfinite(autocorrelation_times(chain)).all()
