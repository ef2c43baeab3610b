"""Structures in space with rigid floors: each moves in x and y and turns about the vertical."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.parameters.parameters import Product, Value, as_product, positive_product
from bayes_ssi.structures.elements import Contribution, Element
from bayes_ssi.structures.geometry import Candidate, Sensor, SinglePlace
from bayes_ssi.structures.lumped import LumpedStructure

DIRECTIONS = ("x", "y", "torsion")


# A floor from 1, or three labels of a rigid part of any structure: of what moves in x, in y, and
# turns about the vertical.
RigidPart = int | tuple[str, str, str]


def floor_label(floor: RigidPart, direction: str) -> str:
    """The degree of freedom of a floor or rigid part in one of its three directions."""
    if isinstance(floor, int):
        return f"floor {floor} {direction}"
    return floor[DIRECTIONS.index(direction)]


@dataclass(frozen=True)
class RigidFloors(LumpedStructure):
    """Floors with three degrees of freedom each: ``"floor 1 x"``, ``"floor 1 y"``, ``"floor 1
    torsion"`` and so on upwards, the last in radians.

    Elements stand on a degree of freedom, by its label; masses and sensors may be anywhere on a
    floor (:class:`FloorBlock`, :func:`floor_sensor`).

    Raises:
        ValueError: the direction is neither "x" nor "y".
    """

    # The direction in which an earthquake moves the ground, "x" or "y".
    ground_motion: str = field(default="x", kw_only=True)

    def __post_init__(self) -> None:
        if self.ground_motion not in DIRECTIONS[:2]:
            raise ValueError(
                f"{type(self).__name__}: ground_motion must be 'x' or 'y', got "
                f"{self.ground_motion!r}"
            )
        super().__post_init__()

    def main_degrees_of_freedom(self) -> Sequence[str]:
        floors = range(1, self.n_floors + 1)
        return [floor_label(floor, direction) for floor in floors for direction in DIRECTIONS]

    def main_influence(self) -> Sequence[float]:
        return [float(d == self.ground_motion) for d in DIRECTIONS] * self.n_floors

    def candidates(self, sensors: Sequence[str]) -> tuple[Candidate, ...]:  # noqa: ARG002
        axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
        on_floors, in_storeys = [], []
        for floor, (direction, axis) in product(range(1, self.n_floors + 1), axes.items()):
            label, storey = floor_label(floor, direction), f"{floor - 1}-{floor} {direction}"
            below = floor_label(floor - 1, direction) if floor > 1 else 0
            on_floors.append(Candidate(label, label, direction=axis))
            in_storeys.append(Candidate(storey, below, to=label, direction=axis))
        return (*on_floors, *in_storeys)

    def _index(self, place: SinglePlace, label: str) -> int:
        require_known(
            f"{label}: the structure has no degree of freedom",
            [place],
            self.degrees_of_freedom,
            besides=" (a floor moves in three directions here)",
        )
        return super()._index(place, label)


@dataclass(frozen=True)
class ShearBuilding3D(RigidFloors):
    """Rigid floors with three degrees of freedom each, on storeys that resist all three.

    The degrees of freedom are those of the floors' centres of mass, which lie above one another.

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

    def size_of_drawing(self) -> tuple[float, float, Sequence[float]]:
        """Of square floors with the largest radius of gyration, which need not be square."""
        half = math.sqrt(1.5) * max(as_product(radius).median for radius in self.radii_of_gyration)
        return half, half, [1.5 * half * floor for floor in range(1, self.n_floors + 1)]

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


