"""Non-structural elements: in parallel (P-NSE), in series (S-NSE), or as mass only.

An element is placed on floors, counted from 1; 0 is the ground. On any structure it may also be
placed on a degree of freedom or a sensor by its label, and on a combination of these, such as a
direction at a node: ``{"node 7 x": 0.6, "node 7 y": 0.8}``. It contributes springs and masses to
its host structure, and an element in series adds one degree of freedom of its own.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar

from bayes_ssi.parameters.parameters import (
    Product,
    Value,
    as_product,
    fraction_product,
    positive_product,
)
from bayes_ssi.structures.geometry import Motion, Place, checked_place, motion_of, place_name


@dataclass(frozen=True)
class Contribution:
    """``c v vᵀ`` of a spring or a mass c, for the displacement ``v·x = Σ component · x(place)``."""

    coefficient: Product
    direction: Motion

    @classmethod
    def on(cls, place: Place, coefficient: Product) -> "Contribution":
        return cls(coefficient, motion_of(place))


class Element(ABC):
    """A non-structural element on a structure.

    Its quantities are numbers, Parameters or products of them.

    Raises:
        ValueError: an element cannot be in that place, or a quantity can be zero or negative.
        TypeError: a quantity is neither a number nor a Parameter.
    """

    # Names the element in messages and reports, and its own degree of freedom if it has one.
    label: str

    @property
    def own_degree_of_freedom(self) -> str | None:
        """Label of the degree of freedom that the element adds; None if it adds none."""
        return None

    def springs(self) -> Sequence[Contribution]:
        """What the element adds to the stiffness matrix."""
        return ()

    @abstractmethod
    def masses(self) -> Sequence[Contribution]:
        """What the element adds to the mass matrix."""

    def as_mass(self) -> "Element":
        """The element without stiffness and dynamics, as in the incorrect model: mass alone."""
        return self

    def _check(self, default_label: str) -> None:
        """Set this label if the element has none, and check its quantities."""
        if not self.label:
            object.__setattr__(self, "label", default_label)
        for field in fields(self):  # type: ignore[arg-type]
            if field.type in (Value, "Value"):  # a text if annotations are delayed
                where, value = f"{self.label}: {field.name}", getattr(self, field.name)
                if field.name != "in_model":
                    positive_product(value, where)
                elif value != 1.0:
                    fraction_product(value, where)


@dataclass(frozen=True)
class AddedMass(Element):
    """Mass without dynamics, shared between places.

    Attributes:
        mass: total mass, in the structure's unit.
        shares: (place, share) pairs: a floor (from 1) or another place, and the share of the mass
            that moves with it; they add up to 1.
        label: names the element in messages and reports.
        stands_for: label of an appendage whose mass this is; a sensor on it then moves with the
            mean of the places, by their shares.

    Raises:
        ValueError, TypeError: as those of every :class:`Element`.

    >>> frame = bs.ShearBuilding(masses=(1.0,), stiffnesses=((2 * np.pi) ** 2,))
    >>> loaded = frame.with_element(bs.AddedMass(3.0, [(1, 1.0)]))
    >>> loaded.modes(np.empty((1, 0))).frequencies_hz.round(3)
    array([[0.5]])
    """

    mass: Value
    shares: tuple[tuple[Place, float], ...]
    label: str = "added mass"
    stands_for: str = ""

    def __post_init__(self) -> None:
        self._check("added mass")
        shares = [share for _, share in self.shares]
        places = [checked_place(place, f"{self.label}: a place") for place, _ in self.shares]
        if any(not share > 0 for share in shares) or not math.isclose(sum(shares), 1.0):
            raise ValueError(
                f"{self.label}: shares must be places with positive shares of the mass that add "
                f"up to 1, got {self.shares!r}"
            )
        object.__setattr__(self, "shares", tuple(zip(places, shares, strict=True)))

    def masses(self) -> Sequence[Contribution]:
        mass = as_product(self.mass)
        return [Contribution.on(place, mass * share) for place, share in self.shares]


class _InSeries(Element):
    mass: Value
    frequency: Value
    stiffness_factor: Value
    in_model: Value

    @abstractmethod
    def _standing(self) -> Sequence[tuple[Place, float]]:
        """Where the mass stands as long as it does not vibrate, and its shares there."""

    def as_mass(self) -> AddedMass:
        """Its mass where it stands; none of it is in the model already.

        Raises:
            ValueError: a share of it is.
        """
        if self.in_model != 0.0:
            raise ValueError(f"{self.label}: as mass, it is in the model already")
        return AddedMass(self.mass, tuple(self._standing()), f"{self.label}, as mass", self.label)

    def _less_in_model(self) -> list[Contribution]:
        """What leaves the places, because the model has it there already."""
        if self.in_model == 0.0:
            return []
        mass = as_product(self.mass) * self.in_model * -1.0
        return [Contribution.on(place, mass * share) for place, share in self._standing()]

    @property
    def own_degree_of_freedom(self) -> str:
        return self.label

    def _stiffness(self, moving_mass: Product) -> Product:
        """k = factor · m (2πf)²."""
        frequency, factor = as_product(self.frequency), as_product(self.stiffness_factor)
        return factor * moving_mass * frequency**2 * (2.0 * math.pi) ** 2


@dataclass(frozen=True)
class Pendulum(_InSeries):
    """A pendulous mass on one floor (S-NSE): a chimney, parapet, tank or suspended mass.

    Attributes:
        on: the floor, or another place: the label of a degree of freedom or sensor, or shares of
            several, such as the cosines of a direction at a node.
        mass: mass of the appendage, in the structure's unit.
        frequency: natural frequency of the appendage on a fixed floor, in Hz.
        stiffness_factor: multiplies the spring's stiffness ``m (2πf)²``.
        label: of the element and its own degree of freedom; made from its place if not given.
        in_model: share of its mass, from 0 to 1, that the structure has at its place already, and
            that leaves it.

    Raises:
        ValueError, TypeError: as those of every :class:`Element`.

    >>> tank = bs.Pendulum(on=1, mass=0.01, frequency=1.0, label="tank")
    >>> frame = bs.ShearBuilding(masses=(1.0,), stiffnesses=((2 * np.pi) ** 2,))
    >>> frame.with_element(tank).modes(np.empty((1, 0))).frequencies_hz.round(3)
    array([[0.951, 1.051]])
    """

    on: Place
    mass: Value
    frequency: Value
    stiffness_factor: Value = 1.0
    label: str = ""
    in_model: Value = 0.0

    def __post_init__(self) -> None:
        on = checked_place(self.on, f"{self.label or 'pendulum'}: on")
        object.__setattr__(self, "on", on)
        self._check(f"pendulum {place_name(on)}")
        if {0, self.label} & {single for single, _ in motion_of(on)}:
            raise ValueError(
                f"{self.label}: an appendage must stand on a floor or another degree of freedom, "
                f"got on={self.on!r}"
            )

    def springs(self) -> Sequence[Contribution]:
        stiffness = self._stiffness(as_product(self.mass))
        return [Contribution(stiffness, (*motion_of(self.on, -1.0), (self.label, 1.0)))]

    def masses(self) -> Sequence[Contribution]:
        return [Contribution.on(self.label, as_product(self.mass)), *self._less_in_model()]

    def _standing(self) -> Sequence[tuple[Place, float]]:
        return ((self.on, 1.0),)


@dataclass(frozen=True)
class _Infill(Element):
    between: tuple[Place, Place]
    mass: Value
    kind: ClassVar[str] = "infill"

    def __post_init__(self) -> None:
        given = self.between
        where = (
            f"{self.label or self.kind}: between must be two different floors such as (1, 2), 0 "
            "being the ground, or other places"
        )
        two = isinstance(given, (tuple, list)) and len(given) == 2
        try:
            ends = tuple(checked_place(place, "one of them") for place in given) if two else ()
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
        if len(set(ends)) != 2 or any(isinstance(end, int) and end < 0 for end in ends):
            raise ValueError(f"{where}, got {given!r}")
        object.__setattr__(self, "between", ends)
        self._check(f"{self.kind} {place_name(ends[0])}-{place_name(ends[1])}")

    def _standing(self) -> Sequence[tuple[Place, float]]:
        """Half of the mass on each of the two floors."""
        return tuple((end, 0.5) for end in self.between)


@dataclass(frozen=True)
class InPlaneInfill(_Infill):
    """An infill in parallel with the structure (P-NSE): a spring between two floors or places.

    Half of its mass goes to each of the two floors.

    Attributes:
        between: the two floors, 0 being the ground, or other places, as those of a pendulum.
        mass: total mass, in the structure's unit.
        stiffness: stiffness of the spring, in the structure's unit.
        label: names the element in messages and reports; made from its place if not given.

    >>> frame = bs.ShearBuilding(masses=(3.0,), stiffnesses=((2 * np.pi) ** 2,))
    >>> stiff = bs.InPlaneInfill(between=(0, 1), mass=2.0, stiffness=3 * (2 * np.pi) ** 2)
    >>> frame.with_element(stiff).modes(np.empty((1, 0))).frequencies_hz.round(3)
    array([[1.]])
    """

    stiffness: Value
    label: str = ""
    kind: ClassVar[str] = "in-plane infill"

    def springs(self) -> Sequence[Contribution]:
        low, high = self.between
        return [Contribution(as_product(self.stiffness), (*motion_of(low, -1.0), *motion_of(high)))]

    def masses(self) -> Sequence[Contribution]:
        return self.as_mass().masses()

    def as_mass(self) -> AddedMass:
        return AddedMass(self.mass, tuple(self._standing()), f"{self.label}, as mass")


@dataclass(frozen=True)
class OutOfPlaneInfill(_Infill, _InSeries):
    """An infill that vibrates out of its plane between two floors (S-NSE).

    Half of its mass moves on a spring to the mean of the two floors, a quarter with each floor.

    Attributes:
        between: the two floors, 0 being the ground, or other places, as those of a pendulum.
        mass: total mass of the infill, in the structure's unit.
        frequency: its natural frequency between fixed floors, in Hz.
        stiffness_factor: multiplies the spring's stiffness ``(m/2) (2πf)²``.
        label: of the element and its own degree of freedom; made from its place if not given.
        in_model: as that of a :class:`Pendulum`.

    >>> infill = bs.OutOfPlaneInfill(between=(1, 2), mass=0.15, frequency=2.8)
    >>> frame = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(200.0, 200.0))
    >>> frame.with_element(infill).degrees_of_freedom
    ('floor 1', 'floor 2', 'infill 1-2')
    """

    frequency: Value
    stiffness_factor: Value = 1.0
    label: str = ""
    in_model: Value = 0.0

    def springs(self) -> Sequence[Contribution]:
        low, high = self.between
        stiffness = self._stiffness(as_product(self.mass) * 0.5)
        direction = (*motion_of(low, -0.5), *motion_of(high, -0.5), (self.label, 1.0))
        return [Contribution(stiffness, direction)]

    def masses(self) -> Sequence[Contribution]:
        mass = as_product(self.mass)
        return [
            *(Contribution.on(end, mass * 0.25) for end in self.between),
            Contribution.on(self.label, mass * 0.5),
            *self._less_in_model(),
        ]
