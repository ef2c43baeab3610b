"""The matrices of a finite-element model and of the elements on it, as solvers take them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.carried_elements import CarriedElements
from bayes_ssi.structures.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.structures.finite_elements.matrix_files import Matrix
from bayes_ssi.structures.finite_elements.sparse_factors import fill_reducing_order, is_semidefinite
from bayes_ssi.structures.finite_elements.sparse_modes import rigid_body_modes
from bayes_ssi.structures.modal import FreeBody, NoModesError


class Coefficients(NamedTuple):
    """c_t(θ) (T,) of the stiffness and d_u(θ) (U,) of the mass, at one θ."""

    stiffness: FloatArray
    mass: FloatArray


@dataclass(frozen=True, eq=False)
class System:
    """K(θ) and M(θ), with their rows in an order that keeps factors sparse; elements come last.

    Attributes:
        stiffness: K + shift·M, of the shift of ``free_body``.
        parameters: the columns of values.
        rows: (n,): row i of the model, as it was given, is row ``rows[i]`` here.
        influence: (n,), displacements when the ground moves by 1; None if not known.
        carried: the elements on the model; their terms follow its own.
    """

    stiffness: AffineMatrix
    mass: AffineMatrix
    parameters: tuple[Parameter, ...]
    rows: NDArray[np.intp]
    influence: FloatArray | None
    free_body: FreeBody
    carried: CarriedElements

    @classmethod
    def of(
        cls,
        stiffness: AffineMatrix,
        mass: AffineMatrix,
        parameters: tuple[Parameter, ...],
        medians: FloatArray,
        influence: FloatArray | None,
        n_modes: int,
    ) -> System:
        """Order and check the matrices at the prior medians (1, n_parameters).

        Raises:
            NoModesError: M is not positive semi-definite, or gives fewer modes than ``n_modes``.
        """
        pattern = stiffness.pattern + mass.pattern
        # From a diagonally dominant matrix with this pattern, which is positive definite.
        row_sums = np.asarray(pattern.sum(axis=1)).ravel()
        order = fill_reducing_order(sp.csc_array(sp.diags_array(row_sums + 1.0) - pattern))
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

    def with_elements(self, carried: CarriedElements, parameters: tuple[Parameter, ...]) -> System:
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
        of_stiffness, of_mass = (
            each.coefficients(values, self.parameters) for each in (self.stiffness, self.mass)
        )
        return list(map(Coefficients, of_stiffness, of_mass))

    def shifted_matrices(self, values: FloatArray) -> tuple[Matrix, Matrix]:
        """K + shift·M and M at ``values`` (n_parameters,).

        Raises:
            NoModesError: a coefficient is not finite, or a mass on the diagonal is negative.
        """
        (coefficients,) = self.coefficients(values[None])
        for name, numbers in coefficients._asdict().items():
            if not np.isfinite(numbers).all():
                raise NoModesError(f"a coefficient of the {name} matrix is not finite")
        mass = self.mass.at(coefficients.mass)
        if mass.diagonal().min() < 0.0:
            raise NoModesError("the mass matrix has a negative entry on its diagonal")
        return self.stiffness.at(coefficients.stiffness), mass
