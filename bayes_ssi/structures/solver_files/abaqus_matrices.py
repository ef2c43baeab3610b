"""Abaqus: text files of ``*MATRIX OUTPUT`` and of ``*SUBSTRUCTURE MATRIX OUTPUT``.

``*MATRIX GENERATE, STIFFNESS, MASS`` and ``*MATRIX OUTPUT, STIFFNESS, MASS`` write
``job_STIFn.mtx`` and ``job_MASSn.mtx``, n being the step (Abaqus Analysis Guide, "Generating
matrices"; Keywords Guide, ``*MATRIX INPUT``). Each line has, separated by commas, the node and
degree of freedom of a row, those of a column, and the entry (FORMAT=MATRIX INPUT, the default, or
LABELS); of a symmetric matrix one triangle or both. Restrained degrees of freedom have 1e36 on the
diagonal of the stiffness. Nodes numbered 0 or less are Abaqus's own (multipliers of constraints).
FORMAT=COORDINATE (row, column, entry, separated by blanks) does not say which row is which degree
of freedom.

A substructure's file has, after ``*USER ELEMENT``, its nodes in comments and their degrees of
freedom in data lines, and after ``*MATRIX, TYPE=STIFFNESS`` or ``MASS`` the entries of the lower
triangle, row by row.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.solver_files.formats import Matrices, Source, file_named
from bayes_ssi.structures.solver_files.input_decks import data_lines, geometry_of_deck
from bayes_ssi.structures.solver_files.row_labels import INTERNAL, numbered_label
from bayes_ssi.structures.solver_files.text_entries import (
    from_triangle,
    matrix_of_entries,
    matrix_of_lines,
    read_number_lines,
    require_whole_lines,
    whole_numbers,
)

_LABELLED = "row node, its degree of freedom, column node, its degree of freedom, entry"
_STIFFNESS_NAME = re.compile(r"_STIF(?=\d+$)", re.IGNORECASE)
_STEP = re.compile(r"_STIF\d+$", re.IGNORECASE)


def recognises_abaqus(suffix: str, head: bytes) -> bool:
    """A substructure, or lines of five numbers or three: others end in .mtx as well."""
    if suffix != ".mtx":
        return False
    lines = [line for line in head.decode("ascii", "replace").splitlines() if line.strip()]
    data = next((line for line in lines if not line.startswith("*")), "")
    return _is_substructure(head) or data.count(",") == 4 or _is_coordinate(data)


def _is_substructure(head: bytes) -> bool:
    return b"*USER ELEMENT" in head.upper()


def _is_coordinate(line: str) -> bool:
    """Whether a line has a row, a column and an entry."""
    fields = line.replace(",", " ").split()
    return len(fields) == 3 and fields[0].isdigit() and fields[1].isdigit()


def read_abaqus(source: Source) -> Matrices:
    """Stiffness and mass: of a substructure, labelled, or by the numbers of rows alone."""
    path = source.path
    with path.open("rb") as file:
        if _is_substructure(file.read(8192)):
            return _substructure(path)
    by_name = file_named(path, _STIFFNESS_NAME.sub("_MASS", path.stem) + path.suffix)
    mass = source.mass or (by_name if by_name and by_name.name != path.name else None)
    if mass is None:
        raise ValueError(
            f"{path}: name the file of the stiffness, job_STIFn.mtx, in whose folder job_MASSn.mtx "
            "stands, or both"
        )
    first = _first_line(path)
    return _unlabelled(path, mass) if _is_coordinate(first) else _labelled(path, mass)


def _first_line(path: Path) -> str:
    with path.open(encoding="ascii", errors="replace") as file:
        return next((line for line in file if line.strip() and not line.startswith("*")), "")


def _labelled(path: Path, mass: Path) -> Matrices:
    stiffness_entries, mass_entries = (
        read_number_lines(each, _LABELLED, delimiter=",", comment="*") for each in (path, mass)
    )
    places = np.unique(_places(path, stiffness_entries).reshape(-1, 2), axis=0)
    stiffness = _assembled(path, stiffness_entries, places)
    labels = [
        numbered_label(node if node > 0 else f"{INTERNAL} {abs(node)}", number)
        for node, number in places.tolist()
    ]
    deck = file_named(path, _STEP.sub("", path.stem) + ".inp")
    notes = ["restrained degrees of freedom are those with 1e+36 on the diagonal"]
    if any(name.startswith(INTERNAL) for name in labels):
        notes.append("nodes numbered 0 or less are Abaqus's own: their rows are called internal")
    return Matrices(
        stiffness,
        _assembled(mass, mass_entries, places),
        str(path),
        str(mass),
        labels=labels,
        geometry=geometry_of_deck(deck) if deck else None,
        removed=_restrained(stiffness),
        notes=tuple(notes),
    )


def _places(path: Path, entries: FloatArray) -> NDArray[np.intp]:
    """Node and degree of freedom of row and column of each entry: (entries, 2, 2)."""
    return whole_numbers(path, entries[:, :4], "node and degree of freedom").reshape(-1, 2, 2)


def _assembled(path: Path, entries: FloatArray, places: NDArray[np.intp]) -> sp.csc_array:
    # Nodes and degrees of freedom as one number, whose order is theirs.
    factor = int(places[:, 1].max()) + 1
    known = places[:, 0] * factor + places[:, 1]
    wanted = _places(path, entries)
    keys = wanted[..., 0] * factor + wanted[..., 1]
    rows = np.searchsorted(known, keys).clip(max=len(known) - 1)
    unknown = np.argwhere((known[rows] != keys) | (wanted[..., 1] >= factor))
    if len(unknown):
        node, number = wanted[tuple(unknown[0])]
        raise ValueError(
            f"{path}: node {node}, degree of freedom {number} is not in the stiffness: of another "
            "model?"
        )
    return matrix_of_entries(path, rows, entries[:, 4], len(known))


def _unlabelled(path: Path, mass: Path) -> Matrices:
    entries = [
        read_number_lines(
            file,
            "row, column, entry",
            delimiter="," if "," in _first_line(file) else None,
            comment="*",
        )
        for file in (path, mass)
    ]
    size = int(entries[0][:, :2].max())
    stiffness = matrix_of_lines(path, entries[0], size)
    return Matrices(
        stiffness,
        matrix_of_lines(mass, entries[1], size),
        str(path),
        str(mass),
        removed=_restrained(stiffness),
        notes=("FORMAT=COORDINATE does not say which row is which degree of freedom",),
    )


def _restrained(stiffness: sp.csc_array) -> Any:
    """Rows of restrained degrees of freedom: Abaqus writes 1e36 on the diagonal."""
    return np.flatnonzero(stiffness.diagonal() >= 1e36)


def _substructure(path: Path) -> Matrices:
    """Stiffness, mass and retained degrees of freedom."""
    require_whole_lines(path)
    freedoms: list[list[int]] = []
    numbers: dict[str, list[float]] = {}
    for place, keyword, options, fields in data_lines(path):
        try:
            if keyword == "*USER ELEMENT":
                if "UNSYM" in options:
                    raise ValueError("the substructure is not symmetric")
                freedoms.append([int(each) for each in fields])
            elif keyword == "*MATRIX":
                numbers.setdefault(options.get("TYPE", "").upper(), []).extend(map(float, fields))
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from None
    head = path.read_text(encoding="ascii", errors="replace").upper().partition("*USER ELEMENT")[2]
    comments = re.findall(r"^[*]{2}([ \d,]*)$", head.partition("\n*MATRIX")[0], re.MULTILINE)
    nodes = [int(each) for each in re.findall(r"\d+", " ".join(comments))]
    labels = _labels(path, nodes, freedoms)
    stiffness, mass = (
        _retained(path, kind, numbers, len(labels)) for kind in ("STIFFNESS", "MASS")
    )
    return Matrices(
        stiffness,
        mass,
        f"{path}: STIFFNESS",
        f"{path}: MASS",
        labels=labels,
        notes=("the retained degrees of freedom of a substructure, the others condensed",),
    )


def _labels(path: Path, nodes: list[int], freedoms: list[list[int]]) -> list[str]:
    """The first line lists the degrees of freedom of the first node and those after it.

    A further line begins with the position of the node from which on it holds.
    """
    if not nodes or not freedoms:
        raise ValueError(f"{path}: no nodes or no degrees of freedom after *USER ELEMENT")
    starts = {1: freedoms[0], **{line[0]: line[1:] for line in freedoms[1:] if line}}
    labels, current = [], freedoms[0]
    for position, node in enumerate(nodes, start=1):
        current = starts.get(position, current)
        labels += [numbered_label(node, number) for number in current]
    return labels


def _retained(path: Path, kind: str, numbers: dict[str, list[float]], size: int) -> sp.csc_array:
    if kind not in numbers:
        raise ValueError(f"{path}: no *MATRIX, TYPE={kind}; was it requested?")
    entries, places = numbers[kind], np.tril_indices(size)
    if len(entries) != len(places[0]):
        raise ValueError(
            f"{path}: {kind}: {len(entries)} entries, but {size} degrees of freedom have "
            f"{len(places[0])} in the lower triangle: truncated?"
        )
    return from_triangle(sp.coo_array((entries, places), shape=(size, size)).tocsc())
