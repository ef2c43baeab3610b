"""ANSYS: the assembled matrices of ``jobname.full``, and Harwell-Boeing files of ``HBMAT``.

Programmer's Reference, "Format of the .full file", which ansys-mapdl-reader reads: it states the
upper triangles. Restrained degrees of freedom are rows without entries; those that couplings and
constraint equations make depend on others have none.

I. Duff, R. Grimes, J. Lewis, "Users' Guide for the Harwell-Boeing Sparse Matrix Collection", 1992:
four lines of headings (five where right-hand sides follow), the positions at which columns begin,
the rows of the entries, and the entries, in Fortran formats. Of a symmetric matrix (RSA), the lower
triangle is stated. ``HBMAT, …, YES`` in its last field adds a file ``.mapping``: equation, node and
degree of freedom. scipy reads unsymmetric files without right-hand sides only.
"""

import re
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named
from bayes_ssi.structures.solver_files.exported_model import Matrices, Source
from bayes_ssi.structures.solver_files.solver_text import from_triangle, label, numbered_label

_TYPE = re.compile(rb"[RCP][SUHZR][AE]\s+\d+\s+\d+\s+\d+", re.IGNORECASE)


def read_full(source: Source) -> Matrices:
    """Stiffness and mass by nodes and degrees of freedom, of which those restrained are named."""
    path = source.path
    with optional_package(f"{path}: ansys-mapdl-reader", extra="ansys"):
        from ansys.mapdl.reader.common import read_table
        from ansys.mapdl.reader.full import FullFile
    with damage_named(path):
        file = FullFile(str(path))
        end = 4 * int(file._header["ptrEND"])
    # The library would read beyond the end of a file that ends too early.
    if path.stat().st_size < end:
        raise ValueError(f"{path}: has {path.stat().st_size} of {end} bytes: truncated")
    with damage_named(path):
        places, stiffness, mass = file.load_km(as_sparse=True, sort=False)
        with path.open("rb") as binary:
            for _ in range(2):
                read_table(binary, skip=True)  # the standard header, and that of the file
            freedoms = np.asarray(read_table(binary))
        restrained = np.asarray(file.const).reshape(-1, 2).tolist()
    if stiffness is None or mass is None:
        raise ValueError(f"{path}: holds no stiffness or no mass; was the analysis modal?")
    row_of = {tuple(place): row for row, place in enumerate(places.tolist())}
    return Matrices(
        [from_triangle(sp.csc_array(matrix)) for matrix in (stiffness, mass)],
        (f"{path}: stiffness", f"{path}: mass"),
        # The program numbers UX to ROTZ from 1 to 6; pressure, temperature and more follow.
        labels=[numbered_label(node, int(freedoms[number])) for node, number in places.tolist()],
        removed=[row_of[tuple(place)] for place in restrained if tuple(place) in row_of],
        notes=(
            "degrees of freedom that couplings and constraint equations make depend on others "
            "have no rows",
        ),
    )


def recognises_harwell_boeing(head: bytes) -> bool:
    """Whether the third line states a type and four sizes."""
    lines = head.splitlines()
    return len(lines) > 3 and _TYPE.match(lines[2]) is not None


def read_harwell_boeing(source: Source) -> Matrices:
    """Stiffness and mass of two files, and labels of the mapping if it stands there."""
    files = (source.path, source.needed_mass())
    mapping = source.with_ending(".mapping")
    return Matrices(
        list(map(_matrix, files)),
        files,
        labels=_labels(mapping) if mapping else None,
        notes=("rows are in the order of the solver, without restrained degrees of freedom",),
    )


def _matrix(path: Path) -> sp.csc_array:
    text = path.read_text(encoding="ascii", errors="replace").replace("D", "E").replace("d", "e")
    lines = text.splitlines()
    try:
        counts = [int(each) for each in lines[1].split()]
        kind, *sizes = lines[2].upper().split()
        rows, columns, entries = (int(each) for each in sizes[:3])
    except ValueError:
        raise ValueError(f"{path}: the headings are not those of a Harwell-Boeing file") from None
    if kind not in ("RSA", "RUA") or rows != columns:
        raise ValueError(
            f"{path}: must be real, assembled and square (RSA or RUA), got {kind} of {rows} by "
            f"{columns}"
        )
    first = 5 if len(counts) > 4 and counts[4] > 0 else 4  # below the format of right-hand sides
    try:
        numbers = np.array(" ".join(lines[first : first + sum(counts[1:4])]).split(), dtype=float)
    except ValueError as error:
        raise ValueError(f"{path}: {error}; truncated?") from None
    expected = columns + 1 + 2 * entries
    if len(numbers) != expected or not np.isfinite(numbers).all():
        raise ValueError(
            f"{path}: expected {expected} finite numbers, got {len(numbers)}: truncated?"
        )
    starts, places, values = np.split(numbers, [columns + 1, columns + 1 + entries])
    indices = (places.astype(np.intp) - 1, starts.astype(np.intp) - 1)
    if starts[-1] != entries + 1 or indices[0].min() < 0 or indices[0].max() >= rows:
        raise ValueError(f"{path}: the positions of columns and rows contradict the headings")
    matrix = sp.csc_array((values, *indices), shape=(rows, columns))
    return from_triangle(matrix) if kind == "RSA" else matrix


def _labels(path: Path) -> list[str]:
    labels: list[str] = []
    with path.open(encoding="ascii", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if len(fields) != 3 or not fields[0].isdigit():
                continue
            try:
                if int(fields[0]) != len(labels) + 1:
                    raise ValueError(f"expected equation {len(labels) + 1}, got {fields[0]}")
                labels.append(label(fields[1], fields[2]))
            except ValueError as error:
                raise ValueError(f"{path}: line {number}: {error}") from None
    return labels
