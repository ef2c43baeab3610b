"""A finite-element model of matrices K(θ) = Σ c_i(θ) K_i and M(θ) = Σ d_j(θ) M_j, in full.

The matrices are those of any finite-element program, sparse or dense, as it wrote them; a
coefficient is a number times powers of parameters.
"""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from bayes_ssi.foundations.argument_types import checked, listed_choices
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Parameter, parameters_of
from bayes_ssi.structures import modal
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.finite_elements.function_structure import PointwiseStructure
from bayes_ssi.structures.finite_elements.matrix_system import AffineMatrix, System
from bayes_ssi.structures.finite_elements.model_arguments import (
    Sensors,
    checked_influence,
    checked_n_modes,
    require_nodes,
    sensor_rows,
)
from bayes_ssi.structures.finite_elements.sparse_modes import count_below, lowest_modes
from bayes_ssi.structures.geometry import Geometry, Location, Place, SinglePlace, motion_of
from bayes_ssi.structures.matrix_terms import AffineArray, CarriedElements, coefficients_of
from bayes_ssi.structures.modal import Eigenpairs, ModalModel, Modes
from bayes_ssi.structures.structure import CarryingStructure

# Modes are computed up to this share above the highest frequency of interest, since frequencies
# fall as parameters change: by a fifth where a stiffness is a third lower than its median.
FREQUENCY_MARGIN = 0.2


