"""Abaqus: text files of ``*MATRIX OUTPUT``.

``*MATRIX GENERATE, STIFFNESS, MASS`` and ``*MATRIX OUTPUT, STIFFNESS, MASS`` write
``job_STIFn.mtx`` and ``job_MASSn.mtx``, n being the step (Abaqus Analysis Guide, "Generating
matrices"; Keywords Guide, ``*MATRIX INPUT``). Each line has, separated by commas, the node and
degree of freedom of a row, those of a column, and the entry (FORMAT=MATRIX INPUT, the default, or
LABELS); of a symmetric matrix one triangle or both. Restrained degrees of freedom have 1e36 on the
diagonal of the stiffness. Nodes numbered 0 or less are Abaqus's own (multipliers of constraints).
"""

import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.solver_files.formats import Matrices, Source, file_named
from bayes_ssi.structures.solver_files.input_decks import geometry_of_deck
from bayes_ssi.structures.solver_files.row_labels import INTERNAL, numbered_label
from bayes_ssi.structures.solver_files.text_entries import (
    matrix_of_entries,
    read_number_lines,
    whole_numbers,
)

_LABELLED = "row node, its degree of freedom, column node, its degree of freedom, entry"
_STIFFNESS_NAME = re.compile(r"_STIF(?=\d+$)", re.IGNORECASE)
_STEP = re.compile(r"_STIF\d+$", re.IGNORECASE)


def recognises_abaqus(suffix: str, head: bytes) -> bool:
    """By its ending, which is that of Matrix Market files as well."""
    return suffix == ".mtx" and not head.startswith(b"%%MatrixMarket")


def read_abaqus(source: Source) -> Matrices:
    """Stiffness and mass by their labels."""
    path = source.path
    by_name = file_named(path, _STIFFNESS_NAME.sub("_MASS", path.stem) + path.suffix)
    mass = source.mass or (by_name if by_name and by_name.name != path.name else None)
    if mass is None:
        raise ValueError(
            f"{path}: name the file of the stiffness, job_STIFn.mtx, in whose folder job_MASSn.mtx "
            "stands, or both"
        )
    try:
        stiffness_entries, mass_entries = (
            read_number_lines(each, _LABELLED, delimiter=",", comment="*") for each in (path, mass)
        )
    except ValueError as error:
        raise ValueError(
            f"{error}; of Abaqus's formats, *MATRIX OUTPUT with FORMAT=MATRIX INPUT is read"
        ) from None
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
        removed=np.flatnonzero(stiffness.diagonal() >= 1e36),
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
