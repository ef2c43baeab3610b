"""Groups of correlated normal errors of equal size, as arrays of one shape for a whole batch."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray


class ModeOfTest(NamedTuple):
    """A model mode in one test: index of the test, label, and number of the mode from 1."""

    test: int
    label: str
    number: int


class ErrorSizes(NamedTuple):
    """Variance and correlations of errors, (B,) each, or (1,) where they are fixed."""

    variance: FloatArray
    between_tests: FloatArray
    between_modes: FloatArray


class Separation(NamedTuple):
    """How far apart modes are: in different tests or in the same one, and in their numbers.

    Attributes:
        modes: difference of their numbers; infinite for modes of different tests that are not
            correlated.
    """

    tests: FloatArray
    modes: FloatArray

    @classmethod
    def of(
        cls, first: Sequence[ModeOfTest], second: Sequence[ModeOfTest], by_label: bool
    ) -> Separation:
        """Separation (n, m) of modes; in different tests by label alone, or by number."""
        tests = np.array([[float(a.test != b.test) for b in second] for a in first])
        modes = np.array([[_distance(a, b, by_label) for b in second] for a in first])
        shape = len(first), len(second)
        return cls(tests.reshape(shape), modes.reshape(shape))

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """σ² ρ_tests^[t ≠ s] ρ_modes^|i - j|, (B or 1, ...)."""
        variance, tests, modes = (size.reshape(-1, *(1,) * self.tests.ndim) for size in sizes)
        return variance * tests**self.tests * modes**self.modes


def _distance(a: ModeOfTest, b: ModeOfTest, by_label: bool) -> float:
    if by_label and a.test != b.test:
        return 0.0 if a.label == b.label else np.inf
    return abs(a.number - b.number)


def grouped(keys: Iterable[Hashable]) -> list[list[int]]:
    """Positions of equal keys, for keys that occur more than once, in order of appearance."""
    positions: dict[Hashable, list[int]] = {}
    for position, key in enumerate(keys):
        positions.setdefault(key, []).append(position)
    return [own for own in positions.values() if len(own) > 1]


@dataclass(frozen=True, eq=False)
class ErrorGroups:
    """G groups of up to n correlated errors; smaller ones are filled up by nothing.

    Attributes:
        members: (G, n), positions of the errors; 0 where there is none.
        present: (G, n), 1 for an error and 0 where there is none.
        own_variance: (G, n), of what is added to each error alone; 1 where there is none.
        separation: (G, n, n) each.
        dimensions: (G,), of each error.
    """

    members: NDArray[np.intp]
    present: FloatArray
    own_variance: FloatArray
    separation: Separation
    dimensions: FloatArray

    @classmethod
    def of(
        cls,
        groups: Sequence[Sequence[int]],
        modes: Sequence[ModeOfTest],
        own_variance: FloatArray,
        by_label: bool,
        dimensions: Sequence[int],
    ) -> ErrorGroups:
        """Groups of positions in ``modes`` and in ``own_variance`` (N,)."""
        most = max(map(len, groups))
        members = np.array([[*own, *[-1] * (most - len(own))] for own in groups], dtype=np.intp)
        present = members >= 0
        members = np.where(present, members, 0)
        whole = Separation.of(modes, modes, by_label)
        rows, columns = members[:, :, None], members[:, None, :]
        return cls(
            members,
            present.astype(float),
            np.where(present, own_variance[members], 1.0),
            Separation(whole.tests[rows, columns], whole.modes[rows, columns]),
            np.array(dimensions, dtype=float),
        )

    def covariance(self, sizes: ErrorSizes) -> FloatArray:
        """Covariance (B or 1, G, n, n) of the errors with what is added to each."""
        shared = self.separation.covariance(sizes)
        covariance = shared * (self.present[:, :, None] * self.present[:, None, :])
        i = np.arange(self.members.shape[1])
        covariance[:, :, i, i] += self.own_variance
        return covariance

    def of_members(self, errors: FloatArray) -> FloatArray:
        """The errors (B, N, k) of all members, (B, G, n, k), zero where there is none."""
        taken: FloatArray = np.take(errors, self.members, axis=1) * self.present[:, :, None]
        return taken

    def log_ratios(self, errors: FloatArray, sizes: ErrorSizes) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B, G).

        ``errors`` (B, G, n, k); their k components are independent, of which only as many vary
        as the error has dimensions. -inf where the joint covariance is singular.
        """
        covariance = self.covariance(sizes)
        variances = np.einsum("...ii->...i", covariance)
        squares = (errors * errors).sum(axis=3)
        of_each = squares / variances + self.dimensions[:, None] * np.log(variances)
        joint = np.zeros(errors.shape[:2])
        regular = np.ones(joint.shape, dtype=bool)
        # The density of every error given those before it.
        for pivot, residual in conditional_errors(covariance, errors):
            square = (residual * residual).sum(axis=2)
            joint += square / pivot + self.dimensions * np.log(pivot)
            regular &= pivot > 0.0
        single = np.ascontiguousarray(of_each).sum(axis=2)
        return np.where(regular, 0.5 * (single - joint), -np.inf)


def conditional_errors(
    covariance: FloatArray, errors: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Variance (..., ) and residual (..., k) of each of n errors, given those before it."""
    covariance, errors = covariance.copy(), errors.copy()
    for i in range(covariance.shape[-1]):
        variance, residual = covariance[..., i, i], errors[..., i, :]
        yield variance, residual
        row = covariance[..., i, i + 1 :]
        gain = (row / variance[..., None])[..., None]
        errors[..., i + 1 :, :] -= gain * residual[..., None, :]
        covariance[..., i + 1 :, i + 1 :] -= gain * row[..., None, :]
