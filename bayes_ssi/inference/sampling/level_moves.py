"""Moves of particles under the prior above a level of the likelihood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.mixture import LIGHT_TAILS, Proposal
from bayes_ssi.inference.sampling.mixture_fitting import fit_mixture
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

# Moves go on until positions and ranks have lost half of their correlation with where they began,
# or no more of it is lost.
CORRELATION_LEFT = 0.5
MAX_STEPS = 25
# Particles per dimension that one component of the proposals' mixture is fitted to.
FITTED_PER_DIMENSION = 30
# Shares of the maxima's components and of the prior in the proposals.
MAXIMA_SHARE, PRIOR_SHARE = 0.3, 0.02


class Level(NamedTuple):
    """A log-likelihood, and the rank among equals, 0 to 1, above which particles are."""

    log_likelihood: float
    rank: float


@dataclass(frozen=True)
class LevelMoves:
    """Moves particles of one target."""

    target: Target
    maxima: Maxima

    def moved(
        self,
        positions: FloatArray,
        log_likelihoods: FloatArray,
        level: Level,
        others: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Positions (n, d), log-likelihoods (n,) and the correlation left with where they began.

        Args:
            positions: (n, d), above the level.
            log_likelihoods: (n,).
            others: (m, d), independent particles at a similar level, which moves are proposed from.
        """

        def log_density(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            values = self.target.log_likelihood(z)
            above = values > level.log_likelihood
            above |= (values == level.log_likelihood) & (rng.random(len(z)) > level.rank)
            return np.where(above, log_standard_normal(z), -np.inf), values

        proposal = self._proposal(level, others, rng)
        return _move(log_density, positions, log_likelihoods, proposal, others, rng)

    def _proposal(self, level: Level, others: FloatArray, rng: np.random.Generator) -> Proposal:
        n, d = others.shape
        mixture = fit_mixture(others, max(1, n // (FITTED_PER_DIMENSION * d)), LIGHT_TAILS, rng)
        around_maxima = self.maxima.above(level.log_likelihood)
        if around_maxima is not None:
            mixture = mixture.mixed_with(around_maxima, MAXIMA_SHARE)
        # Few particles may all be copies of one, to which no mixture can be fitted.
        differ = bool(np.ptp(others, axis=0).any())
        return Proposal(mixture.with_prior_component(PRIOR_SHARE), 0.7 if differ else 0.0)


def _move(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    positions: FloatArray,
    log_likelihoods: FloatArray,
    proposal: Proposal,
    others: FloatArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray, float]:
    """Positions (n, d), log-likelihoods (n,) and the correlation left after moves."""
    from bayes_ssi.inference.sampling.moves import ensemble_sampler, initial_state

    n, d = positions.shape
    sampler = ensemble_sampler(log_density, n, d, proposal, others)
    ranks = _ranks(log_likelihoods, rng)
    start = initial_state(positions, log_standard_normal(positions), log_likelihoods, rng)
    left = 1.0
    states = sampler.sample(start, iterations=MAX_STEPS, store=False, skip_initial_state_check=True)
    for made, state in enumerate(states, start=1):
        before, left = (
            left,
            max(
                _correlation(positions, state.coords),
                _correlation(ranks, _ranks(state.blobs, rng)),
            ),
        )
        if made >= 2 and left < CORRELATION_LEFT:
            break
        # Between separate regions nothing may move: then the correlation settles above the mark.
        if made >= 8 and before - left < 0.002:
            break
    return np.array(state.coords), np.array(state.blobs), float(np.clip(left, 0.0, 0.9))


def _ranks(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Ranks (n, 1), those of equals at random, whose correlation far-off values do not decide."""
    ranks = np.empty((len(values), 1))
    ranks[np.lexsort((rng.random(len(values)), values)), 0] = np.arange(len(values))
    return ranks


def _correlation(before: FloatArray, after: FloatArray) -> float:
    """The mean over dimensions of the correlation between positions before and after.

    One where all positions are the same.
    """
    a, b = before - before.mean(0), after - after.mean(0)
    spreads = np.sqrt((a * a).sum(0) * (b * b).sum(0))
    # Copies are equal to the last digit, but their mean may be rounded.
    differ = np.ptp(before, axis=0) * np.ptp(after, axis=0) > 0
    return float(np.mean(np.where(differ, (a * b).sum(0) / np.maximum(spreads, 1e-300), 1.0)))
