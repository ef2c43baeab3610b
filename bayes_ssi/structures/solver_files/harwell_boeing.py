"""Harwell-Boeing files, as ANSYS writes them by ``HBMAT``.

I. Duff, R. Grimes, J. Lewis, "Users' Guide for the Harwell-Boeing Sparse Matrix Collection", 1992:
four lines of headings (five where right-hand sides follow), the positions at which columns begin,
the rows of the entries, and the entries, in Fortran formats. Of a symmetric matrix (RSA), the lower
triangle is stated. ``HBMAT, …, YES`` in its last field adds a file ``.mapping``: equation, node and
degree of freedom. scipy reads unsymmetric files without right-hand sides only.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.structures.solver_files.formats import Matrices, Source
from bayes_ssi.structures.solver_files.row_labels import label
from bayes_ssi.structures.solver_files.text_entries import from_triangle

_TYPE = re.compile(rb"[RCP][SUHZR][AE]\s+\d+\s+\d+\s+\d+", re.IGNORECASE)
# (3E26.18), (1P3D25.16), (8I10): numbers on a line, letter, and width of a number.
_FORMAT = re.compile(r"\(\s*(?:\d*P,?)?\s*(\d*)\s*([IEDFG])\s*(\d+)", re.IGNORECASE)


def recognises_harwell_boeing(head: bytes) -> bool:
    """Whether the third line states a type and four sizes."""
    lines = head.splitlines()
    return len(lines) > 3 and _TYPE.match(lines[2]) is not None


def read_harwell_boeing(source: Source) -> Matrices:
    """Stiffness and mass of two files, and labels of the mapping if it stands there."""
    mass = source.needed_mass()
    mapping = source.with_ending(".mapping")
    return Matrices(
        _matrix(source.path),
        _matrix(mass),
        str(source.path),
        str(mass),
        labels=_labels(mapping) if mapping else None,
        notes=("rows are in the order of the solver, without restrained degrees of freedom",),
    )


def _matrix(path: Path) -> sp.csc_array:
    with path.open(encoding="ascii", errors="replace") as file:
        lines = iter(file)
        try:
            next(lines)
            counts = [int(each) for each in next(lines).split()]
            kind, *sizes = next(lines).split()
            rows, columns, entries = (int(each) for each in sizes[:3])
            formats = _FORMAT.findall(next(lines))
            if len(counts) > 4 and counts[4] > 0:
                next(lines)  # the format of right-hand sides
        except (StopIteration, ValueError):
            raise ValueError(
                f"{path}: the headings are not those of a Harwell-Boeing file"
            ) from None
        if kind.upper() not in ("RSA", "RUA") or rows != columns:
            raise ValueError(
                f"{path}: must be real, assembled and square (RSA or RUA), got {kind} of {rows} by "
                f"{columns}"
            )
        sections = zip(counts[1:4], formats, (columns + 1, entries, entries), strict=False)
        starts, places, values = (_numbers(path, lines, *section) for section in sections)
    indices = (places.astype(np.intp) - 1, starts.astype(np.intp) - 1)
    if starts[-1] != entries + 1 or indices[0].min() < 0 or indices[0].max() >= rows:
        raise ValueError(f"{path}: the positions of columns and rows contradict the headings")
    matrix = sp.csc_array((values, *indices), shape=(rows, columns))
    return from_triangle(matrix) if kind.upper() == "RSA" else matrix


def _numbers(
    path: Path, lines: Iterator[str], count: int, form: tuple[str, str, str], expected: int
) -> FloatArray:
    """The numbers of one section of so many lines."""
    width = int(form[2])
    fields: list[str] = []
    for _ in range(count):
        text = next(lines, "").rstrip("\n").replace("D", "E").replace("d", "e")
        fields += [text[i : i + width] for i in range(0, len(text.rstrip()), width)]
    try:
        numbers: FloatArray = np.array(fields, dtype=float)
    except ValueError as error:
        raise ValueError(f"{path}: {error}; truncated?") from None
    if len(numbers) != expected or not np.isfinite(numbers).all():
        raise ValueError(
            f"{path}: expected {expected} finite numbers in {count} lines, got {len(numbers)}: "
            "truncated?"
        )
    return numbers


def _labels(path: Path) -> list[str]:
    labels: list[str] = []
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if len(fields) != 3 or not fields[0].isdigit():
                continue
            if int(fields[0]) != len(labels) + 1:
                raise ValueError(
                    f"{path}: line {number}: expected equation {len(labels) + 1}, got {fields[0]}"
                )
            try:
                labels.append(label(fields[1], fields[2]))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    return labels
