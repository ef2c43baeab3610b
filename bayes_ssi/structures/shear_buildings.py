"""Shear buildings: of one motion a floor, and in space, where floors move in x and y and turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayes_ssi.parameters.parameters import Value, as_product
from bayes_ssi.structures.elements import Contribution
from bayes_ssi.structures.geometry import SinglePlace
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.structures.rigid_floors import RigidFloors, floor_label, rigid_masses


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

    def main_springs(self) -> Sequence[Contribution]:
        return [
            Contribution(as_product(stiffness), ((floor - 1, -1.0), (floor, 1.0)))
            for floor, stiffness in enumerate(self.stiffnesses, 1)
        ]

    def main_masses(self) -> Sequence[Contribution]:
        masses = map(as_product, self.masses)
        return [Contribution.on(floor, mass) for floor, mass in enumerate(masses, 1)]


@dataclass(frozen=True)
class ShearBuilding3D(RigidFloors):
    """Rigid floors with three degrees of freedom each, on storeys that resist all three.

    The degrees of freedom are those of the floors' centres of mass, which lie above one another,
    as in :class:`~bayes_ssi.structures.rigid_floors.RigidFloors`.

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
        elements: non-structural elements on it; :meth:`with_element` adds one.
        sensors: not at degrees of freedom; :meth:`with_sensors` adds some.
        ground_motion: the direction in which an earthquake moves the ground, "x" or "y".

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
        centres = self.eccentricities or [(0.0, 0.0)] * len(self.masses)
        centres = tuple((float(x), float(y)) for x, y in centres)
        object.__setattr__(self, "eccentricities", centres)
        self._check_storeys("eccentricities")
        super().__post_init__()

    @property
    def n_floors(self) -> int:
        return len(self.masses)

    def main_springs(self) -> Sequence[Contribution]:
        springs = []
        for storey, (x, y) in enumerate(self.eccentricities, 1):
            # The centre of stiffness moves with its floor by (u_x - y θ, u_y + x θ, θ).
            for stiffnesses, motion in (
                (self.stiffnesses_x, {"x": 1.0, "torsion": -y}),
                (self.stiffnesses_y, {"y": 1.0, "torsion": x}),
                (self.torsional_stiffnesses, {"torsion": 1.0}),
            ):
                drift: list[tuple[SinglePlace, float]] = [
                    (floor_label(floor, direction), sign * component)
                    for floor, sign in ((storey - 1, -1.0), (storey, 1.0))
                    for direction, component in motion.items()
                    if floor
                ]
                springs.append(Contribution(as_product(stiffnesses[storey - 1]), tuple(drift)))
        return springs

    def main_masses(self) -> Sequence[Contribution]:
        masses = []
        each = zip(self.masses, self.radii_of_gyration, strict=True)
        for floor, (mass, radius) in enumerate(each, 1):
            inertia = as_product(mass) * as_product(radius) ** 2
            masses += rigid_masses(floor, as_product(mass), inertia)
        return masses
