"""Matrices of npz, MATLAB and Matrix Market files, which are of no one program.

ANSYS writes Matrix Market files, too (``*EXPORT, …, MMF``), in the order of its solver.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.structures.finite_elements.matrix_files import matrix_keys, read_matrix
from bayes_ssi.structures.solver_files.directions import label
from bayes_ssi.structures.solver_files.element_faces import from_triangle
from bayes_ssi.structures.solver_files.exported_model import Matrices
from bayes_ssi.structures.solver_files.formats import Format, Source
from bayes_ssi.structures.solver_files.named_pairs import chosen_pair
from bayes_ssi.structures.solver_files.number_lines import require_whole_lines

_LABEL = re.compile(r"(\S.*?)[\s.,;]+(\w+)")


def read_labels(path: Path) -> list[str]:
    """Labels "node direction" of lines such as ``12 x``, ``12 UX``, ``12 1`` or ``12.1``."""
    require_whole_lines(path)
    labels = []
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip()
            if not text:
                continue
            match = _LABEL.fullmatch(text)
            if match is None:
                raise ValueError(
                    f"{path}: line {number}: expected a node and a direction, got {text!r}"
                )
            try:
                labels.append(label(match[1], match[2]))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    return labels


SEVERAL = (".npz", ".mat")
# Under this key, a file of several arrays may hold the labels of all rows.
LABELS = "labels"


def _recognises(path: Path, head: bytes) -> bool:
    return path.suffix.lower() in (*SEVERAL, ".npy") or head.startswith(b"%%MatrixMarket")


def _read(source: Source) -> Matrices:
    keys = matrix_keys(source.path)
    if keys is None or source.mass is not None:
        source.refuse_keys()
        mass = source.needed_mass()
        return _matrices(source.path, None, mass, None, None)
    names = [key for key in keys if key != LABELS]
    k, m = chosen_pair(source.path, names, source.keys)
    labels = None
    if LABELS in keys:
        labels = [str(each) for each in np.ravel(read_matrix(source.path, LABELS))]
    return _matrices(source.path, names[k], source.path, names[m], labels)


def _matrices(
    path: Path, key: str | None, mass: Path, mass_key: str | None, labels: list[str] | None
) -> Matrices:
    named = [
        str(file) if name is None else f"{file}: {name}"
        for file, name in ((path, key), (mass, mass_key))
    ]
    arrays = [
        _sparse(read_matrix(path, key), named[0]),
        _sparse(read_matrix(mass, mass_key), named[1]),
    ]
    mirrored = [from_triangle(each) for each in arrays]
    notes = tuple(
        f"{name} states one triangle, which is mirrored"
        for name, array, whole in zip(named, arrays, mirrored, strict=True)
        if whole.nnz > array.nnz
    )
    return Matrices(mirrored[0], mirrored[1], named[0], named[1], labels=labels, notes=notes)


def _sparse(array: Any, name: str) -> sp.csc_array:
    if not sp.issparse(array) and (np.ndim(array) != 2 or array.dtype.kind not in "biufc"):
        raise ValueError(f"{name} must be a matrix of numbers, got shape {np.shape(array)}")
    return sp.csc_array(array)


FORMAT = Format("matrices", ".npz, .mat, .npy, Matrix Market .mtx", _recognises, _read)
