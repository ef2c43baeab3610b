"""Matrices of npz, MATLAB and Matrix Market files, which are of no one program.

ANSYS writes Matrix Market files, too (``*EXPORT, …, MMF``), in the order of its solver.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.structures.finite_elements.matrix_files import matrix_keys, read_matrix
from bayes_ssi.structures.solver_files.formats import Matrices, Source
from bayes_ssi.structures.solver_files.text_entries import from_triangle

# Under this key, a file of several arrays may hold the labels of all rows.
LABELS = "labels"


def read_containers(source: Source) -> Matrices:
    """Stiffness and mass among the arrays of one file, or of two files with one each."""
    keys = matrix_keys(source.path)
    labels = None
    if keys is None or source.mass is not None:
        source.refuse_keys()
        places: list[tuple[Path, str | None]] = [(source.path, None), (source.needed_mass(), None)]
    else:
        names = [key for key in keys if key != LABELS]
        places = [(source.path, names[i]) for i in source.pair(names)]
        if LABELS in keys:
            labels = [str(each) for each in np.ravel(read_matrix(source.path, LABELS))]
    called = [str(file) if key is None else f"{file}: {key}" for file, key in places]
    stated = [
        _sparse(read_matrix(*place), name) for place, name in zip(places, called, strict=True)
    ]
    whole = [from_triangle(matrix) for matrix in stated]
    notes = tuple(
        f"{name} states one triangle, which is mirrored"
        for name, part, matrix in zip(called, stated, whole, strict=True)
        if matrix.nnz > part.nnz
    )
    return Matrices(whole[0], whole[1], called[0], called[1], labels=labels, notes=notes)


def _sparse(array: Any, name: str) -> sp.csc_array:
    if not sp.issparse(array) and (np.ndim(array) != 2 or array.dtype.kind not in "biufc"):
        raise ValueError(f"{name} must be a matrix of numbers, got shape {np.shape(array)}")
    return sp.csc_array(array)
