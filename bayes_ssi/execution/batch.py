"""Evaluating a model at a batch of points, whatever the model does at some of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from bayes_ssi.arrays import FloatArray

__all__ = ["Evaluated", "Function", "evaluate", "joined"]

# (B, d) coordinates → (B,) log-likelihoods. Row i of the answer depends on row i alone, to the
# last digit: a batch may be evaluated in parts, here or elsewhere.
Function = Callable[[FloatArray], FloatArray]


class Evaluated(NamedTuple):
    """Log-likelihoods of a batch.

    Attributes:
        values: (B,); NaN where the model has no answer.
        failures: row → why, where there is more to say than that the answer was NaN.
    """

    values: FloatArray
    failures: Mapping[int, str]


def evaluate(function: Function, z: FloatArray) -> Evaluated:
    """``function`` at every row of ``z`` (B, d); rows at which it raises are NaN.

    A batch that raises is evaluated again in halves, down to the rows at fault.

    Raises:
        ValueError: it does not return one value a row.
    """
    if not len(z):
        return Evaluated(np.empty(0), {})
    try:
        answer = function(z)
    except Exception as error:  # noqa: BLE001 - whatever a user's model may raise
        if len(z) == 1:
            return Evaluated(np.array([np.nan]), {0: _one_line(error)})
        middle = len(z) // 2
        return joined([evaluate(function, z[:middle]), evaluate(function, z[middle:])])
    values = np.asarray(answer, dtype=float)
    if values.shape != (len(z),):
        raise ValueError(
            f"log-likelihood: expected one value for each of {len(z)} points, "
            f"got shape {values.shape}"
        )
    return Evaluated(values, {})


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def joined(parts: list[Evaluated]) -> Evaluated:
    """Consecutive parts of a batch as one."""
    failures: dict[int, str] = {}
    before = 0
    for part in parts:
        failures.update({before + row: reason for row, reason in part.failures.items()})
        before += len(part.values)
    return Evaluated(np.concatenate([part.values for part in parts]), failures)
