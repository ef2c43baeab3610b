"""Writing netCDF files as arviz lays them out, without importing it, which takes seconds.

A file is made in memory and then written as one piece, because the HDF5 library may crash on a
disk that becomes full.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

# Name of a variable → its dimensions and its values; a coordinate is named as its dimension.
Group = Mapping[str, tuple[Sequence[str], ArrayLike]]


def write_netcdf(path: Path, groups: Mapping[str, Group]) -> None:
    """Write a new netCDF-4 file."""
    import h5netcdf
    import h5py

    in_memory = BytesIO()
    with h5netcdf.File(in_memory, "w") as file:
        for group_name, variables in groups.items():
            group = file.create_group(group_name)
            for name, (dimensions, values) in variables.items():
                array = np.asarray(values)
                if array.dtype.kind == "U":
                    array = array.astype(h5py.string_dtype())
                for dimension, size in zip(dimensions, array.shape, strict=True):
                    if dimension not in group.dimensions:
                        group.dimensions[dimension] = size
                group.create_variable(name, tuple(dimensions), array.dtype, data=array)
    try:
        with path.open("xb") as on_disk:
            on_disk.write(in_memory.getbuffer())
    except OSError as error:
        error.filename = str(path)  # Python names it where opening fails, but not writing
        raise
