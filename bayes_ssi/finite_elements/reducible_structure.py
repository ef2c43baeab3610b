"""The matrices and full solutions of a finite-element model, as a reduced basis needs them."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.finite_elements.matrix_files import Matrix
from bayes_ssi.finite_elements.sparse_factors import fill_reducing_order, is_semidefinite
from bayes_ssi.finite_elements.sparse_modes import DENSE_UP_TO, lowest_modes
from bayes_ssi.modal import Eigenpairs, NoModesError
from bayes_ssi.parameters import Parameter, collect_parameters
from bayes_ssi.structures.structure import Structure


class Coefficients(NamedTuple):
    """c_t(θ) (T,) of the stiffness and d_u(θ) (U,) of the mass, at one θ."""

    stiffness: FloatArray
    mass: FloatArray


class System(NamedTuple):
    """The matrices of a model, with their rows in an order that keeps factors sparse.

    Attributes:
        stiffness, mass: the matrices, with reordered rows.
        sensor_rows: rows of the sensors.
        influence: (n,), displacements when the ground moves by 1; None if not known.
    """

    stiffness: AffineMatrix
    mass: AffineMatrix
    sensor_rows: NDArray[np.intp]
    influence: FloatArray | None


class ReducibleStructure(Structure):
    """A model whose matrices are sums of fixed ones times products of parameters."""

    def __init__(
        self,
        stiffness: AffineMatrix,
        mass: AffineMatrix,
        sensors: tuple[tuple[str, ...], NDArray[np.intp]],
        n_modes: int | None,
        influence: FloatArray | None,
    ) -> None:
        """Keep the matrices; ``sensors`` are names and rows, ``n_modes`` None if not known yet."""
        self._stiffness, self._mass, self._influence = stiffness, mass, influence
        self._names, self._rows = sensors
        self._n_modes = n_modes
        self._parameters = collect_parameters([*stiffness.parameters, *mass.parameters])

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """The measured degrees of freedom (the sensors), or all."""
        return self._names

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the matrices."""
        return self._stiffness.size

    @cached_property
    def system(self) -> System:
        """The matrices in a good order, checked at the prior medians.

        Raises:
            NoModesError: M is not positive semi-definite, or has mass at too few places.
        """
        pattern = self._stiffness.pattern + self._mass.pattern
        # From a diagonally dominant matrix with this pattern, which is positive definite.
        row_sums = np.asarray(pattern.sum(axis=1)).ravel()
        order = fill_reducing_order(sp.csc_array(sp.diags_array(row_sums + 1.0) - pattern))
        system = System(
            self._stiffness.ordered(order),
            self._mass.ordered(order),
            np.argsort(order)[self._rows],
            None if self._influence is None else self._influence[order],
        )
        mass = system.mass
        at_medians = mass.at(mass.coefficients(self.prior_medians(), self.parameters)[0])
        if not is_semidefinite(at_medians):
            raise NoModesError("the mass matrix is not positive semi-definite")
        n_with_mass = int(np.count_nonzero(np.diff(at_medians.indptr)))
        required = self._n_modes or 1
        if n_with_mass < required:
            raise NoModesError(
                f"the mass matrix has mass at {n_with_mass} degrees of freedom, which gives fewer "
                f"modes than the {required} asked for"
            )
        return system

    def coefficients(self, values: FloatArray) -> list[Coefficients]:
        """Coefficients of the matrices at every row of ``values`` (B, n_parameters)."""
        of_stiffness, of_mass = (
            each.coefficients(values, self.parameters)
            for each in (self.system.stiffness, self.system.mass)
        )
        return list(map(Coefficients, of_stiffness, of_mass))

    def matrices(self, values: FloatArray) -> tuple[Matrix, Matrix]:
        """K and M at ``values`` (n_parameters,), rows as in :attr:`system`.

        Raises:
            NoModesError: a coefficient is not finite, or a mass on the diagonal is negative.
        """
        (coefficients,) = self.coefficients(values[None])
        for name, numbers in coefficients._asdict().items():
            if not np.isfinite(numbers).all():
                raise NoModesError(f"a coefficient of the {name} matrix is not finite")
        mass = self.system.mass.at(coefficients.mass)
        if mass.diagonal().min() < 0.0:
            raise NoModesError("the mass matrix has a negative entry on its diagonal")
        return self.system.stiffness.at(coefficients.stiffness), mass

    def full_modes(self, values: FloatArray, extra: int = 0) -> Eigenpairs:
        """A full solution at ``values`` (n_parameters,), rows as in :attr:`system`.

        It has ``extra`` modes more than :attr:`n_modes`, as far as the model has them.

        Raises:
            NoModesError: there are fewer than :attr:`n_modes`, or they cannot be counted.
        """
        return lowest_modes(*self.matrices(values), self.n_modes, extra)

    def require_influence(self) -> FloatArray:
        """Influence of ground motion (n,), rows as in :attr:`system`.

        Raises:
            TypeError: it is not known.
        """
        if self.system.influence is None:
            raise TypeError(
                f"{type(self).__name__}: how its degrees of freedom follow the ground is not "
                "known, so its response cannot be computed; give influence=, one number a degree "
                "of freedom (1 for a displacement in the direction of the ground motion, else 0)"
            )
        return self.system.influence

    @property
    def performance_hint(self) -> str:
        """Advice on sampling it much faster, as a sentence; empty where it is fast enough."""
        if self.size <= DENSE_UP_TO:
            return ""
        return (
            f"{self.size} degrees of freedom, solved in full tens of thousands of times; "
            f"{type(self).__name__}.reduced() needs dozens of full solutions"
        )
