"""Abaqus: the file of ``*SUBSTRUCTURE MATRIX OUTPUT``, nodes and both matrices in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.solver_files.directions import label
from bayes_ssi.structures.solver_files.exported_model import Matrices
from bayes_ssi.structures.solver_files.number_lines import require_whole_lines


def is_substructure(head: bytes) -> bool:
    """Whether a file that begins so is that of a substructure."""
    return b"*USER ELEMENT" in head.upper()


def read_substructure(path: Path) -> Matrices:
    """Stiffness, mass and retained degrees of freedom."""
    require_whole_lines(path)
    nodes: list[int] = []
    freedoms: list[list[int]] = []
    numbers: dict[str, list[str]] = {}
    section = ""
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip().rstrip(",")
            try:
                if text.startswith("**"):
                    if section == "*USER ELEMENT":
                        nodes += _whole(text.lstrip("*"))
                elif text.startswith("*"):
                    section = _section(text)
                elif section == "*USER ELEMENT":
                    freedoms.append(_whole(text))
                elif section:
                    numbers.setdefault(section, []).extend(text.split(","))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    labels = _labels(path, nodes, freedoms)
    stiffness, mass = (_matrix(path, kind, numbers, len(labels)) for kind in ("STIFFNESS", "MASS"))
    return Matrices(
        stiffness,
        mass,
        f"{path}: STIFFNESS",
        f"{path}: MASS",
        labels=labels,
        notes=("the retained degrees of freedom of a substructure, the others condensed",),
    )


def _section(text: str) -> str:
    keyword, *options = (each.strip().upper() for each in text.split(","))
    if keyword == "*USER ELEMENT" and "UNSYM" in options:
        raise ValueError("the substructure is not symmetric")
    if keyword == "*MATRIX":
        return next((each[5:].strip() for each in options if each.startswith("TYPE=")), "")
    return keyword


def _whole(text: str) -> list[int]:
    """Whole numbers between commas; none in a comment of words."""
    fields = [each.strip() for each in text.split(",") if each.strip()]
    return [int(each) for each in fields] if all(each.isdigit() for each in fields) else []


def _labels(path: Path, nodes: list[int], freedoms: list[list[int]]) -> list[str]:
    """The first line lists the degrees of freedom of the first node and those after it.

    A further line begins with the position of the node from which on it holds.
    """
    if not nodes or not freedoms:
        raise ValueError(f"{path}: no nodes or no degrees of freedom after *USER ELEMENT")
    starts = {1: freedoms[0], **{line[0]: line[1:] for line in freedoms[1:] if line}}
    labels, current = [], freedoms[0]
    for position, node in enumerate(nodes, start=1):
        current = starts.get(position, current)
        labels += [
            label(node, number) if number <= 6 else f"{node} dof{number}" for number in current
        ]
    return labels


def _matrix(path: Path, kind: str, numbers: dict[str, list[str]], size: int) -> sp.csc_array:
    if kind not in numbers:
        raise ValueError(f"{path}: no *MATRIX, TYPE={kind}; was it requested?")
    try:
        entries: FloatArray = np.array(numbers[kind], dtype=float)
    except ValueError as error:
        raise ValueError(f"{path}: {kind}: {error}") from None
    rows, columns = np.tril_indices(size)
    if len(entries) != len(rows):
        raise ValueError(
            f"{path}: {kind}: {len(entries)} entries, but {size} degrees of freedom have "
            f"{len(rows)} in the lower triangle: truncated?"
        )
    lower = sp.coo_array((entries, (rows, columns)), shape=(size, size)).tocsc()
    return sp.csc_array(lower + sp.tril(lower, -1).T)
