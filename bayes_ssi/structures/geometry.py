"""Where a structure moves: places of elements and sensors, candidates, and nodes for drawings.

A place is a floor, a degree of freedom, a sensor, or a combination of these. An accelerometer
measures at a point and in a direction, which need not be a degree of freedom: on a rigid floor that
moves by u and v and turns by θ, one at (x, y) along x measures u - y θ. That is a row of the sensor
matrix, with terms for these degrees of freedom only, however many the structure has.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_name

# A floor from 1 where a structure has floors (0 is the ground), or the label of a degree of
# freedom or of a sensor.
SinglePlace = int | str
# Σ share · x(single place), as pairs.
Motion = tuple[tuple[SinglePlace, float], ...]
Place = SinglePlace | Motion


def checked_place(place: Any, where: str) -> Place:
    """A place as elements keep it: a mapping of single places to shares becomes pairs."""
    if _is_single(place):
        return place
    pairs = tuple(place.items()) if isinstance(place, Mapping) else place
    try:
        motion: Motion = tuple((one, float(share)) for one, share in pairs)
    except (TypeError, ValueError):
        motion = ()
    if not motion or not all(_is_single(one) and math.isfinite(share) for one, share in motion):
        raise ValueError(
            f"{where} must be a floor, the label of a degree of freedom or sensor, or shares of "
            f"these such as {{'node 7 x': 0.6, 'node 7 y': 0.8}}, got {place!r}"
        )
    if not any(share for _, share in motion):
        raise ValueError(f"{where} is a direction of zeros, got {place!r}")
    return motion


def _is_single(place: Any) -> bool:
    if isinstance(place, str):
        return bool(place.strip())
    return isinstance(place, int) and not isinstance(place, bool)


def motion_of(place: Place, share: float = 1.0) -> Motion:
    """A share of the motion of a place, as a combination of single places."""
    if isinstance(place, tuple):
        return tuple((single, share * own) for single, own in place)
    return ((place, share),)


def place_name(place: Place) -> str:
    """A place in words: ``node 7 x``, ``0.6 node 7 x + 0.8 node 7 y``."""
    if not isinstance(place, tuple):
        return str(place)
    return " + ".join(str(one) if share == 1.0 else f"{share:g} {one}" for one, share in place)


Point = tuple[float, float, float]
# Last words of labels of translations, as in "node 7 x".
DIRECTIONS = ("x", "y", "z")
ROTATIONS = ("rx", "ry", "rz", "torsion")


class Location(NamedTuple):
    """Where a motion takes place, and in which direction."""

    position: Point  # (x, y, z)
    direction: Point | None  # unit vector; None for rotations and scalar motions


@dataclass(frozen=True)
class Geometry:
    """The nodes of a structure, and the lines and faces between them.

    A degree of freedom belongs to the node that its label names, without the last word where that
    is a direction: ``"node 7 x"`` is a motion of ``"node 7"`` along x, ``"node 7 rx"`` a rotation.

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
        for name, kinds in (("lines", self.lines), ("faces", self.faces)):
            object.__setattr__(self, name, tuple(map(tuple, kinds)))
        for line in self.lines:
            if len(line) != 2 or not nodes.keys() >= set(line):
                raise ValueError(f"geometry: a line joins two nodes that it names, got {line!r}")
        for face in self.faces:
            if len(face) < 3 or not nodes.keys() >= set(face):
                raise ValueError(
                    f"geometry: a face joins three or more nodes that it names, got {face!r}"
                )

    @cached_property
    def edges(self) -> tuple[tuple[str, str], ...]:
        """The lines, and the sides of all faces, each once."""
        sides = (side for face in self.faces for side in pairwise((*face, face[0])))
        once = {frozenset(side): side for side in (*self.lines, *sides)}
        return tuple(once.values())

    def location(self, motion: Motion) -> Location | None:
        """Where a combination of degrees of freedom moves; None where a node is not known.

        Of several nodes it is the mean, weighted by their shares.
        """
        total = sum(abs(share) for _, share in motion)
        position, direction = np.zeros(3), np.zeros(3)
        for place, share in motion:
            label = str(place)
            node, _, last = (label, "", "") if label in self.nodes else label.rpartition(" ")
            if node not in self.nodes:
                return None
            position += abs(share) / total * np.array(self.nodes[node])
            if last in DIRECTIONS:
                direction[DIRECTIONS.index(last)] += share
        length = float(np.linalg.norm(direction))
        return Location(_point(position), _point(direction / length) if length > 0.0 else None)


def checked_point(at: Any, where: str) -> Point:
    """Three finite coordinates."""
    try:
        point = tuple(float(coordinate) for coordinate in at)
    except (TypeError, ValueError):
        point = ()
    if len(point) != 3 or not all(math.isfinite(coordinate) for coordinate in point):
        raise ValueError(f"{where}: must have three finite coordinates (x, y, z), got {at!r}")
    return point


def _point(array: Any) -> Point:
    x, y, z = (float(coordinate) for coordinate in array)
    return x, y, z


# Of a node along x, y and z.
Motions = tuple[Motion, ...]
# Nodes to draw with the lines and faces between them, and how each moves; one that is not named
# is at rest.
Drawing = tuple[Geometry, Mapping[str, Motions]]


