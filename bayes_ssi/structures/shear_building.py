"""The shear building: rigid floors that move sideways on storeys with a lateral stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayes_ssi.parameters.parameters import Value, as_product
from bayes_ssi.structures.elements import PointMass, Spring
from bayes_ssi.structures.lumped import LumpedStructure


@dataclass(frozen=True)
class ShearBuilding(LumpedStructure):
    """A planar shear building on a fixed base; floors are labelled ``"floor 1"`` upwards.

    Masses and stiffnesses are in consistent units (kg and N/m, say), each a number, a Parameter
    or a number times a Parameter.

    Attributes:
        masses: of the floors, from the lowest.
        stiffnesses: of the storeys, from the lowest; storey i stands below floor i.
        elements: non-structural elements on it; :meth:`with_element` adds one.
        sensors: not at degrees of freedom; :meth:`with_sensors` adds some.

    Raises:
        ValueError: their numbers differ, or one of them can be zero or negative.
        TypeError: one of them is neither a number nor a Parameter.
    """

    masses: tuple[Value, ...]
    stiffnesses: tuple[Value, ...]

    def __post_init__(self) -> None:
        self._check_storeys()
        super().__post_init__()

    def main_degrees_of_freedom(self) -> Sequence[str]:
        return [f"floor {i}" for i in range(1, len(self.masses) + 1)]

    def main_springs(self) -> Sequence[Spring]:
        return [
            Spring(as_product(stiffness), ((floor - 1, -1.0), (floor, 1.0)))
            for floor, stiffness in enumerate(self.stiffnesses, 1)
        ]

    def main_masses(self) -> Sequence[PointMass]:
        return [PointMass.on(floor, as_product(mass)) for floor, mass in enumerate(self.masses, 1)]
