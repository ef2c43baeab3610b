"""Candidates: where on a structure a search may hang appendages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bayes_ssi.file_names import require_printable
from bayes_ssi.structures.elements import CarriesElements
from bayes_ssi.structures.geometry import Point, checked_point
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.motion import Place, checked_place, motion_of, place_name
from bayes_ssi.structures.rigid_floors import RigidFloors, floor_label
from bayes_ssi.structures.structure import Structure


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
        height: in storeys above the ground, for drawings of buildings; that of a floor if None.

    Raises:
        ValueError: the name cannot be printed, a place is none of these or a direction of zeros,
            the only place is the ground, both ends are one place, or coordinates or direction are
            not three numbers.
    """

    name: str
    place: Place
    to: Place | None
    coordinates: Point | None
    direction: Point | None
    height: float | None

    def __init__(
        self,
        name: str,
        place: Place | Mapping[Any, float],
        *,
        to: Place | Mapping[Any, float] | None = None,
        coordinates: Sequence[float] | None = None,
        direction: Sequence[float] | None = None,
        height: float | None = None,
    ) -> None:
        if not isinstance(name, str) or not name.strip():
            raise ValueError(f"Candidate: name must be text and not empty, got {name!r}")
        require_printable(name, "Candidate")
        where = f"candidate {name!r}"
        own = checked_place(place, f"{where}: place")
        other = None if to is None else checked_place(to, f"{where}: to")
        if own == other:
            raise ValueError(f"{where}: both ends are {place_name(own)!r}")
        if other is None and own == 0:
            raise ValueError(f"{where}: place is the ground, on which nothing can hang; give to")
        ends = [each for each in (own, other) if each is not None]
        if height is None and all(isinstance(each, int) for each in ends):
            height = sum(float(str(each)) for each in ends) / len(ends)
        fields = {
            "name": name,
            "place": own,
            "to": other,
            "coordinates": _point(coordinates, f"{where}: coordinates"),
            "direction": _point(direction, f"{where}: direction"),
            "height": height,
        }
        for field, value in fields.items():
            object.__setattr__(self, field, value)

    @property
    def ends(self) -> tuple[Place, ...]:
        """The place, or both."""
        return (self.place,) if self.to is None else (self.place, self.to)


def _point(given: Sequence[float] | None, where: str) -> Point | None:
    return None if given is None else checked_point(given, where)


def default_candidates(structure: Structure, sensors: Sequence[str]) -> tuple[Candidate, ...]:
    """Floors and storeys where a structure has them, in x and y in space; else sensors' places."""
    if isinstance(structure, RigidFloors):
        return tuple(_in_space(structure.n_floors))
    if isinstance(structure, LumpedStructure):
        floors = range(1, len(structure.main_degrees_of_freedom()) + 1)
        return (
            *(Candidate(str(floor), floor) for floor in floors),
            *(Candidate(f"{floor - 1}-{floor}", floor - 1, to=floor) for floor in floors),
        )
    motions = {sensor.label: dict(sensor.motion) for sensor in structure.sensors}
    places = [place for sensor in sensors for place in motions.get(sensor, (sensor,))]
    return tuple(Candidate(place, place) for place in dict.fromkeys(places))


def _in_space(n_floors: int) -> list[Candidate]:
    floors = range(1, n_floors + 1)
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
    on_floors = [
        Candidate(label, label, direction=axis, height=float(floor))
        for floor in floors
        for direction, axis in axes.items()
        for label in [floor_label(floor, direction)]
    ]
    in_storeys = [
        Candidate(
            f"{floor - 1}-{floor} {direction}",
            floor_label(floor - 1, direction) if floor > 1 else 0,
            to=floor_label(floor, direction),
            direction=axis,
            height=floor - 0.5,
        )
        for floor in floors
        for direction, axis in axes.items()
    ]
    return on_floors + in_storeys


def located(candidate: Candidate, structure: Structure) -> Candidate:
    """The candidate with coordinates and direction as the structure knows them, where not given."""
    places = [structure.location_of(end) for end in candidate.ends if end != 0]
    if candidate.coordinates is not None or not all(places):
        return candidate
    positions = [place.position for place in places if place is not None]
    x, y, z = (sum(values) / len(positions) for values in zip(*positions, strict=True))
    direction = places[0].direction if places[0] is not None else None
    return replace(candidate, coordinates=(x, y, z), direction=candidate.direction or direction)


def require_distinct(candidates: Sequence[Candidate]) -> None:
    """Refuse an empty list, and one that holds a name or a place twice."""
    if not candidates:
        raise ValueError("candidates: the list is empty; give one or more, or none for the default")
    by_name: dict[str, Candidate] = {}
    by_place: dict[frozenset[Any], Candidate] = {}
    for each in candidates:
        if each.name in by_name:
            raise ValueError(f"candidates: two are named {each.name!r}")
        by_name[each.name] = each
        ends = frozenset(frozenset(motion_of(end)) for end in each.ends)
        if ends in by_place:
            other = by_place[ends].name
            raise ValueError(f"candidates: {other!r} and {each.name!r} are one place")
        by_place[ends] = each


def require_on_structure(candidates: Sequence[Candidate], structure: CarriesElements) -> None:
    """Refuse candidates whose places are not on a structure."""
    for candidate in candidates:
        for end in candidate.ends:
            structure.require_place(end, f"candidate {candidate.name!r}")
