"""Nastran: matrices of OUTPUT4 files, binary or text, dense or sparse, through pyyeti.

MSC Nastran DMAP Programmer's Guide, OUTPUT4. The matrices have names (KAA, MAA, KXX, MXX) and no
labels: which row is which degree of freedom is in other files, such as the punched table of
``EXTSEOUT``. Matrices of the analysis set are without restrained, dependent and condensed degrees
of freedom.
"""

import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named
from bayes_ssi.structures.solver_files.formats import Matrices, Source


def read_op4(source: Source) -> Matrices:
    """Stiffness and mass among the matrices of one file, or of two files with one each."""
    path = source.path
    if source.mass is None:
        files, names = (path, path), _names(path)
        chosen = source.pair(names)
    else:
        k, m = _names(path), _names(source.mass)
        if len(k) != 1 or len(m) != 1:
            raise ValueError(
                f"{path}, {source.mass}: two files must hold one matrix each, got {len(k)} and "
                f"{len(m)}; name one file, and keys="
            )
        source.refuse_keys()
        files, names, chosen = (path, source.mass), (*k, *m), (0, 1)
    pair = [names[i] for i in chosen]
    return Matrices(
        _matrix(files[0], pair[0]),
        _matrix(files[1], pair[1]),
        f"{files[0]}: {pair[0]}",
        f"{files[1]}: {pair[1]}",
        notes=(f"{pair[0]} and {pair[1]}; OUTPUT4 does not label rows",),
    )


def _names(path: Path) -> tuple[str, ...]:
    """Names of the matrices, of which the second of one name becomes "kaa 2"."""
    seen: Counter[str] = Counter()
    names = []
    for name in _load(path, "dir", verbose=False)[0]:
        seen[name.lower()] += 1
        names.append(name if seen[name.lower()] == 1 else f"{name} {seen[name.lower()]}")
    return tuple(names)


def _matrix(path: Path, name: str) -> sp.csc_array:
    position = _names(path).index(name)
    stated = _load(path, "dir", verbose=False)[0]
    before = stated[:position].count(stated[position])
    matrices = _load(path, "listload", namelist=[stated[position]], sparse=True)[1]
    return sp.csc_array(matrices[before])


def _load(path: Path, what: str, **options: object) -> tuple[list, ...]:
    with optional_package(f"{path}: pyyeti", extra="nastran"):
        from pyyeti.nastran.op4 import OP4
    # Names that are none in Python are changed there with a warning, and listed here.
    with damage_named(path), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return getattr(OP4(), what)(str(path), **options)
