"""What a format of solver files is: how it is recognised, and how it is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bayes_ssi.foundations.text_files import require_regular_file
from bayes_ssi.structures.solver_files.exported_model import Matrices


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
        """For formats whose matrices have no names."""
        if self.keys is not None:
            raise ValueError(f"{self.path}: keys are given, but its matrices have no names")


@dataclass(frozen=True)
class Format:
    """A format of solver files."""

    program: str
    files: str
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Source], Matrices]


def first_bytes(path: Path) -> bytes:
    """The beginning of a file, in which formats are recognised."""
    require_regular_file(path)
    with path.open("rb") as file:
        return file.read(8192)


def file_named(path: Path, name: str) -> Path | None:
    """The file of a name, in capitals or not, in the folder of another; None if none is there."""
    exact = path.with_name(name)
    if exact.is_file():
        return exact
    alike = (each for each in path.parent.iterdir() if each.name.lower() == name.lower())
    return next(alike, None)
