"""Where a structure's nodes are, and which lines and faces join them in a drawing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.structures.motion import Motion

Point = tuple[float, float, float]
# Last words of labels of translations, as in "node 7 x".
DIRECTIONS = ("x", "y", "z")


class Location(NamedTuple):
    """Where a motion takes place, and in which direction.

    Attributes:
        position: (x, y, z).
        direction: unit vector; None for rotations and scalar motions.
    """

    position: Point
    direction: Point | None


@dataclass(frozen=True)
class Geometry:
    """The nodes of a structure, and the lines and faces between them.

    A degree of freedom belongs to the node that its label names, without the last word where that
    is a direction: ``"node 7 x"`` is the motion of ``"node 7"`` along x, and ``"node 7 rx"`` a
    rotation there.

    Attributes:
        nodes: name → (x, y, z).
        lines: pairs of nodes that a drawing joins, such as the ends of beams.
        unit: of the coordinates, such as "m"; empty where it is not known.
        faces: corners of surfaces, three or more nodes each, in their order around it: shells, and
            the outer faces of solids.

    Raises:
        ValueError: a node does not have three finite coordinates, or a line or face names what is
            no node.
    """

    nodes: Mapping[str, Point]
    lines: tuple[tuple[str, str], ...] = ()
    unit: str = ""
    faces: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        if not self.nodes:
            raise ValueError("geometry: there are no nodes")
        nodes = {name: checked_point(at, f"node {name!r}") for name, at in self.nodes.items()}
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "lines", tuple(_checked_line(line, nodes) for line in self.lines))
        object.__setattr__(self, "faces", tuple(_checked_face(face, nodes) for face in self.faces))

    @cached_property
    def edges(self) -> tuple[tuple[str, str], ...]:
        """The lines, and the sides of all faces, each once."""
        sides = (
            side for face in self.faces for side in zip(face, (*face[1:], face[0]), strict=True)
        )
        once = {frozenset(side): side for side in (*self.lines, *sides)}
        return tuple(once.values())

    def location(self, motion: Motion) -> Location | None:
        """Where a combination of degrees of freedom moves; None where a node is not known.

        Of several nodes it is the mean, weighted by their shares.
        """
        total = sum(abs(share) for _, share in motion)
        position, direction = np.zeros(3), np.zeros(3)
        for place, share in motion:
            node, axis = self._node_and_axis(str(place))
            if node is None:
                return None
            position += abs(share) / total * np.array(self.nodes[node])
            if axis is not None:
                direction[axis] += share
        return Location(_point(position), unit_vector(direction))

    def _node_and_axis(self, label: str) -> tuple[str | None, int | None]:
        """The node that a label names, and the axis, from 0, along which it moves."""
        if label in self.nodes:
            return label, None
        node, _, last = label.rpartition(" ")
        if node not in self.nodes:
            return None, None
        return node, DIRECTIONS.index(last) if last in DIRECTIONS else None


def checked_point(at: Any, where: str) -> Point:
    """Three finite coordinates."""
    try:
        point = tuple(float(coordinate) for coordinate in at)
    except (TypeError, ValueError):
        point = ()
    if len(point) != 3 or not all(math.isfinite(coordinate) for coordinate in point):
        raise ValueError(f"{where}: must have three finite coordinates (x, y, z), got {at!r}")
    return point


def unit_vector(vector: Any) -> Point | None:
    """A direction at unit length; None where it has none."""
    length = float(np.linalg.norm(vector))
    return _point(np.divide(vector, length)) if length > 0.0 else None


def _point(array: Any) -> Point:
    x, y, z = (float(coordinate) for coordinate in array)
    return x, y, z


def _checked_line(line: Sequence[str], nodes: Mapping[str, Point]) -> tuple[str, str]:
    ends = tuple(line)
    unknown = next((end for end in ends if end not in nodes), None)
    if len(ends) != 2 or unknown is not None:
        raise ValueError(f"geometry: a line joins two nodes that it names, got {line!r}")
    return ends[0], ends[1]


def _checked_face(face: Sequence[str], nodes: Mapping[str, Point]) -> tuple[str, ...]:
    corners = tuple(face)
    if len(corners) < 3 or any(corner not in nodes for corner in corners):
        raise ValueError(f"geometry: a face joins three or more nodes that it names, got {face!r}")
    return corners


def direction_name(direction: Point) -> str:
    """A direction in words: ``x``, ``-y``, or its cosines."""
    for axis, name in enumerate(DIRECTIONS):
        if abs(direction[axis]) == 1.0:
            return name if direction[axis] > 0.0 else f"-{name}"
    return f"({', '.join(f'{cosine:.2g}' for cosine in direction)})"
