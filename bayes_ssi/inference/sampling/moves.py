"""Moves of an emcee ensemble that accept or reject a whole batch of walkers at once.

emcee's own accept/reject step visits one walker after another, which for a vectorised likelihood
costs as much as the likelihood itself. Imported only where sampling begins, since emcee is.
"""

from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.packages import importing_without
from bayes_ssi.inference.sampling.mixture import Proposal, StudentMixture
from bayes_ssi.inference.sampling.target import LogDensity

with importing_without("scipy.stats", package="emcee"):  # of which it has a move not used here
    import emcee
    from emcee.moves.red_blue import RedBlueMove


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
    def get_proposal(self, s: FloatArray, c: Any, random: Any) -> tuple[FloatArray, FloatArray]:
        """As emcee's, without its list of all pairs, longer than a matrix in many dimensions."""
        others = np.concatenate(c)
        n_pairs = len(others) * (len(others) - 1) // 2
        chosen = random.choice(2 * n_pairs, size=len(s))
        # Pairs are numbered row by row below the diagonal; then come those of opposite sign.
        number = chosen % n_pairs
        row = ((1.0 + np.sqrt(1.0 + 8.0 * number)) / 2.0).astype(np.intp)
        column = number - row * (row - 1) // 2
        sign = np.where(chosen < n_pairs, 1.0, -1.0)
        lengths = self.g0 * (1.0 + self.sigma * random.randn(len(s), 1))
        steps = lengths * sign[:, None] * (others[column] - others[row])
        return s + steps, np.zeros(len(s))


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
        n_steps = max(1, 512 // n_walkers)  # as many draws as make a batch pay
        counts = rng.multinomial(n_steps * n_walkers, self.mixture.all_weights)
        proposed = rng.permutation(self.mixture.draw(counts, rng))
        log_density, log_likelihoods = model.compute_log_prob_fn(proposed)
        log_weights = log_density - self.mixture.log_pdf(proposed)
        drawn = (proposed, log_density, log_likelihoods, log_weights)
        return list(zip(*(np.split(values, n_steps) for values in drawn), strict=True))


class _BatchSampler(emcee.EnsembleSampler):
    """emcee's sampler without its loop over the rows of a batch.

    Its wrapper would print an error, with all positions and a traceback, before raising it.
    """

    def __init__(self, n_walkers: int, n_dimensions: int, log_density: LogDensity, moves: Any):
        super().__init__(n_walkers, n_dimensions, log_density, moves=moves, vectorize=True)
        self.log_density = log_density

    def compute_log_prob(self, coords: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.log_density(coords)


def begin(
    log_density: LogDensity,
    positions: FloatArray,
    values: tuple[FloatArray, FloatArray],
    proposal: Proposal,
    rng: np.random.Generator,
    others: FloatArray | None = None,
) -> tuple[emcee.EnsembleSampler, emcee.State]:
    """A vectorised emcee sampler, whose blobs are log-likelihoods, and the state it begins in.

    ``values`` are the log density and log-likelihood at ``positions`` (n, d), (n,) each.

    Differential evolution and the stretch move take their directions from one half of the walkers
    for the other, or from ``others`` (m, d) for all of them. emcee's snooker move is not used: it
    divides by zero on the duplicate walkers that resampling makes.
    """
    local = (_DifferentialEvolution(), _Stretch())
    for move in local:
        move.others = others
    shares = np.array([2 / 3, 1 / 3]) * (1.0 - proposal.share)
    moves = [(_FromMixture(proposal.mixture), proposal.share), *zip(local, shares, strict=True)]
    # Assigning a RandomState object to a sampler does nothing; its state tuple does.
    seeds = rng.integers(0, 2**32, size=8, dtype=np.uint32)
    state = emcee.State(
        positions,
        log_prob=values[0],
        blobs=values[1],
        random_state=np.random.RandomState(seeds).get_state(),
        copy=True,
    )
    n_walkers, d = positions.shape
    return _BatchSampler(n_walkers, d, log_density, moves), state
