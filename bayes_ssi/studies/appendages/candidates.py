"""Candidates of a search: where they are, and whether they are on its structures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from bayes_ssi.structures.candidate import Candidate
from bayes_ssi.structures.motion import motion_of
from bayes_ssi.structures.structure import Structure


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


def require_on_structure(candidates: Sequence[Candidate], structure: Structure) -> None:
    """Refuse candidates whose places are not on a structure."""
    for candidate in candidates:
        for end in candidate.ends:
            structure.require_place(end, f"candidate {candidate.name!r}")
