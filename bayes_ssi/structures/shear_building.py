"""The shear building: rigid floors that move sideways on storeys with a lateral stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayes_ssi.parameters import Value, as_product
from bayes_ssi.structures.elements import PointMass, Spring
from bayes_ssi.structures.lumped import LumpedStructure

__all__ = ["ShearBuilding"]


@dataclass(frozen=True)
class ShearBuilding(LumpedStructure):
    """A planar shear building on a fixed base; floors are labelled ``"floor 1"`` upwards.

    Attributes:
        masses: of the floors, from the lowest.
        stiffnesses: of the storeys, from the lowest; storey i stands below floor i.
        elements: non-structural elements on it; :meth:`with_element` adds one.
        sensors: beside the degrees of freedom; :meth:`with_sensors` adds some.

    Masses and stiffnesses are in consistent units (kg and N/m, say), each a number, a Parameter
    or a number times a Parameter.

    Raises:
        ValueError: their lengths differ, or one of them can be zero or negative.
        TypeError: one of them is neither a number nor a Parameter.
    """

    masses: tuple[Value, ...]
    stiffnesses: tuple[Value, ...]

    def __post_init__(self) -> None:
        for name in ("masses", "stiffnesses"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len(self.masses) != len(self.stiffnesses) or not self.masses:
            raise ValueError(
                "ShearBuilding: needs one mass a floor and one stiffness a storey, got "
                f"{len(self.masses)} masses and {len(self.stiffnesses)} stiffnesses"
            )
        for i, (mass, stiffness) in enumerate(zip(self.masses, self.stiffnesses, strict=True), 1):
            for value, field in (
                (mass, f"mass of floor {i}"),
                (stiffness, f"stiffness of storey {i}"),
            ):
                as_product(value, f"ShearBuilding: {field}").require_positive(
                    f"ShearBuilding: {field}"
                )
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
