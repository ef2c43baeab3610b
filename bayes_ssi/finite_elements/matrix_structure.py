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
from bayes_ssi.finite_elements.pointwise_structure import PointwiseStructure
from bayes_ssi.finite_elements.reduced_structure import ReducedStructure
from bayes_ssi.finite_elements.reducible_structure import ReducibleStructure, System
from bayes_ssi.finite_elements.sensor_rows import Sensors, sensor_rows
from bayes_ssi.finite_elements.sparse_factors import (
    count_below,
    fill_reducing_order,
    is_semidefinite,
)
from bayes_ssi.finite_elements.sparse_modes import lowest_modes
from bayes_ssi.modal import (
    BATCHED_UP_TO,
    Eigenpairs,
    ModalModel,
    Modes,
    NoModesError,
    frequencies_hz,
    solve_modes,
)
from bayes_ssi.parameters import Parameter, collect_parameters
from bayes_ssi.structures.affine_array import AffineArray

__all__ = ["MatrixStructure"]

# Modes are computed up to this share above the highest frequency of interest, since they come down
# as parameters change: by a fifth where a stiffness is a third lower than its median.
MARGIN = 0.2


class MatrixStructure(PointwiseStructure, ReducibleStructure):
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
        """Check and keep the matrices; no modes are computed yet.

        Args:
            stiffness: K: a matrix, or a list of matrices and of pairs (coefficient, matrix), which
                are summed. A coefficient is a number, a Parameter, or a product such as
                ``12.5 * thickness**3``; a matrix is scipy's or an array (n, n), symmetric.
            mass: M, in the same way; it may be singular (degrees of freedom without inertia).
            sensors: name → number, from 0, or label of a degree of freedom; or a list of labels;
                all degrees of freedom if None, where they are no more than a thousand.
            labels: of all degrees of freedom.
            n_modes: how many of the lowest modes are computed.
            up_to_hz: instead of ``n_modes``: as many as lie below 1.2 times this frequency at the
                prior medians.
            influence: (n,), how every degree of freedom moves when the ground moves by 1 and
                nothing deforms; needed for responses to ground motion only.

        Raises:
            ValueError, TypeError: an argument is not valid; the message says which.
        """
        try:
            self._stiffness = AffineMatrix.of(stiffness, "stiffness")
            self._mass = AffineMatrix.of(mass, "mass", self._stiffness.size)
            n = self._stiffness.size
            self._names, self._rows = sensor_rows(n, labels, sensors)
            self._parameters = collect_parameters(
                [*self._stiffness.parameters, *self._mass.parameters]
            )
            self._n_modes, self._up_to_hz = _checked_n_modes(n_modes, up_to_hz, n)
            self._influence = _checked_influence(influence, n)
        except (TypeError, ValueError) as error:
            raise type(error)(f"MatrixStructure: {error}") from None

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
        """The measured ones (the sensors) or all."""
        return self._names

    @property
    def size(self) -> int:
        return self._stiffness.size

    @cached_property
    def n_modes(self) -> int:
        """As given, or as many as lie in the band and a margin at the prior medians.

        Raises:
            ValueError: none lies there.
        """
        if self._n_modes is not None:
            return self._n_modes
        assert self._up_to_hz is not None
        shift = (2.0 * math.pi * (1.0 + MARGIN) * self._up_to_hz) ** 2
        count = count_below(*self.matrices(self.prior_medians()[0]), shift)
        if not count:
            raise ValueError(
                f"MatrixStructure: up_to_hz: no mode below {1.0 + MARGIN:g} times "
                f"{self._up_to_hz:g} Hz at the prior medians; are the units right?"
            )
        return count

    def modes(self, values: FloatArray) -> Modes:
        if self.size > BATCHED_UP_TO:
            return super().modes(values)
        stiffness, mass = (each.evaluate(values) for each in self._dense)
        modes = solve_modes(stiffness, mass, self.n_modes).repeated(len(values))
        failed = np.isnan(modes.frequencies_hz).any(axis=1)
        if failed.any():
            row = values[failed.argmax()]
            self._cached("modes", row, self.modes_at)  # raises, and says why
            raise ValueError(f"at {self._named(row)}: the matrices are too close to singular")
        return Modes(modes.frequencies_hz, modes.shapes[:, self.system.sensor_rows])

    @cached_property
    def _dense(self) -> tuple[AffineArray, AffineArray]:
        """Stiffness and mass of a small structure."""
        system = self.system
        return system.stiffness.dense(self.parameters), system.mass.dense(self.parameters)

    def modes_at(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        modes, n = self.full_modes(values), self.n_modes
        return frequencies_hz(modes.eigenvalues[:n]), modes.vectors[self.system.sensor_rows, :n]

    def full_modes(self, values: FloatArray, extra: int = 0) -> Eigenpairs:
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
        responses = [self._cached("response", row, self._response_at) for row in values]
        return ModalModel(
            np.array([frequencies for frequencies, _, _ in responses]),
            np.array([shapes for _, shapes, _ in responses]),
            np.array([participation for _, _, participation in responses]),
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
        of_both = (
            system.stiffness.coefficients(values[None], parameters)[0],
            system.mass.coefficients(values[None], parameters)[0],
        )
        for name, coefficients in zip(("stiffness", "mass"), of_both, strict=True):
            if not np.isfinite(coefficients).all():
                raise NoModesError(f"a coefficient of the {name} matrix is not finite")
        return of_both

    @cached_property
    def system(self) -> System:
        """The matrices in a good order, checked at the prior medians.

        Raises:
            NoModesError: M is not positive semi-definite, or has mass at too few places.
        """
        pattern = self._stiffness.pattern + self._mass.pattern
        # Of a diagonally dominant matrix with this pattern, which is positive definite.
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

    def _response_at(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
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


def _checked_n_modes(
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
    array = np.array(influence, dtype=float)
    if array.shape != (n,) or not np.isfinite(array).all():
        raise ValueError(
            f"influence must be {n} finite numbers, one a degree of freedom, got "
            f"shape {array.shape}"
        )
    array.setflags(write=False)
    return array
