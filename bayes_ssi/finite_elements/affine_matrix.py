"""``Σ c_t(θ) A_t``: sparse matrices times numbers and powers of parameters."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.matrix_files import Matrix, checked_matrix
from bayes_ssi.parameters import Parameter, Product, ProductTable, Value, as_product

__all__ = ["AffineMatrix"]


@dataclass(frozen=True, eq=False)
class AffineMatrix:
    """A matrix that depends on parameters.

    Attributes:
        products: the coefficients c_t, no two with the same powers of parameters.
        matrices: A_t, all of one size.
    """

    products: tuple[Product, ...]
    matrices: tuple[Matrix, ...]

    @classmethod
    def of(cls, given: Any, name: str, size: int | None = None) -> AffineMatrix:
        """From what a user gave: a matrix, or a list of matrices and (coefficient, matrix).

        Raises:
            TypeError: a term is neither.
            ValueError: there is no term, or a matrix is not as
                :func:`~bayes_ssi.finite_elements.matrix_files.checked_matrix` wants it.
        """
        is_pair = isinstance(given, tuple) and len(given) == 2 and not np.ndim(given[0])
        listed = isinstance(given, (list, tuple)) and not is_pair
        terms = list(given) if listed else [given]
        if not terms:
            raise ValueError(f"{name}: no term; give matrices, or pairs (coefficient, matrix)")
        merged: dict[tuple[tuple[Parameter, float], ...], Matrix] = {}
        for number, term in enumerate(terms, start=1):
            where = name if len(terms) == 1 else f"{name}, term {number}"
            coefficient, matrix = _pair(term, where)
            product = as_product(coefficient, f"{where}: the coefficient")
            if not np.isfinite(product.scale):
                raise ValueError(f"{where}: the coefficient must be finite, got {product.scale!r}")
            found = checked_matrix(matrix, f"{where}: the matrix", size)
            size = found.shape[0]
            found = sp.csc_array(product.scale * found)
            known = merged.get(product.powers)
            merged[product.powers] = found if known is None else sp.csc_array(known + found)
        products = tuple(Product(1.0, powers) for powers in merged)
        return cls(products, tuple(merged.values()))

    @property
    def size(self) -> int:
        return int(self.matrices[0].shape[0])

    @property
    def parameters(self) -> list[Parameter]:
        return [p for product in self.products for p in product.parameters]

    def coefficients(self, values: FloatArray, parameters: tuple[Parameter, ...]) -> FloatArray:
        """c_t (B, T) at ``values`` (B, n_parameters), whose columns ``parameters`` are."""
        tables: dict[tuple[Parameter, ...], ProductTable] = self.__dict__.setdefault("_tables", {})
        if parameters not in tables:
            tables[parameters] = ProductTable(self.products, parameters)
        return tables[parameters].evaluate(values)

    @cached_property
    def dense(self) -> FloatArray:
        """A_t (T, n, n); of small matrices."""
        return np.array([matrix.toarray() for matrix in self.matrices])

    def at(self, coefficients: FloatArray) -> Matrix:
        """The matrix for coefficients (T,)."""
        pattern, places = self._layout
        data = np.zeros(pattern.nnz)
        for coefficient, matrix, where in zip(coefficients, self.matrices, places, strict=True):
            data[where] += coefficient * matrix.data
        return sp.csc_array((data, pattern.indices, pattern.indptr), shape=pattern.shape)

    def ordered(self, order: NDArray[np.intp]) -> AffineMatrix:
        """The same with its rows and columns in another order."""
        return AffineMatrix(self.products, tuple(_permuted(m, order) for m in self.matrices))

    @cached_property
    def pattern(self) -> Matrix:
        """Ones wherever a matrix has an entry."""
        total = sum((abs(matrix) for matrix in self.matrices[1:]), start=abs(self.matrices[0]))
        found = sp.csc_array(total)
        found.sort_indices()
        found.data[:] = 1.0
        return found

    @cached_property
    def _layout(self) -> tuple[Matrix, list[NDArray[np.intp]]]:
        """The common pattern, and where in its data those of each matrix go."""
        return self.pattern, [_places(matrix, self.pattern) for matrix in self.matrices]

    def formula(self, symbol: str) -> str:
        """The sum in symbols: K0 + k1·K1 + k2·K2, that without parameters first."""
        found, number = [], 0
        for product in sorted(self.products, key=lambda product: bool(product.powers)):
            number += bool(product.powers)
            factor = f"{repr(product).removeprefix('1 * ')} * " if product.powers else ""
            found.append(f"{factor}{symbol}{number if factor else 0}")
        return " + ".join(found).replace(" * ", " · ")

    def __repr__(self) -> str:
        each = zip(self.products, self.matrices, strict=True)
        return " + ".join(
            f"{product!r} * <{_digest(matrix)}>" if product.powers else f"<{_digest(matrix)}>"
            for product, matrix in each
        )


def _pair(term: Any, where: str) -> tuple[Value, Any]:
    if not isinstance(term, (tuple, list)):
        return 1.0, term
    if len(term) == 2:
        return term[0], term[1]
    raise TypeError(
        f"{where} must be a matrix or a pair (coefficient, matrix), got {len(term)} items"
    )


def _permuted(matrix: Matrix, order: Sequence[int] | NDArray[np.intp]) -> Matrix:
    found = sp.csc_array(matrix[order][:, order])
    found.sort_indices()
    return found


def _places(matrix: Matrix, pattern: Matrix) -> NDArray[np.intp]:
    """Where the entries of a matrix are among those of a pattern that holds them all."""
    n = pattern.shape[0]
    keys = []
    for each in (pattern, matrix):
        columns = np.repeat(np.arange(n, dtype=np.int64), np.diff(each.indptr))
        keys.append(columns * n + each.indices)
    return np.searchsorted(keys[0], keys[1])


def _digest(matrix: Matrix) -> str:
    hashed = hashlib.sha256()
    for part in (matrix.indptr, matrix.indices, matrix.data):
        hashed.update(np.ascontiguousarray(part).tobytes())
    return hashed.hexdigest()[:12]
