"""What arviz does: measures of chains and of importance weights, and draws by groups and in files.

This module alone touches arviz, of both generations: up to 0.23, and from 1.0 on. It is imported
where it is first needed, because its import takes longer than many a study.
"""

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, singledispatch
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.arrays import FloatArray

# Name of a variable → its dimensions and its values; a coordinate is named as its dimension.
Group = Mapping[str, tuple[Sequence[str], ArrayLike]]
# Of shorter chains arviz computes nothing: their halves have no variance.
FEWEST_STEPS = 4
# Of fewer weights, the tail is shorter than the six that every version fits a distribution to.
FEWEST_WEIGHTS = 30


@cache
def arviz() -> ModuleType:
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


def _is_first_generation() -> bool:
    return hasattr(arviz(), "psislw")


@cache
def _statistics() -> Any:
    """What has ``rhat``, ``ess``, ``mcse`` and ``psislw`` of arrays."""
    if _is_first_generation():
        # What numba compiles of 0.23 takes arrays of one element for numbers; numpy 2.4 does not.
        arviz().Numba.disable_numba()
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
    """Effective sample size of the ranks of each coordinate, (d,); 0 where it is not defined."""
    return _by_coordinate(_statistics().ess, chains, 0.0)


def tail_ess(chains: FloatArray) -> FloatArray:
    """The smaller one of the 5 and 95 % quantiles of each coordinate, (d,); 0 likewise."""
    ess = _statistics().ess
    return _by_coordinate(lambda draws: ess(draws, method="tail", prob=(0.05, 0.95)), chains, 0.0)


def mcse_mean(chains: FloatArray) -> FloatArray:
    """Monte Carlo standard error of the mean of each coordinate, (d,); infinite likewise."""
    return _errors(chains, "mean")


def mcse_sd(chains: FloatArray) -> FloatArray:
    """The same of the standard deviation."""
    return _errors(chains, "sd")


def _errors(chains: FloatArray, method: str) -> FloatArray:
    def error(draws: FloatArray) -> float:
        spread = np.ptp(draws)  # below 1e-15, in whatever unit, arviz sees none
        return spread * _statistics().mcse(draws / spread, method=method)

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
    # The second generation takes log-likelihoods left out: their negatives are the log weights.
    sign = 1.0 if _is_first_generation() else -1.0
    with np.errstate(all="ignore"):
        span = tail.max() - tail[0]
        if span < 1e-10:
            return -math.inf
        if not span < 700.0:  # beyond, their ratio is no double
            return math.inf
        k = float(_statistics().psislw(sign * log_weights)[1])
    return math.inf if math.isnan(k) else k


@singledispatch
def groups_of(draws: object) -> Mapping[str, Group]:
    """The groups of draws; whatever lays out one kind of draws registers it here."""
    raise TypeError(f"no groups of {draws!r}")


def in_arviz(draws: object) -> Any:
    """Draws as arviz holds them: an ``InferenceData``, from 1.0 on a ``DataTree``."""
    tree = _tree(groups_of(draws))
    return arviz().InferenceData.from_datatree(tree) if _is_first_generation() else tree


def netcdf_file(draws: object) -> bytes:
    """What a netCDF file of draws holds, which arviz opens.

    It is made in memory: the HDF5 library crashes where a disk becomes full.
    """
    # A buffer that is still lent out when its owner is collected cannot be closed.
    with _tree(groups_of(draws)).to_netcdf(engine="h5netcdf") as lent:
        return bytes(lent)


def _tree(groups: Mapping[str, Group]) -> Any:
    """The groups with their chains and draws numbered."""
    from xarray import Dataset, DataTree

    datasets = {}
    for name, group in groups.items():
        made = Dataset({key: (dims, np.asarray(values)) for key, (dims, values) in group.items()})
        numbers = {dim: range(n) for dim, n in made.sizes.items() if dim in ("chain", "draw")}
        datasets[name] = made.assign_coords(numbers)
    return DataTree.from_dict(datasets)
