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

from bayes_ssi.mixture import StudentMixture
from bayes_ssi.priors import FloatArray

__all__ = ["ensemble_moves", "ensemble_sampler", "initial_state", "raise_if_failed"]


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


class _FromMixture(_BatchAcceptance):
    """Proposes from a fixed mixture, wherever a walker is: it changes between separate regions."""

    def __init__(self, mixture: StudentMixture) -> None:
        # No walker's proposal depends on another's, so the ensemble need not be split.
        super().__init__(nsplits=1, randomize_split=False)
        self.mixture = mixture

    def get_proposal(
        self, sample: FloatArray, complement: list[FloatArray], random: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray]:
        del complement
        rng = np.random.default_rng(random.randint(0, 2**32, size=4, dtype=np.uint32))
        counts = rng.multinomial(len(sample), self.mixture.all_weights)
        proposed = rng.permutation(self.mixture.draw(counts, rng))
        return proposed, self.mixture.log_pdf(sample) - self.mixture.log_pdf(proposed)


def ensemble_moves(mixture: StudentMixture) -> list[tuple[RedBlueMove, float]]:
    """Independent proposals from ``mixture`` most of the time, else DE and stretch moves.

    emcee's snooker move is not among them: it divides by zero on the duplicate walkers that
    resampling makes.
    """
    return [(_FromMixture(mixture), 0.7), (_DifferentialEvolution(), 0.2), (_Stretch(), 0.1)]


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
    mixture: StudentMixture,
) -> emcee.EnsembleSampler:
    """A vectorised emcee sampler with the moves of :func:`ensemble_moves`.

    After it has run, :func:`raise_if_failed` tells of errors in the log density.
    """
    return emcee.EnsembleSampler(
        n_walkers,
        n_dimensions,
        _Guarded(log_density),
        moves=ensemble_moves(mixture),
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
