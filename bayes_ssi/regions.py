"""Separate regions of a posterior: which parts of it are joined by a path without a valley."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.mixture import StudentMixture
from bayes_ssi.priors import FloatArray
from bayes_ssi.target import Target

__all__ = ["Regions", "find_regions"]

# Two groups of draws are apart when the density between their nearest draws falls by this many
# nats below the lower of the two.
VALLEY_DEPTH = 2.0
NEIGHBOURS = 4
POINTS_BETWEEN = 3


@dataclass(frozen=True, eq=False)
class Regions:
    """A mixture's components, gathered into regions that no valley divides.

    Attributes:
        mixture: the components.
        of_component: (K,), the region of each component, numbered from 0.
    """

    mixture: StudentMixture
    of_component: NDArray[np.intp]

    @property
    def n_regions(self) -> int:
        return int(self.of_component.max()) + 1

    def assign(self, z: FloatArray) -> NDArray[np.intp]:
        """The region (n,) of each of ``z`` (n, d): that of its most probable component."""
        if self.n_regions == 1:
            return np.zeros(len(z), dtype=np.intp)
        return self.of_component[self.mixture.log_components(z).argmax(0)]

    def shares(self, z: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """The share (n_regions,) of draws, or of their weights, in each region."""
        shares = np.bincount(self.assign(z), weights, minlength=self.n_regions)
        return shares / shares.sum()


def find_regions(
    mixture: StudentMixture, target: Target, draws: FloatArray, log_posteriors: FloatArray
) -> Regions:
    """Gather the components of ``mixture`` into regions.

    Args:
        mixture: fitted to the draws.
        target: evaluated at a few points between neighbouring components.
        draws: (n, d).
        log_posteriors: (n,), up to a constant.
    """
    k = mixture.n_components
    parent = list(range(k))

    def root(i: int) -> int:
        while parent[i] != i:
            i = parent[i]
        return i

    if k > 1:
        members = _members(mixture, draws)
        for i, j in _nearest_first(mixture):
            if not len(members[i]) or not len(members[j]) or root(i) == root(j):
                continue
            if _joined(members[i], members[j], target, draws, log_posteriors):
                parent[root(j)] = root(i)
        # A component that is nowhere the most probable one lies inside another.
        for i in range(k):
            if not len(members[i]):
                others = mixture.log_components(mixture.means[i][None])[:, 0]
                others[[j for j in range(k) if not len(members[j])]] = -np.inf
                parent[i] = root(int(others.argmax()))
    roots = [root(i) for i in range(k)]
    return Regions(mixture, np.unique(roots, return_inverse=True)[1].astype(np.intp))


def _members(mixture: StudentMixture, draws: FloatArray) -> list[NDArray[np.intp]]:
    """For each component the draws of which it is the most probable source."""
    labels = mixture.log_components(draws).argmax(0)
    return [np.flatnonzero(labels == component) for component in range(mixture.n_components)]


def _nearest_first(mixture: StudentMixture) -> list[tuple[int, int]]:
    """All pairs of components, those with overlapping means first."""
    distances = mixture.squared_distances(mixture.means)
    pairs = [(i, j) for i in range(len(distances)) for j in range(i)]
    return sorted(pairs, key=lambda pair: min(distances[pair], distances[pair[::-1]]))


def _joined(
    of_i: NDArray[np.intp],
    of_j: NDArray[np.intp],
    target: Target,
    draws: FloatArray,
    log_posteriors: FloatArray,
) -> bool:
    """Whether the density has no valley between the nearest draws of two components."""
    from scipy.spatial import cKDTree

    distances, nearest = cKDTree(draws[of_i]).query(draws[of_j])
    closest = np.argsort(distances)[:NEIGHBOURS]
    a, b = of_i[np.asarray(nearest)[closest]], of_j[closest]
    fractions = np.arange(1, POINTS_BETWEEN + 1)[:, None, None] / (POINTS_BETWEEN + 1)
    between = draws[a] + fractions * (draws[b] - draws[a])
    heights = target.log_posterior(between.reshape(-1, draws.shape[1])).reshape(POINTS_BETWEEN, -1)
    lower_end = np.minimum(log_posteriors[a], log_posteriors[b])
    return bool(np.any(heights.min(0) > lower_end - VALLEY_DEPTH))