class AssembledStructure(CarryingStructure, PointwiseStructure):
    """A model whose matrices are sums of fixed ones times products of parameters."""

    geometry: Geometry | None = None
    labels: tuple[str, ...] | None = None  # of all degrees of freedom but those of elements
    _carried: CarriedElements = CarriedElements((), (), (), 0)

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
            self._stiffness = AffineMatrix.of(stiffness, "stiffness")
            size = self._stiffness.size
            self._mass = AffineMatrix.of(mass, "mass", size)
            self._names, self._rows = sensor_rows(size, labels, sensors)
            self._n_modes, self._up_to_hz = checked_n_modes(n_modes, up_to_hz, size)
            self._influence = checked_influence(influence, size)
            self.labels = None if labels is None else tuple(labels)
            require_nodes(geometry, self.labels or self._names)
        except (TypeError, ValueError) as error:
            raise type(error)(f"MatrixStructure: {error}") from None
        self.geometry = geometry
        self.elements: tuple[Element, ...] = ()
        self._main: AssembledStructure | None = None  # without elements, where there are any
        self._carried = CarriedElements((), (), (), size)

    @property
    def without_elements(self) -> "AssembledStructure":
        """The model alone, with the modes that were asked of it."""
        return self._main or self

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        springs, masses = map(coefficients_of, (self._carried.springs, self._carried.masses))
        return parameters_of([*self._stiffness.products, *springs, *self._mass.products, *masses])

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """The measured degrees of freedom (the sensors), or all."""
        return (*self._names, *self.appendages)

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the matrices."""
        return self._carried.whole_size

    @cached_property
    def n_modes(self) -> int:
        """Number of modes, as given or up to ``up_to_hz`` and a margin at the prior medians."""
        if self._main is not None:
            return self._main.n_modes + len(self.appendages)
        if self._n_modes is not None:
            return self._n_modes
        assert self._up_to_hz is not None
        number, shift = self.system.free_body
        factor = 1.0 + FREQUENCY_MARGIN
        limit = (2.0 * math.pi * factor * self._up_to_hz) ** 2 + shift
        matrices = self.system.shifted_matrices(self.prior_medians()[0])
        count = count_below(*matrices, limit) - number
        if not count:
            raise ValueError(
                f"MatrixStructure: up_to_hz: no mode below {factor:g} times "
                f"{self._up_to_hz:g} Hz at the prior medians; are the units right?"
            )
        return count

    @property
    def n_rigid_modes(self) -> int:
        return self.system.free_body.number

    # Places, and elements on them.

    @checked
    def with_element(self, element: Element) -> Self:
        """This model with one more element on it.

        Its places are sensors and labels of degrees of freedom (``"dof 0"`` upwards where these
        have none, unless sensors are named so in another order), combinations of them, and 0, the
        ground. A degree of freedom of its own is one more sensor, and one more mode is computed for
        it: no more modes can move below a frequency.

        Raises:
            ValueError: the element's place is not on the structure, or its label is taken.
        """
        main, elements = self.without_elements, (*self.elements, element)
        shift, taken = main.system.free_body.shift, (*self._names, *(self.labels or ()))
        carried = CarriedElements.of(elements, main.rows_of, main.size, shift, taken)
        whole = copy(self)
        whole._main, whole.elements, whole._carried = main, elements, carried
        whole.__dict__ = whole.__getstate__()
        return whole

    def __getstate__(self) -> dict[str, Any]:
        """State without what follows from it: a large model goes to other processes many times."""
        state = super().__getstate__()
        if self._main is None:
            return state
        kept = (n for n in state if not isinstance(getattr(type(self), n, None), cached_property))
        return {name: state[name] for name in kept}

    def rows_of(self, place: SinglePlace, label: str) -> list[tuple[int, float]]:
        if place == 0:
            return []
        if place not in self._row_of_label:
            last = f"dof {self._stiffness.size - 1}"
            unnamed = ("dof 0", "...", last) if last in self._row_of_label else ()
            choices = dict.fromkeys((*self._names, *(self.labels or unnamed)))
            raise ValueError(
                f"{label}: the structure has no degree of freedom or sensor {place!r}; choose from "
                f"{listed_choices(choices)}, or 0 for the ground"
            )
        return [(self._row_of_label[place], 1.0)]

    @cached_property
    def _row_of_label(self) -> dict[SinglePlace, int]:
        if self._main is not None:
            own: dict[SinglePlace, int] = {
                label: row for row, label in enumerate(self.appendages, self._main.size)
            }
            return own | self._main._row_of_label
        labels = self.labels or tuple(f"dof {i}" for i in range(self.size))
        of_labels: dict[SinglePlace, int] = {label: i for i, label in enumerate(labels)}
        sensors = zip(self._names, self._rows.tolist(), strict=True)
        of_sensors: dict[SinglePlace, int] = {name: int(row) for name, row in sensors}
        if self.labels is None and any(
            of_labels.get(s, row) != row for s, row in of_sensors.items()
        ):
            return of_sensors  # which count from another number
        return of_labels | of_sensors

    def motions(self, places: Sequence[Place]) -> Any:
        """A sparse row for each place (n_places, n), of its motion by rows as in :attr:`system`."""
        terms = [
            (share, i, self.system.rows[row])
            for i, place in enumerate(places)
            for single, share in motion_of(place)
            for row, _ in self.rows_of(single, "place")
        ]
        shares, of_place, rows = (list(column) for column in zip(*terms, strict=True))
        return sp.csr_array((shares, (of_place, rows)), shape=(len(places), self.size))

    def location_of(self, place: Place) -> Location | None:
        """See :meth:`Structure.location_of`; a sensor is where its degree of freedom is."""
        if self.geometry is None:
            return None
        labels, row_of = dict(enumerate(self.labels or ())), self._row_of_label
        named = ((labels.get(row_of.get(one, -1), one), share) for one, share in motion_of(place))
        return self.geometry.location(tuple(named))

    # Solutions.

    @cached_property
    def system(self) -> System:
        """The matrices in a good order, checked at the prior medians."""
        if self._main is not None:
            return self._main.system.with_elements(self._carried, self.parameters)
        matrices, n_modes = (self._stiffness, self._mass), self._n_modes or 1
        return System.of(*matrices, self.parameters, self.prior_medians(), self._influence, n_modes)

    @property
    def sensor_rows(self) -> NDArray[np.intp]:
        """Of all degrees of freedom that are measured, as in :attr:`system`."""
        own = np.arange(self._carried.size, self.size)
        return np.append(self.system.rows[self._rows], own)

    @property
    def n_solved(self) -> int:
        """The number of modes that are solved for, with the rigid-body ones."""
        return self.n_modes + self.n_rigid_modes

    def modes(self, values: FloatArray) -> Modes:
        if self.size > modal.BATCHED_UP_TO:
            return super().modes(values)
        stiffness, mass = (each.evaluate(values) for each in self._dense)
        modes = self.system.free_body.elastic(modal.solve_modes(stiffness, mass, self.n_solved))
        modes = modes.repeated(len(values))
        failed = np.isnan(modes.frequencies_hz).any(axis=1)
        if failed.any():
            row = values[failed.argmax()]
            self.solution(row)  # raises, and says why
            raise ValueError(f"at {self._named(row)}: the matrices are too close to singular")
        return Modes(modes.frequencies_hz, modes.shapes[:, self.sensor_rows])

    @cached_property
    def _dense(self) -> tuple[AffineArray, AffineArray]:
        system = self.system
        return system.stiffness.dense(self.parameters), system.mass.dense(self.parameters)

    def full_modes(self, values: FloatArray) -> Eigenpairs:
        """A full solution at ``values`` (n_parameters,), rows as in :attr:`system`.

        It may have more modes than :attr:`n_modes`, and has none of the rigid-body modes.

        Raises:
            NoModesError: there are fewer than :attr:`n_modes`, or they cannot be counted.
        """
        modes, (number, shift) = self.shifted_modes(values), self.system.free_body
        return Eigenpairs(modes.eigenvalues[number:] - shift, modes.vectors[:, number:])

    def shifted_modes(self, values: FloatArray, extra: int = 0) -> Eigenpairs:
        """Modes of the shifted matrices, with rigid-body modes and ``extra`` more if there are."""
        return lowest_modes(*self.system.shifted_matrices(values), self.n_solved, extra)

    def solved_at(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Frequencies, shapes and, where ``influence`` is known, participation."""
        modes, n = self.full_modes(values), self.n_modes
        frequencies, rows = modal.frequencies_hz(modes.eigenvalues[:n]), self.sensor_rows
        shapes, influence = modes.vectors[:, :n], self.system.influence
        if influence is None:
            return frequencies, shapes[rows]
        _, mass = self.system.shifted_matrices(values)
        return frequencies, shapes[rows], shapes.T @ (mass @ influence)

    def place_shapes(self, places: Sequence[Place], values: FloatArray) -> FloatArray:
        """See :meth:`Structure.place_shapes`; by a full solution."""
        return self.motions(places) @ self.full_modes(values[0]).vectors

    def place_masses(self, places: Sequence[Place]) -> FloatArray:
        """See :meth:`Structure.place_masses`; where mass couples places, those of lumped ones."""
        (coefficients,) = self.system.coefficients(self.prior_medians())
        motions, mass = self.motions(places), self.system.mass.at(coefficients.mass)
        inertia = (motions @ mass).multiply(motions).sum(axis=1)
        return np.asarray(inertia / motions.power(2).sum(axis=1) ** 2)

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """By a full solution, at all degrees of freedom where these have labels."""
        modes, n = self.full_modes(values), self.n_modes
        labels, rows = self.degrees_of_freedom, self.sensor_rows
        if self.labels is not None:
            labels, rows = self.labels, self.system.rows[: len(self.labels)]
        return labels, modal.frequencies_hz(modes.eigenvalues[:n]), modes.vectors[rows, :n]

    def modal_model(self, values: FloatArray) -> ModalModel:
        influence = self.require_influence()
        solutions = [self.solution(row) for row in values]
        parts = [np.array([solution[i] for solution in solutions]) for i in range(3)]
        return ModalModel(parts[0], parts[1], parts[2], influence[self.sensor_rows])

    def require_influence(self) -> FloatArray:
        """Influence of ground motion (n,), rows as in :attr:`system`; TypeError if not known."""
        if self.system.influence is None:
            raise TypeError(
                f"{type(self).__name__}: how its degrees of freedom follow the ground is not "
                "known, so its response cannot be computed; give influence=, one number a degree "
                "of freedom (1 for a displacement in the direction of the ground motion, else 0)"
            )
        return self.system.influence

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
