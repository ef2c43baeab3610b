"""How walkers move: emcee's own moves, and its Metropolis-Hastings move with other proposals.

Independence proposals are draws of a mixture, evaluated many at a time and proposed in turn.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.target import LogDensity

BATCH = 512  # as many as make a batch pay
# Fixed walkers of which a step takes its directions: of all pairs of many more, a list is longer
# than a matrix in many dimensions.
PARTNERS = 100


class Drawn(NamedTuple):
    """Evaluated draws of a mixture."""

    z: FloatArray  # (n, d)
    log_densities: FloatArray  # (n,), of the target
    log_likelihoods: FloatArray  # (n,)
    log_proposals: FloatArray  # (n,), of the mixture


@dataclass(eq=False)
class Independence:
    """Proposals that do not depend on a walker's position."""

    mixture: StudentMixture  # of which they are draws
    share: float  # of the steps that it proposes; local moves propose the others
    draw: Callable[[int], Drawn]  # of the mixture, so many in random order
    ready: Drawn | None = None  # the same, proposed before others are drawn
    _now: Drawn | None = field(default=None, init=False)  # proposed last

    def propose(self, coords: FloatArray, _random: Any) -> tuple[FloatArray, FloatArray]:
        """As many positions x as ``coords`` y (n, d) has, and log q(y) - log q(x), (n,).

        The signature is that of a proposal function of emcee's Metropolis-Hastings move.
        """
        n, left = len(coords), self.ready
        while left is None or len(left.z) < n:
            new = self.draw(max(n, BATCH))
            left = joined([left, new]) if left else new
        self._now = now = Drawn(*(part[:n] for part in left))
        self.ready = Drawn(*(part[n:] for part in left))
        return now.z, self.mixture.log_pdf(coords) - now.log_proposals

    def density(self, log_density: LogDensity) -> LogDensity:
        """``log_density``, which does not evaluate again what was proposed last."""

        def recalled(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            if self._now and z is self._now.z:
                return self._now.log_densities, self._now.log_likelihoods
            return log_density(z)

        return recalled


def drawn_anew(
    mixture: StudentMixture, share: float, log_density: LogDensity, rng: np.random.Generator
) -> Independence:
    """Proposals that are drawn and evaluated as they are needed."""

    def draw(n: int) -> Drawn:
        z = rng.permutation(mixture.draw(rng.multinomial(n, mixture.all_weights), rng))
        return Drawn(z, *log_density(z), mixture.log_pdf(z))

    return Independence(mixture, share, draw)


def begin(
    log_density: LogDensity,
    positions: FloatArray,
    values: tuple[FloatArray, FloatArray],
    independence: Independence,
    rng: np.random.Generator,
    others: FloatArray | None = None,
) -> tuple[Any, Any]:
    """A vectorised sampler of emcee, whose blobs are log-likelihoods, and the state it begins in.

    ``values`` are the log density and log-likelihood at ``positions`` (n, d), (n,) each.

    Differential evolution and the stretch move take their directions from one half of the walkers
    for the other, or from ``others`` (m, d) for all of them. emcee's snooker move is not used: it
    divides by zero on the duplicate walkers that resampling makes.
    """
    import emcee

    local = [emcee.moves.DEMove(), emcee.moves.StretchMove()]
    if others is not None:
        local = [_with_respect_to(others, move) for move in local]
    shares = np.array([2 / 3, 1 / 3]) * (1.0 - independence.share)
    far = emcee.moves.MHMove(independence.propose), independence.share
    moves = [far, *zip(local, shares, strict=True)]
    # Assigning a RandomState object to a sampler does nothing; its state tuple does.
    seeds = rng.integers(0, 2**32, size=8, dtype=np.uint32)
    state = emcee.State(positions, *values, np.random.RandomState(seeds).get_state(), copy=True)
    sampler = emcee.EnsembleSampler(*positions.shape, log_density, moves=moves, vectorize=True)
    # Without emcee's loop over the rows of a batch, whose wrapper would print an error, with all
    # positions and a traceback, before raising it.
    sampler.compute_log_prob = independence.density(log_density)
    return sampler, state


def _with_respect_to(others: FloatArray, move: Any) -> Any:
    """emcee's red-blue move for all walkers at once, with fixed partners (m, d)."""
    import emcee

    move.setup(others)

    def proposed(coords: FloatArray, random: Any) -> tuple[FloatArray, FloatArray]:
        chosen = random.choice(len(others), min(len(others), PARTNERS), replace=False)
        return move.get_proposal(coords, [others[chosen]], random)

    return emcee.moves.MHMove(proposed)
