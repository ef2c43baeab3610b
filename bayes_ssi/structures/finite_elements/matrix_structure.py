"""A structure given by its matrices: K(θ) = Σ c_i(θ) K_i and M(θ) = Σ d_j(θ) M_j.

The matrices are those of any finite-element program, sparse or dense, as it wrote them
(:func:`~bayes_ssi.structures.finite_elements.matrix_files.read_matrix`); a coefficient is a number
times powers of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import listed_choices
from bayes_ssi.structures.affine_array import AffineArray
from bayes_ssi.structures.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.structures.finite_elements.elements_on_rows import Sensors, sensor_rows
from bayes_ssi.structures.finite_elements.function_structure import PointwiseStructure
from bayes_ssi.structures.finite_elements.reduced_structure import ReducedStructure
from bayes_ssi.structures.finite_elements.reducible_structure import ReducibleStructure
from bayes_ssi.structures.finite_elements.sparse_factors import count_below
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.structures.modal import BATCHED_UP_TO, ModalModel, Modes, frequencies_hz, solve_modes
from bayes_ssi.structures.motion import motion_of

# Modes are computed up to this share above the highest frequency of interest, since frequencies
# fall as parameters change: by a fifth where a stiffness is a third lower than its median.
MARGIN = 0.2


class MatrixStructure(PointwiseStructure, ReducibleStructure):
    """A finite-element model whose matrices are sums of fixed ones times products of parameters.

    Every set of parameter values costs a full eigen-solution, milliseconds for thousands of
    degrees of freedom and seconds for a hundred thousand; use :meth:`reduced` for sampling.
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
        geometry: Geometry | None = None,
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
            n_modes: number of lowest modes that are computed.
            up_to_hz: instead of ``n_modes``: compute all modes below 1.2 times this frequency at
                the prior medians.
            influence: (n,), displacements when the ground moves by 1 and nothing deforms; needed
                only for responses to ground motion.
            geometry: where the nodes are that labels name, for drawings; sensors name them where
                there are no labels.

        Raises:
            ValueError, TypeError: an argument is not valid; the message says which.
        """
        try:
            k = AffineMatrix.of(stiffness, "stiffness")
            m = AffineMatrix.of(mass, "mass", k.size)
            rows = sensor_rows(k.size, labels, sensors)
            own_modes, self._up_to_hz = _checked_n_modes(n_modes, up_to_hz, k.size)
            labels = None if labels is None else tuple(labels)
            ground = _checked_influence(influence, k.size)
            super().__init__(k, m, rows, own_modes, ground, labels, geometry)
            _require_nodes(geometry, labels or self.degrees_of_freedom)
        except (TypeError, ValueError) as error:
            raise type(error)(f"MatrixStructure: {error}") from None

    def reduced(self, **options: Any) -> ReducedStructure:
        """The same model in a reduced basis: thousands of times faster, with a certified error.

        Args:
            options: arguments of
                :class:`~bayes_ssi.structures.finite_elements.reduced_structure.ReducedStructure`.
        """
        return ReducedStructure(self, **options)

    @cached_property
    def n_modes(self) -> int:
        """Number of modes, as given or up to ``up_to_hz`` and a margin at the prior medians.

        Raises:
            ValueError: there is no mode below.
        """
        if self._main is not None:
            return self._main.n_modes + len(self.appendages)
        if self._n_modes is not None:
            return self._n_modes
        assert self._up_to_hz is not None
        number, shift = self.free_body
        limit = (2.0 * math.pi * (1.0 + MARGIN) * self._up_to_hz) ** 2 + shift
        count = count_below(*self.shifted_matrices(self.prior_medians()[0]), limit) - number
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
        modes = self.free_body.elastic(solve_modes(stiffness, mass, self.n_solved))
        modes = modes.repeated(len(values))
        failed = np.isnan(modes.frequencies_hz).any(axis=1)
        if failed.any():
            row = values[failed.argmax()]
            self.solution(row)  # raises, and says why
            raise ValueError(f"at {self._named(row)}: the matrices are too close to singular")
        return Modes(modes.frequencies_hz, modes.shapes[:, self.system.sensor_rows])

    @cached_property
    def _dense(self) -> tuple[AffineArray, AffineArray]:
        """Stiffness and mass of a small structure."""
        system = self.system
        return system.stiffness.dense(self.parameters), system.mass.dense(self.parameters)

    def solved_at(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Frequencies, shapes and, where ``influence`` is known, participation."""
        modes, n = self.full_modes(values), self.n_modes
        frequencies, rows = frequencies_hz(modes.eigenvalues[:n]), self.system.sensor_rows
        shapes = modes.vectors[:, :n]
        if self.system.influence is None:
            return frequencies, shapes[rows]
        _, mass = self.matrices(values)
        return frequencies, shapes[rows], shapes.T @ (mass @ self.system.influence)

    def description(self) -> Mapping[str, Any]:
        main = self.without_elements
        up_to = f", those up to {self._up_to_hz:g} Hz and a margin" if self._up_to_hz else ""
        return {
            "size": f"{self.size} degrees of freedom, {len(self._names)} of them observed",
            "stiffness": main._stiffness.formula("K"),
            "mass": main._mass.formula("M"),
            "modes": f"the lowest {self.n_modes}{up_to}{self._without_rigid_modes()}",
            **{element.label: element for element in self.elements},
            **self._described_sensors(),
        }

    def _without_rigid_modes(self) -> str:
        number = self.n_rigid_modes
        return f", without {number} rigid-body mode{'s' if number > 1 else ''}" if number else ""

    def modal_model(self, values: FloatArray) -> ModalModel:
        """See :meth:`Structure.modal_model`.

        Raises:
            TypeError: the structure was not given ``influence``.
        """
        influence = self.require_influence()
        solutions = [self.solution(row) for row in values]
        frequencies, shapes, participation = (
            np.array([solution[i] for solution in solutions]) for i in range(3)
        )
        return ModalModel(frequencies, shapes, participation, influence[self.system.sensor_rows])

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
            f"influence must be {n} finite numbers, one per degree of freedom, got "
            f"shape {array.shape}"
        )
    array.setflags(write=False)
    return array


def _require_nodes(geometry: Geometry | None, labels: Sequence[str]) -> None:
    if geometry is None or any(geometry.location(motion_of(label)) for label in labels):
        return
    raise ValueError(
        "geometry: no degree of freedom is at any of its nodes; labels are "
        f"{listed_choices(labels, 3)}, nodes {listed_choices(geometry.nodes, 3)}, and a label is "
        "the name of a node and a direction, such as 'node 7 x'"
    )
