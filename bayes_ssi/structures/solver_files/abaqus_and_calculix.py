"""Matrices of Abaqus and CalculiX, and their input decks, which are of one syntax.

Abaqus: ``*MATRIX GENERATE, STIFFNESS, MASS`` and ``*MATRIX OUTPUT, STIFFNESS, MASS`` write
``job_STIFn.mtx`` and ``job_MASSn.mtx``, n being the step (Abaqus Analysis Guide, "Generating
matrices"; Keywords Guide, ``*MATRIX INPUT``). Each line has, separated by commas, the node and
degree of freedom of a row, those of a column, and the entry (FORMAT=MATRIX INPUT, the default, or
LABELS); of a symmetric matrix one triangle or both. Restrained degrees of freedom have 1e36 on the
diagonal of the stiffness. Nodes numbered 0 or less are Abaqus's own (multipliers of constraints).
FORMAT=COORDINATE (row, column, entry, separated by blanks) does not say which row is which degree
of freedom.

CalculiX (CrunchiX User's Manual, ``*FREQUENCY, SOLVER=MATRIXSTORAGE``): ``.sti`` and ``.mas`` hold
stiffness and mass, one line for each entry of the upper triangle and the diagonal, column by
column: row, column, value. ``.dof`` holds a line "node.direction" for each row. Restrained
displacements and the dependent ones of multiple-point constraints have no rows. Incompatible modes
of elements (C3D8I) are rows of nodes that no deck states; beams, shells and trusses are expanded
into solids, whose nodes repeat the number of the node that they come from (``.12d``).

Faces of a deck's shell and solid elements are given by their first, the corner nodes (Abaqus
Elements Guide, "Element library: faces and node ordering"; CrunchiX User's Manual, section 6.2).
"""

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np

from bayes_ssi.foundations.text_files import first_bytes
from bayes_ssi.structures.geometry import Geometry, Point
from bayes_ssi.structures.solver_files.exported_model import Matrices, Source, file_named
from bayes_ssi.structures.solver_files.solver_text import (
    INTERNAL,
    matrix_of_entries,
    matrix_of_lines,
    numbered_label,
    numbered_lines,
    read_labels,
    read_number_lines,
    whole_numbers,
)

_LABELLED = "row node, its degree of freedom, column node, its degree of freedom, entry"
_STIFFNESS_NAME = re.compile(r"_STIF(?=\d+$)", re.IGNORECASE)
_STEP = re.compile(r"_STIF\d+$", re.IGNORECASE)
# On the diagonal of the stiffness, from here upwards, of restrained degrees of freedom.
RESTRAINED = 1e36


def recognises_abaqus(suffix: str, head: bytes) -> bool:
    """Lines of five numbers or three: others end in .mtx as well."""
    data = _first_data(head)
    return suffix == ".mtx" and (data.count(",") == 4 or _is_coordinate(data))


def _first_data(head: bytes) -> str:
    lines = head.decode("ascii", "replace").splitlines()
    return next((line for line in lines if line.strip() and not line.startswith("*")), "")


def _is_coordinate(line: str) -> bool:
    """Whether a line has a row, a column and an entry."""
    fields = line.replace(",", " ").split()
    return len(fields) == 3 and fields[0].isdigit() and fields[1].isdigit()


def read_abaqus(source: Source) -> Matrices:
    """Stiffness and mass: labelled, or by the numbers of rows alone."""
    path = source.path
    by_name = file_named(path, _STIFFNESS_NAME.sub("_MASS", path.stem) + path.suffix)
    mass = source.mass or (by_name if by_name and by_name.name != path.name else None)
    if mass is None:
        raise ValueError(
            f"{path}: name the file of the stiffness, job_STIFn.mtx, in whose folder job_MASSn.mtx "
            "stands, or both"
        )
    read = _unlabelled if _is_coordinate(_first_data(first_bytes(path))) else _labelled
    return read(path, mass)


