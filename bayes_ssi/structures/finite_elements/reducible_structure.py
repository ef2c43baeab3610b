"""The matrices and full solutions of a finite-element model, as a reduced basis needs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.parameters.parameters import Parameter, collect_parameters
from bayes_ssi.structures.combined_sensors import CombinedSensors
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.finite_elements.affine_matrix import AffineMatrix
from bayes_ssi.structures.finite_elements.elements_on_rows import ElementsOnRows
from bayes_ssi.structures.finite_elements.matrix_files import Matrix
from bayes_ssi.structures.finite_elements.sparse_factors import fill_reducing_order, is_semidefinite
from bayes_ssi.structures.finite_elements.sparse_modes import (
    DENSE_UP_TO,
    lowest_modes,
    rigid_body_modes,
)
from bayes_ssi.structures.geometry import Geometry, Location
from bayes_ssi.structures.modal import Eigenpairs, FreeBody, NoModesError, frequencies_hz
from bayes_ssi.structures.motion import Place, SinglePlace, motion_of


class Coefficients(NamedTuple):
    """c_t(θ) (T,) of the stiffness and d_u(θ) (U,) of the mass, at one θ."""

    stiffness: FloatArray
    mass: FloatArray


class System(NamedTuple):
    """The matrices of a model, with their rows in an order that keeps factors sparse.

    Attributes:
        influence: (n,), displacements when the ground moves by 1; None if not known.
    """

    stiffness: AffineMatrix
    mass: AffineMatrix
    sensor_rows: NDArray[np.intp]
    rows: NDArray[np.intp]
    influence: FloatArray | None


class ReducibleStructure(CombinedSensors):
    """A model whose matrices are sums of fixed ones times products of parameters.

    Elements on it add terms k v vᵀ and m v vᵀ, and a row for each degree of freedom of their own.
    """

    def __init__(
        self,
        stiffness: AffineMatrix,
        mass: AffineMatrix,
        sensors: tuple[tuple[str, ...], NDArray[np.intp]],
        n_modes: int | None,
        influence: FloatArray | None,
        labels: tuple[str, ...] | None = None,
        geometry: Geometry | None = None,
    ) -> None:
        """Keep the matrices; ``sensors`` are names and rows, ``n_modes`` None if not known yet.

        ``labels`` are those of all degrees of freedom, ``"dof 0"`` upwards if None.
        """
        self._labels, self._geometry = labels, geometry
        self._main: ReducibleStructure | None = None
        self.elements: tuple[Element, ...] = ()
        self._stiffness, self._mass, self._influence = stiffness, mass, influence
        self._names, self._rows = sensors
        self._n_modes = n_modes
        self._parameters = collect_parameters([*stiffness.parameters, *mass.parameters])
        self._carried = ElementsOnRows((), (), (), self.size)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        """The measured degrees of freedom (the sensors), or all."""
        return self._names

    @property
    def labels(self) -> tuple[str, ...] | None:
        """Labels of all degrees of freedom but those of elements; None if none were given."""
        return self.without_elements._labels

    @property
    def size(self) -> int:
        """Number of degrees of freedom of the matrices."""
        return self._stiffness.size

    @checked
    def with_element(self, element: Element) -> Self:
        """This model with one more element on it.

        Its places are sensors and labels of degrees of freedom (``"dof 0"`` upwards where these
        have none, unless sensors are named so in another order), combinations of them, and 0, the
        ground. A degree of freedom of its own is one
        more sensor, and one more mode is computed for it: no more modes can move below a
        frequency.

        Raises:
            ValueError: the element's place is not on the structure, or its label is taken.
        """
        main = self._main or self
        elements, shift = (*self.elements, element), main.free_body.shift
        carried = ElementsOnRows.of(elements, main.row_of, main.size, shift)
        names, rows = main._names, main._rows
        taken = {*names, *(main._labels or ())}
        for i, label in enumerate(carried.labels):
            if label in taken or label in carried.labels[:i]:
                raise ValueError(
                    f"element {label!r}: the structure has a degree of freedom of that label "
                    "already; give the element a label of its own"
                )
        whole = copy(self)
        for name in list(vars(whole)):
            if isinstance(getattr(type(self), name, None), cached_property):
                del whole.__dict__[name]
        whole._main, whole.elements = main, (*self.elements, element)
        size = main.size + len(carried.labels)
        whole._carried = carried
        whole._add_terms()
        whole._names = (*names, *carried.labels)
        whole._rows = np.append(rows, np.arange(main.size, size))
        if main._influence is not None:
            whole._influence = carried.influence(main._influence)
        whole._parameters = collect_parameters(
            [*whole._stiffness.parameters, *whole._mass.parameters]
        )
        return whole

    def _add_terms(self) -> None:
        """Make the matrices from those of the model without elements."""
        assert self._main is not None
        carried, size = self._carried, self._main.size + len(self._carried.labels)
        self._stiffness = self._main._stiffness.with_terms(size, carried.springs)
        self._mass = self._main._mass.with_terms(size, carried.masses)

    def __getstate__(self) -> dict[str, Any]:
        """State without matrices that follow from those of the model without elements.

        A large model with elements goes to other processes many times.
        """
        state = super().__getstate__()
        assert isinstance(state, dict)
        if self._main is None:
            return state
        derived = ("_stiffness", "_mass", "system")
        return {name: value for name, value in state.items() if name not in derived}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if self._main is not None:
            self._add_terms()

    def require_place(self, place: Place, label: str) -> None:
        for single, _ in motion_of(place):
            if single not in self._carried.labels:
                (self._main or self).row_of(single, label)

    @property
    def appendages(self) -> tuple[str, ...]:
        return self._carried.labels

    @property
    def geometry(self) -> Geometry | None:
        return self._geometry

    def location_of(self, place: Place) -> Location | None:
        """See :meth:`Structure.location_of`; a sensor is where its degree of freedom is."""
        if self._geometry is None:
            return None
        labels = dict(enumerate(self._labels or ()))
        row_of = self._row_of_label
        motion = motion_of(place)
        return self._geometry.location(
            tuple((labels.get(row_of.get(single, -1), single), share) for single, share in motion)
        )

    def row_of(self, place: SinglePlace, label: str) -> int | None:
        """The degree of freedom, from 0, at a place of an element; None for the ground.

        Raises:
            ValueError: there is no such place; the message begins with ``label``.
        """
        if place == 0:
            return None
        row = self._row_of_label.get(place)
        if row is not None:
            return row
        last = f"dof {self.size - 1}"
        unnamed = ("dof 0", "...", last) if last in self._row_of_label else ()
        choices = (*self._names, *(self._labels or unnamed))
        require_known(
            f"{label}: the structure has no degree of freedom or sensor",
            [place],
            dict.fromkeys(choices),
            besides=", or 0 for the ground",
        )
        return None

    def place_shapes(self, places: Sequence[Place], values: FloatArray) -> FloatArray:
        """Motions of places in the modes (n_places, n_modes), at one row of ``values``.

        By a full solution, at unit modal mass.
        """
        vectors = self.full_modes(values[0]).vectors
        return self.combined_rows(places, lambda rows: vectors[rows])

    def labelled_modes(self, values: FloatArray) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
        """By a full solution, at all degrees of freedom where these have labels."""
        modes, n = self.full_modes(values), self.n_modes
        labels, rows = self.degrees_of_freedom, self.system.sensor_rows
        if self.labels is not None:
            labels, rows = self.labels, self.system.rows[: len(self.labels)]
        return labels, frequencies_hz(modes.eigenvalues[:n]), modes.vectors[rows, :n]

    def combined_rows(
        self, places: Sequence[Place], rows_of: Callable[[NDArray[np.intp]], FloatArray]
    ) -> FloatArray:
        """Rows (n_places, ...) of places, from those of degrees of freedom in :attr:`system`."""
        terms = [
            (i, row, share)
            for i, place in enumerate(places)
            for single, share in motion_of(place)
            for row in [self.system_row_of(single, "place")]
            if row is not None
        ]
        of_place, rows, shares = (np.array(each) for each in zip(*terms, strict=True))
        parts = shares[:, None] * rows_of(rows.astype(np.intp))
        total = np.zeros((len(places), parts.shape[1]))
        np.add.at(total, of_place.astype(np.intp), parts)
        return total

    def system_row_of(self, place: SinglePlace, label: str) -> int | None:
        """As :meth:`row_of`, but the row in :attr:`system`."""
        row = self.row_of(place, label)
        return None if row is None else int(self.system.rows[row])

    @cached_property
    def _row_of_label(self) -> dict[SinglePlace, int]:
        labels = self._labels or tuple(f"dof {i}" for i in range(self.size))
        of_labels: dict[SinglePlace, int] = {label: i for i, label in enumerate(labels)}
        each = zip(self._names, self._rows.tolist(), strict=True)
        of_sensors: dict[SinglePlace, int] = {name: int(row) for name, row in each}
        if self._labels is None and any(
            of_labels.get(s, row) != row for s, row in of_sensors.items()
        ):
            return of_sensors  # which count from another number
        return of_labels | of_sensors

    @cached_property
    def system(self) -> System:
        """The matrices in a good order, checked at the prior medians.

        Elements add their rows at the end of the model's own order.

        Raises:
            NoModesError: M is not positive semi-definite, or has mass at too few places.
        """
        if self._main is not None:
            return self._with_elements(self._main.system)
        system, free = self._system_without_shift, self.free_body
        if not free.number:
            return system
        stiffness = AffineMatrix(
            (*system.stiffness.products, *system.mass.products),
            (*system.stiffness.matrices, *(free.shift * each for each in system.mass.matrices)),
        )
        return system._replace(stiffness=stiffness)

    @cached_property
    def free_body(self) -> FreeBody:
        """Its rigid-body modes at the prior medians, by which :attr:`system` is shifted."""
        if self._main is not None:
            return self._main.free_body
        system, medians = self._system_without_shift, self.prior_medians()
        stiffness, mass = (
            each.at(each.coefficients(medians, self.parameters)[0])
            for each in (system.stiffness, system.mass)
        )
        return rigid_body_modes(stiffness, mass)

    @property
    def n_rigid_modes(self) -> int:
        return self.free_body.number

    @property
    def n_solved(self) -> int:
        """The number of modes that are solved for, with the rigid-body ones."""
        return self.n_modes + self.free_body.number

    @cached_property
    def _system_without_shift(self) -> System:
        pattern = self._stiffness.pattern + self._mass.pattern
        # From a diagonally dominant matrix with this pattern, which is positive definite.
        row_sums = np.asarray(pattern.sum(axis=1)).ravel()
        order = fill_reducing_order(sp.csc_array(sp.diags_array(row_sums + 1.0) - pattern))
        system = System(
            self._stiffness.ordered(order),
            self._mass.ordered(order),
            np.argsort(order)[self._rows],
            np.argsort(order),
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

    @property
    def without_elements(self) -> ReducibleStructure:
        """The model alone, with the modes that were asked of it."""
        return self._main or self

    @property
    def carried(self) -> ElementsOnRows:
        """The elements, with rows as in :attr:`system`."""
        return self._carried.ordered(self.system.rows)

    def _with_elements(self, main: System) -> System:
        rows = np.append(main.rows, np.arange(len(main.rows), self.size))
        carried = self._carried.ordered(rows)
        stiffness = main.stiffness.with_terms(self.size, carried.springs)
        mass = main.mass.with_terms(self.size, carried.masses)
        influence = self._influence
        if influence is not None:
            influence = influence[np.argsort(rows)]
        return System(stiffness, mass, rows[self._rows], rows, influence)

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
        stiffness, mass = self.shifted_matrices(values)
        if self.free_body.number:
            stiffness = stiffness - self.free_body.shift * mass
        return stiffness, mass

    def shifted_matrices(self, values: FloatArray) -> tuple[Matrix, Matrix]:
        """As :meth:`matrices`, but K + shift·M of :attr:`free_body`, as solvers take it."""
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

        It has ``extra`` modes more than :attr:`n_modes`, as far as the model has them, and none of
        the rigid-body modes.

        Raises:
            NoModesError: there are fewer than :attr:`n_modes`, or they cannot be counted.
        """
        modes, (number, shift) = self.shifted_modes(values, extra), self.free_body
        return Eigenpairs(modes.eigenvalues[number:] - shift, modes.vectors[:, number:])

    def shifted_modes(self, values: FloatArray, extra: int = 0) -> Eigenpairs:
        """As :meth:`full_modes`, but of :meth:`shifted_matrices`, with rigid-body modes."""
        return lowest_modes(*self.shifted_matrices(values), self.n_solved, extra)

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
