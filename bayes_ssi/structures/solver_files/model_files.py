"""Finite-element models from the files of solvers, in any format that the package reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.structures.solver_files import (
    abaqus_matrices,
    ansys_full,
    calculix_storage,
    harwell_boeing,
    matrix_containers,
    nastran_op4,
    nastran_punch,
    opensees_text,
    sap2000_text,
)
from bayes_ssi.structures.solver_files.exported_model import ExportedModel, exported_model
from bayes_ssi.structures.solver_files.formats import Format, Source, first_bytes
from bayes_ssi.structures.solver_files.matrix_containers import read_labels
from bayes_ssi.structures.solver_files.unit_systems import in_si, mass_note, require_mass

# In the order in which they are tried.
FORMATS: tuple[Format, ...] = (
    sap2000_text.FORMAT,
    calculix_storage.FORMAT,
    ansys_full.FORMAT,
    nastran_op4.FORMAT,
    nastran_punch.FORMAT,
    abaqus_matrices.FORMAT,
    matrix_containers.FORMAT,
    harwell_boeing.FORMAT,
    opensees_text.FORMAT,
)


@checked
def read_model(
    path: str | Path,
    mass: str | Path | None = None,
    *,
    keys: tuple[str, str] | None = None,
    labels: Sequence[str] | str | Path | None = None,
    units: str | None = None,
    mass_kg: float | None = None,
) -> ExportedModel:
    """Stiffness and mass of a finite-element model, as its program exported them.

    The format is recognised by the file's ending and first lines; files that belong together
    (``frame.sti``, ``frame.mas``, ``frame.dof``) stand in one folder, and any of them is named.

    Args:
        path: a file of the stiffness, or of the whole model.
        mass: the file of the mass matrix, where its name does not follow from that of the
            stiffness.
        keys: names of stiffness and mass in a file that holds several matrices.
        labels: "node direction" of every row, where the files do not state them; or a text file
            with a line ``12 x``, ``12 1`` or ``12.1`` for each.
        units: the units of the model, such as "N, mm": turns it into N, m, kg. None leaves the
            numbers as exported.
        mass_kg: the structure's mass as it is known, to within a factor of 2: other units are
            refused.

    Returns:
        The model; :class:`MatrixStructure` takes its ``stiffness``, ``mass``, ``labels`` and
        ``geometry``.

    Raises:
        OSError: a file cannot be read.
        ValueError: the format is not known, a file is damaged, truncated or of another model, the
            matrices are not symmetric, or units and mass contradict each other; one line names
            the file and, where there is one, the line.
    """
    source = Source(Path(path), None if mass is None else Path(mass), keys)
    head = first_bytes(source.path)
    known = next((each for each in FORMATS if each.recognises(source.path, head)), None)
    if known is None:
        listed = "; ".join(f"{each.program} ({each.files})" for each in FORMATS)
        raise ValueError(f"{path}: not recognised as a solver's matrices; known are {listed}")
    if isinstance(labels, str | Path):
        labels = read_labels(Path(labels))
    model = exported_model(known.program, known.read(source), labels)
    if mass_kg is not None:
        require_mass(model, mass_kg, units)
    if units is not None:
        model = in_si(model, units)
    note = mass_note(model)
    return model if note is None else replace(model, notes=(*model.notes, note))
