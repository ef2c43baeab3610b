"""Measures of chains and of importance weights as arviz computes them.

This module alone touches arviz, of both generations: up to 0.23, and from 1.0 on. It is imported
where it is first needed, because its import takes longer than many a study.
"""

import math
import os
import warnings
from collections.abc import Callable
from functools import cache
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray

# Of shorter chains arviz computes nothing: their halves have no variance.
FEWEST_STEPS = 4
# Of fewer weights, the tail is shorter than the six that every version fits a distribution to.
FEWEST_WEIGHTS = 30


@cache
def arviz() -> ModuleType:
    """The package, whichever generation is installed."""
    with warnings.catch_warnings():
        # Versions 0.22 and 0.23 announce the next generation.
        warnings.simplefilter("ignore", FutureWarning)
        try:
            import arviz
        except OSError:
            # 0.23 notes when it did so in the user's cache folder, which may not be writable.
            from unittest.mock import patch

            with TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):
                import arviz
    return arviz


@cache
def _statistics() -> Any:
    """What has arviz's functions of arrays: of both generations ``rhat``, ``ess`` and ``mcse``."""
    if hasattr(arviz(), "psislw"):
        return arviz()
    from arviz_stats.base import array_stats

    return array_stats


def r_hat(chains: FloatArray) -> FloatArray:
    """Rank-normalised split R-hat of each coordinate, (d,) (Vehtari et al. 2021).

    Infinite where it is not defined: of fewer than two chains or four steps, of draws that are all
    the same or not all finite.

    Args:
        chains: (n_chains, n_steps, d).
    """
    if len(chains) < 2:
        return np.full(chains.shape[-1], math.inf)
    return _by_coordinate(_statistics().rhat, chains, math.inf)


def bulk_ess(chains: FloatArray) -> FloatArray:
    """Effective sample size of the ranks of each coordinate, (d,) (Vehtari et al. 2021).

    Of chains (n_chains, n_steps, d). Zero where it is not defined, as for :func:`r_hat`.
    """
    return _by_coordinate(_statistics().ess, chains, 0.0)


def tail_ess(chains: FloatArray) -> FloatArray:
    """The smaller of the effective sample sizes of the 5 and 95 % quantiles, (d,).

    Of chains (n_chains, n_steps, d). Zero where it is not defined, as for :func:`r_hat`.
    """
    ess = _statistics().ess
    return _by_coordinate(lambda draws: ess(draws, method="tail", prob=(0.05, 0.95)), chains, 0.0)


def mcse_mean(chains: FloatArray) -> FloatArray:
    """Monte Carlo standard error of the mean of each coordinate, (d,).

    Of chains (n_chains, n_steps, d). Infinite where it is not defined, as for :func:`r_hat`.
    """
    return _monte_carlo_errors(chains, "mean")


def mcse_sd(chains: FloatArray) -> FloatArray:
    """Monte Carlo standard error of the standard deviation of each coordinate, (d,).

    Of chains (n_chains, n_steps, d). Infinite where it is not defined, as for :func:`r_hat`.
    """
    return _monte_carlo_errors(chains, "sd")


def _monte_carlo_errors(chains: FloatArray, method: str) -> FloatArray:
    mcse = _statistics().mcse

    def error(draws: FloatArray) -> float:
        # Draws that differ by less than 1e-15, in whatever unit, arviz takes for a constant.
        spread = np.ptp(draws)
        return mcse(draws / spread, method=method) * spread

    return _by_coordinate(error, chains, math.inf)


def _by_coordinate(
    measure: Callable[[FloatArray], float], chains: FloatArray, undefined: float
) -> FloatArray:
    """``measure`` of the draws (n_chains, n_steps) of each coordinate, (d,)."""
    n_steps, d = chains.shape[1:]
    result = np.full(d, undefined)
    if n_steps < FEWEST_STEPS:
        return result
    with np.errstate(all="ignore"):
        for i, draws in enumerate(np.ascontiguousarray(np.moveaxis(chains, -1, 0))):
            if 0.0 < np.ptp(draws) < math.inf:  # not if one of them is NaN
                value = float(measure(draws))
                result[i] = undefined if math.isnan(value) else value
    return result


def pareto_k(log_weights: FloatArray) -> float:
    """Shape of the generalised Pareto distribution of the largest of weights (n,).

    The fit of Pareto-smoothed importance sampling (Vehtari et al. 2024) to the min(n/5, 3√n)
    largest; below one half, the mean of the weights has a finite variance. Minus infinity where
    these weights are equal but for rounding; infinite where there are fewer than 30 weights or too
    few that matter, or where one is not a number.
    """
    n = len(log_weights)
    if n < FEWEST_WEIGHTS or not np.max(log_weights) < math.inf:
        return math.inf
    n_tail = int(min(0.2 * n, 3.0 * math.sqrt(n)))
    tail = np.partition(log_weights, n - n_tail)[n - n_tail :]
    statistics = _statistics()
    # The second generation takes log-likelihoods left out: their negatives are the log weights.
    sign = 1.0 if statistics is arviz() else -1.0
    with np.errstate(all="ignore"):
        span = tail.max() - tail[0]
        if span < 1e-10:
            return -math.inf
        if not span < 700.0:  # beyond, their ratio is no double
            return math.inf
        k = float(statistics.psislw(sign * log_weights)[1])
    return math.inf if math.isnan(k) else k
