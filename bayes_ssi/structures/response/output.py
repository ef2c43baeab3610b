"""Response quantities at places of a structure, and modal damping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_one_of
from bayes_ssi.structures.structure import Structure

GROUND = "ground"
Quantity = Literal["displacement", "acceleration", "drift"]
# One ratio for all modes, or one for each.
Damping = float | Sequence[float]
# Modes of structures that are damped by more than a fifth of critical are not identified.
HEAVY_DAMPING = 0.2


@dataclass(frozen=True)
class Output:
    """A response quantity at one or more places.

    Attributes:
        quantity: "displacement" (relative to the ground), "acceleration" (absolute), or "drift"
            (the displacement of one place minus that of another).
        places: labels of degrees of freedom, or of the structure's sensors; for drift pairs of
            them, (lower, upper), of which the lower may be "ground".

    Raises:
        ValueError: the quantity is unknown, there is no place, or a place has the wrong form for
            the quantity.
    """

    quantity: Quantity
    places: tuple[str, ...] | tuple[tuple[str, str], ...]

    def __post_init__(self) -> None:
        require_one_of("output: quantity", self.quantity, get_args(Quantity))
        if isinstance(self.places, str) or not len(self.places):
            raise ValueError(f"output: places must be a list of one or more, got {self.places!r}")
        pairs = self.quantity == "drift"
        for place in self.places:
            if not (_is_pair(place) if pairs else isinstance(place, str)):
                form = "a pair such as ('ground', 'floor 1')" if pairs else "a label"
                raise ValueError(
                    f"output: a place of {self.quantity!r} must be {form}, got {place!r}"
                )
        places = tuple(tuple(place) if pairs else place for place in self.places)
        object.__setattr__(self, "places", places)

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for every place."""
        return tuple(
            place if isinstance(place, str) else f"{place[0]} to {place[1]}"
            for place in self.places
        )

    def require_on(self, structure: Structure) -> None:
        """Refuse places that the structure does not have.

        Raises:
            ValueError: a place is no degree of freedom or sensor of the structure.
        """
        self.at_places(structure, np.zeros(len(structure.degrees_of_freedom)), axis=0)

    def at_places(self, structure: Structure, displacements: FloatArray, axis: int) -> FloatArray:
        """Displacements at the places, or their differences for drift.

        Args:
            structure: the structure that has the places.
            displacements: displacements of all its degrees of freedom, along ``axis``.
            axis: axis of ``displacements``; in the result, the places lie along it.

        Raises:
            ValueError: a place is no degree of freedom or sensor of the structure.
        """

        def at(labels: Sequence[str]) -> FloatArray:
            moving = [label for label in labels if label != GROUND]
            result = structure.sensor_matrix(moving, "place").apply(displacements, axis)
            for i, label in enumerate(labels):
                if label == GROUND:
                    result = np.insert(result, i, 0.0, axis)
            return result

        if self.quantity != "drift":
            labels = list(map(str, self.places))
            return structure.sensor_matrix(labels, "place").apply(displacements, axis)
        lower, upper = zip(*self.places, strict=True)
        return at(upper) - at(lower)


def _is_pair(place: object) -> bool:
    return (
        isinstance(place, (tuple, list))
        and len(place) == 2
        and all(isinstance(label, str) for label in place)
        and place[0] != place[1]
    )


def heavy_damping_warning(ratio: float) -> str:
    """What to say of a damping ratio above :data:`HEAVY_DAMPING`."""
    return (
        f"damping is {ratio:g}, a fraction: {100 * ratio:.3g} % of critical damping; "
        "is it a percentage?"
    )


def damping_ratios(damping: Damping, n_modes: int) -> FloatArray:
    """Modal damping ratios (n_modes,), as fractions of critical damping."""
    try:
        ratios = np.array(damping, dtype=float)
    except (TypeError, ValueError):
        ratios = np.array(np.nan)
    if not ((ratios > 0.0) & (ratios < 1.0)).all():
        raise ValueError(
            "damping must be a fraction of critical damping strictly between 0 and 1, "
            f"got {damping!r}"
        )
    if ratios.shape not in ((), (n_modes,)):
        raise ValueError(
            f"damping must be one ratio or one for each of the {n_modes} modes, got "
            f"{ratios.size} ratios"
        )
    return np.broadcast_to(ratios, (n_modes,))
