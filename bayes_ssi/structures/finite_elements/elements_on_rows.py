"""Elements on a model that is given by its matrices: their springs and masses by rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import listed_choices
from bayes_ssi.parameters.parameters import Product
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.motion import Motion, SinglePlace

# A larger model must name its sensors: every mode shape is kept at all of them.
MOST_WITHOUT_SENSORS = 1000

Sensors = Mapping[str, "int | str"] | Sequence["int | str"]


def sensor_rows(
    n: int, labels: Sequence[str] | None, sensors: Sensors | None
) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Names and rows of the measured degrees of freedom.

    Args:
        n: number of degrees of freedom of the model.
        labels: labels of all degrees of freedom, or None.
        sensors: name → label, or number from 0, of a degree of freedom; or labels alone; or
            None for all.
    """
    if isinstance(labels, str) or isinstance(sensors, str):
        raise TypeError("labels and sensors must be several names, got a single text")
    if labels is not None:
        _require_names("labels", labels)
        if len(labels) != n:
            raise ValueError(f"labels: {len(labels)} for {n} degrees of freedom")
    if sensors is None:
        if n > MOST_WITHOUT_SENSORS:
            raise ValueError(
                f"sensors: a model of more than {MOST_WITHOUT_SENSORS} degrees of freedom, here "
                f'{n}, must name the measured ones, as in sensors={{"roof x": 1203}}'
            )
        return tuple(labels or (f"dof {i}" for i in range(n))), np.arange(n)
    if not isinstance(sensors, Mapping):
        if not all(isinstance(sensor, str) for sensor in sensors):
            raise TypeError(
                "sensors: a list holds labels; to give numbers, name them, as in "
                f'sensors={{"roof x": 1203}}, got {sensors!r}'
            )
        _require_names("sensors", list(sensors))
        sensors = {str(sensor): sensor for sensor in sensors}
    _require_names("sensors", list(sensors))
    row_of = {label: i for i, label in enumerate(labels or ())}
    rows = [_row(name, place, n, row_of) for name, place in sensors.items()]
    return tuple(sensors), np.array(rows, dtype=np.intp)


def _row(name: str, place: object, n: int, row_of: Mapping[str, int]) -> int:
    if isinstance(place, str):
        if place in row_of:
            return row_of[place]
        raise ValueError(
            f"sensor {name!r}: no degree of freedom is labelled {place!r}; labels are "
            f"{listed_choices(row_of) if row_of else 'none: no labels were given'}"
        )
    if isinstance(place, Integral) and not isinstance(place, bool):
        if 0 <= int(place) < n:
            return int(place)
        raise ValueError(
            f"sensor {name!r}: number {place} of a degree of freedom must be from 0 to {n - 1}"
        )
    raise TypeError(
        f"sensor {name!r}: must be the label or the number of a degree of freedom, got {place!r}"
    )


def _require_names(what: str, names: Sequence[object]) -> None:
    for name in names:
        if not isinstance(name, str) or not name.strip():
            raise TypeError(f"{what} must be text and not empty, got {name!r}")
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise ValueError(f"{what}: {repeated[0]!r} names two degrees of freedom")


# A displacement v·x by the nonzero components of v: row → component.
Vector = dict[int, float]


@dataclass(frozen=True)
class ElementsOnRows:
    """Springs k v vᵀ and masses m v vᵀ on a model of ``size`` degrees of freedom.

    Attributes:
        labels: of the degrees of freedom that elements add, which are rows ``size`` upwards.
        size: number of degrees of freedom of the model without them.
    """

    labels: tuple[str, ...]
    springs: tuple[tuple[Product, Vector], ...]
    masses: tuple[tuple[Product, Vector], ...]
    size: int

    @classmethod
    def of(
        cls,
        elements: Sequence[Element],
        row_of: Callable[[SinglePlace, str], int | None],
        size: int,
        shift: float = 0.0,
    ) -> ElementsOnRows:
        """Find the rows of elements.

        Args:
            row_of: the row of a place of the model, None for the ground; refuses others with a
                message that begins with the element's label.
            size: number of degrees of freedom of the model.
            shift: that of :class:`~bayes_ssi.structures.modal.FreeBody`, for the springs.
        """
        own = [e.own_degree_of_freedom for e in elements if e.own_degree_of_freedom is not None]
        added = {label: size + i for i, label in enumerate(own)}

        def vector(motion: Motion, label: str) -> Vector:
            total: Vector = {}
            for place, component in motion:
                row = added[str(place)] if place in added else row_of(place, label)
                if row is not None:
                    total[row] = total.get(row, 0.0) + component
            return {row: component for row, component in total.items() if component != 0.0}

        springs = [
            (s.stiffness, vector(s.direction, e.label)) for e in elements for s in e.springs()
        ]
        masses = [(m.mass, vector(m.direction, e.label)) for e in elements for m in e.masses()]
        if shift:
            springs += [(shift * mass, motion) for mass, motion in masses]
        return cls(tuple(own), tuple(springs), tuple(masses), size)

    def ordered(self, rows: NDArray[np.intp]) -> ElementsOnRows:
        """The same elements where row i of the model and theirs has become ``rows[i]``."""
        springs, masses = (
            tuple((c, {int(rows[i]): v for i, v in vector.items()}) for c, vector in of_kind)
            for of_kind in (self.springs, self.masses)
        )
        return replace(self, springs=springs, masses=masses)

    def own_springs(self) -> list[int]:
        """The spring by which each degree of freedom of their own hangs on the others."""
        last = [max(vector, default=0) for _, vector in self.springs]
        return [last.index(self.size + i) for i in range(len(self.labels))]

    def influence(self, influence: FloatArray) -> FloatArray:
        """Displacements (size + own,) when the ground moves by 1; appendages do not deform.

        ``influence`` (size,) is that of the model without elements.
        """
        whole = np.append(influence, np.zeros(len(self.labels)))
        for row, spring in enumerate(self.own_springs(), self.size):
            _, vector = self.springs[spring]
            moved = sum(component * whole[other] for other, component in vector.items())
            whole[row] = -moved / vector[row]
        return whole