@dataclass(frozen=True)
class FloorBlock(Element):
    """A mass somewhere on a floor of a structure in space, or off a node of another one.

    Off the floor's centre it couples its motions: the static moment and the polar inertia count.

    Attributes:
        on: the floor, from 1; on other structures, labels of the degrees of freedom (or sensors)
            in x, y and torsion (in radians) of the node or rigid part that carries it.
        mass: the mass, in the structure's unit.
        at: (x, y) of its centre from the floor's or the node, in the structure's unit of length.
        radius: radius of gyration about its own centre; a point mass if None.
        label: names the element in messages and reports; made from its place if not given.

    Raises:
        ValueError, TypeError: as those of every :class:`Element`.
    """

    on: RigidPart
    mass: Value
    at: tuple[float, float] = (0.0, 0.0)
    radius: Value | None = None
    label: str = ""

    def __post_init__(self) -> None:
        on = _rigid_part(self.on, f"{self.label or 'block'}: on")
        object.__setattr__(self, "on", on)
        self._check(f"block on {f'floor {on}' if isinstance(on, int) else on[0]}")
        if self.radius is not None:
            positive_product(self.radius, f"{self.label}: radius")
        object.__setattr__(self, "at", _point(self.at, f"{self.label}: at"))

    def masses(self) -> Sequence[Contribution]:
        mass = as_product(self.mass)
        motions = (_motion_at(self.on, self.at, angle) for angle in (0.0, 90.0))
        moving = [Contribution(mass, tuple(motion.items())) for motion in motions]
        if self.radius is None:
            return moving
        inertia = mass * as_product(self.radius) ** 2
        return [*moving, Contribution.on(floor_label(self.on, "torsion"), inertia)]


@checked
def floor_sensor(
    label: str, floor: RigidPart, at: tuple[float, float], direction: str | float
) -> Sensor:
    """A sensor at a point of a floor of a structure in space, or off a node of another one.

    Args:
        label: its name in the data.
        floor: number of the floor, from 1; on other structures, labels of the degrees of freedom
            in x, y and torsion of the rigid part that carries it.
        at: (x, y) from the floor's centre or from the node, in the structure's unit of length.
        direction: direction of measurement: "x", "y", or degrees from x towards y.

    Raises:
        ValueError: the floor, the point or the direction is not valid.
    """
    floor = _rigid_part(floor, f"sensor {label!r}: floor")
    angles = {"x": 0.0, "y": 90.0}
    angle = angles.get(direction) if isinstance(direction, str) else float(direction)
    if angle is None or not math.isfinite(angle):
        raise ValueError(
            f"sensor {label!r}: direction must be 'x', 'y' or degrees from x, got {direction!r}"
        )
    return Sensor(label, _motion_at(floor, _point(at, f"sensor {label!r}: at"), angle))


def rigid_masses(floor: int, mass: Product, rotational_inertia: Product) -> list[Contribution]:
    """The inertia of a mass that moves with a floor about its centre."""
    inertias = zip((mass, mass, rotational_inertia), DIRECTIONS, strict=True)
    return [Contribution.on(floor_label(floor, direction), each) for each, direction in inertias]


def _motion_at(floor: RigidPart, at: tuple[float, float], angle: float) -> dict[str, float]:
    """Motion of a point of a floor along an axis, at an angle in degrees from x.

    The point itself moves by (u - y θ, v + x θ); zero terms are left out.
    """
    # Exact along the axes, where a cosine would leave a rounding error.
    along = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0)}
    turned = math.radians(angle)
    cosine, sine = along.get(angle, (math.cos(turned), math.sin(turned)))
    x, y = at
    parts = zip(DIRECTIONS, (cosine, sine, x * sine - y * cosine), strict=True)
    return {floor_label(floor, direction): part for direction, part in parts if part != 0.0}


def _rigid_part(on: Any, where: str) -> RigidPart:
    if isinstance(on, int) and not isinstance(on, bool) and on >= 1:
        return on
    labels = tuple(on) if isinstance(on, (tuple, list)) else ()
    if len(labels) != 3 or not all(isinstance(each, str) and each.strip() for each in labels):
        raise ValueError(
            f"{where} must be a floor from 1 upwards, or three labels of degrees of freedom, in "
            f"x, y and torsion, got {on!r}"
        )
    return labels


def _point(at: Sequence[float], where: str) -> tuple[float, float]:
    try:
        x, y = (float(coordinate) for coordinate in at)
    except (TypeError, ValueError):
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"{where} must be two coordinates, (x, y), got {at!r}")
    return x, y
