"""Finite-element models from the files of solvers, in any format and in N, m, kg.

Files of matrices state no units: the engineer does, and sees the mass in them. Frequencies are
right in every consistent system, in which the unit of mass is that of force times s² divided by
that of length; masses and stiffnesses that are added to a model in kg and N/m are not.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.argument_types import checked, require_one_of
from bayes_ssi.foundations.text_files import first_bytes
from bayes_ssi.structures.solver_files.abaqus_and_calculix import (
    read_abaqus,
    read_calculix,
    recognises_abaqus,
)
from bayes_ssi.structures.solver_files.ansys import read_full
from bayes_ssi.structures.solver_files.exported_model import (
    ExportedModel,
    Matrices,
    Source,
    exported_model,
)
from bayes_ssi.structures.solver_files.nastran import read_punch
from bayes_ssi.structures.solver_files.plain_matrices import (
    read_containers,
    read_printed,
    recognises_rows,
)
from bayes_ssi.structures.solver_files.sap2000_text import read_sap2000
from bayes_ssi.structures.solver_files.solver_text import TRANSLATIONS, direction_of, read_labels


class Format(NamedTuple):
    """A format of solver files: how it is recognised by ending and first bytes, and read."""

    program: str
    files: str
    recognises: Callable[[str, bytes], bool]
    read: Callable[[Source], Matrices]
    has_keys: bool = False


# In the order in which they are tried.
FORMATS = (
    Format("SAP2000 or ETABS text", ".TXE, .TXK, .TXM",
           lambda end, _: end in (".txa", ".txe", ".txk", ".txm", ".txc"), read_sap2000),
    Format("CalculiX matrix storage", ".sti, .mas, .dof",
           lambda end, _: end in (".sti", ".mas", ".dof"), read_calculix),
    Format("ANSYS full file", ".full", lambda end, _: end == ".full", read_full),
    Format("Nastran punched matrices (DMIG)", ".pch, .dmig",
           lambda end, head: end in (".pch", ".dmig") or b"\nDMIG" in b"\n" + head,
           read_punch, has_keys=True),
    Format("Abaqus matrix output", "job_STIFn.mtx, job_MASSn.mtx", recognises_abaqus, read_abaqus),
    Format("matrices", ".npz, .mat, .npy, Matrix Market .mtx",
           lambda end, head: end in (".npz", ".mat", ".npy") or head.startswith(b"%%MatrixMarket"),
           read_containers, has_keys=True),
    Format("matrices printed as text (OpenSees)", "a file of rows for each matrix",
           lambda _, head: recognises_rows(head), read_printed),
)  # fmt: skip


@checked
def read_model(
    path: str | Path, mass: str | Path | None = None, *, keys: tuple[str, str] | None = None,
    labels: Sequence[str] | str | Path | None = None, units: str | None = None,
    numbered: bool = False,
) -> ExportedModel:  # fmt: skip
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
        numbered: rows that neither files nor caller label are ``dof 1``, ``dof 2``, … in order.

    Returns:
        The model, whose matrices, labels and geometry :class:`MatrixStructure` takes.

    Raises:
        OSError: a file cannot be read.
        ValueError: the format is not known, a file is damaged, truncated or of another model, the
            matrices are not symmetric, or the units are not known; one line names the file and,
            where there is one, the line.
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
    matrices = known.read(source)
    if numbered and labels is None and matrices.labels is None:
        if units is not None and _system(units)[1] != 1.0:
            raise ValueError(f"units {units!r}: numbers do not say which rows are rotations")
        labels = [f"dof {i}" for i in range(1, matrices.pair[0].shape[0] + 1)]
    model = exported_model(known.program, matrices, labels)
    if units is not None:
        model = in_si(model, units)
    note = mass_note(model)
    return model if note is None else replace(model, notes=(*model.notes, note))


# Consistent systems: units of force in N and of length in m. NIST Special Publication 811:
# 1 lbf = 4.4482216152605 N, 1 in = 0.0254 m, 1 ft = 0.3048 m, 1 kgf = 9.80665 N.
SYSTEMS = {
    "N, m": (1.0, 1.0),
    "N, mm": (1.0, 1e-3),
    "kN, m": (1e3, 1.0),
    "kN, mm": (1e3, 1e-3),
    "kgf, m": (9.80665, 1.0),
    "kgf, cm": (9.80665, 1e-2),
    "lbf, in": (4.4482216152605, 0.0254),
    "lbf, ft": (4.4482216152605, 0.3048),
    "kip, in": (4448.2216152605, 0.0254),
    "kip, ft": (4448.2216152605, 0.3048),
}


def in_si(model: ExportedModel, units: str) -> ExportedModel:
    """The model in N, m and kg; rotations stay in radians."""
    force, length = _system(units)
    if model.labels is None and length != 1.0:
        raise ValueError(
            f"units {units!r}: labels are needed to say which rows are rotations, whose units "
            "are not those of displacements"
        )

    def unit(label: str) -> float:
        """Of a degree of freedom, in m or in radians."""
        return length if direction_of(label) in TRANSLATIONS else 1.0

    # Energies are in units of force times length, of displacements in m and rotations in radians.
    energy = force * length
    by_row = sp.diags_array(1.0 / np.array(list(map(unit, model.labels or [""] * model.size))))
    stiffness, mass = (
        sp.csc_array(energy * (by_row @ each @ by_row)) for each in (model.stiffness, model.mass)
    )
    geometry = model.geometry
    if geometry is not None:
        nodes = {
            name: (length * x, length * y, length * z) for name, (x, y, z) in geometry.nodes.items()
        }
        geometry = replace(geometry, nodes=nodes, unit="m")
    dependent = {
        name: {other: factor * unit(name) / unit(other) for other, factor in of.items()}
        for name, of in model.dependent.items()
    }
    return replace(
        model,
        stiffness=stiffness,
        mass=mass,
        geometry=geometry,
        dependent=dependent,
        units="N, m, kg",
        notes=(*model.notes, f"turned from {units} into N, m, kg; rotations stay in radians"),
    )


def mass_note(model: ExportedModel) -> str | None:
    """The total mass in words, and what it would be in kg if the units were not stated."""
    totals = model.total_mass
    if not totals:
        return None
    shown = ", ".join(f"{value:.4g} in {direction}" for direction, value in totals.items())
    if model.units == "N, m, kg":
        return f"mass that moves, in kg: {shown}"
    largest = max(totals.values())
    usual = [(name, *SYSTEMS[name]) for name in ("N, m", "N, mm", "kN, m")]
    kg = ", ".join(f"{largest * f / length:.4g} kg in {name}" for name, f, length in usual)
    return f"mass that moves: {shown} (that is {kg}; state units= to have N, m, kg)"


def _system(units: str) -> tuple[float, float]:
    require_one_of("units", units, SYSTEMS)
    return SYSTEMS[units]
