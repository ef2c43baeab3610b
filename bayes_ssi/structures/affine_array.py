"""Sums of fixed matrices times products of parameters, ``K(θ) = Σ c_t(θ) K_t``, for a batch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.parameters import Parameter, Product, ProductTable


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
        n_terms, *shape = self.arrays.shape
        if not any(product.powers for product in self.table.products):
            return self.arrays.sum(axis=0, keepdims=True)
        coefficients = self.table.evaluate(values)
        with np.errstate(invalid="ignore"):  # inf · 0 of a value that is not finite
            # A matrix product would round a row differently in a batch of another size.
            total = np.einsum("bt,tk->bk", coefficients, self.arrays.reshape(n_terms, -1))
            return total.reshape(-1, *shape)
