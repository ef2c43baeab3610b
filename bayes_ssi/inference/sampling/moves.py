"""Moves of an emcee ensemble that accept or reject a whole batch of walkers at once.

emcee's own accept/reject step visits one walker after another, which for a vectorised likelihood
costs as much as the likelihood itself. Imported only where sampling begins, since emcee is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.packages import importing_without
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.mixture import LIGHT_TAILS, Proposal, StudentMixture
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


with importing_without("scipy.stats", package="emcee"):  # of which it has a move not used here
    import emcee
    from emcee.moves.red_blue import RedBlueMove

# Proposals that need not wait for one another are evaluated in batches of this size.
DRAWN_AT_ONCE = 512
# Positions (n, d) → log density and log-likelihood, (n,) each.
LogDensity = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class _BatchAcceptance(RedBlueMove):
    """The red-blue move of Foreman-Mackey et al. (2013), each half accepted as one batch.

    Where there are other, fixed walkers, all walkers move with respect to those.
    """

    others: FloatArray | None = None

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, np.ndarray]:
        accepted = np.zeros(len(state.coords), dtype=bool)
        self.setup(state.coords)
        halves = np.arange(len(accepted)) % 2
        model.random.shuffle(halves)
        for moves in (halves == 0, halves == 1) if self.others is None else (halves >= 0,):
            moving = np.flatnonzero(moves)
            others = state.coords[~moves] if self.others is None else self.others
            proposed, log_factors = self.get_proposal(state.coords[moving], [others], model.random)
            log_density, log_likelihoods = model.compute_log_prob_fn(proposed)
            log_ratio = log_factors + log_density - state.log_prob[moving]
            taken = log_ratio > np.log(model.random.rand(len(moving)))
            moved = moving[taken]
            state.coords[moved], state.log_prob[moved] = proposed[taken], log_density[taken]
            state.blobs[moved] = log_likelihoods[taken]
            accepted[moved] = True
        return state, accepted


class _DifferentialEvolution(_BatchAcceptance, emcee.moves.DEMove):
    pass


class _Stretch(_BatchAcceptance, emcee.moves.StretchMove):
    pass


class _FromMixture(emcee.moves.Move):
    """Independence proposals from a fixed mixture; those of many steps are evaluated as a batch."""

    def __init__(self, mixture: StudentMixture) -> None:
        self.mixture = mixture
        # For steps to come: positions, log densities, log-likelihoods, and log density over the
        # mixture's.
        self._ahead: list[tuple[FloatArray, ...]] = []

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, np.ndarray]:
        if not self._ahead:
            self._ahead = self._drawn(model, len(state.coords))
        proposed, log_density, log_likelihoods, log_weights = self._ahead.pop()
        current_weights = state.log_prob - self.mixture.log_pdf(state.coords)
        taken = log_weights - current_weights > np.log(model.random.rand(len(proposed)))
        state.coords[taken] = proposed[taken]
        state.log_prob[taken] = log_density[taken]
        state.blobs[taken] = log_likelihoods[taken]
        return state, taken

    def _drawn(self, model: Any, n_walkers: int) -> list[tuple[FloatArray, ...]]:
        rng = np.random.default_rng(model.random.randint(0, 2**32, size=4, dtype=np.uint32))
        n_steps = max(1, DRAWN_AT_ONCE // n_walkers)
        counts = rng.multinomial(n_steps * n_walkers, self.mixture.all_weights)
        proposed = rng.permutation(self.mixture.draw(counts, rng))
        log_density, log_likelihoods = model.compute_log_prob_fn(proposed)
        log_weights = log_density - self.mixture.log_pdf(proposed)
        drawn = (proposed, log_density, log_likelihoods, log_weights)
        return list(zip(*(np.split(each, n_steps) for each in drawn), strict=True))


class _BatchSampler(emcee.EnsembleSampler):
    """emcee's sampler without its loop over the rows of a batch.

    Its wrapper would print an error, with all positions and a traceback, before raising it.
    """

    def __init__(self, n_walkers: int, n_dimensions: int, log_density: LogDensity, moves: Any):
        super().__init__(n_walkers, n_dimensions, log_density, moves=moves, vectorize=True)
        self.log_density = log_density

    def compute_log_prob(self, coords: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.log_density(coords)


def ensemble_sampler(
    log_density: LogDensity,
    n_walkers: int,
    n_dimensions: int,
    proposal: Proposal,
    others: FloatArray | None = None,
) -> emcee.EnsembleSampler:
    """A vectorised emcee sampler, whose blobs are log-likelihoods.

    Differential evolution and the stretch move take their directions from one half of the walkers
    for the other, or from ``others`` (m, d) for all of them.

    emcee's snooker move is not used: it divides by zero on the duplicate walkers that resampling
    makes.
    """
    local = (_DifferentialEvolution(), _Stretch())
    for move in local:
        move.others = others
    shares = np.array([2 / 3, 1 / 3]) * (1.0 - proposal.share)
    moves = [(_FromMixture(proposal.mixture), proposal.share), *zip(local, shares, strict=True)]
    return _BatchSampler(n_walkers, n_dimensions, log_density, moves)


def initial_state(
    positions: FloatArray,
    log_density: FloatArray,
    log_likelihoods: FloatArray,
    rng: np.random.Generator,
) -> emcee.State:
    """Walkers at ``positions`` (n, d) with a random state that follows from ``rng``."""
    # Assigning a RandomState object to a sampler does nothing; its state tuple does.
    seeds = rng.integers(0, 2**32, size=8, dtype=np.uint32)
    random_state = np.random.RandomState(seeds).get_state()
    return emcee.State(
        positions,
        log_prob=log_density,
        blobs=log_likelihoods,
        random_state=random_state,
        copy=True,
    )
