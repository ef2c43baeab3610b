"""How walkers move: emcee's own moves, and its Metropolis-Hastings move with other proposals.

Imported only where sampling begins, since emcee is.
"""

from typing import Any

import emcee
import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.proposals import Independence
from bayes_ssi.inference.sampling.target import LogDensity

# Fixed walkers of which a step takes its directions: of all pairs of many more, a list is longer
# than a matrix in many dimensions.
PARTNERS = 100


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
    independence: Independence,
    rng: np.random.Generator,
    others: FloatArray | None = None,
) -> tuple[emcee.EnsembleSampler, emcee.State]:
    """A vectorised emcee sampler, whose blobs are log-likelihoods, and the state it begins in.

    ``values`` are the log density and log-likelihood at ``positions`` (n, d), (n,) each.

    Differential evolution and the stretch move take their directions from one half of the walkers
    for the other, or from ``others`` (m, d) for all of them. emcee's snooker move is not used: it
    divides by zero on the duplicate walkers that resampling makes.
    """
    local = [emcee.moves.DEMove(), emcee.moves.StretchMove()]
    if others is not None:
        local = [_with_respect_to(others, move) for move in local]
    shares = np.array([2 / 3, 1 / 3]) * (1.0 - independence.share)
    far = emcee.moves.MHMove(independence.propose), independence.share
    moves = [far, *zip(local, shares, strict=True)]
    # Assigning a RandomState object to a sampler does nothing; its state tuple does.
    seeds = rng.integers(0, 2**32, size=8, dtype=np.uint32)
    state = emcee.State(
        positions,
        log_prob=values[0],
        blobs=values[1],
        random_state=np.random.RandomState(seeds).get_state(),
        copy=True,
    )
    density = independence.density(log_density)
    n_walkers, d = positions.shape
    return _BatchSampler(n_walkers, d, density, moves), state


def _with_respect_to(others: FloatArray, move: Any) -> emcee.moves.MHMove:
    """emcee's red-blue move for all walkers at once, with fixed partners (m, d)."""
    move.setup(others)

    def proposed(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        chosen = random.choice(len(others), min(len(others), PARTNERS), replace=False)
        return move.get_proposal(coords, [others[chosen]], random)

    return emcee.moves.MHMove(proposed)
