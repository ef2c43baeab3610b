"""Where an element acts: a floor, a degree of freedom, a sensor, or a combination of these."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

# A floor from 1 where a structure has floors (0 is the ground), or the label of a degree of
# freedom or of a sensor.
SinglePlace = int | str
# Σ share · x(single place), as pairs.
Motion = tuple[tuple[SinglePlace, float], ...]
Place = SinglePlace | Motion


def checked_place(place: Any, where: str) -> Place:
    """A place as elements keep it: a mapping of single places to shares becomes pairs."""
    if _is_single(place):
        single: SinglePlace = place
        return single
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
