"""An order of the rows of sparse symmetric matrices in which their factors stay sparse.

In plane meshes and slender frames minimum degree serves best. A body or a frame of many bays each
way is divided first, by nested dissection (George 1973): the rows at one distance from some row
come last, after the two parts that they separate, which are divided in turn. Of several distances
from rows at the far end the level is taken that is small and leaves parts of like size.
"""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.structures.finite_elements.model_arguments import Matrix

Numbers = NDArray[np.intp]

# A part is divided where that takes more rows than this times the root of their number: of a
# square mesh with three displacements a node it takes two to three.
SOLID = 3.5
SMALL = 2000  # rows that minimum degree orders in less time, and about as well
STARTS = 6  # rows from which distances are tried
LEAST_SHARE = 0.15  # of the rows, in the smaller part


def fill_reducing_order(*matrices: Matrix) -> Numbers:
    """The order (n,) for sums of symmetric matrices (n, n)."""
    entries = sp.csr_array(sum(map(abs, matrices[1:]), start=abs(matrices[0])))
    entries.data[:] = 1.0
    return _dissected(entries, np.random.default_rng(0))


def _dissected(entries: sp.csr_array, rng: np.random.Generator) -> Numbers:
    if entries.shape[0] > SMALL:
        below, above, between = _divided(entries, rng)
        if len(between) > SOLID * np.sqrt(entries.shape[0]):
            parts = (part[_dissected(entries[part][:, part], rng)] for part in (below, above))
            return np.concatenate([*parts, between])
    return _by_minimum_degree(entries)


def _by_minimum_degree(entries: sp.csr_array) -> Numbers:
    from scipy.sparse.linalg import spilu

    # Diagonally dominant, so positive definite; of its factor nearly all is dropped.
    columns = sp.csc_matrix(sp.diags_array(2.0 * entries.sum(axis=0) + 1.0) - entries)
    options = {"SymmetricMode": True}
    by_degree = spilu(columns, 1e9, 1.0, permc_spec="MMD_AT_PLUS_A", options=options)
    return np.argsort(by_degree.perm_c)


def _divided(entries: sp.csr_array, rng: np.random.Generator) -> list[Numbers]:
    """Two parts of the rows, and those that separate them."""
    level, separating, least = np.zeros(entries.shape[0], dtype=np.intp), 0, np.inf
    distance = _distances(entries, int(rng.integers(len(level))))
    for _ in range(STARTS):
        far = np.flatnonzero(distance == distance.max())
        distance = _distances(entries, int(rng.choice(far)))
        sizes = np.bincount(distance)
        before = np.cumsum(sizes) - sizes
        smaller = np.minimum(before, len(level) - before - sizes) / len(level)
        allowed = np.flatnonzero(smaller > LEAST_SHARE)
        costs = sizes[allowed] / np.sqrt(smaller[allowed])
        if costs.min(initial=np.inf) < least:
            level, separating, least = distance, int(allowed[costs.argmin()]), float(costs.min())
    beyond = level > separating
    between = (level == separating) & (entries @ beyond > 0.0)
    return [np.flatnonzero(part) for part in (~beyond & ~between, beyond, between)]


def _distances(entries: sp.csr_array, start: int) -> Numbers:
    """Numbers of steps (n,) from a row, the most where there is no way."""
    distance, rows, steps = np.full(entries.shape[0], -1), np.array([start]), 0
    while len(rows):
        distance[rows] = steps
        neighbours = np.unique(entries[rows].indices)
        rows, steps = neighbours[distance[neighbours] < 0], steps + 1
    distance[distance < 0] = steps
    return distance
