"""A finite-element model given by its matrices, and in a reduced basis with a certified error."""

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import counted
from bayes_ssi.structures import modal
from bayes_ssi.structures.elements import Element
from bayes_ssi.structures.finite_elements.assembled_structure import AssembledStructure
from bayes_ssi.structures.finite_elements.projected_structure import ProjectedStructure
from bayes_ssi.structures.finite_elements.reduced_basis import (
    Bounds,
    ReducedBasis,
    Reference,
    reference_of,
)
from bayes_ssi.structures.geometry import Place, SinglePlace
from bayes_ssi.structures.matrix_terms import AffineArray
from bayes_ssi.structures.modal import BATCHED_UP_TO, ModalModel, Modes
from bayes_ssi.structures.structure import Accuracy, ApproximateStructure, Requirement, Structure

# Largest errors over the prior: of frequencies, as a fraction, and of shapes at the sensors, at
# unit length there. Sampling makes them as small as the posterior demands.
FREQUENCY_ERROR = 1e-3
SHAPE_ERROR = 0.1
# Where so many full solutions do not suffice, a larger error is accepted and reported.
MOST_FULL_SOLUTIONS = 150
# So many in a row that add nothing to a basis: bounds of close modes stay large all the same.
MOST_IDLE = 3
TRAINING_POINTS = 512  # Sobol points of the prior among which full solutions are placed
# Directions that add less than this share of the required accuracy to a mode are left out of a
# basis; some of them together remain below it.
NEGLIGIBLE = 0.15
# Degrees of freedom from which on a basis is made by the reference's factorisation: those of full
# solutions, two each, take most of the time that a solid takes.
ONE_FACTOR_FROM = 20_000
# Certified errors of frequency and shape of what confirms results then, in place of full solutions.
CONFIRMING_ERRORS = 1e-5, 1e-3
DRAWS_ACCURACY = 0.01  # share of the accuracy over the prior that a basis for draws has on average
BATCHED_WITH_ELEMENTS = BATCHED_UP_TO - 4  # size that batches take with two elements on it


