"""Candidates of a search: where they are, which ones sensors see, and what can hang on them."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import checked, repeated
from bayes_ssi.foundations.text_files import read_table
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.parameters.priors import LogUniform, Prior
from bayes_ssi.structures.elements import Element, OutOfPlaneInfill, Pendulum
from bayes_ssi.structures.geometry import Candidate, Place, Point, motion_of, place_name
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.search.family import FeaturePlace, SearchLimits


@dataclass(frozen=True)
class SearchSettings(SearchLimits):
    """What an appendage may be, and how many there may be.

    What modes determine is not a mass but its effective mass, the mass times the square of the
    motion of its place in the mode beside which it vibrates. The default prior is uniform in the
    logarithm of both, so that within its range it prefers no place to any other.

    Attributes:
        mass_ratio: prior of the vibrating mass over the mean floor mass, or the median modal
            mass where there are no floors
            (:func:`~bayes_ssi.studies.appendages.baselines.scale_of`).
        mass: instead of ``mass_ratio``, the lightest and the heaviest vibrating mass, in the
            structure's unit; log-uniform between them.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights, branches, most_unsampled, most_sampled: how many appendages, and how far the
            search goes, as in :class:`~bayes_ssi.studies.search.family.SearchLimits`.

    Raises:
        ValueError: as :class:`~bayes_ssi.studies.search.family.SearchLimits`, or a mass is not
            usable.
        TypeError: a prior is not a prior distribution.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogUniform(0.001, 0.5))
    mass: tuple[float, float] | None = None
    frequency: Prior | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None:
            lightest, heaviest = self.mass
            LogUniform(lightest, heaviest)  # which refuses what is no range
            object.__setattr__(self, "mass", (lightest, heaviest))
        self._require_priors("mass_ratio", "frequency", optional=("frequency",))

    def prior_of_mass_ratio(self, scale: float, available: float | None = None) -> Prior:
        """The prior of the vibrating mass over ``scale``, a mass in the structure's unit.

        A log-uniform one ends at the mass that is ``available`` at the place, if not before.
        """
        ends = self.mass and (self.mass[0] / scale, self.mass[1] / scale)
        prior = LogUniform(*ends) if ends else self.mass_ratio
        if available and isinstance(prior, LogUniform) and prior.lower * scale < available:
            return LogUniform(prior.lower, min(prior.upper, available / scale))
        return prior


# What a search takes for seen.
# A mode moves the sensors by this share, or more, of the one that does most, at unit modal mass.
VISIBLE_SHARE = 0.05
# A place moves in a mode by this share of what the sensors do; less, and an appendage of a
# tenth of the modal mass moves its frequencies apart by less than 0.3 %.
LEAST_PART = 0.01
MOST_LEAVING = 0.999  # share of a place's mass that may leave it; what is left is not zero


def are_observed(
    structure: Structure, candidates: Sequence[Candidate], data: ModalData
) -> NDArray[np.bool_]:
    """Whether candidates (n,) take part in a mode of the band that the sensors see.

    At the prior medians; of two ends of a candidate one is enough.
    """
    values = structure.prior_medians()
    modes = structure.modes(values)
    at_sensors = structure.sensor_matrix(data.sensors).apply(modes.shapes)[0]
    seen = np.abs(at_sensors).max(axis=0, initial=0.0)
    counts = (modes.frequencies_hz[0] <= data.band_hz[1]) & (seen >= VISIBLE_SHARE * seen.max())
    ends = [end for candidate in candidates for end in candidate.ends]
    moved = structure.place_shapes(ends, values)
    if moved is None or not counts.any():
        return np.ones(len(candidates), dtype=bool)
    takes_part = (np.abs(moved)[:, : len(seen)] >= LEAST_PART * seen)[:, counts].any(axis=1)
    of_candidate = np.repeat(np.arange(len(candidates)), [len(each.ends) for each in candidates])
    return np.bincount(of_candidate, takes_part, minlength=len(candidates)) > 0


def located(candidate: Candidate, structure: Structure) -> Candidate:
    """The candidate with coordinates and direction as the structure knows them, where not given."""
    places = [structure.location_of(end) for end in candidate.ends if end != 0]
    if candidate.coordinates is not None or not all(places):
        return candidate
    positions = [place.position for place in places if place is not None]
    x, y, z = (sum(values) / len(positions) for values in zip(*positions, strict=True))
    direction = places[0].direction if places[0] is not None else None
    return replace(candidate, coordinates=(x, y, z), direction=candidate.direction or direction)


