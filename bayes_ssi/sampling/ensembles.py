"""Production: independent emcee ensembles from the tempered starts, until they are long enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.mixture import StudentMixture
from bayes_ssi.sampling.target import Target, log_standard_normal
from bayes_ssi.sampling.tempering import TemperedStart

__all__ = [
    "Ensemble",
    "Proposal",
    "Walkers",
    "autocorrelation_times",
    "effective_sample_size",
    "first_walkers",
    "r_hat",
    "run_ensemble",
]

# A chain is long enough at this many of the autocorrelation times that it measures.
LENGTH_IN_AUTOCORRELATION_TIMES = 50
SOKAL_WINDOW = 5.0


class Proposal(NamedTuple):
    """What proposes the moves of walkers, independently of where they are.

    Attributes:
        mixture: fitted beforehand, and fixed.
        share: of the steps that it proposes; emcee's differential evolution and stretch moves
            propose the others.
    """

    mixture: StudentMixture
    share: float


class Walkers(NamedTuple):
    """Where the walkers of an ensemble are.

    Attributes:
        positions: (n_walkers, d), an even number of at least 2 d walkers.
        log_posteriors: (n_walkers,), likelihood times prior density.
    """

    positions: FloatArray
    log_posteriors: FloatArray


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Draws of one emcee ensemble, in standard-normal coordinates.

    Attributes:
        positions: (n_steps, n_walkers, d).
        log_posteriors: (n_steps, n_walkers), likelihood times prior density.
        autocorrelation_times: (d,), in steps.
        acceptance: share of proposals accepted.
    """

    positions: FloatArray
    log_posteriors: FloatArray
    autocorrelation_times: FloatArray
    acceptance: float

    @property
    def n_steps(self) -> int:
        return len(self.positions)

    @property
    def draws(self) -> FloatArray:
        """All draws, (n_steps · n_walkers, d)."""
        return self.positions.reshape(-1, self.positions.shape[-1])

    @property
    def walkers(self) -> Walkers:
        """Where the ensemble ended."""
        return Walkers(self.positions[-1], self.log_posteriors[-1])

    @property
    def needed_steps(self) -> int:
        """The least number of steps that is long enough."""
        return math.ceil(LENGTH_IN_AUTOCORRELATION_TIMES * self.autocorrelation_times.max())

    @property
    def is_long_enough(self) -> bool:
        return self.n_steps >= self.needed_steps


def run_ensemble(
    target: Target,
    walkers: Walkers,
    proposal: Proposal,
    max_steps: int,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] | None = None,
    slowest: float = math.inf,
) -> Ensemble:
    """Sample the posterior by emcee, until the chain is long enough.

    Most of the moves propose from a mixture, independently of where a walker is, so walkers
    change between separate regions.

    Args:
        target: what is sampled.
        walkers: where they begin.
        proposal: of the moves.
        max_steps: where to stop if the autocorrelation time stays too long.
        seed: everything random follows from it.
        progress: called with the share of the needed length that is done.
        slowest: autocorrelation time in steps above which a first, short run is all.
    """
    from bayes_ssi.sampling.moves import ensemble_sampler, initial_state, raise_if_failed

    n_walkers, d = walkers.positions.shape
    sampler = ensemble_sampler(target.log_posterior, n_walkers, d, *proposal)
    state = initial_state(*walkers, np.random.default_rng(seed))
    wanted = first = min(2 * LENGTH_IN_AUTOCORRELATION_TIMES, max_steps)
    while True:
        state = sampler.run_mcmc(state, wanted - sampler.iteration, skip_initial_state_check=True)
        raise_if_failed(sampler)
        times = autocorrelation_times(sampler.get_chain())
        enough = int(np.ceil(LENGTH_IN_AUTOCORRELATION_TIMES * times.max()))
        if sampler.iteration == first and times.max() > slowest:
            break
        if progress is not None:
            progress(min(sampler.iteration / min(enough, max_steps), 1.0))
        if sampler.iteration >= min(enough, max_steps):
            break
        wanted = min(max_steps, int(1.1 * enough))
    return Ensemble(
        positions=sampler.get_chain(),
        log_posteriors=sampler.get_log_prob(),
        autocorrelation_times=times,
        acceptance=float(np.mean(sampler.acceptance_fraction)),
    )


def first_walkers(start: TemperedStart, n: int, rng: np.random.Generator) -> Walkers:
    """``n`` walkers from the particles of one tempered start."""
    scarce = len(start.positions) < n
    chosen = rng.choice(len(start.positions), size=n, replace=scarce)
    positions = start.positions[chosen]
    return Walkers(positions, start.log_likelihoods[chosen] + log_standard_normal(positions))


def autocorrelation_times(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation times in steps of a chain (n_steps, n_walkers, k), (k,).

    The autocovariance is averaged over the walkers before it is normalised, and taken about the
    mean of all of them: a walker that stays where it is then lengthens the time, while emcee's
    estimate, normalised walker by walker, is not defined for it. Summed over Sokal's window, the
    first M that exceeds five times the estimate.
    """
    n = len(chain)
    centred = chain - chain.mean(axis=(0, 1))
    transformed = np.fft.rfft(centred, n=2 * n, axis=0)
    covariance = np.fft.irfft(np.abs(transformed) ** 2, axis=0)[:n].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = 2.0 * np.cumsum(covariance / covariance[0], axis=0) - 1.0
    beyond = np.arange(n)[:, None] > SOKAL_WINDOW * times
    last = np.where(beyond.any(axis=0), beyond.argmax(axis=0), n - 1)
    found = times[last, np.arange(chain.shape[-1])]
    return np.where(np.isfinite(found), np.maximum(found, 1.0), 1.0)


def effective_sample_size(ensembles: Sequence[Ensemble]) -> FloatArray:
    """Effective number of independent draws of each coordinate, (d,), over all ensembles."""
    return np.sum([e.positions[..., 0].size / e.autocorrelation_times for e in ensembles], axis=0)


def r_hat(ensembles: Sequence[Ensemble]) -> FloatArray:
    """Potential scale reduction of each coordinate, (d,) (Gelman and Rubin 1992).

    The chains compared are the halves of each ensemble, all walkers together: walkers of one
    ensemble are not independent of one another, the ensembles are.
    """
    n = min(e.n_steps for e in ensembles) // 2
    halves = [half for e in ensembles for half in (e.positions[:n], e.positions[-n:])]
    chains = [half.reshape(-1, half.shape[-1]) for half in halves]
    within = np.mean([chain.var(axis=0, ddof=1) for chain in chains], axis=0)
    between = np.var([chain.mean(axis=0) for chain in chains], axis=0, ddof=1)
    size = len(chains[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt((size - 1) / size + between / within)
    return np.where(within > 0, ratio, np.where(between > 0, np.inf, 1.0))
