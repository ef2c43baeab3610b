"""Independent emcee ensembles whose walkers are the chains that are quoted.

They are as long as arviz's statistics of all chains ask for.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.arviz_functions import bulk_ess, r_hat, tail_ess
from bayes_ssi.inference.sampling.proposals import Independence, begin
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

# Steps after which chains are first judged: of two ensembles, enough where a mixture is near
# the posterior.
FIRST_STEPS = 150
# The first share of the steps, which is left out. Walkers begin at importance draws, resampled,
# or at particles of the posterior.
BURN_IN = 0.1


class Walkers(NamedTuple):
    """Where the walkers of an ensemble are."""

    positions: FloatArray  # (n_walkers, d), an even number of at least 2 d walkers
    log_posteriors: FloatArray  # (n_walkers,), likelihood times prior density


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Draws of one emcee ensemble after burn-in, in standard-normal coordinates."""

    positions: FloatArray  # (n_steps, n_walkers, d)
    log_posteriors: FloatArray  # (n_steps, n_walkers), likelihood times prior density
    burn_in: int  # steps left out before them
    # By emcee, the longest of all coordinates, in steps; NaN where a walker did not move.
    autocorrelation_time: float
    acceptance_fraction: float  # emcee's, the mean over walkers
    thinned_by: int = 1  # of the steps after burn-in, one in so many is kept

    @property
    def n_steps(self) -> int:
        return len(self.positions)

    @property
    def draws(self) -> FloatArray:
        """All draws, (n_steps · n_walkers, d)."""
        return self.positions.reshape(-1, self.positions.shape[-1])

    @property
    def chains(self) -> FloatArray:
        """(n_walkers, n_steps, d)."""
        return self.positions.transpose(1, 0, 2)

    def thinned(self, by: int) -> "Ensemble":
        kept = slice(by - 1, None, by)  # as emcee thins
        positions, log_posteriors = self.positions[kept], self.log_posteriors[kept]
        return replace(self, positions=positions, log_posteriors=log_posteriors, thinned_by=by)


@dataclass(frozen=True, eq=False)
class ChainStatistics:
    """arviz's statistics of chains (n_chains, n_steps, d), parameter by parameter (d,)."""

    chains: FloatArray

    @cached_property
    def r_hat(self) -> float:
        """The largest rank-normalised split R-hat of any parameter."""
        return float(np.max(r_hat(self.chains)))

    @cached_property
    def bulk_sizes(self) -> FloatArray:
        """Bulk effective sample sizes."""
        return bulk_ess(self.chains)

    @cached_property
    def tail_sizes(self) -> FloatArray:
        """Effective sample sizes of the 5 and 95 % quantiles, the smaller of both."""
        return tail_ess(self.chains)

    @property
    def smallest_size(self) -> float:
        return float(min(self.bulk_sizes.min(), self.tail_sizes.min()))

    @property
    def slowness(self) -> float:
        """Draws for each effective one of the slowest parameter's bulk."""
        return self.chains[..., 0].size / max(float(self.bulk_sizes.min()), 1.0)

    def reach(self, settings: SamplingSettings) -> bool:
        """Whether they have what the settings aim at."""
        enough = self.smallest_size >= settings.effective_sample_size
        return enough and self.r_hat <= settings.r_hat


def statistics_of(target: Target, ensembles: Sequence[Ensemble]) -> ChainStatistics:
    """Those of the parameter values of all walkers of all ensembles."""
    z = np.concatenate([ensemble.chains for ensemble in ensembles])
    if target.parameter_values is None:
        return ChainStatistics(z)
    return ChainStatistics(target.parameter_values(z.reshape(-1, z.shape[-1])).reshape(z.shape))


def thinned_ensembles(
    target: Target,
    ensembles: tuple[Ensemble, ...],
    statistics: ChainStatistics,
    settings: SamplingSettings,
) -> tuple[tuple[Ensemble, ...], ChainStatistics]:
    """Without steps that hardly add to what ``settings`` aim at, and the statistics of the others.

    One step in half an autocorrelation time, as emcee advises, or in half, a quarter … of that.
    """
    by = int(statistics.slowness / 2.0)
    while by > 1:
        fewer = tuple(ensemble.thinned(by) for ensemble in ensembles)
        of_fewer = statistics_of(target, fewer)
        if of_fewer.reach(settings):
            return fewer, of_fewer
        by //= 2
    return ensembles, statistics


def run_ensembles(
    target: Target,
    walkers: Sequence[Walkers],
    proposals: Sequence[Independence],
    settings: SamplingSettings,
    rngs: Sequence[np.random.Generator],
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[tuple[Ensemble, ...], ChainStatistics]:
    """Sample the posterior with emcee until the chains, and statistics, are as ``settings`` aim.

    Most moves propose from a mixture, independently of a walker's position, so that walkers
    change between separate regions.
    """
    running = []
    for start, independence, rng in zip(walkers, proposals, rngs, strict=True):
        positions, log_posteriors = start
        values = log_posteriors, log_posteriors - log_standard_normal(positions)
        running.append(begin(target.log_density, positions, values, independence, rng))
    n, most = min(FIRST_STEPS, settings.max_steps), settings.max_steps
    while True:
        running = [
            (sampler, sampler.run_mcmc(state, n - sampler.iteration, skip_initial_state_check=True))
            for sampler, state in running
        ]
        ensembles = tuple(_ensemble(sampler) for sampler, _ in running)
        statistics = statistics_of(target, ensembles)
        if n >= most or statistics.reach(settings):
            progress(1.0)
            return ensembles, statistics
        excess = (statistics.r_hat - 1.0) / (settings.r_hat - 1.0)
        factor = max(settings.effective_sample_size / max(statistics.smallest_size, 1.0), excess)
        wanted = math.ceil(n * min(1.1 * factor, 2.0))
        progress(n / wanted)
        n = min(wanted, most)


def _ensemble(sampler: Any) -> Ensemble:
    burn_in = math.floor(BURN_IN * sampler.iteration)
    with np.errstate(divide="ignore", invalid="ignore"):  # walkers that did not move
        times = sampler.get_autocorr_time(discard=burn_in, tol=0)
    return Ensemble(
        positions=sampler.get_chain(discard=burn_in),
        log_posteriors=sampler.get_log_prob(discard=burn_in),
        burn_in=burn_in,
        autocorrelation_time=float(np.max(times)),
        acceptance_fraction=float(np.mean(sampler.acceptance_fraction)),
    )
