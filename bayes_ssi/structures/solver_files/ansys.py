"""ANSYS: the assembled matrices of ``jobname.full``.

Programmer's Reference, "Format of the .full file", which ansys-mapdl-reader reads: it states the
upper triangles. Restrained degrees of freedom are rows without entries; those that couplings and
constraint equations make depend on others have none.
"""

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named
from bayes_ssi.structures.solver_files.exported_model import Matrices, Source
from bayes_ssi.structures.solver_files.solver_text import from_triangle, numbered_label


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