def require_distinct(candidates: Sequence[Candidate]) -> None:
    """Refuse an empty list, and one that holds a name or a place twice."""
    if not candidates:
        raise ValueError("candidates: the list is empty; give one or more, or none for the default")
    if twice := repeated(each.name for each in candidates):
        raise ValueError(f"candidates: two are named {twice[0]!r}")
    by_place: dict[frozenset[Any], str] = {}
    for each in candidates:
        ends = frozenset(frozenset(motion_of(end)) for end in each.ends)
        if (other := by_place.setdefault(ends, each.name)) != each.name:
            raise ValueError(f"candidates: {other!r} and {each.name!r} are one place")


def require_on_structure(candidates: Sequence[Candidate], structure: Structure) -> None:
    """Refuse candidates whose places are not on a structure."""
    for candidate in candidates:
        for end in candidate.ends:
            structure.require_place(end, f"candidate {candidate.name!r}")


REQUIRED = ("name", "place")
DIRECTION = ("x", "y", "z")
COORDINATES = ("x_coord", "y_coord", "z_coord")
COLUMNS = (*REQUIRED, *DIRECTION, *COORDINATES, "to")


@checked
def read_candidates(path: str | Path) -> tuple[Candidate, ...]:
    """Candidates of a search from a CSV file.

    ::

        name,        place,     x,   y,   z, x_coord, y_coord, z_coord
        roof edge,   node 7,  0.6, 0.8,    ,    12.0,     0.0,     9.5
        mast,        node 9 x,    ,    ,    ,    15.0,     0.0,    11.0

    ``place`` is the label of a degree of freedom or of a sensor. Where a row gives a direction by
    its cosines ``x``, ``y``, ``z`` (scaled to unit length; an empty one is zero), ``place`` is a
    node with degrees of freedom that are labelled by it and the axis: ``node 7 x``, ``node 7 y``,
    ``node 7 z``. Coordinates are optional, and so is ``to``, the label of the other end of an
    element between two places (``0`` for the ground).

    Args:
        path: the file; rows that begin with ``#`` are comments, and columns are separated by commas
            or as a first line such as ``sep=;`` says.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is empty, a column is missing or unknown, a cell is not valid, or a name or
            place is there twice; the message names the file and the line.
    """
    path = Path(path)
    names, rows = read_table(path)
    if not rows:
        raise ValueError(f"{path}: no candidate below the column names {','.join(REQUIRED)}")
    all_wrong = {
        "no column": [name for name in REQUIRED if name not in names],
        "unknown column": [name for name in names if name not in COLUMNS],
        "two columns": repeated(names),
    }
    for what, wrong in all_wrong.items():
        if wrong:
            raise ValueError(
                f"{path}: {what} {wrong[0]!r}; the columns are {', '.join(REQUIRED)} and, if "
                f"needed, {', '.join(COLUMNS[len(REQUIRED) :])}"
            )
    candidates = []
    for where, row in rows:
        if len(row) > len(names):
            raise ValueError(f"{where}: {len(row)} cells for {len(names)} columns")
        try:
            candidates.append(_candidate(dict(zip(names, row, strict=False))))
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from None
    try:
        require_distinct(candidates)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    return tuple(candidates)


def _candidate(cells: Mapping[str, str]) -> Candidate:
    place: Place = cells.get("place", "")
    direction, coordinates = _numbers(cells, DIRECTION), _numbers(cells, COORDINATES)
    if direction is not None:
        length = math.hypot(*direction)
        if length == 0.0:
            raise ValueError("x, y, z: a direction of zeros")
        x, y, z = (cosine / length for cosine in direction)
        direction = (x, y, z)
        axes = zip(DIRECTION, direction, strict=True)
        place = tuple((f"{place} {axis}", cosine) for axis, cosine in axes if cosine != 0.0)
    if coordinates is not None and any(not cells.get(name) for name in COORDINATES):
        raise ValueError("x_coord, y_coord, z_coord: give all three, or none")
    to: Place | None = 0 if cells.get("to") == "0" else cells.get("to") or None
    name = cells.get("name", "")
    return Candidate(name, place, to=to, coordinates=coordinates, direction=direction)


def _numbers(cells: Mapping[str, str], names: tuple[str, str, str]) -> Point | None:
    """Three numbers, zero where a cell is empty; None where all are."""
    if not any(cells.get(name) for name in names):
        return None
    numbers = []
    for name in names:
        cell = cells.get(name) or "0"
        try:
            number = float(cell)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise ValueError(f"{name}: {cell!r} is not a number")
        numbers.append(number)
    x, y, z = numbers
    return x, y, z


