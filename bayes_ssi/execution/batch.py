"""Evaluation of a model at a batch of points, some of which may fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.error_places import with_place

# (B, d) coordinates → (B,) log-likelihoods. Row i of the answer depends on row i alone, to the
# last digit: a batch may be evaluated in parts, here or elsewhere.
Function = Callable[[FloatArray], FloatArray]


class Evaluated(NamedTuple):
    """Log-likelihoods of a batch.

    Attributes:
        values: (B,); NaN where the model failed.
        failures: row → reason, where one is known beyond that the answer was NaN.
    """

    values: FloatArray
    failures: Mapping[int, str]


def evaluate(function: Function, z: FloatArray) -> Evaluated:
    """``function`` at every row of ``z`` (B, d); rows at which it raises are NaN.

    A batch that raises is halved repeatedly, down to the rows at fault.

    Raises:
        ValueError: it does not return one value per row.
    """
    values = np.full(len(z), np.nan)
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
        if part.shape != (end - begin,):
            raise ValueError(
                f"log-likelihood: expected one value for each of {end - begin} points, "
                f"got shape {part.shape}"
            )
        values[begin:end] = part
    return Evaluated(values, failures)


@dataclass(frozen=True)
class SafeFunction:
    """:func:`evaluate` of one function."""

    function: Function

    def __call__(self, z: FloatArray) -> Evaluated:
        return evaluate(self.function, z)