def _labelled(path: Path, mass: Path) -> Matrices:
    files = (path, mass)
    lines = [read_number_lines(file, _LABELLED, delimiter=",", comment="*") for file in files]
    stated = [
        whole_numbers(file, numbers[:, :4], "node and degree of freedom")
        for file, numbers in zip(files, lines, strict=True)
    ]
    places, numbers = np.unique(np.vstack(stated).reshape(-1, 2), axis=0, return_inverse=True)
    of_stiffness, of_mass = np.split(numbers.reshape(-1, 2), [len(stated[0])])
    unknown = np.setdiff1d(of_mass, of_stiffness)
    if len(unknown):
        node, number = places[unknown[0]]
        raise ValueError(
            f"{mass}: node {node}, degree of freedom {number} is not in the stiffness: of another "
            "model?"
        )
    stiffness = matrix_of_entries(path, of_stiffness, lines[0][:, 4], len(places))
    labels = [
        numbered_label(node if node > 0 else f"{INTERNAL} {abs(node)}", number)
        for node, number in places.tolist()
    ]
    deck = file_named(path, _STEP.sub("", path.stem) + ".inp")
    notes = ["restrained degrees of freedom are those with 1e+36 on the diagonal"]
    if any(name.startswith(INTERNAL) for name in labels):
        notes.append("nodes numbered 0 or less are Abaqus's own: their rows are called internal")
    return Matrices(
        (stiffness, matrix_of_entries(mass, of_mass, lines[1][:, 4], len(places))),
        files,
        labels=labels,
        geometry=geometry_of_deck(deck) if deck else None,
        removed=np.flatnonzero(stiffness.diagonal() >= RESTRAINED),
        notes=tuple(notes),
    )


def _unlabelled(path: Path, mass: Path) -> Matrices:
    entries = [
        read_number_lines(file, "row, column, entry", delimiter=delimiter, comment="*")
        for file in (path, mass)
        for delimiter in ["," if "," in _first_data(first_bytes(file)) else None]
    ]
    size = int(entries[0][:, :2].max())
    stiffness = matrix_of_lines(path, entries[0], size)
    return Matrices(
        (stiffness, matrix_of_lines(mass, entries[1], size)),
        (path, mass),
        removed=np.flatnonzero(stiffness.diagonal() >= RESTRAINED),
        notes=("FORMAT=COORDINATE does not say which row is which degree of freedom",),
    )


def read_calculix(source: Source) -> Matrices:
    """Stiffness and mass by their labels, with the deck's geometry if it stands there."""
    labels = read_labels(source.needed(".dof", "nodes and directions"))
    files = (source.needed(".sti", "stiffness"), source.mass or source.needed(".mas", "mass"))
    deck, geometry = source.with_ending(".inp"), None
    notes = ["restrained displacements, and those that constraints tie to others, have no rows"]
    if deck is not None:
        try:
            geometry = geometry_of_deck(deck)
            notes.append(f"coordinates are those of {deck.name}")
        except OSError as error:
            notes.append(
                f"no coordinates: {deck.name} includes a file that cannot be read: {error}"
            )
    if geometry is not None:
        known = geometry.nodes
        labels = [x if x.rpartition(" ")[0] in known else f"{INTERNAL} {x}" for x in labels]
    entries = [read_number_lines(path, "row, column, value") for path in files]
    lengths = list(map(len, entries))
    if lengths[0] != lengths[1]:
        raise ValueError(
            f"{files[lengths.index(min(lengths))]}: {min(lengths)} entries, the other of the two "
            f"files has {max(lengths)}: truncated, or of another model?"
        )
    pair = [
        matrix_of_lines(path, numbers, len(labels), to_the_last="column")
        for path, numbers in zip(files, entries, strict=True)
    ]
    return Matrices(pair, files, labels=labels, geometry=geometry, notes=tuple(notes))


