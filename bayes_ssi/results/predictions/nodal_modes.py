"""Modes of a structure at all of its nodes, as other programs draw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.directions import DIRECTIONS, INTERNAL
from bayes_ssi.structures.structure import Structure


@dataclass(frozen=True, eq=False)
class NodalModes:
    """Modes at nodes.

    Attributes:
        positions: (n_nodes, 3), x, y and z; NaN where they are not known.
        geometry: the structure's, with lines and faces between some of the nodes; None if it has
            none.
        frequencies_hz: (n_modes,).
        displacements: (n_modes, n_nodes, 6), along x, y, z and about them, the largest
            displacement of a mode being 1; zero where the
            model has no row, as where a node is restrained.
    """

    nodes: tuple[str, ...]
    positions: FloatArray
    geometry: Geometry | None
    frequencies_hz: FloatArray
    displacements: FloatArray


def nodal_modes(structure: Structure, values: FloatArray) -> NodalModes:
    """Modes at one set of parameter values, of the exact model where it is approximated.

    Args:
        structure: degrees of freedom are labelled "node direction", such as ``12 x``; others, of
            elements on it for instance, have no node.
        values: (n_parameters,).
    """
    labels, frequencies, shapes = structure.labelled_modes(values)
    places = [_place(label) for label in labels]
    moving = dict.fromkeys(place[0] for place in places if place is not None)
    if not moving:
        raise ValueError(
            f"no degree of freedom is labelled 'node direction', such as '12 x'; labels are "
            f"{', '.join(map(repr, labels[:3]))}, …"
        )
    geometry = structure.geometry
    known = {} if geometry is None else geometry.nodes
    nodes = tuple(dict.fromkeys([*known, *moving]))  # restrained nodes are drawn, too
    number = {node: i for i, node in enumerate(nodes)}
    displacements = np.zeros((len(frequencies), len(nodes), len(DIRECTIONS)))
    for row, place in enumerate(places):
        if place is not None:
            displacements[:, number[place[0]], place[1]] = shapes[row]
    largest = abs(displacements[:, :, :3]).max(axis=(1, 2))
    return NodalModes(
        nodes,
        np.array([known.get(node, (np.nan,) * 3) for node in nodes]),
        geometry,
        frequencies,
        displacements / np.where(largest > 0.0, largest, 1.0)[:, None, None],
    )


def _place(label: str) -> tuple[str, int] | None:
    """Node and number of the direction, from 0; None where the label names none."""
    node, _, last = label.rpartition(" ")
    if not node or node.startswith(f"{INTERNAL} ") or last not in DIRECTIONS:
        return None
    return node, DIRECTIONS.index(last)
