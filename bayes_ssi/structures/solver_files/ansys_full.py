"""ANSYS: the assembled matrices of ``jobname.full``, through ansys-mapdl-reader.

Programmer's Reference, "Format of the .full file". The file states the upper triangles. Restrained
degrees of freedom are rows without entries; those that couplings and constraint equations make
depend on others have none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from bayes_ssi.structures.solver_files.directions import DIRECTIONS, label
from bayes_ssi.structures.solver_files.element_faces import from_triangle
from bayes_ssi.structures.solver_files.exported_model import Matrices
from bayes_ssi.structures.solver_files.formats import Format, Source


def _recognises(path: Path, head: bytes) -> bool:  # noqa: ARG001
    return path.suffix.lower() == ".full"


def _read(source: Source) -> Matrices:
    source.refuse_keys()
    path = source.path
    try:
        from ansys.mapdl.reader.common import read_table
        from ansys.mapdl.reader.full import FullFile
    except ImportError:
        raise ValueError(
            f"{path}: ansys-mapdl-reader is not installed; install it with pip install "
            '"bayes_ssi[ansys]"'
        ) from None
    try:
        file = FullFile(str(path))
        _require_whole(path, file._header["ptrEND"])
        places, stiffness, mass = file.load_km(as_sparse=True, sort=False)
        with path.open("rb") as binary:
            for _ in range(2):
                read_table(binary, skip=True)  # the standard header, and that of the file
            freedoms = np.asarray(read_table(binary))
        restrained = np.asarray(file.const).reshape(-1, 2)
    except _TruncatedError as error:
        raise ValueError(str(error)) from None
    except Exception as error:  # a damaged file may raise anything there
        reason = " ".join(str(error).split())
        raise ValueError(
            f"{path}: cannot be read; damaged or truncated? {type(error).__name__}: {reason}"
        ) from error
    if stiffness is None or mass is None:
        raise ValueError(f"{path}: holds no stiffness or no mass; was the analysis modal?")
    return Matrices(
        from_triangle(sp.csc_array(stiffness)),
        from_triangle(sp.csc_array(mass)),
        f"{path}: stiffness",
        f"{path}: mass",
        labels=[_label(node, freedoms[number]) for node, number in places.tolist()],
        removed=_rows(places, restrained),
        notes=(
            "degrees of freedom that couplings and constraint equations make depend on others "
            "have no rows",
        ),
    )


class _TruncatedError(Exception):
    """The file is shorter than its header says."""


def _require_whole(path: Path, end: int) -> None:
    """Refuse a file that ends too early: the library would read beyond its end."""
    size = path.stat().st_size
    if size < 4 * int(end):
        raise _TruncatedError(f"{path}: has {size} of {4 * int(end)} bytes: truncated")


def _label(node: int, number: int) -> str:
    """The program numbers UX to ROTZ from 1 to 6; pressure, temperature and more follow."""
    known = 1 <= number <= len(DIRECTIONS)
    return label(node, int(number)) if known else f"{node} dof{number}"


def _rows(places: Any, restrained: Any) -> Any:
    known = {tuple(place): row for row, place in enumerate(places.tolist())}
    return [known[place] for each in restrained.tolist() if (place := tuple(each)) in known]


FORMAT = Format("ANSYS full file", ".full", _recognises, _read)
