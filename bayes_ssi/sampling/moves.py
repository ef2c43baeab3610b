"""Moves of an emcee ensemble that accept or reject a whole batch of walkers at once.

emcee's own accept/reject step visits one walker after another, which for a vectorised likelihood
costs as much as the likelihood itself. Imported only where sampling begins, since emcee is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
from emcee.moves.red_blue import RedBlueMove

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.mixture import Proposal, StudentMixture

__all__ = ["ensemble_sampler", "initial_state", "raise_if_failed"]

# Proposals that need not wait for one another are evaluated in batches of this size.
DRAWN_AT_ONCE = 512


class _BatchAcceptance(RedBlueMove):
    """The red-blue move of Foreman-Mackey et al. (2013), each half accepted as one batch."""

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, np.ndarray]:
        n_walkers = len(state.coords)
        accepted = np.zeros(n_walkers, dtype=bool)
        self.setup(state.coords)
        half = np.arange(n_walkers) % self.nsplits
        if self.randomize_split:
            model.random.shuffle(half)
        for split in range(self.nsplits):
            own = np.flatnonzero(half == split)
            others = [state.coords[half == j] for j in range(self.nsplits) if j != split]
            proposed, log_factors = self.get_proposal(state.coords[own], others, model.random)
            log_density, _ = model.compute_log_prob_fn(proposed)
            log_ratio = log_factors + log_density - state.log_prob[own]
            taken = log_ratio > np.log(model.random.rand(len(own)))
            state.coords[own[taken]] = proposed[taken]
            state.log_prob[own[taken]] = log_density[taken]
            accepted[own[taken]] = True
        return state, accepted


class _DifferentialEvolution(_BatchAcceptance, emcee.moves.DEMove):
    pass


class _Stretch(_BatchAcceptance, emcee.moves.StretchMove):
    pass


class _FromMixture(emcee.moves.Move):
    """Proposes from a fixed mixture, wherever a walker is: it changes between separate regions.

    No proposal depends on where a walker is, so those of many steps are drawn and evaluated as
    one batch.
    """

    def __init__(self, mixture: StudentMixture) -> None:
        self.mixture = mixture
        # Positions, their log densities, and log density over the mixture's, for steps to come.
        self._ahead: list[tuple[FloatArray, FloatArray, FloatArray]] = []

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, np.ndarray]:
        if not self._ahead:
            self._ahead = self._drawn(model, *state.coords.shape)
        proposed, log_density, log_weights = self._ahead.pop()
        own_weights = state.log_prob - self.mixture.log_pdf(state.coords)
        taken = log_weights - own_weights > np.log(model.random.rand(len(proposed)))
        state.coords[taken] = proposed[taken]
        state.log_prob[taken] = log_density[taken]
        return state, taken

    def _drawn(
        self, model: Any, n_walkers: int, n_dimensions: int
    ) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        rng = np.random.default_rng(model.random.randint(0, 2**32, size=4, dtype=np.uint32))
        n_steps = max(1, DRAWN_AT_ONCE // n_walkers)
        counts = rng.multinomial(n_steps * n_walkers, self.mixture.all_weights)
        proposed = rng.permutation(self.mixture.draw(counts, rng))
        log_density, _ = model.compute_log_prob_fn(proposed)
        log_weights = log_density - self.mixture.log_pdf(proposed)
        shape = (n_steps, n_walkers)
        return list(
            zip(
                proposed.reshape(*shape, n_dimensions),
                log_density.reshape(shape),
                log_weights.reshape(shape),
                strict=True,
            )
        )


class _Guarded:
    """A log density that keeps its first error for later, and is -inf from then on.

    emcee would print the error, with all positions and a traceback, before it raises it again.
    """

    def __init__(self, log_density: Callable[[FloatArray], FloatArray]) -> None:
        self.log_density = log_density
        self.error: BaseException | None = None

    def __call__(self, z: FloatArray) -> FloatArray:
        if self.error is None:
            try:
                return self.log_density(z)
            except BaseException as error:  # noqa: BLE001 - an interrupt and a full disk, too
                self.error = error
        return np.full(len(z), -np.inf)


def raise_if_failed(sampler: emcee.EnsembleSampler) -> None:
    """Raise the error that the sampler's log density met, if it met one."""
    if sampler.log_prob_fn.f.error is not None:
        raise sampler.log_prob_fn.f.error


def ensemble_sampler(
    log_density: Callable[[FloatArray], FloatArray],
    n_walkers: int,
    n_dimensions: int,
    proposal: Proposal,
) -> emcee.EnsembleSampler:
    """A vectorised emcee sampler; after it has run, call :func:`raise_if_failed`.

    emcee's snooker move is not used: it divides by zero on the duplicate walkers that resampling
    makes.
    """
    others = 1.0 - proposal.share
    moves = [
        (_FromMixture(proposal.mixture), proposal.share),
        (_DifferentialEvolution(), others * 2 / 3),
        (_Stretch(), others / 3),
    ]
    return emcee.EnsembleSampler(
        n_walkers,
        n_dimensions,
        _Guarded(log_density),
        moves=moves,
        vectorize=True,
    )


def initial_state(
    positions: FloatArray, log_density: FloatArray, rng: np.random.Generator
) -> emcee.State:
    """Walkers at ``positions`` (n, d) with a random state that follows from ``rng``."""
    # Assigning a RandomState object to a sampler does nothing; its state tuple does.
    seeds = rng.integers(0, 2**32, size=8, dtype=np.uint32)
    random_state = np.random.RandomState(seeds).get_state()
    return emcee.State(positions, log_prob=log_density, random_state=random_state, copy=True)