@dataclass(frozen=True)
class AppendagePlace(FeaturePlace, ABC):
    """One kind of appendage at one candidate."""

    candidate: Candidate
    # Share of its mass that the model has there already: all of an element given as mass, none
    # where there is less than an appendage may have, else inferred (None).
    in_model: float | None = field(default=0.0, compare=False)
    given_as: str = field(default="", compare=False)  # label of that element
    available: float | None = field(default=None, compare=False)  # mass that can leave its place

    word: ClassVar[str]

    @classmethod
    @abstractmethod
    def fits(cls, candidate: Candidate) -> bool:
        """Whether this kind can be put there."""

    @property
    def name(self) -> str:
        return f"{self.word} {self.candidate.name}"

    @property
    def coordinates(self) -> Point | None:
        return self.candidate.coordinates

    @property
    def direction(self) -> Point | None:
        return self.candidate.direction

    @property
    def _as_given(self) -> str:
        return f", which is given as mass ({self.given_as!r})" if self.given_as else ""

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

    @classmethod
    def fits(cls, candidate: Candidate) -> bool:
        return candidate.to is None

    @property
    def description(self) -> str:
        on = self.candidate.place
        where = f"on floor {on}" if isinstance(on, int) else f"at {self.candidate.name}"
        return f"a pendulum {where}{self._as_given}"

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        return Pendulum(self.candidate.place, vibrating_mass, frequency, label=self.label)


@dataclass(frozen=True)
class InfillPlace(AppendagePlace):
    """An infill that moves out of its plane between two places, such as two floors."""

    word, title = "infill", "infill in a storey"

    @classmethod
    def fits(cls, candidate: Candidate) -> bool:
        return candidate.to is not None

    @property
    def description(self) -> str:
        ends = self.candidate.ends
        if all(isinstance(end, int) and end != 0 for end in ends):
            return f"an infill between floors {ends[0]} and {ends[1]}{self._as_given}"
        return f"an infill between {' and '.join(map(_in_words, ends))}{self._as_given}"

    def element(self, vibrating_mass: Value, frequency: Value) -> Element:
        low, high = self.candidate.ends
        # Half of an infill vibrates.
        return OutOfPlaneInfill((low, high), 2.0 * vibrating_mass, frequency, label=self.label)


@dataclass(frozen=True)
class FurtherMotion(FeaturePlace):
    """A motion that the model does not have, and which competes with appendages.

    The structure twists, moves in the other direction or on its soil, or a neighbour moves it: one
    more mode, which changes no other.
    """

    mode: int  # of the structure, from 1, whose shape the motion has at the sensors
    title = "motion that the model does not have"
    is_common = True

    @property
    def name(self) -> str:
        return f"motion like mode {self.mode}"

    @property
    def description(self) -> str:
        return f"a motion that the model does not have, like mode {self.mode} at the sensors"


def _in_words(place: Place) -> str:
    if place == 0:
        return "the ground"
    return f"floor {place}" if isinstance(place, int) else place_name(place)


def appendages_among(features: Iterable[Any]) -> list[AppendagePlace]:
    return [each for each in features if isinstance(each, AppendagePlace)]


# Kinds of appendages of a search; add a class to search for another kind.
KINDS: tuple[type[AppendagePlace], ...] = (PendulumPlace, InfillPlace)


def places_of(candidates: Iterable[Candidate]) -> tuple[AppendagePlace, ...]:
    """Every appendage that can be put on the candidates, kind by kind."""
    candidates = tuple(candidates)
    return tuple(kind(each) for kind in KINDS for each in candidates if kind.fits(each))


def with_given_masses(
    candidates: Sequence[Candidate], structure: Structure
) -> tuple[Candidate, ...]:
    """The candidates, and the elements given as mass that stand where none of them is."""
    shares = [[place for place, _ in each.shares] for each in structure.given_as_mass]
    given = {frozenset(ends): ends for ends in shares if len(ends) <= 2}
    for each in candidates:
        given.pop(frozenset(each.ends), None)
    added = (
        Candidate("-".join(map(place_name, (on, *to))), on, to=next(iter(to), None))
        for on, *to in given.values()
    )
    return (*candidates, *added)


def with_masses_in_model(
    places: Sequence[AppendagePlace], structure: Structure, heaviest: float
) -> tuple[AppendagePlace, ...]:
    """Which of them may be in the structure's mass already, for ``heaviest`` that may vibrate."""
    given = {frozenset(p for p, _ in each.shares): each for each in structure.given_as_mass}
    ends = [[end for end in place.candidate.ends if end != 0] for place in places]
    masses = iter(structure.place_masses([end for own in ends for end in own]).tolist())
    known = []
    for place, own in zip(places, ends, strict=True):
        least = MOST_LEAVING * len(place.candidate.ends) * min(next(masses) for _ in own)
        element = given.get(frozenset(place.candidate.ends))
        if element is not None or least >= heaviest:
            label, share = (element.stands_for, 1.0) if element else ("", None)
            place = replace(place, in_model=share, given_as=label, available=least or None)
        known.append(place)
    return tuple(known)