# Keywords whose option INPUT names a file with their data lines, or with more of the deck.
WITH_INPUT = ("*INCLUDE", "*NODE", "*ELEMENT")
# Beams and trusses begin so; a drawing joins their nodes in the order in which the deck states
# them.
MEMBERS = ("B2", "B3", "T2", "T3", "PIPE")
# Of solids, and of shells and membranes: their number of nodes.
SURFACES = re.compile(r"(C3D|S|M3D)(\d+)")
Faces = tuple[tuple[int, ...], ...]
TRIANGLE, QUAD = ((0, 1, 2),), ((0, 1, 2, 3),)
TETRA = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
WEDGE = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
BRICK = (
    (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)
)  # fmt: skip
SOLIDS: dict[int, Faces] = {4: TETRA, 10: TETRA, 6: WEDGE, 15: WEDGE, 8: BRICK, 20: BRICK}
SHELLS: dict[int, Faces] = {3: TRIANGLE, 6: TRIANGLE, 4: QUAD, 8: QUAD, 9: QUAD}


def geometry_of_deck(path: Path) -> Geometry | None:
    """Nodes that a deck states, and its beams, shells and solids; None if it states no node.

    Decks that it includes are read as well. Nodes that it generates or copies, and parts that it
    places elsewhere, are missing. Faces that two solids share lie within the structure.
    """
    nodes: dict[str, Point] = {}
    lines: list[tuple[str, str]] = []
    solids: dict[frozenset[str], tuple[str, ...]] = {}
    shells: dict[frozenset[str], tuple[str, ...]] = {}
    begun: list[int] = []  # the element and nodes of a shell or solid, which may take two lines
    for place, keyword, options, fields in data_lines(path):
        if keyword not in ("*NODE", "*ELEMENT"):
            continue
        try:
            kind = options.get("TYPE", "").upper()
            count, faces = _faces(kind)
            numbers = [int(each) for each in fields[: 1 if keyword == "*NODE" else None]]
            if keyword == "*NODE":
                x, y, z = ([float(each) for each in fields[1:4]] + [0.0] * 3)[:3]
                nodes[str(numbers[0])] = (x, y, z)
            elif kind.startswith(MEMBERS):
                lines += pairwise(map(str, numbers[1:]))
            elif faces:
                begun += numbers
                if len(begun) > count + 1:
                    raise ValueError(kind)
                if len(begun) <= count:
                    continue
                for corners in faces:
                    face = tuple(str(begun[1 + corner]) for corner in corners)
                    if not kind.startswith("C3D"):
                        shells[frozenset(face)] = face
                    elif solids.pop(frozenset(face), None) is None:
                        solids[frozenset(face)] = face
                begun = []
        except ValueError:
            raise ValueError(
                f"{place}: expected whole numbers of nodes and elements, and coordinates, got "
                f"{', '.join(fields)!r}"
            ) from None
    if not nodes:
        return None
    return Geometry(
        nodes,
        tuple(line for line in lines if set(line) <= nodes.keys()),
        faces=tuple(face for key, face in (solids | shells).items() if key <= nodes.keys()),
    )


def _faces(kind: str) -> tuple[int, Faces]:
    """Number of nodes, and corners of the faces; no faces of other elements, such as beams."""
    match = SURFACES.match(kind)
    if match is None:
        return 0, ()
    count = int(match[2])
    return count, (SOLIDS if match[1] == "C3D" else SHELLS).get(count, ())


def data_lines(
    path: Path, keyword: str = "", options: Mapping[str, str] = MappingProxyType({})
) -> Iterator[tuple[str, str, Mapping[str, str], list[str]]]:
    """File and line, keyword, its options and the fields of each line of data."""
    for number, line in numbered_lines(path):
        text = line.strip().rstrip(",")
        if not text or text.startswith("**"):
            continue
        first, *others = (each.strip() for each in text.split(","))
        if not text.startswith("*"):
            yield f"{path}: line {number}", keyword, options, [first, *others]
            continue
        keyword = first.upper()
        pairs = (each.partition("=") for each in others)
        options = {name.strip().upper(): value.strip() for name, _, value in pairs}
        if keyword in WITH_INPUT and "INPUT" in options:
            inside = "" if keyword == "*INCLUDE" else keyword
            yield from data_lines(path.parent / options["INPUT"], inside, options)
