"""Multistart: independent searches for every maximum of the posterior, until they agree.

One search is multi-level single linkage (Rinnooy Kan and Timmer 1987): many draws from the prior,
and an ascent from each draw that is higher than all its neighbours. So the ascents go where a
basin may be that no other ascent is in, and a narrow basin needs one draw in it, not one ascent
in hundreds.

What no search meets, no later step can tell. Independent searches that find the same maxima are
the evidence that there are no others; they go on until every maximum that matters was found by
two of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.sampling.maxima import SAME_MAXIMUM, Maxima, find_maxima
from bayes_ssi.sampling.target import Target

__all__ = ["Effort", "MultistartSearch", "discover"]

# Draws of one search; in many dimensions neighbours are far, and more draws help less.
DRAWS = 4000
DRAWS_IN_MANY_DIMENSIONS, MANY_DIMENSIONS = 2000, 7
NEIGHBOURS = 8
MAX_ASCENTS = 40
# Searches go on, to this multiple of those asked for, while only one found a maximum that holds
# more than this share of the posterior by Laplace's approximation.
PATIENCE = 3
SHARE_THAT_MATTERS = 1e-3


@dataclass(frozen=True)
class Effort:
    """What one search may cost.

    Attributes:
        draws: from the prior.
        ascents: at most, from the highest of the draws that none of their neighbours exceeds.
    """

    draws: int
    ascents: int = MAX_ASCENTS

    @classmethod
    def usual(cls, n_dimensions: int) -> Effort:
        few = n_dimensions < MANY_DIMENSIONS
        return cls(DRAWS if few else DRAWS_IN_MANY_DIMENSIONS)


@dataclass(frozen=True, eq=False)
class MultistartSearch:
    """The maxima that independent searches found.

    Attributes:
        maxima: all of them.
        found_by: (n_searches, m), whether a search found a maximum by itself.
    """

    maxima: Maxima
    found_by: NDArray[np.bool_]

    @property
    def n_searches(self) -> int:
        return len(self.found_by)

    @property
    def converged(self) -> bool:
        """Whether every maximum that matters was found by two searches."""
        masses = self.maxima.log_masses
        matters = masses - logsumexp(masses) > np.log(SHARE_THAT_MATTERS)
        return bool((self.found_by[:, matters].sum(axis=0) >= 2).all())


def discover(
    target: Target,
    n_searches: int,
    seed: np.random.SeedSequence,
    progress: Callable[[float], None] | None = None,
    effort: Effort | None = None,
) -> MultistartSearch:
    """Search for maxima until independent searches agree.

    Args:
        target: whose log-likelihood times prior density is climbed.
        n_searches: at least so many, and more while they do not agree.
        seed: everything random follows from it.
        progress: called with the share of ``n_searches`` that is done.
        effort: of each search.

    Raises:
        ValueError: the likelihood is zero at every draw from the prior.
    """
    effort = effort or Effort.usual(target.n_dimensions)
    found: list[Maxima | None] = []
    seeds = seed.spawn(max(PATIENCE * n_searches, 2))
    for each in seeds:
        found.append(_search(target, effort, np.random.default_rng(each)))
        if progress is not None:
            progress(min(len(found) / n_searches, 1.0))
        if len(found) < n_searches:
            continue
        if not any(found):
            n = len(found) * effort.draws
            raise ValueError(
                f"the likelihood is zero at all of {n} draws from the prior; "
                "are the priors, the pairing and the units those of the data?"
            )
        discovery = _agreed(target, found)
        if discovery.converged:
            break
    return discovery


def _agreed(target: Target, found: list[Maxima | None]) -> MultistartSearch:
    """The maxima of all searches as one list, and who found which."""
    tops = [np.empty((0, target.n_dimensions)) if each is None else each.z for each in found]
    # Climbing on from all of them makes one of those that stopped short of the same top.
    maxima = find_maxima(target, np.concatenate(tops))
    reach = SAME_MAXIMUM**2 * target.n_dimensions
    found_by = [(maxima.squared_distances(own) < reach).any(axis=1) for own in tops]
    return MultistartSearch(maxima, np.array(found_by))


def _search(target: Target, effort: Effort, rng: np.random.Generator) -> Maxima | None:
    """The maxima that one search finds; None if the likelihood is zero at all its draws."""
    draws = rng.standard_normal((effort.draws, target.n_dimensions))
    log_likelihoods = target.log_likelihood(draws)
    possible = np.isfinite(log_likelihoods)
    if not possible.any():
        return None
    tops = _tops(draws[possible], log_likelihoods[possible])
    return find_maxima(target, tops[: effort.ascents])


def _tops(draws: FloatArray, log_likelihoods: FloatArray) -> FloatArray:
    """The draws (k, d) that none of their neighbours exceeds, the highest first."""
    from scipy.spatial import cKDTree

    neighbours = min(NEIGHBOURS + 1, len(draws))  # the nearest is the draw itself
    _, nearest = cKDTree(draws).query(draws, k=neighbours)
    highest = log_likelihoods[np.reshape(nearest, (len(draws), -1))].max(axis=1)
    tops = np.flatnonzero(log_likelihoods >= highest)
    return draws[tops[np.argsort(-log_likelihoods[tops], kind="stable")]]
