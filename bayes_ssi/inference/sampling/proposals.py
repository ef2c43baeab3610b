"""Independence proposals: draws of a mixture, evaluated many at a time, proposed in turn."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.target import LogDensity

# As many as make a batch pay.
BATCH = 512


class Drawn(NamedTuple):
    """Evaluated draws of a mixture."""

    z: FloatArray  # (n, d)
    log_densities: FloatArray  # (n,), of the target
    log_likelihoods: FloatArray  # (n,)
    log_proposals: FloatArray  # (n,), of the mixture


class Independence:
    """Proposals that do not depend on a walker's position.

    Attributes:
        mixture: of which they are draws.
        share: of the steps that it proposes; local moves propose the others.
    """

    def __init__(
        self,
        mixture: StudentMixture,
        share: float,
        draw: Callable[[int], Drawn],
        ready: Drawn | None = None,
    ) -> None:
        """``draw(n)`` makes ``n`` draws of the mixture, in random order as ``ready`` ones are."""
        self.mixture, self.share = mixture, share
        self._draw, self._left = draw, ready
        self._now: Drawn | None = None  # proposed last

    def propose(self, coords: FloatArray, _random: Any) -> tuple[FloatArray, FloatArray]:
        """As many positions x as ``coords`` y (n, d) has, and log q(y) - log q(x), (n,).

        The signature is that of a proposal function of emcee's Metropolis-Hastings move.
        """
        n, left = len(coords), self._left
        while left is None or len(left.z) < n:
            new = self._draw(max(n, BATCH))
            left = joined([left, new]) if left else new
        now, self._left = (
            Drawn(*(part[rows] for part in left)) for rows in (slice(n), slice(n, None))
        )
        self._now = now
        return now.z, self.mixture.log_pdf(coords) - now.log_proposals

    def density(self, log_density: LogDensity) -> LogDensity:
        """``log_density``, which does not evaluate again what was proposed last."""

        def recalled(z: FloatArray) -> tuple[FloatArray, FloatArray]:
            now = self._now
            return (
                (now.log_densities, now.log_likelihoods) if now and z is now.z else log_density(z)
            )

        return recalled


def drawn_anew(
    mixture: StudentMixture, share: float, log_density: LogDensity, rng: np.random.Generator
) -> Independence:
    """Proposals that are drawn and evaluated as they are needed."""

    def draw(n: int) -> Drawn:
        z = rng.permutation(mixture.draw(rng.multinomial(n, mixture.all_weights), rng))
        return Drawn(z, *log_density(z), mixture.log_pdf(z))

    return Independence(mixture, share, draw)
