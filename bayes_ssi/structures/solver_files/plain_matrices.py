"""Files of matrices alone, which say of their rows no more than an array of labels beside them.

Files of npz, MATLAB and Matrix Market are of no one program; ANSYS writes the last, too
(``*EXPORT, …, MMF``), in the order of its solver.

OpenSees's ``printA -file`` prints one row a line. With ``system FullGeneral`` it is the left-hand
side of the equations: K after a static analysis, and M, C or K after a transient one with
``integrator GimmeMCK m c k`` (M. Scott, "Gimme All Your Damping, All Your Mass and Stiffness Too",
Portwood Digital, 2020; OpenSees documentation, ``printA``). Rows are the equations in the order of
the numberer (``nodeDOFs`` gives them). Six digits are printed unless ``setPrecision`` asks for
more.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.named_arrays import read_arrays
from bayes_ssi.structures.finite_elements.model_arguments import arrays_of, read_matrix
from bayes_ssi.structures.solver_files.exported_model import Matrices, Source, significant_digits
from bayes_ssi.structures.solver_files.solver_text import from_triangle, read_number_lines

# Under this key, a file of several arrays may hold the labels of all rows.
LABELS = "labels"


def read_containers(source: Source) -> Matrices:
    """Stiffness and mass among the arrays of one file, or of two files with one each."""
    arrays, labels = arrays_of(source.path), None
    if "" in arrays or source.mass is not None:
        source.refuse_keys()
        files = (source.path, source.needed_mass())
        called, given = list(map(str, files)), list(map(read_matrix, files))
    else:
        names = [name for name in arrays if name != LABELS]
        chosen = [names[i] for i in source.pair(names)]
        called = [f"{source.path}: {name}" for name in chosen]
        given = [arrays[name] for name in chosen]
        if stated_labels := read_arrays(source.path, [LABELS]):
            labels = [str(each) for each in np.ravel(stated_labels[LABELS])]
    stated = list(map(_sparse, given, called))
    whole = [from_triangle(matrix) for matrix in stated]
    notes = tuple(
        f"{name} states one triangle, which is mirrored"
        for name, part, matrix in zip(called, stated, whole, strict=True)
        if matrix.nnz > part.nnz
    )
    return Matrices(whole, called, labels=labels, notes=notes)


def _sparse(array: Any, name: str) -> sp.csc_array:
    if not sp.issparse(array) and (np.ndim(array) != 2 or array.dtype.kind not in "biufc"):
        raise ValueError(f"{name} must be a matrix of numbers, got shape {np.shape(array)}")
    return sp.csc_array(array)


def recognises_rows(head: bytes) -> bool:
    """Lines of as many numbers each; the file's ending is the user's."""
    lines = [line.split() for line in head.split(b"\n") if line.strip()]
    complete = lines[:-1] if len(head) == 8192 and len(lines) > 1 else lines
    if not complete or any(len(line) != len(complete[0]) for line in complete):
        return False
    try:
        [float(each) for line in complete for each in line]
    except ValueError:
        return False
    return True


def read_printed(source: Source) -> Matrices:
    """Stiffness and mass of two files, and how many digits are printed."""
    files = (source.path, source.needed_mass())
    (stiffness, mass), counts = zip(*map(_printed, files), strict=True)
    digits = max(counts)  # numbers that end in zeros show fewer
    notes = (
        f"{digits} digits are printed; OpenSees prints more after setPrecision 15, which stiff "
        "elements beside soft ones need",
        "the rows are the equations of the numberer",
    )
    return Matrices((stiffness, mass), files, notes=notes)


def _printed(path: Path) -> tuple[sp.csc_array, int]:
    """The matrix, and the largest number of significant digits of an entry."""
    with path.open(encoding="ascii", errors="replace") as file:
        size = len(next((line.split() for line in file if line.strip()), []))
    rows = read_number_lines(path, f"{size} numbers, as in the first row", width=size)
    if len(rows) != size:
        raise ValueError(f"{path}: {len(rows)} rows of {size} numbers: truncated?")
    digits = significant_digits(np.unique(np.abs(rows)))
    return _rounded_alike(sp.csc_array(rows), digits), digits


def _rounded_alike(matrix: sp.csc_array, digits: int) -> sp.csc_array:
    """Halfway between an entry and its transpose where they differ by one in the last digit."""
    difference, size = abs(matrix - matrix.T), abs(matrix).maximum(abs(matrix.T))
    if ((difference - 10.0 ** (1 - digits) * size) > 0.0).nnz:
        return matrix  # not symmetric, which is said where that is checked
    return sp.csc_array(0.5 * (matrix + matrix.T))
