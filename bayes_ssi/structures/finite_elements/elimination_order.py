"""An order of the rows of sparse symmetric matrices in which their factors stay sparse.

Rows that have nearly all entries in common, those of a mesh's node, stand together: where a few of
them happen to cancel, factors of an order that tells such rows apart may be twice as large.

In plane meshes and slender frames minimum degree serves best. A body or a frame of many bays each
way is divided first, by nested dissection (George 1973): the nodes at one distance from some node
come last, after the two parts that they separate, which are divided in turn. Of several distances
from nodes at the far end the level is taken that is small and leaves parts of like size.
"""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.structures.finite_elements.model_arguments import Matrix

Numbers = NDArray[np.intp]

ALIKE = 0.9  # share of entries that rows of one node have in common
SMALL = 200  # nodes that minimum degree orders at once
# A part is divided where that takes more nodes than this times the root of their number: of a
# square mesh it takes one to two.
SOLID = 2.5
STARTS = 6  # nodes from which distances are tried
LEAST_SHARE = 0.15  # of the nodes, in the smaller part


def fill_reducing_order(*matrices: Matrix) -> Numbers:
    """The order (n,) for sums of symmetric matrices (n, n)."""
    entries = sp.csc_array(sum(map(abs, matrices[1:]), start=abs(matrices[0])))
    entries.data[:] = 1.0
    node = _nodes(entries)
    members = sp.csc_array((np.ones(len(node)), (node, np.arange(len(node)))))
    graph = sp.csr_array(members @ entries @ members.T)
    position = np.argsort(_dissected(graph, np.random.default_rng(0)))
    return np.argsort(position[node], kind="stable")


def _nodes(entries: Matrix) -> Numbers:
    """The node (n,) of each row."""
    from scipy.sparse.csgraph import connected_components

    number, common = np.diff(entries.indptr), sp.coo_array((entries @ entries) * entries)
    row, column = common.coords
    alike = common.data >= ALIKE * np.maximum(number[row], number[column])
    pairs = sp.coo_array((common.data[alike], (row[alike], column[alike])), common.shape)
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.intp)


def _dissected(graph: "sp.csr_array", rng: np.random.Generator) -> Numbers:
    if graph.shape[0] > SMALL:
        below, above, separator = _divided(graph, rng)
        if len(separator) > SOLID * np.sqrt(graph.shape[0]):
            parts = (part[_dissected(graph[part][:, part], rng)] for part in (below, above))
            return np.concatenate([*parts, separator])
    return _by_minimum_degree(graph)


def _by_minimum_degree(graph: "sp.csr_array") -> Numbers:
    from scipy.sparse.linalg import spilu

    # Diagonally dominant, so positive definite; of its factor nearly all is dropped.
    columns = sp.csc_matrix(sp.diags_array(2.0 * graph.sum(axis=0) + 1.0) - graph)
    options = {"SymmetricMode": True}
    by_degree = spilu(columns, 1e9, 1.0, permc_spec="MMD_AT_PLUS_A", options=options)
    return np.argsort(by_degree.perm_c)


def _divided(graph: "sp.csr_array", rng: np.random.Generator) -> list[Numbers]:
    """Two parts of the nodes, and those that separate them."""
    level, separating, least = np.zeros(graph.shape[0], dtype=np.intp), -1, np.inf
    distance = _distances(graph, int(rng.integers(len(level))))
    for _ in range(STARTS):
        far = np.flatnonzero(distance == distance.max())
        distance = _distances(graph, int(rng.choice(far)))
        sizes = np.bincount(distance)
        before = np.cumsum(sizes) - sizes
        smaller = np.minimum(before, len(level) - before - sizes) / len(level)
        allowed = np.flatnonzero(smaller > LEAST_SHARE)
        costs = sizes[allowed] / np.sqrt(smaller[allowed])
        if costs.min(initial=np.inf) < least:
            level, separating, least = distance, int(allowed[costs.argmin()]), float(costs.min())
    beyond = level > separating
    between = (level == separating) & (graph @ beyond > 0.0)
    return [np.flatnonzero(part) for part in (~beyond & ~between, beyond, between)]


def _distances(graph: "sp.csr_array", start: int) -> Numbers:
    """Numbers of steps (n,) from a node, the most where there is no way."""
    distance, nodes, steps = np.full(graph.shape[0], -1), np.array([start]), 0
    while len(nodes):
        distance[nodes] = steps
        neighbours = np.unique(graph[nodes].indices)
        nodes, steps = neighbours[distance[neighbours] < 0], steps + 1
    distance[distance < 0] = steps
    return distance
