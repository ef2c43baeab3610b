"""The matrices of a model, sums ``Σ c_t(θ) A_t`` of sparse ones, and of the elements on it.

A coefficient c_t is a number times powers of parameters.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, steady_digest
from bayes_ssi.parameters.parameters import Parameter, Product, ProductTable, as_product
from bayes_ssi.structures.finite_elements.elimination_order import fill_reducing_order
from bayes_ssi.structures.finite_elements.model_arguments import Matrix, checked_matrix
from bayes_ssi.structures.finite_elements.sparse_modes import is_semidefinite, rigid_body_modes
from bayes_ssi.structures.matrix_terms import AddedTerm, AffineArray, CarriedElements
from bayes_ssi.structures.modal import FreeBody, NoModesError


@dataclass(frozen=True, eq=False)
class AffineMatrix:
    products: tuple[Product, ...]
    matrices: tuple[Matrix, ...]

    @classmethod
    def of(cls, given: Any, name: str, size: int | None = None) -> "AffineMatrix":
        """Of a user's argument, a matrix, or a list of matrices and pairs (coefficient, matrix)."""
        is_pair = isinstance(given, tuple) and len(given) == 2 and not np.ndim(given[0])
        terms = list(given) if isinstance(given, (list, tuple)) and not is_pair else [given]
        if not terms:
            raise ValueError(f"{name}: no term; give matrices, or pairs (coefficient, matrix)")
        merged: dict[tuple[tuple[Parameter, float], ...], Matrix] = {}
        for number, term in enumerate(terms, start=1):
            where = name if len(terms) == 1 else f"{name}, term {number}"
            pair = term if isinstance(term, (tuple, list)) else (1.0, term)
            if len(pair) != 2:
                raise TypeError(
                    f"{where} must be a matrix or a pair (coefficient, matrix), got {len(pair)} "
                    "items"
                )
            product = as_product(pair[0], f"{where}: the coefficient")
            if not np.isfinite(product.scale):
                raise ValueError(f"{where}: the coefficient must be finite, got {product.scale!r}")
            matrix = checked_matrix(pair[1], f"{where}: the matrix", size)
            size = matrix.shape[0]
            matrix = sp.csc_array(product.scale * matrix)
            if product.powers in merged:
                matrix = sp.csc_array(merged[product.powers] + matrix)
            matrix.eliminate_zeros()
            matrix.sort_indices()
            merged[product.powers] = matrix
        products = tuple(Product(1.0, powers) for powers in merged)
        return cls(products, tuple(merged.values()))

    @property
    def size(self) -> int:
        return int(self.matrices[0].shape[0])

    def coefficients(self, values: FloatArray, parameters: tuple[Parameter, ...]) -> FloatArray:
        """c_t (B, T) at ``values`` (B, n_parameters), whose columns are ``parameters``."""
        return ProductTable(self.products, parameters).evaluate(values)

    def dense(self, parameters: tuple[Parameter, ...]) -> AffineArray:
        return self.projected(np.array([m.toarray() for m in self.matrices]), parameters)

    def projected(self, arrays: FloatArray, parameters: tuple[Parameter, ...]) -> AffineArray:
        """The sum of ``arrays`` (T, ...), such as Vᵀ A_t V, with these coefficients."""
        return AffineArray(ProductTable(self.products, parameters), arrays)

    def at(self, coefficients: FloatArray) -> Matrix:
        """The matrix for coefficients (T,)."""
        each = zip(coefficients.tolist(), self.matrices, strict=True)
        first, *others = (coefficient * matrix for coefficient, matrix in each)
        return sp.csc_array(sum(others, start=first))

    def ordered(self, order: NDArray[np.intp]) -> "AffineMatrix":
        matrices = tuple(sp.csc_array(matrix[order][:, order]) for matrix in self.matrices)
        for matrix in matrices:
            matrix.sort_indices()
        return AffineMatrix(self.products, matrices)

    def with_terms(self, size: int, terms: Iterable[AddedTerm]) -> "AffineMatrix":
        """This matrix, enlarged to ``size`` by zeros, and terms c w wᵀ."""
        products, matrices = list(self.products), [_enlarged(m, size) for m in self.matrices]
        for coefficient, vector, *_ in terms:
            rows, components = np.array(list(vector), dtype=np.intp), np.array([*vector.values()])
            column = sp.csc_array((components, (rows, 0 * rows)), shape=(size, 1))
            products.append(Product(1.0, coefficient.powers))
            matrices.append(sp.csc_array(coefficient.scale * (column @ column.T)))
            matrices[-1].sort_indices()
        return AffineMatrix(tuple(products), tuple(matrices))

    def formula(self, symbol: str) -> str:
        """The sum in symbols: K0 + k1·K1 + k2·K2, beginning with the term without parameters."""
        terms, number = [], 0
        for product in sorted(self.products, key=lambda product: bool(product.powers)):
            number += bool(product.powers)
            factor = f"{repr(product).removeprefix('1 * ')} * " if product.powers else ""
            terms.append(f"{factor}{symbol}{number if factor else 0}")
        return " + ".join(terms).replace(" * ", " · ")

    def __repr__(self) -> str:
        each = zip(self.products, self.matrices, strict=True)
        return " + ".join(
            f"{product!r} * <{_digest(matrix)}>" if product.powers else f"<{_digest(matrix)}>"
            for product, matrix in each
        )


