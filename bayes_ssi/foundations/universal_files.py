"""Universal files, in which programs for vibration tests exchange data."""

from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.packages import optional_package
from bayes_ssi.foundations.text_files import damage_named


def begins_universal(head: bytes) -> bool:
    """Whether a file begins as universal files do, with the delimiter -1 of a data set."""
    return head.split(maxsplit=1)[:1] == [b"-1"]


def read_data_sets(path: Path, *numbers: int) -> list[dict[str, Any]]:
    """The data sets of these numbers, such as 55, as pyuff gives them, in the file's order."""
    file, kinds = _opened(path)
    with damage_named(path):
        return [file.read_sets(i) for i, kind in enumerate(kinds) if kind in numbers]


def has_data_set(path: Path, number: int) -> bool:
    """Whether a universal file has a data set of this number, which is not read."""
    return number in _opened(path)[1]


def _opened(path: Path) -> tuple[Any, list[int]]:
    """A universal file, and the numbers of its data sets."""
    with optional_package("pyuff", extra="uff"):
        import pyuff
    with damage_named(path):
        file = pyuff.UFF(str(path))
        return file, np.atleast_1d(file.get_set_types()).astype(int).tolist()
