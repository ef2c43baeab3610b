"""Candidates of a search: where they are, on which structures, and which ones sensors see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.candidate import Candidate
from bayes_ssi.structures.motion import motion_of
from bayes_ssi.structures.structure import Structure

# A mode that the sensors see moves them by at least this share of the one that moves them most, at
# unit modal mass.
VISIBLE = 0.05
# A place takes part in a mode if it moves by this share of what the sensors do: less, and an
# appendage of a tenth of the modal mass, in resonance, moves the two frequencies apart by less than
# 0.3 % (the square root of 0.1 times this share), and no other mode by a part of that.
TAKES_PART = 0.01


def are_observed(
    structure: Structure, candidates: Sequence[Candidate], data: ModalData
) -> NDArray[np.bool_]:
    """Whether candidates (n,) take part in a mode of the band that the sensors see.

    At the prior medians; of two ends of a candidate one is enough. An appendage elsewhere changes
    no identified mode, so its probability remains that before the test.
    """
    values = structure.prior_medians()
    modes = structure.modes(values)
    at_sensors = structure.sensor_matrix(data.sensors).apply(modes.shapes)[0]
    seen = np.abs(at_sensors).max(axis=0, initial=0.0)
    counts = (modes.frequencies_hz[0] <= data.band_hz[1]) & (seen >= VISIBLE * seen.max())
    ends = [end for candidate in candidates for end in candidate.ends]
    moved = structure.place_shapes(ends, values)
    if moved is None or not counts.any():
        return np.ones(len(candidates), dtype=bool)
    takes_part = (np.abs(moved)[:, : len(seen)] >= TAKES_PART * seen)[:, counts].any(axis=1)
    of_candidate = np.repeat(np.arange(len(candidates)), [len(each.ends) for each in candidates])
    return np.bincount(of_candidate, takes_part, minlength=len(candidates)) > 0


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
