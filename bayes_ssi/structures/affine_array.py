"""Sums of fixed matrices times products of parameters, ``K(θ) = Σ c_t(θ) K_t``, for a batch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable


@dataclass(frozen=True)
class AffineArray:
    """``Σ c_t(θ) A_t``: coefficients (products of parameters) times fixed arrays."""

    table: ProductTable
    arrays: FloatArray

    @classmethod
    def of(
        cls,
        terms: Iterable[tuple[Product, FloatArray]],
        parameters: tuple[Parameter, ...],
        shape: tuple[int, ...],
    ) -> AffineArray:
        """Merge terms with the same powers of parameters: all fixed ones become one array."""
        merged: dict[tuple[tuple[Parameter, float], ...], FloatArray] = {}
        for coefficient, array in terms:
            total = merged.setdefault(coefficient.powers, np.zeros(shape))
            total += coefficient.scale * array
        merged = merged or {(): np.zeros(shape)}
        table = ProductTable(tuple(Product(1.0, powers) for powers in merged), parameters)
        arrays = np.array(list(merged.values()))
        arrays.setflags(write=False)
        return cls(table, arrays)

    def evaluate(self, values: FloatArray) -> FloatArray:
        """The sum, (B, *shape); (1, *shape) where nothing depends on the parameters."""
        if self._fixed is not None:
            return self._fixed
        if len(values) == 1:  # numpy would add in another order than in a batch
            return self.evaluate(np.repeat(values, 2, axis=0))[:1]
        entries, arrays = self._not_zero
        coefficients = self.table.evaluate(values)
        total = np.zeros((self.arrays[0].size, len(values)))
        with np.errstate(invalid="ignore"):  # inf · 0 of a value that is not finite
            # A matrix product would round a row differently in a batch of another size.
            total[entries] = np.einsum("bt,tk->kb", coefficients, arrays)
        # A matrix's entries are far apart, and those of the batch next to each other.
        shape = self.arrays.shape[1:]
        return total.reshape(*shape, -1).transpose(-1, *range(len(shape)))

    @cached_property
    def _fixed(self) -> FloatArray | None:
        """The sum, (1, *shape), where nothing depends on the parameters; None elsewhere."""
        if any(product.powers for product in self.table.products):
            return None
        return self.arrays.sum(axis=0, keepdims=True)

    @cached_property
    def _not_zero(self) -> tuple[NDArray[np.intp] | slice, FloatArray]:
        """Which entries of the sum are not always zero, and those of the arrays (T, n_entries)."""
        flat = self.arrays.reshape(len(self.arrays), -1)
        entries = np.flatnonzero(flat.any(axis=0))
        if len(entries) == flat.shape[1]:
            return slice(None), flat
        return entries, flat[:, entries]
