"""A finite-element model as a program exported it: what readers of files get, return, and check."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import listed_choices
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.finite_elements.model_arguments import checked_matrix
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS, direction_of

# K, KAA, kxx, stiffness, STIF1 and M, MAA, mxx, mass, MASS1: a pair has the same rest.
_STIFFNESS = re.compile(r"(?:stiffness|stif|k)(.*)", re.IGNORECASE)
_MASS = re.compile(r"(?:mass|m)(.*)", re.IGNORECASE)


@dataclass(frozen=True)
class Matrices:
    """What a reader returns."""

    pair: Sequence[Any]  # stiffness and mass
    called: Sequence[object]  # their files, and what messages call them
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


# Stiffness, mass and labels.
Parts = tuple[sp.csc_array, sp.csc_array, "Sequence[str] | None"]


@dataclass(frozen=True, eq=False)
class ExportedModel:
    """Stiffness and mass of a finite-element model, as its program exported them.

    Attributes:
        program: the program and its format.
        stiffness: (n, n), sparse and symmetric, without the rows that are restrained.
        mass: (n, n), in the same way.
        labels: "node direction" of the n degrees of freedom, such as ``12 x`` or ``12 rz``; None
            where neither the files nor the caller state them.
        geometry: where the nodes are, where the files state it; else None.
        dependent: "node direction" that has no row of its own → label → factor: constraints make
            its displacement the sum of the factors times those of the labels.
        units: of all numbers: "as exported", or "N, m, kg".
        notes: what was done and met: restrained and empty rows, constraints, and the total mass.
        digits: significant digits to which the files state the stiffness.
    """

    program: str
    stiffness: sp.csc_array
    mass: sp.csc_array
    labels: tuple[str, ...] | None
    geometry: Geometry | None
    dependent: Mapping[str, Mapping[str, float]]
    units: str
    notes: tuple[str, ...]
    digits: int = 16

    @property
    def size(self) -> int:
        """Number of degrees of freedom."""
        return int(self.stiffness.shape[0])

    @property
    def total_mass(self) -> Mapping[str, float]:
        """Direction → the mass that moves when all rows of it do by 1; nothing without labels."""
        of_rows = [direction_of(name) for name in self.labels or ()]
        moved = {each: np.equal(of_rows, each) * 1.0 for each in TRANSLATIONS if each in of_rows}
        return {direction: float(r @ (self.mass @ r)) for direction, r in moved.items()}

    def with_rows(self, labels: Sequence[str], spring: float | None = None) -> "ExportedModel":
        """The model with rows for displacements that constraints tie to others.

        A row without mass hangs on those that move it by a spring, ½ k (u - Σ c_i u_i)²: as no
        force acts on it, u = Σ c_i u_i exactly, whatever k is, and no mode changes.

        Args:
            labels: of :attr:`dependent`.
            spring: k; the mean diagonal entry of the stiffness if None, which keeps factors well
                conditioned. Exports that are compared take the same.

        Raises:
            ValueError: a label is not among those that are dependent.
        """
        if not labels:
            return self
        unknown = [label for label in labels if label not in self.dependent]
        if unknown or self.labels is None:
            raise ValueError(f"no constraint moves {(unknown or labels)[0]!r}")
        row = {label: i for i, label in enumerate(self.labels)}
        by_entry = sp.lil_array((len(labels), self.size + len(labels)))
        for i, label in enumerate(labels):
            by_entry[i, self.size + i] = 1.0
            for other, factor in self.dependent[label].items():
                if other not in row:
                    raise ValueError(f"{label!r} is moved by {other!r}, which has no stiffness")
                by_entry[i, row[other]] = -factor
        ties = sp.csc_array(by_entry)
        k = float(self.stiffness.diagonal().mean()) if spring is None else spring
        empty = sp.csc_array((len(labels), len(labels)))
        return replace(
            self,
            stiffness=sp.csc_array(
                sp.block_diag((self.stiffness, empty), format="csc") + k * (ties.T @ ties)
            ),
            mass=sp.csc_array(sp.block_diag((self.mass, empty), format="csc")),
            labels=(*self.labels, *labels),
            dependent={name: of for name, of in self.dependent.items() if name not in labels},
            notes=(*self.notes, f"{len(labels)} rows are added for displacements of constraints"),
        )

    def __str__(self) -> str:
        lines = [f"{self.program}: {self.size} degrees of freedom, {self.units}", *self.notes]
        return "\n".join(lines)


def exported_model(
    program: str, matrices: Matrices, labels: Sequence[str] | None = None
) -> ExportedModel:
    """The checked model, in the units of the files, without rows that are restrained or empty."""
    stiffness, mass = map(sp.csc_array, matrices.pair)
    of_stiffness, of_mass = map(str, matrices.called)
    if matrices.labels is not None and labels is not None:
        raise ValueError(f"{of_stiffness}: labels are given, but the files state their own")
    names, size = matrices.labels if labels is None else labels, stiffness.shape[0]
    if mass.shape[0] != size:
        raise ValueError(
            f"{of_mass} has {mass.shape[0]} rows, {of_stiffness} has {size}; they are not of one "
            "model"
        )
    if names is not None and len(names) != size:
        raise ValueError(f"{of_stiffness}: {len(names)} labels for {size} rows")
    notes = list(matrices.notes)
    dependent = {
        name: {names[row]: factor for row, factor in of.items()}
        for name, of in matrices.dependent.items()
        if names is not None
    }
    # Restrained rows go first: a huge stiffness there would hide what is wrong elsewhere.
    restrained = np.zeros(size, dtype=bool)
    restrained[np.asarray(matrices.removed, dtype=np.intp)] = True
    parts: Parts = (stiffness, mass, names)
    stiffness, mass, names = _without(restrained, "that are restrained", parts, notes)
    stiffness = _checked(stiffness, of_stiffness, "stiffness")
    mass = _checked(mass, of_mass, "mass")
    if not mass.diagonal().any():
        raise ValueError(f"{of_mass}: there is no mass; does the model state a density?")
    empty = abs(stiffness).sum(axis=0) + abs(mass).sum(axis=0) == 0.0
    parts = (stiffness, mass, names)
    stiffness, mass, names = _without(empty, "without stiffness and mass", parts, notes)
    if names is not None:
        names = _numbered(names, notes)
    return ExportedModel(
        program,
        stiffness,
        mass,
        names,
        matrices.geometry,
        dependent,
        "as exported",
        tuple(notes),
        significant_digits(stiffness.data),
    )


def significant_digits(numbers: FloatArray) -> int:
    """The largest number of significant digits that numbers, a thousand at most, are stated to."""
    some = numbers[:: max(1, len(numbers) // 1000)]
    mantissas = (repr(abs(number)).partition("e")[0] for number in some.tolist())
    return max((len(text.replace(".", "").strip("0")) for text in mantissas), default=16)


def _checked(given: sp.csc_array, name: str, what: str) -> sp.csc_array:
    matrix = checked_matrix(given, name)
    diagonal = matrix.diagonal()
    if diagonal.min() < 0.0:
        raise ValueError(
            f"{name}: row {diagonal.argmin() + 1} has the negative {what} {diagonal.min():.3g}; is "
            "it another matrix?"
        )
    return matrix


def _without(left_out: NDArray[np.bool_], why: str, parts: Parts, notes: list[str]) -> Parts:
    """Stiffness, mass and labels without some rows, which a note names."""
    if not left_out.any():
        return parts
    stiffness, mass, names = parts
    # The first ones show which kind they are.
    first = [names[i] if names else f"row {i + 1}" for i in np.flatnonzero(left_out)[:6].tolist()]
    more = ", …" if left_out.sum() > len(first) else ""
    notes.append(f"{left_out.sum()} rows {why} are left out: {', '.join(first)}{more}")
    kept = np.flatnonzero(~left_out)
    if not len(kept):
        raise ValueError(f"all rows of the model are {why}")
    stiffness, mass = (sp.csc_array(each[:, kept][kept, :]) for each in (stiffness, mass))
    return stiffness, mass, None if names is None else [names[i] for i in kept.tolist()]


def _numbered(names: Sequence[str], notes: list[str]) -> tuple[str, ...]:
    """Labels of which the second of a name becomes "12 x (2)", which a note says."""
    seen: Counter[str] = Counter()
    unique = []
    for name in names:
        seen[name] += 1
        unique.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    repeated = [name for name in unique if name not in seen]
    if repeated:
        notes.append(
            f"{len(repeated)} rows repeat the node and direction of another; they are numbered, as "
            f"in {repeated[0]!r}"
        )
    return tuple(unique)
