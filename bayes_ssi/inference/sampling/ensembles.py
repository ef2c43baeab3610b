"""Independent emcee ensembles that sample a posterior until they are long enough."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.diagnostics import autocorrelation_times
from bayes_ssi.inference.sampling.mixture import Proposal
from bayes_ssi.inference.sampling.settings import CHAINS
from bayes_ssi.inference.sampling.target import Target, log_standard_normal


class Walkers(NamedTuple):
    """Where the walkers of an ensemble are."""

    positions: FloatArray  # (n_walkers, d), an even number of at least 2 d walkers
    log_posteriors: FloatArray  # (n_walkers,), likelihood times prior density


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Draws of one emcee ensemble, in standard-normal coordinates."""

    positions: FloatArray  # (n_steps, n_walkers, d)
    log_posteriors: FloatArray  # (n_steps, n_walkers), likelihood times prior density
    autocorrelation_times: FloatArray  # (d,), in steps
    acceptance: float

    @property
    def n_steps(self) -> int:
        return len(self.positions)

    @property
    def draws(self) -> FloatArray:
        """All draws, (n_steps · n_walkers, d)."""
        return self.positions.reshape(-1, self.positions.shape[-1])

    @property
    def effective_sample_sizes(self) -> FloatArray:
        """Effective sample size for the mean of each coordinate, (d,)."""
        return self.log_posteriors.size / self.autocorrelation_times

    @property
    def needed_steps(self) -> int:
        return math.ceil(CHAINS.autocorrelation_times * self.autocorrelation_times.max())

    @property
    def is_long_enough(self) -> bool:
        return self.n_steps >= self.needed_steps

    @property
    def is_long_enough_for_tails(self) -> bool:
        """Whether it also is by the times in which walkers enter and leave the tails.

        These may be several times as long, as in the neck of a funnel.
        """
        ends = np.quantile(self.draws, [CHAINS.tail, 1.0 - CHAINS.tail], axis=0)
        in_tails = np.concatenate([self.positions <= ends[0], self.positions >= ends[1]], axis=2)
        longest = autocorrelation_times(in_tails.astype(float)).max()
        return bool(self.n_steps >= CHAINS.autocorrelation_times * longest)


def run_ensemble(
    target: Target,
    walkers: Walkers,
    proposal: Proposal,
    max_steps: int,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] = lambda _: None,
    slowest: float = math.inf,
) -> Ensemble:
    """Sample the posterior with emcee until the chain is long enough.

    Most moves propose from a mixture, independently of a walker's position, so that walkers
    change between separate regions.
    """
    from bayes_ssi.inference.sampling.moves import begin

    def log_density(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = target.log_likelihood(z)
        return values + log_standard_normal(z), values

    positions, log_posteriors = walkers
    values = log_posteriors, log_posteriors - log_standard_normal(positions)
    rng = np.random.default_rng(seed)
    sampler, state = begin(log_density, positions, values, proposal, rng)
    wanted = min(2 * CHAINS.autocorrelation_times, max_steps)
    while True:
        state = sampler.run_mcmc(state, wanted - sampler.iteration, skip_initial_state_check=True)
        chain = sampler.get_chain()
        ensemble = Ensemble(
            positions=chain,
            log_posteriors=sampler.get_log_prob(),
            autocorrelation_times=autocorrelation_times(chain),
            acceptance=float(np.mean(sampler.acceptance_fraction)),
        )
        enough = min(ensemble.needed_steps, max_steps)
        progress(min(wanted / enough, 1.0))
        if wanted >= enough or ensemble.autocorrelation_times.max() > slowest:
            return ensemble
        wanted = min(max_steps, int(1.1 * ensemble.needed_steps))
