"""Finite-element models from the files of solvers, in any format that the package reads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.text_files import first_bytes
from bayes_ssi.structures.solver_files.abaqus_and_calculix import (
    read_abaqus,
    read_calculix,
    recognises_abaqus,
)
from bayes_ssi.structures.solver_files.ansys import (
    read_full,
    read_harwell_boeing,
    recognises_harwell_boeing,
)
from bayes_ssi.structures.solver_files.exported_model import (
    ExportedModel,
    Matrices,
    Source,
    exported_model,
)
from bayes_ssi.structures.solver_files.nastran import read_op4, read_punch
from bayes_ssi.structures.solver_files.plain_matrices import (
    read_containers,
    read_printed,
    recognises_rows,
)
from bayes_ssi.structures.solver_files.sap2000_text import read_sap2000
from bayes_ssi.structures.solver_files.solver_text import read_labels
from bayes_ssi.structures.solver_files.unit_systems import in_si, mass_note, require_mass

Begins = Callable[[bytes], bool]


class Format(NamedTuple):
    """A format of solver files: how it is recognised by ending and first bytes, and read."""

    program: str
    files: str
    recognises: Callable[[str, bytes], bool]
    read: Callable[[Source], Matrices]
    has_keys: bool = False


def _ends(*endings: str, or_begins: Begins | None = None) -> Callable[[str, bytes], bool]:
    return lambda ending, head: ending in endings or bool(or_begins and or_begins(head))


# In the order in which they are tried.
FORMATS = (
    Format("SAP2000 or ETABS text", ".TXE, .TXK, .TXM",
           _ends(".txa", ".txe", ".txk", ".txm", ".txc"), read_sap2000),
    Format("CalculiX matrix storage", ".sti, .mas, .dof", _ends(".sti", ".mas", ".dof"),
           read_calculix),
    Format("ANSYS full file", ".full", _ends(".full"), read_full),
    Format("Nastran OUTPUT4", ".op4", _ends(".op4"), read_op4, has_keys=True),
    Format("Nastran punched matrices (DMIG)", ".pch, .dmig",
           _ends(".pch", ".dmig", or_begins=lambda head: b"\nDMIG" in b"\n" + head),
           read_punch, has_keys=True),
    Format("Abaqus matrix output", "job_STIFn.mtx, job_MASSn.mtx, substructure .mtx",
           recognises_abaqus, read_abaqus),
    Format("matrices", ".npz, .mat, .npy, Matrix Market .mtx",
           _ends(".npz", ".mat", ".npy", or_begins=lambda head: head.startswith(b"%%MatrixMarket")),
           read_containers, has_keys=True),
    Format("Harwell-Boeing (ANSYS HBMAT)", "a file for each matrix, .mapping",
           _ends(or_begins=recognises_harwell_boeing), read_harwell_boeing),
    Format("matrices printed as text (OpenSees)", "a file of rows for each matrix",
           _ends(or_begins=recognises_rows), read_printed),
)  # fmt: skip


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
    ending, head = source.path.suffix.lower(), first_bytes(source.path)
    known = next((form for form in FORMATS if form.recognises(ending, head)), None)
    if known is None:
        listed = "; ".join(f"{each.program} ({each.files})" for each in FORMATS)
        raise ValueError(f"{path}: not recognised as a solver's matrices; known are {listed}")
    if not known.has_keys:
        source.refuse_keys()
    if isinstance(labels, str | Path):
        labels = read_labels(Path(labels))
    model = exported_model(known.program, known.read(source), labels)
    if mass_kg is not None:
        require_mass(model, mass_kg, units)
    if units is not None:
        model = in_si(model, units)
    note = mass_note(model)
    return model if note is None else replace(model, notes=(*model.notes, note))
