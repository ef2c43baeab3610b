"""What a reader of one format of solver files gets, and what it returns."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bayes_ssi.foundations.choices import listed_choices
from bayes_ssi.structures.geometry import Geometry

# K, KAA, kxx, stiffness, STIF1 and M, MAA, mxx, mass, MASS1: a pair has the same rest.
_STIFFNESS = re.compile(r"(?:stiffness|stif|k)(.*)", re.IGNORECASE)
_MASS = re.compile(r"(?:mass|m)(.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Matrices:
    """What a reader returns."""

    stiffness: Any
    mass: Any
    stiffness_from: str  # what messages call the stiffness, and ``mass_from`` the mass
    mass_from: str
    # "node direction" of every row, or None where the files do not state them.
    labels: Sequence[str] | None = None
    geometry: Geometry | None = None
    # "node direction" without a row of its own → row → factor, where the program's constraints tie
    # it to rows (counted from 0).
    dependent: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    removed: Any = ()  # rows that are restrained
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Source:
    """The files of a model, as the caller named them."""

    path: Path
    mass: Path | None = None
    keys: tuple[str, str] | None = None

    def with_ending(self, ending: str) -> Path | None:
        """The file of the same name with another ending, in any case; None if there is none."""
        return file_named(self.path, self.path.stem + ending)

    def needed(self, ending: str, what: str) -> Path:
        """The file of the same name with another ending."""
        file = self.with_ending(ending)
        if file is None:
            raise ValueError(
                f"{self.path}: {self.path.stem}{ending} ({what}) must stand in the same folder"
            )
        return file

    def needed_mass(self) -> Path:
        """The file of the mass, where it cannot be known from the name of the stiffness."""
        if self.mass is None:
            raise ValueError(
                f"{self.path}: name the file of the mass matrix as well: {self.path.name}+MASS in "
                "commands, mass= in Python"
            )
        return self.mass

    def refuse_keys(self) -> None:
        """For files whose matrices have no names."""
        if self.keys is not None:
            raise ValueError(f"{self.path}: keys are given, but its matrices have no names")

    def pair(self, names: Sequence[str]) -> tuple[int, int]:
        """Positions of stiffness and mass among the named matrices of one file."""
        lower = [name.lower() for name in names]
        held = listed_choices(names) if names else "no matrix"
        if self.keys is not None:
            for key in self.keys:
                if key.lower() not in lower:
                    raise ValueError(f"{self.path}: no matrix {key!r}; it holds {held}")
            return lower.index(self.keys[0].lower()), lower.index(self.keys[1].lower())
        masses = {match[1]: i for i, name in enumerate(lower) if (match := _MASS.fullmatch(name))}
        pairs = [
            (i, masses[match[1]])
            for i, name in enumerate(lower)
            if (match := _STIFFNESS.fullmatch(name)) and match[1] in masses
        ]
        if len(pairs) != 1:
            raise ValueError(
                f"{self.path}: name its stiffness and mass, as in --keys KAA,MAA, or "
                f'keys=("KAA", "MAA") in Python; it holds {held}'
            )
        return pairs[0]


def file_named(path: Path, name: str) -> Path | None:
    """The file of a name, in capitals or not, in the folder of another; None if none is there."""
    exact = path.with_name(name)
    if exact.is_file():
        return exact
    return next((file for file in path.parent.iterdir() if file.name.lower() == name.lower()), None)
