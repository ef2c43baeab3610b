"""What may have changed between two tests: a stiffness, a mass, an appendage, or something else."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

from bayes_ssi.foundations.argument_types import repeated, require_known
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.parameters.priors import LogUniform, Prior, TruncatedNormal, Uniform
from bayes_ssi.structures.elements import AddedMass, Element, Pendulum
from bayes_ssi.structures.geometry import SinglePlace
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.search.family import FeaturePlace

# Shares of the mean floor mass, or of the median modal mass: a mass that came or went, and what
# vibrates of an appendage.
MASS_SHARE, APPENDAGE_SHARE = Uniform(0.0, 0.5), LogUniform(0.001, 0.5)
FALL = TruncatedNormal(0.0, 0.1, -0.9, 0.9)  # share by which something else changes a frequency
COMMON_PLACE = "all in common"  # which no study uses as the name of a place


class KindOfChange(FeaturePlace, ABC):
    """One kind of change at one place."""

    kind: ClassVar[str]  # in sentences
    title = "change"

    @property
    @abstractmethod
    def amount_names(self) -> tuple[str, ...]:
        """Names of the parameters that say how much there is of it."""


@dataclass(frozen=True)
class ChangePlace(KindOfChange):
    """Parameters of a class of which a change at one place takes a share."""

    name: str  # unique among the places
    parameters: tuple[str, ...]
    is_joined: bool = True  # whether all of them lose one share; else each loses one of its own
    is_common: bool = False  # whether this is a common factor of all places, which is no change

    kind = "a loss of stiffness"

    @property
    def description(self) -> str:
        return "a loss in common" if self.is_common else f"a loss in {self.name}"

    @property
    def amount_names(self) -> tuple[str, ...]:
        return tuple(self.losses)

    @property
    def losses(self) -> dict[str, tuple[str, ...]]:
        """Name of every loss → the parameters of which it takes a share."""
        if self.is_common:
            return {"common loss": self.parameters}
        if self.is_joined:
            return {f"loss, {self.name}": self.parameters}
        return {f"loss, {name}": (name,) for name in self.parameters}


@dataclass(frozen=True)
class ElementPlace(KindOfChange):
    """What stood at one place in the tests of one side alone: those after, or those before."""

    name: str
    ends: tuple[SinglePlace, ...]  # degrees of freedom or floors with which it moves
    has_gone: bool = False  # whether it stood there before

    @property
    def amount_names(self) -> tuple[str, ...]:
        return (f"mass, {self.name}",)

    @property
    def description(self) -> str:
        return f"{'an' if self.name[0] == 'a' else 'a'} {self.name}"

    @abstractmethod
    def elements(self, scale: float, frequency: Prior) -> Iterator[Element]:
        """Its mass in shares of ``scale``, and its frequency in Hz if it vibrates."""


class MassPlace(ElementPlace):
    """A mass that moves with its place, in all directions in which that can move."""

    kind = "a mass"

    def elements(self, scale: float, frequency: Prior) -> Iterator[Element]:  # noqa: ARG002
        mass = scale * Parameter(self.amount_names[0], MASS_SHARE)
        return (AddedMass(mass, ((end, 1.0),), f"{self.name}, {end}") for end in self.ends)


@dataclass(frozen=True)
class AppearedAppendage(ElementPlace):
    """A pendulum; tests with it have one mode more, which the analyst left unpaired."""

    mode: str = ""  # label of that mode; empty where pairings are inferred

    kind = "an appendage"

    def elements(self, scale: float, frequency: Prior) -> Iterator[Element]:
        mass = scale * Parameter(self.amount_names[0], APPENDAGE_SHARE)
        hz = Parameter(f"frequency, {self.name}", frequency, unit="Hz")
        yield Pendulum(self.ends[0], mass, hz, label=self.name)

    def pairing_in(
        self, test: Configuration, pairing: Mapping[str, int], side: Iterable[Configuration]
    ) -> dict[str, int]:
        """The ``pairing`` of a test where the appendage has one mode more, by its frequency.

        ``side`` are all tests with the appendage, in some of which its mode may be missed.
        """
        data = next(each.data for each in side if self.mode in each.data.labels)
        hz = data.mode(self.mode).frequency_hz
        is_below = {label: test.data.mode(label).frequency_hz < hz for label in pairing}
        below = [number for label, number in pairing.items() if is_below[label]]
        above = [number for label, number in pairing.items() if not is_below[label]]
        of_model = test.structure.modes(test.structure.prior_medians()).frequencies_hz[0]
        # Between its neighbours, of which some modes may have been missed, as the model has them.
        own = min(1 + int((of_model < hz).sum()), *above, len(of_model) + 1)
        own = max(own, 1 + max(below, default=0))
        moved = {label: number + (number >= own) for label, number in pairing.items()}
        return moved | ({self.mode: own} if self.mode in test.data.labels else {})


@dataclass(frozen=True)
class SomethingElse(KindOfChange):
    """Every frequency changed by a share of its own, which no loss, mass or appendage explains."""

    modes: tuple[str, ...]  # labels of the modes that both sides have

    name, kind = "something else", "something else"

    @property
    def amount_names(self) -> tuple[str, ...]:
        return tuple(f"fall, mode {label}" for label in self.modes)

    @property
    def falls(self) -> dict[str, Parameter]:
        """Label of a mode → the share by which its frequency fell."""
        names = zip(self.modes, self.amount_names, strict=True)
        return {label: Parameter(name, FALL) for label, name in names}


def places_of(
    parameters: Sequence[str],
    joined: Mapping[str, Sequence[str]],
    places: Mapping[str, Sequence[str]],
    left_out: Sequence[str],
    where: str,
) -> tuple[ChangePlace, ...]:
    """Those that are given, then every other parameter alone; ``where`` begins messages."""
    groups = [(name, tuple(names), True) for name, names in joined.items()]
    groups += [(name, tuple(names), False) for name, names in places.items()]
    named = [*left_out, *(one for _, names, _ in groups for one in names)]
    require_known(f"{where}: no parameter", named, parameters)
    groups += [(name, (name,), True) for name in parameters if name not in named]
    groups = [group for group in groups if group[1]]
    for all_of, what in ((named, "parameter"), ([name for name, *_ in groups], "place")):
        if twice := repeated(all_of):
            raise ValueError(f"{where}: {what} {twice[0]!r} is named twice")
    if not groups:
        raise ValueError(f"{where}: every parameter is left out; leave one in")
    return tuple(ChangePlace(name, names, is_joined) for name, names, is_joined in groups)


def element_places(
    structure: Structure, sensors: Sequence[str], modes: Mapping[bool, Sequence[str]]
) -> Iterator[ElementPlace]:
    """Masses that came or went, and appendages that came or went where that shows a mode.

    Args:
        modes: whether it stood there before → labels of modes that are unpaired on that side and
            unknown on the other, or an empty one where pairings are inferred.
    """
    if not structure.carries_elements:
        return
    places = (each.place for each in structure.candidates(sensors) if each.to is None)
    single = [place for place in places if isinstance(place, int | str)]
    moving = dict(_moving_together(structure, place) for place in single)
    for has_gone in (False, True):
        gone, on = ("gone ", "from") if has_gone else ("", "on")
        for name, ends in moving.items():
            yield MassPlace(f"mass {gone}{on} {name}", ends, has_gone)
        for label in modes[has_gone]:
            mode = f", mode {label}" if label else ""
            for place in single:
                name = f"appendage {gone}{on} {_name(place)}{mode}"
                yield AppearedAppendage(name, (place,), has_gone, label)


def _moving_together(
    structure: Structure, place: SinglePlace
) -> tuple[str, tuple[SinglePlace, ...]]:
    """A place's name without its direction, and all directions in which its node moves."""
    node, _, axis = place.rpartition(" ") if isinstance(place, str) else ("", "", "")
    if axis not in ("x", "y", "z"):
        return _name(place), (place,)
    directions = []
    for each in (f"{node} {axis}" for axis in "xyz"):
        with suppress(ValueError):
            structure.require_place(each, "mass")
            directions.append(each)
    return node, tuple(directions)


def _name(place: SinglePlace) -> str:
    return f"floor {place}" if isinstance(place, int) else place