def _enlarged(matrix: Matrix, size: int) -> Matrix:
    """The matrix with further rows and columns of zeros."""
    ends = np.full(size - matrix.shape[0], matrix.indptr[-1], dtype=matrix.indptr.dtype)
    whole = np.concatenate([matrix.indptr, ends])
    return sp.csc_array((matrix.data, matrix.indices, whole), shape=(size, size))


def _digest(matrix: Matrix) -> str:
    """A digest of the entries over √(A_ii A_jj), of displacements and rotations alike."""
    diagonal = np.sqrt(np.abs(matrix.diagonal()))
    # Entries of rows with smaller diagonals may be rounding.
    scale = np.maximum(diagonal, 1e-4 * (diagonal.max(initial=0.0) or 1.0))
    rows, columns = matrix.indices, np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    in_shares = matrix.data / (scale[rows] * scale[columns])
    of_scale = steady_digest(scale, np.arange(len(scale)))
    return steady_digest(in_shares, rows, columns)[:6] + of_scale[:6]


class Coefficients(NamedTuple):
    """c_t(θ) (T,) of the stiffness and d_u(θ) (U,) of the mass, at one θ."""

    stiffness: FloatArray
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class System:
    """K(θ) and M(θ), with their rows in an order that keeps factors sparse; elements come last."""

    stiffness: AffineMatrix  # K + shift·M, of the shift of ``free_body``
    mass: AffineMatrix
    parameters: tuple[Parameter, ...]  # the columns of values
    rows: NDArray[np.intp]  # (n,): row i of the model, as it was given, is row ``rows[i]`` here
    # (n,), displacements when the ground moves by 1; None if not known.
    influence: FloatArray | None
    free_body: FreeBody
    carried: CarriedElements  # the elements on the model; their terms follow its own

    @classmethod
    def of(
        cls,
        stiffness: AffineMatrix,
        mass: AffineMatrix,
        parameters: tuple[Parameter, ...],
        medians: FloatArray,
        influence: FloatArray | None,
        n_modes: int,
    ) -> "System":
        """Order and check the matrices at the prior medians (1, n_parameters)."""
        order = fill_reducing_order(*stiffness.matrices, *mass.matrices)
        stiffness, mass = stiffness.ordered(order), mass.ordered(order)
        k, m = (each.at(each.coefficients(medians, parameters)[0]) for each in (stiffness, mass))
        if not is_semidefinite(m):
            raise NoModesError("the mass matrix is not positive semi-definite")
        n_with_mass = int(np.count_nonzero(np.diff(m.indptr)))
        if n_with_mass < n_modes:
            raise NoModesError(
                f"the mass matrix has mass at {n_with_mass} degrees of freedom, which gives fewer "
                f"modes than the {n_modes} asked for"
            )
        free_body = rigid_body_modes(k, m)
        if free_body.number:
            stiffness = AffineMatrix(
                (*stiffness.products, *mass.products),
                (*stiffness.matrices, *(free_body.shift * each for each in mass.matrices)),
            )
        return cls(
            stiffness,
            mass,
            parameters,
            np.argsort(order),
            None if influence is None else influence[order],
            free_body,
            CarriedElements((), (), (), len(order)),
        )

    def with_elements(
        self, carried: CarriedElements, parameters: tuple[Parameter, ...]
    ) -> "System":
        """The system of the model with elements, whose rows are those of the model as given."""
        carried = carried.ordered(self.rows)
        size = carried.whole_size
        return replace(
            self,
            stiffness=self.stiffness.with_terms(size, carried.springs),
            mass=self.mass.with_terms(size, carried.masses),
            parameters=parameters,
            rows=np.append(self.rows, np.arange(len(self.rows), size)),
            influence=None if self.influence is None else carried.influence(self.influence),
            carried=carried,
        )

    def coefficients(self, values: FloatArray) -> list[Coefficients]:
        """Coefficients of the matrices at every row of ``values`` (B, n_parameters)."""
        both = (each.coefficients(values, self.parameters) for each in (self.stiffness, self.mass))
        return list(map(Coefficients, *both))

    def shifted_matrices(self, values: FloatArray) -> tuple[Matrix, Matrix]:
        """K + shift·M and M at ``values`` (n_parameters,)."""
        (coefficients,) = self.coefficients(values[None])
        for name, numbers in coefficients._asdict().items():
            if not np.isfinite(numbers).all():
                raise NoModesError(f"a coefficient of the {name} matrix is not finite")
        mass = self.mass.at(coefficients.mass)
        if mass.diagonal().min() < 0.0:
            raise NoModesError("the mass matrix has a negative entry on its diagonal")
        return self.stiffness.at(coefficients.stiffness), mass
