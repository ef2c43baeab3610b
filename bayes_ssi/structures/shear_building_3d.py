"""The shear building in space: every floor moves in x and y and turns about the vertical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayes_ssi.parameters import Product, Value, as_product
from bayes_ssi.structures.elements import Element, Place, PointMass, Spring
from bayes_ssi.structures.lumped import LumpedStructure

__all__ = ["FloorMass", "ShearBuilding3D"]

DIRECTIONS = ("x", "y", "torsion")


def _label(floor: int, direction: str) -> str:
    return f"floor {floor} {direction}"


@dataclass(frozen=True)
class ShearBuilding3D(LumpedStructure):
    """Rigid floors with three degrees of freedom each, on storeys that resist all three.

    The degrees of freedom are ``"floor 1 x"``, ``"floor 1 y"``, ``"floor 1 torsion"`` and so on
    upwards: displacements of the floor's centre of mass, and its rotation in radians. The centres
    of mass lie above one another. Elements stand on a degree of freedom, by its label.

    Attributes:
        masses: of the floors, from the lowest.
        radii_of_gyration: of the floors about their centres of mass; a floor's moment of inertia
            is its mass times the square.
        stiffnesses_x: of the storeys in x, from the lowest; storey i stands below floor i.
        stiffnesses_y: the same in y.
        torsional_stiffnesses: of the storeys, moment over rotation about the centre of stiffness.
        eccentricities: (x, y) of each storey's centre of stiffness from the centre of mass,
            numbers in the unit of length of the radii; zero where not given, and then x, y and
            torsion are uncoupled.

    Masses, lengths and stiffnesses are in consistent units, each a number, a Parameter or a
    number times a Parameter.

    Raises:
        ValueError: lengths differ, or a mass, radius or stiffness can be zero or negative.
        TypeError: one of them is neither a number nor a Parameter.
    """

    masses: tuple[Value, ...]
    radii_of_gyration: tuple[Value, ...]
    stiffnesses_x: tuple[Value, ...]
    stiffnesses_y: tuple[Value, ...]
    torsional_stiffnesses: tuple[Value, ...]
    eccentricities: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        fields = (
            "masses", "radii_of_gyration", "stiffnesses_x", "stiffnesses_y",
            "torsional_stiffnesses",
        )  # fmt: skip
        for name in fields:
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.eccentricities:
            object.__setattr__(self, "eccentricities", ((0.0, 0.0),) * len(self.masses))
        centres = tuple((float(x), float(y)) for x, y in self.eccentricities)
        object.__setattr__(self, "eccentricities", centres)
        counts = {name: len(getattr(self, name)) for name in (*fields, "eccentricities")}
        if len(set(counts.values())) != 1 or not self.masses:
            told = ", ".join(f"{count} {name}" for name, count in counts.items())
            raise ValueError(
                f"ShearBuilding3D: needs one of each a floor and storey, at least one, got {told}"
            )
        for name in fields:
            for i, value in enumerate(getattr(self, name), 1):
                where = f"ShearBuilding3D: {name}, number {i} from below,"
                as_product(value, where).require_positive(where)
        super().__post_init__()

    def main_degrees_of_freedom(self) -> Sequence[str]:
        floors = range(1, len(self.masses) + 1)
        return [_label(floor, direction) for floor in floors for direction in DIRECTIONS]

    def main_springs(self) -> Sequence[Spring]:
        springs = []
        for storey, (x, y) in enumerate(self.eccentricities, 1):
            # What the centre of stiffness does when its floor moves: (u_x - y θ, u_y + x θ, θ).
            for stiffnesses, motion in (
                (self.stiffnesses_x, {"x": 1.0, "torsion": -y}),
                (self.stiffnesses_y, {"y": 1.0, "torsion": x}),
                (self.torsional_stiffnesses, {"torsion": 1.0}),
            ):
                drift: list[tuple[Place, float]] = [
                    (_label(floor, direction), sign * component)
                    for floor, sign in ((storey - 1, -1.0), (storey, 1.0))
                    for direction, component in motion.items()
                    if floor
                ]
                springs.append(Spring(as_product(stiffnesses[storey - 1]), tuple(drift)))
        return springs

    def main_masses(self) -> Sequence[PointMass]:
        each = zip(self.masses, self.radii_of_gyration, strict=True)
        return [
            mass
            for floor, (m, radius) in enumerate(each, 1)
            for mass in _rigid(floor, as_product(m), as_product(radius))
        ]

    def _index(self, place: Place, label: str = "element") -> int | None:
        if place != 0 and place not in self.degrees_of_freedom:
            raise ValueError(
                f"{label}: the structure has no degree of freedom {place!r}; choose from "
                f"{', '.join(map(repr, self.degrees_of_freedom))} (a floor moves in three "
                "directions here)"
            )
        return super()._index(place, label)


@dataclass(frozen=True)
class FloorMass(Element):
    """A mass that rides on a floor of a :class:`ShearBuilding3D`, in x, y and torsion.

    Attributes:
        on: the floor, from 1.
        mass: the mass.
        radius: of gyration about the floor's centre of mass, for a small mass its distance.
    """

    on: int
    mass: Value
    radius: Value
    label: str = ""

    def __post_init__(self) -> None:
        if not self.label:
            object.__setattr__(self, "label", f"mass on floor {self.on}")
        if not isinstance(self.on, int) or isinstance(self.on, bool) or self.on < 1:
            raise ValueError(f"{self.label}: on must be a floor from 1 upwards, got {self.on!r}")
        for field in ("mass", "radius"):
            where = f"{self.label}: {field}"
            as_product(getattr(self, field), where).require_positive(where)

    def masses(self) -> Sequence[PointMass]:
        return _rigid(self.on, as_product(self.mass), as_product(self.radius))

    def as_mass(self) -> FloorMass:
        return self


def _rigid(floor: int, mass: Product, radius: Product) -> list[PointMass]:
    """The inertia of a mass that moves with a floor."""
    inertias = (mass, mass, mass * radius**2)
    return [
        PointMass(inertia, _label(floor, direction))
        for inertia, direction in zip(inertias, DIRECTIONS, strict=True)
    ]
