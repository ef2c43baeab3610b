"""A structure given by its matrices: K(θ) = Σ c_i(θ) K_i and M(θ) = Σ d_j(θ) M_j.

The matrices are those of any finite-element program, sparse or dense, as it wrote them
(:func:`~bayes_ssi.finite_elements.matrix_files.read_matrix`); a coefficient is a number times
powers of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.finite_elements.matrix_files import Matrix
from bayes_ssi.finite_elements.named_rows import Sensors, named_rows
from bayes_ssi.finite_elements.one_by_one import OneByOne, Solved
from bayes_ssi.finite_elements.reduced_structure import ReducedStructure
from bayes_ssi.finite_elements.reducible_structure import ReducibleStructure, System
from bayes_ssi.finite_elements.sparse_factors import (
    NoModesError,
    count_below,
    fill_reducing_order,
    is_semidefinite,
)
from bayes_ssi.finite_elements.sparse_modes import (
    DENSE_BELOW,
    SparseModes,
    dense_modes,
    frequencies_hz,
    lowest_modes,
    require_held,
)
from bayes_ssi.modal import ModalModel, Modes
from bayes_ssi.parameters import Parameter, collect_parameters

__all__ = ["MatrixStructure"]

# How far above the highest frequency of interest modes are computed: they come down from there
# as parameters change.
MARGIN = 0.2
# Structures with fewer degrees of freedom are solved a batch at a time.
AT_ONCE_BELOW = 40
# Of the largest eigenvalue: smaller ones may be no more than rounding.
ROUNDING = 1e-12


class MatrixStructure(OneByOne, ReducibleStructure):
    """A finite-element model whose matrices are sums of fixed ones times products of parameters.

    Every set of parameter values costs a full eigen-solution, milliseconds for thousands of
    degrees of freedom and seconds for a hundred thousand; :meth:`reduced` is what to sample with.
    """

    def __init__(
        self,
        stiffness: Any,
        mass: Any,
        *,
        sensors: Sensors | None = None,
        labels: Sequence[str] | None = None,
        n_modes: int | None = None,
        up_to_hz: float | None = None,
        influence: ArrayLike | None = None,
    ) -> None:
        """Say what the matrices are, and where the structure is looked at.

        Args:
            stiffness: K: a matrix, or a list of matrices and of pairs (coefficient, matrix), which
                are summed. A coefficient is a number, a Parameter, or a product such as
                ``12.5 * thickness**3``; a matrix is scipy's or an array (n, n), symmetric.
            mass: M, in the same way; it may be singular (degrees of freedom without inertia).
            sensors: name → number, from 0, or label of a degree of freedom; or a list of labels;
                all degrees of freedom if None, where they are no more than a thousand.
            labels: of all degrees of freedom.
            n_modes: how many of the lowest modes there are to be.
            up_to_hz: instead of ``n_modes``: as many as lie below this frequency at the prior
                medians, and below a fifth more.
            influence: (n,), how every degree of freedom moves when the ground moves by 1 and
                nothing deforms; needed for responses to ground motion only.

        Raises:
            ValueError, TypeError: one of these is not as it should be; the message says which.
        """
        try:
            self._stiffness = AffineMatrix.of(stiffness, "stiffness")
            self._mass = AffineMatrix.of(mass, "mass", self._stiffness.size)
            n = self._stiffness.size
            self._names, self._rows = named_rows(n, labels, sensors)
            self._parameters = collect_parameters(
                [*self._stiffness.parameters, *self._mass.parameters]
            )
            self._n_modes, self._up_to_hz = _checked_number(n_modes, up_to_hz, n)
            self._influence = _checked_influence(influence, n)
        except (TypeError, ValueError) as wrong:
            raise type(wrong)(f"MatrixStructure: {wrong}") from None

    def reduced(self, **options: Any) -> ReducedStructure:
        """The same model in a reduced basis, thousands of times faster, its error certified.

        Args:
            options: those of
                :class:`~bayes_ssi.finite_elements.reduced_structure.ReducedStructure`.
        """
        return ReducedStructure(self, **options)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """Those that are looked at: the sensors, or all."""
        return self._names

    @property
    def size(self) -> int:
        return self._stiffness.size

    @cached_property
    def n_modes(self) -> int:
        """As asked for, or as many as lie in the band and a margin at the prior medians.

        Raises:
            ValueError: none lies there.
        """
        if self._n_modes is not None:
            return self._n_modes
        assert self._up_to_hz is not None
        shift = (2.0 * math.pi * (1.0 + MARGIN) * self._up_to_hz) ** 2
        found = count_below(*self.matrices(self.prior_medians()[0]), shift)
        if not found:
            raise ValueError(
                f"MatrixStructure: up_to_hz: no mode below {1.0 + MARGIN:g} times "
                f"{self._up_to_hz:g} Hz at the prior medians; are the units right?"
            )
        return found

    def modes(self, values: FloatArray) -> Modes:
        found = self._all_at_once(values) if self.size <= AT_ONCE_BELOW else None
        return super().modes(values) if found is None else found

    def _all_at_once(self, values: FloatArray) -> Modes | None:
        """The modes of very small matrices, of a whole batch; None where a row has none.

        None as well where M is singular: one by one that is no hindrance.
        """
        try:
            stiffness, mass = (
                np.einsum("bt,tij->bij", each.coefficients(values, self.parameters), each.dense)
                for each in (self.system.stiffness, self.system.mass)
            )
            inverse = np.linalg.inv(np.linalg.cholesky(mass))
            transposed = inverse.transpose(0, 2, 1)
            eigenvalues, vectors = np.linalg.eigh(inverse @ stiffness @ transposed)
        except (NoModesError, np.linalg.LinAlgError):
            return None
        if not np.all(eigenvalues[:, 0] > ROUNDING * eigenvalues[:, -1]):
            return None
        n = self.n_modes
        shapes = (transposed @ vectors)[:, self.system.sensor_rows, :n]
        return Modes(frequencies_hz(eigenvalues[:, :n]), shapes)

    def solved(self, values: FloatArray) -> Solved:
        n = self.n_modes
        if self.size > DENSE_BELOW:
            modes = self.full_modes(values)
        else:
            of_stiffness, of_mass = self._coefficients(values)
            stiffness = np.tensordot(of_stiffness, self.system.stiffness.dense, 1)
            modes = dense_modes(stiffness, np.tensordot(of_mass, self.system.mass.dense, 1), n)
            require_held(stiffness, modes.vectors[:, 0])
        return frequencies_hz(modes.eigenvalues[:n]), modes.vectors[self.system.sensor_rows, :n]

    def full_modes(self, values: FloatArray, extra: int = 0) -> SparseModes:
        """A full solution at ``values`` (n_parameters,), rows as in :attr:`system`.

        It holds ``extra`` modes more than :attr:`n_modes`, where there are so many, or more.

        Raises:
            NoModesError: K is not positive definite, or modes cannot be found or be counted.
        """
        return lowest_modes(*self.matrices(values), self.n_modes, extra)

    def description(self) -> Mapping[str, Any]:
        up_to = f", those up to {self._up_to_hz:g} Hz and a margin" if self._up_to_hz else ""
        return {
            "size": f"{self.size} degrees of freedom, {len(self._names)} of them observed",
            "stiffness": self._stiffness.formula("K"),
            "mass": self._mass.formula("M"),
            "modes": f"the lowest {self.n_modes}{up_to}",
        }

    def modal_model(self, values: FloatArray) -> ModalModel:
        """As :meth:`Structure.modal_model`.

        Raises:
            TypeError: the structure was not given ``influence``.
        """
        influence = self.require_influence()
        found = [self._remembered("response", row, self._response_of) for row in values]
        return ModalModel(
            np.array([frequencies for frequencies, _, _ in found]),
            np.array([shapes for _, shapes, _ in found]),
            np.array([participation for _, _, participation in found]),
            influence[self.system.sensor_rows],
        )

    def matrices(self, values: FloatArray) -> tuple[Matrix, Matrix]:
        """K and M at ``values`` (n_parameters,), rows as in :attr:`system`.

        Raises:
            NoModesError: a coefficient is not finite, or a mass on the diagonal is negative.
        """
        of_stiffness, of_mass = self._coefficients(values)
        mass = self.system.mass.at(of_mass)
        if mass.diagonal().min() < 0.0:
            raise NoModesError("the mass matrix has a negative entry on its diagonal")
        return self.system.stiffness.at(of_stiffness), mass

    def _coefficients(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Those of the stiffness and of the mass at ``values`` (n_parameters,)."""
        system, parameters = self.system, self.parameters
        found = (
            system.stiffness.coefficients(values[None], parameters)[0],
            system.mass.coefficients(values[None], parameters)[0],
        )
        for name, coefficients in zip(("stiffness", "mass"), found, strict=True):
            if not np.isfinite(coefficients).all():
                raise NoModesError(f"a coefficient of the {name} matrix is not finite")
        return found

    @cached_property
    def system(self) -> System:
        """The matrices in a good order, checked at the prior medians.

        Raises:
            NoModesError: M is not positive semi-definite, or has mass at too few places.
        """
        pattern = self._stiffness.pattern + self._mass.pattern
        # Of a matrix with this pattern that is surely positive definite.
        row_sums = np.asarray(pattern.sum(axis=1)).ravel()
        order = fill_reducing_order(sp.csc_array(sp.diags_array(row_sums + 1.0) - pattern))
        place = np.argsort(order)
        system = System(
            self._stiffness.ordered(order),
            self._mass.ordered(order),
            place[self._rows],
            None if self._influence is None else self._influence[order],
        )
        mass = system.mass
        at_medians = mass.at(mass.coefficients(self.prior_medians(), self.parameters)[0])
        if not is_semidefinite(at_medians):
            raise NoModesError("the mass matrix is not positive semi-definite")
        n_with_mass = int(np.count_nonzero(np.diff(at_medians.indptr)))
        wanted = self._n_modes or 1
        if n_with_mass < wanted:
            raise NoModesError(
                f"the mass matrix has mass at {n_with_mass} degrees of freedom, which gives fewer "
                f"modes than the {wanted} asked for"
            )
        return system

    def _response_of(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        modes, n = self.full_modes(values), self.n_modes
        _, mass = self.matrices(values)
        participation = modes.vectors[:, :n].T @ (mass @ self.require_influence())
        shapes = modes.vectors[self.system.sensor_rows, :n]
        return frequencies_hz(modes.eigenvalues[:n]), shapes, participation

    def __repr__(self) -> str:
        modes = f"n_modes={self._n_modes}" if self._n_modes else f"up_to_hz={self._up_to_hz}"
        places = dict(zip(self._names, self._rows.tolist(), strict=True))
        return (
            f"MatrixStructure(stiffness={self._stiffness!r}, mass={self._mass!r}, "
            f"sensors={places}, {modes})"
        )


def _checked_number(
    n_modes: int | None, up_to_hz: float | None, n: int
) -> tuple[int | None, float | None]:
    if (n_modes is None) == (up_to_hz is None):
        raise ValueError("give either n_modes or up_to_hz, to say how many modes are computed")
    if n_modes is None:
        if not (isinstance(up_to_hz, (int, float)) and 0 < up_to_hz < math.inf):
            raise ValueError(f"up_to_hz must be a positive frequency in Hz, got {up_to_hz!r}")
        return None, float(up_to_hz)
    if not isinstance(n_modes, Integral) or isinstance(n_modes, bool) or not 1 <= n_modes <= n:
        raise ValueError(
            f"n_modes must be a whole number from 1 to {n}, the degrees of freedom, got {n_modes!r}"
        )
    return int(n_modes), None


def _checked_influence(influence: ArrayLike | None, n: int) -> FloatArray | None:
    if influence is None:
        return None
    found = np.array(influence, dtype=float)
    if found.shape != (n,) or not np.isfinite(found).all():
        raise ValueError(
            f"influence must be {n} finite numbers, one a degree of freedom, got "
            f"shape {found.shape}"
        )
    found.setflags(write=False)
    return found
