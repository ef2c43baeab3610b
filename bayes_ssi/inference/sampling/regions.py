"""Separate regions of a posterior: which parts of it are joined by a path without a valley.

Every draw leads to the highest of its neighbours, and so, step by step, to a local maximum; draws
that lead to the same one form a group (quick shift, Vedaldi and Soatto 2008). Groups are joined
where a path between the two does not lead through a valley. Distances are scaled by the differences
between neighbours, not by the spread of all draws, in which separate regions would seem near.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, IntArray, evenly_spaced_indices
from bayes_ssi.inference.sampling.mixture import Chart
from bayes_ssi.inference.sampling.target import Target

# Neighbours per draw: enough to connect the draws of one region, in a few dimensions.
NEIGHBOURS = 8
# Two maxima, or groups of draws, are separate where every path between them that is tried leads
# this many nats below the lower one, at one of so many points. At an edge of where the
# likelihood is positive there is no curvature to tell how far a maximum reaches.
VALLEY_DEPTH = 2.0
POINTS_BETWEEN = 3
MOST_DRAWS = 1500
# Pairs of draws between which two groups are tested. A group of no more draws has most of its
# neighbours outside, and is no region of its own.
PAIRS = 4


def _tree(points: FloatArray) -> Any:
    from scipy.spatial import cKDTree

    return cKDTree(points)


def nearest_neighbours(points: FloatArray) -> IntArray:
    """The nearest of ``points`` (n, d) to each, (n, k), beginning with itself."""
    _, nearest = _tree(points).query(points, k=min(NEIGHBOURS + 1, len(points)))
    return np.reshape(nearest, (len(points), -1))


def local_maxima(draws: FloatArray, heights: FloatArray) -> FloatArray:
    """The draws (k, d) higher than all their neighbours, the highest first."""
    chosen = np.flatnonzero(heights >= heights[nearest_neighbours(draws)].max(axis=1))
    return draws[chosen[np.argsort(-heights[chosen], kind="stable")]]


def lowest_between(
    log_density: Callable[[FloatArray], FloatArray], a: FloatArray, b: FloatArray, ends: FloatArray
) -> FloatArray:
    """The lowest log density (m,) on straight paths from ``a`` to ``b`` (m, d) and at ``ends``."""
    n = POINTS_BETWEEN
    fractions = np.arange(1, n + 1)[:, None, None] / (n + 1)
    between = a + fractions * (b - a)
    inside = log_density(between.reshape(-1, a.shape[1])).reshape(n, -1)
    return np.minimum(inside.min(axis=0), ends)


@dataclass(frozen=True, eq=False)
class Regions:
    """Draws that represent the regions of a posterior."""

    draws: FloatArray  # (n, d), in coordinates of the chart if there is one
    labels: IntArray  # (n,), the region of each draw, numbered from 0
    chart: Chart | None = None

    @property
    def n_regions(self) -> int:
        return int(self.labels.max()) + 1

    def assign(self, z: FloatArray) -> IntArray:
        """The region (n,) of each of ``z`` (n, d): that of the nearest draw."""
        if self.n_regions == 1:
            return np.zeros(len(z), dtype=np.intp)
        whitening, tree = self._whitened
        z = z if self.chart is None else self.chart.straight(z)
        return self.labels[tree.query(z @ whitening)[1]]

    def shares(self, z: FloatArray, weights: FloatArray | None = None) -> FloatArray:
        """The share (n_regions,) of draws, or of their weights, in each region."""
        shares = np.bincount(self.assign(z), weights, minlength=self.n_regions)
        return shares / shares.sum()

    @cached_property
    def _whitened(self) -> tuple[FloatArray, Any]:
        """A whitening (d, d), and a tree of the draws times it."""
        whitening = _local_whitening(self.draws)
        return whitening, _tree(self.draws @ whitening)


def find_regions(
    target: Target, draws: FloatArray, log_posteriors: FloatArray, chart: Chart | None = None
) -> Regions:
    """Group posterior draws (n, d) into regions; their log posteriors (n,) are up to a constant.

    Paths are straight in the coordinates of ``chart``. Between draws of a thin curved sheet, paths
    that are straight in others leave it.
    """

    def log_posterior(z: FloatArray) -> FloatArray:
        return target.log_posterior(z if chart is None else chart.curved(z))

    chosen = evenly_spaced_indices(len(draws), MOST_DRAWS)
    draws = draws[chosen] if chart is None else chart.straight(draws[chosen])
    paths = _Paths(log_posterior, draws, log_posteriors[chosen])
    whitened = draws @ _local_whitening(draws)
    nearest = nearest_neighbours(whitened)
    groups = _groups(nearest, paths)
    groups = _joined(groups, _neighbouring_pairs(groups, nearest, paths), paths)
    # Groups whose draws are no other draw's neighbours.
    groups = _joined(groups, _between_groups(groups, whitened, paths), paths)
    return Regions(draws, _without_the_smallest(groups, whitened), chart)


@dataclass(frozen=True, eq=False)
class _Paths:
    """Draws (n, d) with their log posteriors (n,), and what lies between two of them."""

    log_posterior: Callable[[FloatArray], FloatArray]
    draws: FloatArray
    log_posteriors: FloatArray

    def lowest(self, first: IntArray, second: IntArray) -> FloatArray:
        """The lowest log posterior (m,) on the straight path between two draws, ends included."""
        lower_ends = np.minimum(self.log_posteriors[first], self.log_posteriors[second])
        return lowest_between(self.log_posterior, self.draws[first], self.draws[second], lower_ends)

    def highest_draws(self, groups: IntArray) -> dict[int, int]:
        """Group → its highest draw, given the group (n,) of each draw."""
        return {int(groups[i]): int(i) for i in np.argsort(self.log_posteriors, kind="stable")}


def _local_whitening(draws: FloatArray) -> FloatArray:
    """(d, d): differences between neighbouring draws, times it, have a unit covariance."""
    whitening = _whitening(draws - draws.mean(axis=0))
    if len(draws) > NEIGHBOURS:
        for _ in range(3):
            nearest = nearest_neighbours(draws @ whitening)
            differences = draws[nearest[:, 1:]] - draws[:, None]
            whitening = _whitening(differences.reshape(-1, draws.shape[1]))
    return whitening


def _whitening(differences: FloatArray) -> FloatArray:
    """(d, d): differences (m, d) of mean zero, times it, have a unit covariance."""
    values, vectors = np.linalg.eigh(differences.T @ differences / len(differences))
    floor = max(1e-12 * float(values.max()), 1e-300)
    return vectors / np.sqrt(np.maximum(values, floor))


def _groups(nearest: IntArray, paths: _Paths) -> IntArray:
    """The group (n,) of each draw, by the local maximum that higher neighbours lead to."""
    n = len(nearest)
    # The first of equally high neighbours counts, so that no two lead to one another.
    order = np.lexsort((-np.arange(n), paths.log_posteriors))
    rank = np.empty(n, dtype=np.intp)
    rank[order] = np.arange(n)
    leads_to = nearest[np.arange(n), rank[nearest].argmax(axis=1)]
    higher = np.flatnonzero(rank[leads_to] > rank)
    lowest = paths.lowest(higher, leads_to[higher])
    led = higher[lowest > paths.log_posteriors[higher] - VALLEY_DEPTH]
    leads_to = np.arange(n)
    leads_to[led] = nearest[led, rank[nearest[led]].argmax(axis=1)]
    while not np.array_equal(further := leads_to[leads_to], leads_to):
        leads_to = further
    return _numbered(leads_to)


def _joined(groups: IntArray, pairs: IntArray, paths: _Paths) -> IntArray:
    """Groups (n,) after joining those that a high path connects.

    ``pairs`` (m, 2) are draws of different groups between which there may be one. The highest
    paths come first; one joins two groups unless it leads far below the typical draw of the lower
    one, as in watersheds by prominence.
    """
    groups = groups.copy()
    levels = paths.lowest(*pairs.T)
    heights = paths.log_posteriors
    typical = np.array([np.median(heights[groups == group]) for group in range(groups.max() + 1)])
    for pair in np.argsort(-levels, kind="stable"):
        a, b = groups[pairs[pair]]
        if a != b and levels[pair] > min(typical[a], typical[b]) - VALLEY_DEPTH:
            groups[groups == b] = a
            typical[a] = np.median(heights[groups == a])
    return _numbered(groups)


def _numbered(groups: IntArray) -> IntArray:
    """The same groups (n,), numbered from 0."""
    return np.unique(groups, return_inverse=True)[1].astype(np.intp)


def _neighbouring_pairs(groups: IntArray, nearest: IntArray, paths: _Paths) -> IntArray:
    """Pairs of draws (m, 2) at which groups meet, the highest few of every two groups.

    With the two groups' highest draws, between which a straight line may be the best path.
    """
    first = np.repeat(np.arange(len(nearest)), nearest.shape[1])
    pairs = np.sort(np.column_stack([first, nearest.ravel()]), axis=1)
    pairs = np.unique(pairs[groups[pairs[:, 0]] != groups[pairs[:, 1]]], axis=0)
    order = np.argsort(-paths.log_posteriors[pairs].min(axis=1), kind="stable")
    highest = paths.highest_draws(groups)
    kept: dict[tuple[int, int], list[list[int]]] = {}
    for i, j in pairs[order].tolist():
        a, b = sorted((int(groups[i]), int(groups[j])))
        between = kept.setdefault((a, b), [[highest[a], highest[b]]])
        if len(between) <= PAIRS:
            between.append([i, j])
    return np.array(list(chain.from_iterable(kept.values())), dtype=np.intp).reshape(-1, 2)


def _without_the_smallest(groups: IntArray, whitened: FloatArray) -> IntArray:
    """Groups (n,) after merging those with too few draws into the nearest other group."""
    large = np.bincount(groups)[groups] >= min(PAIRS + 1, np.bincount(groups).max())
    _, nearest = _tree(whitened[large]).query(whitened[~large])
    kept = groups.copy()
    kept[~large] = groups[large][nearest]
    return _numbered(kept)


def _between_groups(groups: IntArray, whitened: FloatArray, paths: _Paths) -> IntArray:
    """The nearest pairs of draws (m, 2) of every two groups, and their highest draws."""
    members = [np.flatnonzero(groups == group) for group in range(groups.max() + 1)]
    highest = paths.highest_draws(groups)
    pairs: list[list[int]] = []
    for j, second in enumerate(members[1:], start=1):
        tree = _tree(whitened[second])
        for i, first in enumerate(members[:j]):
            distances, nearest = tree.query(whitened[first])
            closest = np.argsort(distances, kind="stable")[:PAIRS]
            pairs.extend([int(first[c]), int(second[nearest[c]])] for c in closest)
            pairs.append([highest[i], highest[j]])
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)
