"""CalculiX: the files .sti, .mas and .dof of ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

CalculiX CrunchiX User's Manual, ``*FREQUENCY``: ``.sti`` and ``.mas`` hold stiffness and mass, one
line for each entry of the upper triangle and the diagonal, column by column: row, column, value.
``.dof`` holds a line "node.direction" for each row. Restrained displacements and the dependent ones
of multiple-point constraints have no rows. Incompatible modes of elements (C3D8I) are rows of nodes
that no deck states; beams, shells and trusses are expanded into solids, whose nodes repeat the
number of the node that they come from (``.12d``).
"""

from __future__ import annotations

from pathlib import Path

import scipy.sparse as sp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.directions import INTERNAL, direction, label
from bayes_ssi.structures.solver_files.element_faces import from_entries, rows_from_one
from bayes_ssi.structures.solver_files.exported_model import Matrices
from bayes_ssi.structures.solver_files.formats import Format, Source
from bayes_ssi.structures.solver_files.input_decks import geometry_of_deck
from bayes_ssi.structures.solver_files.number_lines import read_number_lines, require_whole_lines

ENDINGS = (".sti", ".mas", ".dof")


def _recognises(path: Path, head: bytes) -> bool:  # noqa: ARG001
    return path.suffix.lower() in ENDINGS


def _read(source: Source) -> Matrices:
    source.refuse_keys()
    places = _places(source.needed(".dof", "nodes and directions"))
    stiffness = source.needed(".sti", "stiffness")
    mass = source.mass or source.needed(".mas", "mass")
    geometry, notes = _geometry(source)
    labels = [
        label(
            node if geometry is None or str(node) in geometry.nodes else f"{INTERNAL} {node}",
            number,
        )
        for node, number in places
    ]
    entries = {path: read_number_lines(path, "row, column, value") for path in (stiffness, mass)}
    if len(entries[stiffness]) != len(entries[mass]):
        shorter = min(entries, key=lambda path: len(entries[path]))
        raise ValueError(
            f"{shorter}: {len(entries[shorter])} entries, the other of the two files has "
            f"{max(map(len, entries.values()))}: truncated, or of another model?"
        )
    return Matrices(
        _matrix(stiffness, entries[stiffness], len(labels)),
        _matrix(mass, entries[mass], len(labels)),
        str(stiffness),
        str(mass),
        labels=labels,
        geometry=geometry,
        notes=(
            "restrained displacements, and those that constraints tie to others, have no rows",
            *notes,
        ),
    )


def _geometry(source: Source) -> tuple[Geometry | None, tuple[str, ...]]:
    """Coordinates from the deck, if it stands there, and what is to be said of it."""
    deck = source.with_ending(".inp")
    if deck is None:
        return None, ()
    try:
        return geometry_of_deck(deck), (f"coordinates are those of {deck.name}",)
    except OSError as error:
        return None, (f"no coordinates: {deck.name} includes a file that cannot be read: {error}",)


def _places(path: Path) -> list[tuple[int, int]]:
    """Node and direction (1 to 6) of every row."""
    require_whole_lines(path)
    places = []
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            node, _, component = line.strip().partition(".")
            try:
                direction(component)
                places.append((int(node), int(component)))
            except ValueError:
                raise ValueError(
                    f"{path}: line {number}: expected node.direction, such as 12.3, got "
                    f"{line.strip()!r}"
                ) from None
    return places


def _matrix(path: Path, entries: FloatArray, size: int) -> sp.csc_array:
    rows, columns = (rows_from_one(path, entries[:, i], size, first_line=1) for i in (0, 1))
    if columns.max() < size - 1:
        raise ValueError(
            f"{path}: ends with column {columns.max() + 1} of {size}: truncated, or of another "
            "model?"
        )
    return from_entries(path, rows, columns, entries[:, 2], size)


FORMAT = Format("CalculiX matrix storage", ".sti, .mas, .dof", _recognises, _read)
