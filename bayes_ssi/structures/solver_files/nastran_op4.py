"""Nastran: matrices of OUTPUT4 files, binary or text, dense or sparse, through pyyeti.

MSC Nastran DMAP Programmer's Guide, OUTPUT4. The matrices have names (KAA, MAA, KXX, MXX) and no
labels: which row is which degree of freedom is in other files, such as the punched table of
``EXTSEOUT``. Matrices of the analysis set are without restrained, dependent and condensed degrees
of freedom.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.structures.solver_files.exported_model import Matrices
from bayes_ssi.structures.solver_files.formats import Format, Source
from bayes_ssi.structures.solver_files.named_pairs import chosen_pair, numbered


def _recognises(path: Path, head: bytes) -> bool:  # noqa: ARG001
    return path.suffix.lower() == ".op4"


def _read(source: Source) -> Matrices:
    path = source.path
    if source.mass is not None:
        k, m = _named(path), _named(source.mass)
        if len(k) != 1 or len(m) != 1:
            raise ValueError(
                f"{path}, {source.mass}: two files must hold one matrix each, got {len(k)} and "
                f"{len(m)}; name one file, and keys="
            )
        source.refuse_keys()
        files, chosen = (path, source.mass), (0, 0)
        names = (k[0], m[0])
    else:
        all_names = _named(path)
        chosen = chosen_pair(path, all_names, source.keys)
        files, names = (path, path), (all_names[chosen[0]], all_names[chosen[1]])
    matrices = [_matrix(file, i) for file, i in zip(files, chosen, strict=True)]
    return Matrices(
        matrices[0],
        matrices[1],
        f"{files[0]}: {names[0]}",
        f"{files[1]}: {names[1]}",
        notes=(f"{names[0]} and {names[1]}; OUTPUT4 does not label rows",),
    )


def _named(path: Path) -> tuple[str, ...]:
    from_library = _load(path, "dir", verbose=False)
    return numbered(from_library[0])


def _matrix(path: Path, position: int) -> sp.csc_array:
    name = _load(path, "dir", verbose=False)[0]
    before = name[:position].count(name[position])
    matrix = _load(path, "listload", namelist=[name[position]], sparse=True)[1][before]
    return sp.csc_array(matrix)


def _load(path: Path, what: str, **options: object) -> tuple[list, ...]:
    try:
        from pyyeti.nastran.op4 import OP4
    except ImportError:
        raise ValueError(
            f'{path}: pyyeti is not installed; install it with pip install "bayes_ssi[nastran]"'
        ) from None
    try:
        # Names that are none in Python are changed there with a warning, and listed here.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return getattr(OP4(), what)(str(path), **options)
    except Exception as error:  # a damaged file may raise anything there
        reason = " ".join(str(error).split())
        raise ValueError(
            f"{path}: cannot be read; damaged or truncated? {type(error).__name__}: {reason}"
        ) from error


FORMAT = Format("Nastran OUTPUT4", ".op4", _recognises, _read)
