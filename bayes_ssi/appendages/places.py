"""Places of a building where an appendage may hang: a class for each kind of appendage."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

from bayes_ssi.parameters import Value
from bayes_ssi.structures.elements import Element, OutOfPlaneInfill, Pendulum


class AppendagePlace(ABC):
    """One kind of appendage at one place; floors count from 1, and 0 is the ground.

    Attributes:
        title: name of the kind, for the legend of a drawing.
        marker: matplotlib's name of the marker that draws it.
        is_outside: whether it is drawn next to the building, joined to its floor.
    """

    # Where a stored record names the kind.
    record_tag = "kind"
    title: ClassVar[str]
    marker: ClassVar[str]
    is_outside: ClassVar[bool]

    @classmethod
    @abstractmethod
    def all_of(cls, n_floors: int) -> tuple[Self, ...]:
        """Every such place in a building of ``n_floors`` floors."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Name, unique among all places of a building."""

    @property
    def description(self) -> str:
        """The appendage and its place in words; its name, unless a kind says more."""
        return self.name

    @property
    @abstractmethod
    def height(self) -> float:
        """Height in storeys above the ground."""

    @abstractmethod
    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        """The appendage, given its vibrating mass and its frequency in Hz on fixed floors."""


@dataclass(frozen=True)
class PendulumPlace(AppendagePlace):
    """A pendulum on the floor ``on``: a chimney, a parapet, a tank."""

    on: int

    title = "pendulum on a floor"
    marker = "o"
    is_outside = True

    @classmethod
    def all_of(cls, n_floors: int) -> tuple[Self, ...]:
        return tuple(cls(floor) for floor in range(1, n_floors + 1))

    @property
    def name(self) -> str:
        return f"pendulum {self.on}"

    @property
    def description(self) -> str:
        return f"a pendulum on floor {self.on}"

    @property
    def height(self) -> float:
        return float(self.on)

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        return Pendulum(self.on, vibrating_mass, frequency, label=f"appendage {self.name}")


@dataclass(frozen=True)
class InfillPlace(AppendagePlace):
    """An infill that moves out of its plane in the storey ``between`` two floors."""

    between: tuple[int, int]

    title = "infill in a storey"
    marker = "s"
    is_outside = False

    @classmethod
    def all_of(cls, n_floors: int) -> tuple[Self, ...]:
        return tuple(cls((floor - 1, floor)) for floor in range(1, n_floors + 1))

    @property
    def name(self) -> str:
        return f"infill {self.between[0]}-{self.between[1]}"

    @property
    def description(self) -> str:
        below, above = self.between
        if below == 0:
            return f"an infill between the ground and floor {above}"
        return f"an infill between floors {below} and {above}"

    @property
    def height(self) -> float:
        return 0.5 * sum(self.between)

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        # Half of an infill vibrates.
        label = f"appendage {self.name}"
        return OutOfPlaneInfill(self.between, 2.0 * vibrating_mass, frequency, label=label)


# Kinds of appendages that a search hangs on a building; add a class to search for another kind.
KINDS: tuple[type[AppendagePlace], ...] = (PendulumPlace, InfillPlace)
