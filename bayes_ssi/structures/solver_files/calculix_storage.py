"""CalculiX: the files .sti, .mas and .dof of ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.

CalculiX CrunchiX User's Manual, ``*FREQUENCY``: ``.sti`` and ``.mas`` hold stiffness and mass, one
line for each entry of the upper triangle and the diagonal, column by column: row, column, value.
``.dof`` holds a line "node.direction" for each row. Restrained displacements and the dependent ones
of multiple-point constraints have no rows. Incompatible modes of elements (C3D8I) are rows of nodes
that no deck states; beams, shells and trusses are expanded into solids, whose nodes repeat the
number of the node that they come from (``.12d``).
"""

from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.solver_files.formats import Matrices, Source
from bayes_ssi.structures.solver_files.input_decks import geometry_of_deck
from bayes_ssi.structures.solver_files.row_labels import INTERNAL, read_labels
from bayes_ssi.structures.solver_files.text_entries import matrix_of_lines, read_number_lines


def read_calculix(source: Source) -> Matrices:
    """Stiffness and mass by their labels, with the deck's geometry if it stands there."""
    labels = read_labels(source.needed(".dof", "nodes and directions"))
    files = (source.needed(".sti", "stiffness"), source.mass or source.needed(".mas", "mass"))
    geometry, notes = _geometry(source)
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
    stiffness, mass = (
        matrix_of_lines(path, numbers, len(labels), to_the_last="column")
        for path, numbers in zip(files, entries, strict=True)
    )
    return Matrices(
        stiffness,
        mass,
        str(files[0]),
        str(files[1]),
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
