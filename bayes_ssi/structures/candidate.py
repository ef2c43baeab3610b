"""A place of a structure where an appendage may hang."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bayes_ssi.foundations.text_files import require_printable
from bayes_ssi.structures.geometry import Point, checked_point
from bayes_ssi.structures.motion import Place, checked_place, place_name


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