def stick(labels: Sequence[str]) -> Drawing:
    """Degrees of freedom or sensors one above the other, as far as nothing says where they are.

    Each moves in the direction with which its label ends, or along x; rotations do not move it.
    """
    motions: dict[str, list[Motion]] = {}
    for label in labels:
        name, _, last = label.rpartition(" ")
        directed = bool(name) and last in (*DIRECTIONS, *ROTATIONS)
        along = motions.setdefault(name if directed else label, [(), (), ()])
        if last not in ROTATIONS:
            along[DIRECTIONS.index(last) if directed else 0] = ((label, 1.0),)
    names = ["", *motions]  # from the ground
    nodes = {name: (0.0, 0.0, float(i)) for i, name in enumerate(names)}
    moving = {name: tuple(along) for name, along in motions.items()}
    return Geometry(nodes, tuple(pairwise(names))), moving


def drawn_at(drawing: Drawing, motion: Motion) -> Location | None:
    """Where a motion along one axis is on a drawing; None where it is none of its nodes'."""
    geometry, moving = drawing
    for node, along in moving.items():
        if motion in along:
            unit = np.eye(3)[along.index(motion)]
            return Location(geometry.nodes[node], _point(unit))
    return None


@dataclass(frozen=True)
class Candidate:
    """A place for a pendulum, or two places for an element between them.

    Attributes:
        name: unique in a list of candidates; tables and results call the place by it.
        place: a floor, the label of a degree of freedom or sensor, or shares of several, such as
            the cosines of a direction at a node: ``{"node 7 x": 0.6, "node 7 y": 0.8}``. The mass
            of an appendage moves in series with Σ share · x, so shares of a direction are to have
            squares that add up to 1.
        to: the other end of an element between two places.
        coordinates: (x, y, z) of the place, for drawings.
        direction: (x, y, z) of its motion, for drawings.

    Raises:
        ValueError: the name cannot be printed, a place is none of these or a direction of zeros,
            the only place is the ground, both ends are one place, or coordinates or direction are
            not three numbers.
    """

    name: str
    place: Place
    _: KW_ONLY
    to: Place | None = None
    coordinates: Point | None = None
    direction: Point | None = None

    def __post_init__(self) -> None:
        require_name(self.name, "Candidate: name")
        where = f"candidate {self.name!r}"
        object.__setattr__(self, "place", checked_place(self.place, f"{where}: place"))
        if self.to is not None:
            object.__setattr__(self, "to", checked_place(self.to, f"{where}: to"))
        if self.place == self.to:
            raise ValueError(f"{where}: both ends are {place_name(self.place)!r}")
        if self.to is None and self.place == 0:
            raise ValueError(f"{where}: place is the ground, on which nothing can hang; give to")
        for name in ("coordinates", "direction"):
            if getattr(self, name) is not None:
                point = checked_point(getattr(self, name), f"{where}: {name}")
                object.__setattr__(self, name, point)

    @property
    def ends(self) -> tuple[Place, ...]:
        """The place, or both."""
        return (self.place,) if self.to is None else (self.place, self.to)


@dataclass(frozen=True)
class Sensor:
    """A point and direction in which motion is measured.

    Attributes:
        label: its name in the data.
        motion: label of a degree of freedom → what the sensor measures of its unit displacement;
            stored as pairs.

    Raises:
        ValueError: the label or the motion is empty, or a number in the motion is not finite.

    >>> frame = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(40.0, 40.0))
    >>> halfway = bs.Sensor("landing", {"floor 1": 0.5, "floor 2": 0.5})
    >>> frame.with_sensors([halfway]).sensor_matrix(["landing"]).weights
    array([[0.5, 0.5]])
    """

    label: str
    motion: tuple[tuple[str, float], ...]

    def __init__(self, label: str, motion: Mapping[str, float]) -> None:
        require_name(label, "Sensor: label")
        pairs = tuple((place, float(share)) for place, share in dict(motion).items())
        if not pairs or not all(math.isfinite(share) for _, share in pairs):
            raise ValueError(
                f"sensor {label!r}: motion must give a finite number for one degree of freedom or "
                f"more, got {motion!r}"
            )
        object.__setattr__(self, "label", label)
        object.__setattr__(self, "motion", pairs)


class SensorMatrix:
    """The sensor matrix (n_sensors, n_dof) of a structure, by its nonzero terms.

    Rows with fewer terms than the longest are padded with terms of weight zero.

    Attributes:
        rows: (n_sensors, n_terms), degrees of freedom.
        weights: (n_sensors, n_terms).
    """

    def __init__(
        self, motions: Sequence[Mapping[str, float]], degrees_of_freedom: Sequence[str]
    ) -> None:
        """From each sensor's motion: degree of freedom → its weight in the measurement."""
        row = {label: i for i, label in enumerate(degrees_of_freedom)}
        shape = (len(motions), max(map(len, motions), default=1))
        self.rows: NDArray[np.intp] = np.zeros(shape, dtype=np.intp)
        self.weights = np.zeros(shape)
        for i, motion in enumerate(motions):
            self.rows[i, : len(motion)] = [row[label] for label in motion]
            self.rows[i, len(motion) :] = self.rows[i, 0]
            self.weights[i, : len(motion)] = list(motion.values())

    def apply(self, motions: FloatArray, axis: int = 1) -> FloatArray:
        """Motions at the sensors: (B, n_dof, n_modes) along an axis become (B, n_sensors, …).

        Only measured degrees of freedom are read, and terms are added one by one: in a matrix
        product, a row could depend on the size of its batch.
        """
        before = (slice(None),) * (motions.ndim - 1 - axis)
        column = [1] * motions.ndim
        column[axis] = len(self.rows)
        first, *others = (
            motions.T[(*before, rows)].T * weights.reshape(column)
            for rows, weights in zip(self.rows.T, self.weights.T, strict=True)
        )
        return sum(others, start=first)
