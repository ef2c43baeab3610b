"""A structure given by its matrices: K(θ) = Σ c_i(θ) K_i and M(θ) = Σ d_j(θ) M_j.

The matrices are those of any finite-element program, sparse or dense, as it wrote them
(:func:`~bayes_ssi.structures.finite_elements.matrix_files.read_matrix`); a coefficient is a number
times powers of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import listed_choices
from bayes_ssi.structures.finite_elements.assembled_structure import AssembledStructure
from bayes_ssi.structures.finite_elements.finite_element_settings import FEM
from bayes_ssi.structures.finite_elements.matrix_system import AffineMatrix
from bayes_ssi.structures.finite_elements.reduced_structure import ReducedStructure
from bayes_ssi.structures.finite_elements.sensor_rows import Sensors, sensor_rows
from bayes_ssi.structures.geometry import Geometry, motion_of


class MatrixStructure(AssembledStructure):
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
            names_and_rows = sensor_rows(k.size, labels, sensors)
            modes_or_hz = _checked_n_modes(n_modes, up_to_hz, k.size)
            of_all = None if labels is None else tuple(labels)
            ground = _checked_influence(influence, k.size)
            _require_nodes(geometry, of_all or names_and_rows[0])
        except (TypeError, ValueError) as error:
            raise type(error)(f"MatrixStructure: {error}") from None
        super().__init__(k, m, names_and_rows, *modes_or_hz, ground, of_all, geometry)

    def reduced(self) -> ReducedStructure:
        """The same model in a reduced basis: thousands of times faster, with a certified error."""
        return ReducedStructure(self)

    @property
    def performance_hint(self) -> str:
        """Advice on sampling it much faster, as a sentence; empty where it is fast enough."""
        if self.size <= FEM.dense_up_to:
            return ""
        return (
            f"{self.size} degrees of freedom, solved in full tens of thousands of times; "
            f"{type(self).__name__}.reduced() needs dozens of full solutions"
        )

    def description(self) -> Mapping[str, Any]:
        up_to = f", those up to {self._up_to_hz:g} Hz and a margin" if self._up_to_hz else ""
        number = self.n_rigid_modes
        rigid = f", without {number} rigid-body mode{'s' if number > 1 else ''}" if number else ""
        observed = len(self.degrees_of_freedom)
        return {
            "size": f"{self.size} degrees of freedom, {observed} of them observed",
            "stiffness": self._stiffness.formula("K"),
            "mass": self._mass.formula("M"),
            "modes": f"the lowest {self.n_modes}{up_to}{rigid}",
            **{element.label: element for element in self.elements},
            **self._described_sensors(),
        }

    def __repr__(self) -> str:
        modes = f"n_modes={self._n_modes}" if self._n_modes else f"up_to_hz={self._up_to_hz}"
        own = range(self._carried.size, self.size)
        places = dict(zip(self.degrees_of_freedom, (*self._rows.tolist(), *own), strict=True))
        stiffness = self._stiffness.with_terms(self.size, self._carried.springs)
        mass = self._mass.with_terms(self.size, self._carried.masses)
        return f"MatrixStructure(stiffness={stiffness!r}, mass={mass!r}, sensors={places}, {modes})"


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
