"""Evaluation of a model at a batch of points, some of which may fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.error_places import with_place

# (B, d) coordinates → (B,) log-likelihoods. Row i of the answer depends on row i alone, to the
# last digit: a batch may be evaluated in parts, here or elsewhere.
Function = Callable[[FloatArray], FloatArray]


class Evaluated(NamedTuple):
    """What a model answers at a batch of points.

    Attributes:
        values: (B,) log-likelihoods, or (B, n_columns); NaN where the model failed.
        failures: row → reason, where one is known beyond that the answer was NaN.
    """

    values: FloatArray
    failures: Mapping[int, str]


def evaluate(function: Function, z: FloatArray, n_columns: int | None = None) -> Evaluated:
    """``function`` at every row of ``z`` (B, d); rows at which it raises are NaN.

    A batch that raises is halved repeatedly, down to the rows at fault.

    Args:
        n_columns: number of values that it returns for each row; None if it is one, (B,).
    """
    of_row = () if n_columns is None else (n_columns,)
    values = np.full((len(z), *of_row), np.nan)
    failures: dict[int, str] = {}
    parts = [(0, len(z))] if len(z) else []
    while parts:
        begin, end = parts.pop()
        try:
            answer = function(z[begin:end])
        except Exception as error:  # noqa: BLE001 - whatever a user's model may raise
            middle = (begin + end) // 2
            if begin == middle:
                failures[begin] = with_place(error)
            else:
                parts += [(middle, end), (begin, middle)]
            continue
        part = np.asarray(answer, dtype=float)
        if part.shape != (end - begin, *of_row):
            expected = "one value" if n_columns is None else f"{n_columns} values"
            raise ValueError(
                f"log-likelihood: expected {expected} for each of {end - begin} points, "
                f"got shape {part.shape}"
            )
        values[begin:end] = part
    return Evaluated(values, failures)


@dataclass(frozen=True)
class SafeFunction:
    """:func:`evaluate` of one function."""

    function: Function
    n_columns: int | None = None

    def __call__(self, z: FloatArray) -> Evaluated:
        return evaluate(self.function, z, self.n_columns)