class ReducedStructure(ApproximateStructure):
    """A finite-element model whose modes are combinations of some of its full solutions.

    The basis is made when modes are first computed. Full solutions are placed one after the other
    where the certified error is largest among points of the prior (a greedy reduced basis), until
    it is small enough at all of them. :meth:`accurate_at` adds solutions at other values. A basis
    never changes: adding solutions makes a new structure.

    The error is certified as in :mod:`bayes_ssi.structures.finite_elements.reduced_basis`. That
    cannot detect a mode that no full solution has; the modes of every full solution are counted by
    Sylvester's law.
    """

    def __init__(self, full: AssembledStructure) -> None:
        self.full = full
        self.n_full_solutions = 0
        self.n_corrected = 0  # values at which the reference's factor took the place of another
        self._basis: ReducedBasis | None = None

    @checked
    def with_element(self, element: Element) -> Self:
        """This structure with one more element on it, in the same basis.

        The basis is extended by a static solution for every place of the element and by the
        element's own degree of freedom; no mode is solved for. The error is certified as before,
        and :meth:`accurate_at` adds full solutions with the element where they are needed.
        """
        whole = self._copied()
        whole.full = self.full.with_element(element)
        whole._basis = whole._carrying(self.basis.without_elements(self._reference))
        return whole

    def require_place(self, place: Place, label: str) -> None:
        self.full.require_place(place, label)

    @property
    def exact(self) -> AssembledStructure:
        return self.full

    @property
    def basis(self) -> ReducedBasis:
        """The basis with the elements that it carries, computed when it is first needed."""
        if self._basis is None:
            points = self.prior_points(TRAINING_POINTS, tail=1e-4)
            self._train(Requirement(points, FREQUENCY_ERROR, SHAPE_ERROR))
        assert self._basis is not None
        return self._basis

    def _carrying(self, basis: ReducedBasis) -> ReducedBasis:
        """The basis with the elements, from one of the model without them."""
        negligible = self._negligible(FREQUENCY_ERROR, SHAPE_ERROR)
        return basis.carrying(self.full.system.carried, negligible, self._reference)

    def place_shapes(self, places: Sequence[Place], values: FloatArray) -> FloatArray:
        """See :meth:`Structure.place_shapes`; by a full solution where it carries elements."""
        if self.full.elements:
            return self.full.place_shapes(places, values)
        in_basis: FloatArray = self.full.motions(places) @ self.basis.vectors
        return in_basis @ self._modes_in_basis(values).shapes[0]

    def projected(self, values: FloatArray, places: Iterable[SinglePlace]) -> Structure:
        """In the few combinations of the basis that its modes at ``values`` consist of.

        There, frequencies are accurate to a hundredth of ``FREQUENCY_ERROR`` on average.
        """
        if self.full.elements:
            return self
        shares, directions = self._directions(values)
        # The energy that is neglected of a mode is about twice the relative error of its frequency.
        neglected = np.cumsum(shares) <= 2.0 * DRAWS_ACCURACY * FREQUENCY_ERROR
        n_kept = max(int((~neglected).sum()), min(self.full.n_solved, len(shares)))
        basis = self.basis.combined(directions[:, -n_kept:])
        return ProjectedStructure.of(basis, self.full, places, self._reference)

    def compact(self, values: FloatArray) -> Self:
        """This structure in fewer combinations of the basis, certified as before.

        They are as many as a batch of small matrices is solved with at once, less those that two
        elements need. Where they do not suffice, :meth:`accurate_at` adds full solutions.
        """
        if self.full.elements:
            return self
        smaller = self._copied()
        _, directions = self._directions(values)
        smaller._basis = self.basis.combined(directions[:, -BATCHED_WITH_ELEMENTS:])
        return smaller

    def _directions(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Combinations (N, N) of the basis, by ascending mean shares (N,) in the modes' energy."""
        shapes = self._shifted_modes_in_basis(values).shapes
        modes = shapes[np.isfinite(shapes).all(axis=(1, 2))].transpose(1, 0, 2)
        modes = modes.reshape(len(modes), -1)
        modes = modes / np.linalg.norm(modes, axis=0)
        shares, directions = np.linalg.eigh(modes @ modes.T / modes.shape[1])
        return shares, directions

    @staticmethod
    def _negligible(frequency_error: float, shape_error: float) -> float:
        return NEGLIGIBLE * min(math.sqrt(frequency_error), shape_error)

    def modes(self, values: FloatArray) -> Modes:
        in_basis = self._modes_in_basis(values)
        shapes = self.basis.at_sensors @ in_basis.shapes
        # What basis the vectors are is a matter of rounding, too.
        modal.settle(in_basis.frequencies_hz, shapes)
        return Modes(in_basis.frequencies_hz, shapes)

    def modal_model(self, values: FloatArray) -> ModalModel:
        influence = self.full.require_influence()
        frequencies_hz, y = self._modes_in_basis(values)
        mass = self.full.system.mass
        loads = np.array([self.basis.loads(each @ influence) for each in mass.matrices])
        of_batch = mass.projected(loads, self.parameters).evaluate(values)
        return ModalModel(
            frequencies_hz,
            self.basis.at_sensors @ y,
            np.einsum("bk,bkm->bm", np.broadcast_to(of_batch, (len(values), len(loads[0]))), y),
            influence[self.full.sensor_rows],
        )

    def description(self) -> Mapping[str, Any]:
        basis = (
            f"frequencies within {FREQUENCY_ERROR:g} (as a fraction) and shapes within "
            f"{SHAPE_ERROR:g} (at unit length) over the prior, smaller where the posterior "
            f"lies; at most {MOST_FULL_SOLUTIONS} full solutions"
        )
        return {**self.full.description(), "reduced basis": basis}

    def bounds(self, values: FloatArray, n_modes: int | None = None) -> Bounds:
        """The certified errors at ``values`` (B, n_parameters): arrays (B, n_modes)."""
        basis, n, reference = self.basis, n_modes or self.n_modes, self._reference
        rigid = self.full.n_rigid_modes
        coefficients = self.full.system.coefficients(values)
        rows = [basis.bounds(each, n + rigid, reference) for each in coefficients]
        both = np.array(rows).reshape(-1, 2, n + rigid)[:, :, rigid:]
        frequency, shape = both.transpose(1, 0, 2)
        # A shift by half of the lowest (2πf)² raises it by half, and errors are shares of it.
        return Bounds(1.5 * frequency if rigid else frequency, shape)

    def accurate_at(self, required: Requirement) -> Self:
        """See :meth:`Structure.accurate_at`; at most ``MOST_FULL_SOLUTIONS`` in all."""
        bounds = self.bounds(required.values, required.n_modes)
        if not (_excess(bounds, required) > 1.0).any():
            return self
        better = self._copied()
        better._train(required)
        return better if better.basis.size > self.basis.size else self

    def confirming(self, values: FloatArray) -> Structure:
        if self.full.size <= ONE_FACTOR_FROM:
            return self.exact
        return self.accurate_at(Requirement(values, *CONFIRMING_ERRORS))

    def accuracy(self, values: FloatArray, n_modes: int | None = None) -> Accuracy:
        bounds = self.bounds(values, n_modes)
        frequency, shape = (float(each.max(initial=0.0)) for each in bounds)
        solutions = counted(self.n_full_solutions, "full solution")
        if self.n_corrected:
            solutions += f" and {counted(self.n_corrected, 'correction')} by its factors"
        return Accuracy(
            frequency,
            shape,
            f"{self.full.size} degrees of freedom reduced to {self.basis.size} by "
            f"{solutions}; by the residuals at {len(values)} draws, "
            f"frequencies are within {frequency:.1g} of the full model's (as a fraction)",
            f" and shapes at the sensors within about {shape:.1g} (at unit length)",
        )

    def _train(self, required: Requirement) -> None:
        """Add full solutions where errors are largest, until they are small at all values."""
        points, n_bounded = required.values, required.n_modes or self.n_modes
        n_bounded += self.full.n_rigid_modes
        negligible = self._negligible(required.frequency, required.shape)
        of_points = self.full.system.coefficients(points)
        whole = self._basis or ReducedBasis.empty(self._reference)
        basis = whole.without_elements(self._reference)
        # In units of what is required, at most: errors shrink as the basis grows, so only that of
        # the worst point is computed again, until it stays the worst.
        errors = np.full(len(points), np.inf)
        idle = 0  # last full solutions that the basis held already, as where modes cross
        while self.n_full_solutions + self.n_corrected < MOST_FULL_SOLUTIONS and idle < MOST_IDLE:
            worst = int(errors.argmax())
            while basis.size and errors[worst] > 1.0:
                bounds = whole.bounds(of_points[worst], n_bounded, self._reference)
                errors[worst] = _excess(bounds, required).max()
                if errors[worst] >= errors.max():
                    break
                worst = int(errors.argmax())
            if errors[worst] <= 1.0:
                break
            size = basis.size
            if size and self.full.size > ONE_FACTOR_FROM:
                at = of_points[worst]
                lacking = whole.corrections(at, n_bounded, negligible, self._reference)
                basis = basis.spanning(lacking, negligible, self._reference)
                self.n_corrected += 1
            else:
                # No point is solved twice, whatever rounding makes of its bound.
                errors[worst] = 0.0
                try:
                    modes = self.full.shifted_modes(points[worst], extra=1)
                except modal.NoModesError:
                    if not size:
                        raise
                    continue
                basis = basis.enriched(modes, negligible, self._reference)
                self.n_full_solutions += 1
            if basis.size == size:
                errors[worst] = 0.0
            idle = idle + 1 if basis.size == size else 0
            whole = self._carrying(basis)
        self._basis = whole

    def _modes_in_basis(self, values: FloatArray) -> Modes:
        """Modes of the small problem: shapes are y (B, N, n_modes); NaN in rows without modes."""
        return self.full.system.free_body.elastic(self._shifted_modes_in_basis(values))

    def _shifted_modes_in_basis(self, values: FloatArray) -> Modes:
        n, size = self.full.n_solved, self.basis.size
        frequencies_hz, y = np.empty((len(values), n)), np.empty((len(values), size, n))
        step = 64  # rows, whose matrices stay in the processor's cache
        for start in range(0, len(values), step):
            rows = slice(start, start + step)
            k, m = (each.evaluate(values[rows]) for each in self._in_basis)
            frequencies_hz[rows], y[rows] = modal.solve_modes(k, m, n)
        return Modes(frequencies_hz, y)

    @cached_property
    def _in_basis(self) -> tuple[AffineArray, AffineArray]:
        system, basis = self.full.system, self.basis
        return (
            system.stiffness.projected(basis.stiffness.matrices, self.parameters),
            system.mass.projected(basis.mass.matrices, self.parameters),
        )

    @cached_property
    def _reference(self) -> Reference:
        main = self.full.without_elements
        (medians,) = main.system.coefficients(main.prior_medians())
        return reference_of(main.system, main.sensor_rows, medians)

    def _copied(self) -> Self:
        """A copy for another basis, with the same reference."""
        other = copy(self)
        other.__dict__["_reference"] = self._reference
        return other

    def __getstate__(self) -> dict[str, Any]:
        """State without what is large, or belongs to this basis, and is quickly recomputed."""
        derived = ("_reference", "_in_basis")
        return {name: value for name, value in self.__dict__.items() if name not in derived}

    def __repr__(self) -> str:
        return (
            f"ReducedStructure({self.full!r}, frequency_error={FREQUENCY_ERROR}, "
            f"shape_error={SHAPE_ERROR}, most_full_solutions={MOST_FULL_SOLUTIONS}, "
            f"training_points={TRAINING_POINTS})"
        )


def _excess(bounds: Bounds, required: Requirement) -> FloatArray:
    """The larger of the two errors, relative to the required ones."""
    return np.maximum(bounds.frequency / required.frequency, bounds.shape / required.shape)


class MatrixStructure(AssembledStructure):
    """A finite-element model whose matrices are sums of fixed ones times products of parameters.

    Every set of parameter values costs a full eigen-solution, milliseconds for thousands of
    degrees of freedom and seconds for a hundred thousand; use :meth:`reduced` for sampling.

    >>> k = bs.Parameter("k", bs.LogNormal(median=(2 * np.pi) ** 2, cov=0.3))
    >>> stiffness = [(k, np.array([[2.0, -1.0], [-1.0, 1.0]]))]
    >>> frame = bs.MatrixStructure(stiffness, np.eye(2), n_modes=2, sensors={"roof": 1})
    >>> frame.modes(frame.prior_medians()).frequencies_hz.round(3)
    array([[0.618, 1.618]])
    """

    def reduced(self) -> ReducedStructure:
        """The same model in a reduced basis: thousands of times faster, with a certified error."""
        return ReducedStructure(self)

    @cached_property
    def for_many_hypotheses(self) -> Structure:
        return self.reduced() if self.size > BATCHED_WITH_ELEMENTS else self

    @property
    def performance_hint(self) -> str:
        if self.size <= BATCHED_UP_TO:
            return ""
        return (
            f"{self.size} degrees of freedom, solved in full tens of thousands of times; "
            f"{type(self).__name__}.reduced() needs dozens of full solutions"
        )
