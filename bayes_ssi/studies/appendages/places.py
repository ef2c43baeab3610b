"""Appendages at places: a class for each kind, which says on which candidates it can be put."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from bayes_ssi.parameters.parameters import Value
from bayes_ssi.structures.elements import Element, OutOfPlaneInfill, Pendulum
from bayes_ssi.structures.geometry import Candidate, Place, Point, place_name


@dataclass(frozen=True)
class AppendagePlace(ABC):
    """One kind of appendage at one candidate."""

    candidate: Candidate

    # Where a stored record names the kind.
    record_tag = "kind"
    word: ClassVar[str]
    title: ClassVar[str]
    marker: ClassVar[str]
    is_outside: ClassVar[bool]

    @classmethod
    @abstractmethod
    def fits(cls, candidate: Candidate) -> bool:
        """Whether this kind can be put there."""

    @property
    def name(self) -> str:
        """Name, unique among all places of a search."""
        return f"{self.word} {self.candidate.name}"

    @property
    @abstractmethod
    def description(self) -> str:
        """The appendage and its place in words."""

    @property
    def height(self) -> float | None:
        """Height in storeys above the ground; None where there are no floors."""
        return self.candidate.height

    @property
    def coordinates(self) -> Point | None:
        """(x, y, z), where they are known."""
        return self.candidate.coordinates

    @property
    def direction(self) -> Point | None:
        """(x, y, z) of its motion, where it is known."""
        return self.candidate.direction

    @property
    def label(self) -> str:
        """The element's own degree of freedom."""
        return f"appendage {self.name}"

    @abstractmethod
    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        """The appendage, given its vibrating mass and its frequency in Hz on a fixed structure."""


@dataclass(frozen=True)
class PendulumPlace(AppendagePlace):
    """A pendulum on one place: a chimney, a parapet, a tank."""

    word, title = "pendulum", "pendulum"
    marker = "o"
    is_outside = True

    @classmethod
    def fits(cls, candidate: Candidate) -> bool:
        return candidate.to is None

    @property
    def description(self) -> str:
        on = self.candidate.place
        where = f"on floor {on}" if isinstance(on, int) else f"at {self.candidate.name}"
        return f"a pendulum {where}"

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        return Pendulum(self.candidate.place, vibrating_mass, frequency, label=self.label)


@dataclass(frozen=True)
class InfillPlace(AppendagePlace):
    """An infill that moves out of its plane between two places, such as two floors."""

    word, title = "infill", "infill in a storey"
    marker = "s"
    is_outside = False

    @classmethod
    def fits(cls, candidate: Candidate) -> bool:
        return candidate.to is not None

    @property
    def description(self) -> str:
        ends = self.candidate.ends
        if all(isinstance(end, int) and end != 0 for end in ends):
            return f"an infill between floors {ends[0]} and {ends[1]}"
        return f"an infill between {' and '.join(map(_in_words, ends))}"

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        low, high = self.candidate.ends
        # Half of an infill vibrates.
        return OutOfPlaneInfill((low, high), 2.0 * vibrating_mass, frequency, label=self.label)


def _in_words(place: Place) -> str:
    if place == 0:
        return "the ground"
    return f"floor {place}" if isinstance(place, int) else place_name(place)


# Kinds of appendages of a search; add a class to search for another kind.
KINDS: tuple[type[AppendagePlace], ...] = (PendulumPlace, InfillPlace)


def places_of(candidates: Iterable[Candidate]) -> tuple[AppendagePlace, ...]:
    """Every appendage that can be put on the candidates, kind by kind."""
    candidates = tuple(candidates)
    return tuple(kind(each) for kind in KINDS for each in candidates if kind.fits(each))
