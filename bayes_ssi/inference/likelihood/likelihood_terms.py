"""What a likelihood is computed from, and what it consists of, at a batch of parameter values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray


class ComparedModes(NamedTuple):
    """The modes of a model at a batch of B parameter values, compared with the identified ones.

    Attributes:
        frequencies_hz: (B, n_modes), of the model.
        shape_distances: (B, n_shape_pairs), 1 - |φ_e·φ| of the pairs whose shape is scored.
        shape_errors: (B, n_shape_pairs · n_sensors), errors of these shapes in the planes that
            touch the sphere at the identified ones, pair by pair; (B, 0) where the errors of the
            data have no joint covariance.
    """

    frequencies_hz: FloatArray
    shape_distances: FloatArray
    shape_errors: FloatArray


class ModalTerms(NamedTuple):
    """Terms of the log-likelihood at a batch of B parameter values, which sum to the whole.

    Attributes:
        frequency: (B, n_pairs), terms of the paired frequencies, p_D included.
        shape: (B, n_shape_pairs), terms of the paired modes whose shape is scored.
        undetected: (B,), terms of the unpaired model modes.
        joint: (B,), log of the joint density of the paired modes' errors over the product of
            single ones; zero where errors are independent.
    """

    frequency: FloatArray
    shape: FloatArray
    undetected: FloatArray
    spurious: float
    joint: FloatArray

    def total(self) -> FloatArray:
        """The log-likelihood (B,)."""
        single = row_sums(self.frequency) + row_sums(self.shape) + self.undetected + self.spurious
        return single + self.joint


def row_sums(terms: FloatArray) -> FloatArray:
    """The sum over the second axis of (B, m) or (B, m, …), the same for a row in any batch.

    numpy adds in an order that depends on the memory layout, which a batch of one may change; here
    one term is added after the other, to all rows at once.
    """
    if not terms.shape[1]:
        return np.zeros((len(terms), *terms.shape[2:]))
    total = np.copy(terms[:, 0])
    for j in range(1, terms.shape[1]):
        total += terms[:, j]
    return total
