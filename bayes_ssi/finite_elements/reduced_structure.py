"""A finite-element model in a reduced basis: small matrices, and a certificate of their error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.finite_elements.approximate_structure import Accuracy, ApproximateStructure
from bayes_ssi.finite_elements.reduced_basis import (
    Bounds,
    Coefficients,
    ReducedBasis,
    Reference,
)
from bayes_ssi.finite_elements.reducible_structure import ReducibleStructure
from bayes_ssi.finite_elements.sparse_factors import NoModesError
from bayes_ssi.finite_elements.sparse_modes import (
    SMALL,
    batch_of_modes,
    dense_modes,
    frequencies_hz,
)
from bayes_ssi.modal import ModalModel, Modes
from bayes_ssi.parameters import Parameter

__all__ = ["ReducedStructure"]

# Points of the prior among which full solutions are placed.
TRAINING_POINTS = 512
# Rows that are assembled at a time.
CHUNK = 64
# Directions that add less than this share of the wanted accuracy to a mode are left out.
NEGLIGIBLE = 0.15
# A point whose error is this share of the largest one known may be solved in its place.
BAD_ENOUGH = 0.7


class ReducedStructure(ApproximateStructure):
    """A finite-element model whose modes are sought in the span of some of its full solutions.

    The basis is made when modes are first asked for. Full solutions are placed one after the other
    where the certified error is largest among points of the prior (a greedy reduced basis), until
    it is below what was asked for at all of them. :meth:`accurate_at` goes on from there at other
    values. A basis never changes: what goes on is a new structure.

    The certificate is in :mod:`bayes_ssi.finite_elements.reduced_basis`. What it cannot see is a
    mode that no full solution had; every full solution is counted by Sylvester's law.
    """

    def __init__(
        self,
        full: ReducibleStructure,
        *,
        frequency_error: float = 1e-3,
        shape_error: float = 0.1,
        most_full_solutions: int = 150,
    ) -> None:
        """Say how accurate it is to be; nothing is computed yet.

        Args:
            full: the model.
            frequency_error: largest relative error of frequencies over the prior.
            shape_error: largest error of shapes, at the sensors and at unit length there.
            most_full_solutions: when to stop, whatever the error; it is then said to be larger.

        Raises:
            ValueError: one of them is not positive.
            TypeError: ``full`` cannot be reduced.
        """
        if not isinstance(full, ReducibleStructure):
            raise TypeError(f"ReducedStructure: full must be a MatrixStructure, got {full!r}")
        for name, value in (
            ("frequency_error", frequency_error),
            ("shape_error", shape_error),
            ("most_full_solutions", most_full_solutions),
        ):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"ReducedStructure: {name} must be positive, got {value!r}")
        self.full = full
        self.frequency_error, self.shape_error = frequency_error, shape_error
        self.most_full_solutions = most_full_solutions
        self.n_full_solutions = 0
        self._basis: ReducedBasis | None = None

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.full.parameters

    @property
    def degrees_of_freedom(self) -> tuple[str, ...]:
        return self.full.degrees_of_freedom

    @property
    def n_modes(self) -> int:
        return self.full.n_modes

    @property
    def exact(self) -> ReducibleStructure:
        return self.full

    @property
    def basis(self) -> ReducedBasis:
        """The basis, made now if it was not asked for before.

        Raises:
            NoModesError: the full model has no solution at the prior medians.
        """
        if self._basis is None:
            points = np.vstack([self.full.prior_medians(), self._prior_points()])
            self._train(points, self.frequency_error, self.shape_error)
        assert self._basis is not None
        return self._basis

    def modes(self, values: FloatArray) -> Modes:
        """As :meth:`Structure.modes`; rows without modes are NaN.

        Raises:
            NoModesError: there are none at the only row of ``values``; the message says why.
        """
        eigenvalues, y = self._solved(values)
        return Modes(frequencies_hz(eigenvalues), self.basis.at_sensors @ y)

    def modal_model(self, values: FloatArray) -> ModalModel:
        influence = self.full.require_influence()
        eigenvalues, y = self._solved(values)
        mass = self.full.system.mass
        pushed = [self.basis.vectors.T @ (each @ influence) for each in mass.matrices]
        of_mass = mass.coefficients(values, self.parameters)
        return ModalModel(
            frequencies_hz(eigenvalues),
            self.basis.at_sensors @ y,
            np.einsum("bt,tk,bkm->bm", of_mass, np.array(pushed), y),
            influence[self.full.system.sensor_rows],
        )

    def description(self) -> Mapping[str, Any]:
        basis = (
            f"frequencies within {self.frequency_error:g} (as a fraction) and shapes within "
            f"{self.shape_error:g} (at unit length) over the prior, sharper where the posterior "
            f"lies; at most {self.most_full_solutions} full solutions"
        )
        return {**self.full.description(), "reduced basis": basis}

    def bounds(self, values: FloatArray) -> Bounds:
        """The certified errors at ``values`` (B, n_parameters): arrays (B, n_modes)."""
        basis, n, reference = self.basis, self.n_modes, self._reference
        of_rows = [basis.bounds(each, n, reference) for each in self._at(values)]
        empty = np.empty((0, self.n_modes))
        return Bounds(
            np.array([one.frequency for one in of_rows]) if of_rows else empty,
            np.array([one.shape for one in of_rows]) if of_rows else empty,
        )

    def accurate_at(self, values: FloatArray, frequency_error: float, shape_error: float) -> Self:
        """This structure if it is so accurate at all ``values``, or one with a larger basis.

        ``most_full_solutions`` is the limit of both together.
        """
        bounds = self.bounds(values)
        if not (_excess(bounds, frequency_error, shape_error) > 1.0).any():
            return self
        better = copy(self)
        better._train(values, frequency_error, shape_error)
        return better if better.n_full_solutions > self.n_full_solutions else self

    def accuracy(self, values: FloatArray) -> Accuracy:
        bounds = self.bounds(values)
        frequency, shape = (
            float(each.max(initial=0.0)) for each in (bounds.frequency, bounds.shape)
        )
        return Accuracy(
            frequency,
            shape,
            f"{self.full.size} degrees of freedom reduced to {self.basis.size} by "
            f"{self.n_full_solutions} full solutions; by the residuals at {len(values)} draws, "
            f"frequencies are within {frequency:.1g} of the full model's (as a fraction) and "
            f"shapes that the sensors see within about {shape:.1g} (at unit length)",
        )

    def _train(self, points: FloatArray, frequency_error: float, shape_error: float) -> None:
        """Full solutions where they are needed most, until none of ``points`` needs one.

        Errors shrink as the basis grows, so the last known ones are bounds: only the points that
        may be the worst are asked again.
        """
        basis = self._basis
        negligible = NEGLIGIBLE * min(math.sqrt(frequency_error), shape_error)
        of_points = self._at(points)
        last_known = np.full(len(points), np.inf)

        def update(i: int) -> float:
            assert basis is not None
            bounds = basis.bounds(of_points[i], self.n_modes, self._reference)
            last_known[i] = _excess(bounds, frequency_error, shape_error).max()
            return float(last_known[i])

        while self.n_full_solutions < self.most_full_solutions:
            if basis is None:
                worst = 0
                basis = ReducedBasis.empty(self._reference)
            else:
                worst = int(last_known.argmax())
                while last_known[worst] > 1.0:
                    if update(worst) >= BAD_ENOUGH * last_known.max():
                        break
                    worst = int(last_known.argmax())
                if not last_known[worst] > 1.0:
                    break
            try:
                modes = self.full.full_modes(points[worst], extra=1)
            except NoModesError:
                if not basis.size:
                    raise
                modes = None  # a point without modes needs no basis
            # Once solved it is never asked again, whatever rounding makes of its bound.
            last_known[worst] = 0.0
            if modes is not None:
                basis = basis.grown(modes, negligible, self._reference)
                self.n_full_solutions += 1
        self._basis = basis

    def _solved(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(2πf)² (B, n_modes) and y (B, N, n_modes); NaN in rows that have no modes."""
        basis = self.basis
        of_stiffness, of_mass = self._coefficients(values)
        size, n = basis.size, self.n_modes
        stiffness = basis.stiffness.reshape(len(basis.stiffness), -1)
        mass = basis.mass.reshape(len(basis.mass), -1)
        eigenvalues, y = np.empty((len(values), n)), np.empty((len(values), size, n))
        solve = batch_of_modes if size <= SMALL else _one_by_one
        for start in range(0, len(values), CHUNK):
            rows = slice(start, start + CHUNK)
            # Not matrix products: BLAS rounds a row differently in a batch of another size.
            k = np.einsum("bt,tk->bk", of_stiffness[rows], stiffness).reshape(-1, size, size)
            m = np.einsum("bt,tk->bk", of_mass[rows], mass).reshape(-1, size, size)
            eigenvalues[rows], y[rows] = solve(k, m, n)
        if len(values) == 1 and np.isnan(eigenvalues).any():
            dense_modes(k[0], m[0], n)  # says why
        return eigenvalues, y

    @cached_property
    def _reference(self) -> Reference:
        (medians,) = self._at(self.full.prior_medians())
        system = self.full.system
        return Reference(system.stiffness, system.mass, system.sensor_rows, medians)

    def _coefficients(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        system = self.full.system
        return (
            system.stiffness.coefficients(values, self.parameters),
            system.mass.coefficients(values, self.parameters),
        )

    def _at(self, values: FloatArray) -> list[Coefficients]:
        return [Coefficients(k, m) for k, m in zip(*self._coefficients(values), strict=True)]

    def _prior_points(self) -> FloatArray:
        """Points (TRAINING_POINTS, n_parameters) that fill the prior evenly."""
        from scipy.stats import qmc

        d = len(self.parameters)
        if not d:
            return np.empty((0, 0))
        uniform = qmc.Sobol(d, rng=np.random.default_rng(0)).random(TRAINING_POINTS)
        from scipy.special import ndtri

        z = ndtri(np.clip(uniform, 1e-4, 1.0 - 1e-4))
        return np.column_stack(
            [p.prior.from_normal(z[:, i]) for i, p in enumerate(self.parameters)]
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without what is quickly made again, and too large to be sent."""
        return {name: value for name, value in self.__dict__.items() if name != "_reference"}

    def __repr__(self) -> str:
        return (
            f"ReducedStructure({self.full!r}, frequency_error={self.frequency_error}, "
            f"shape_error={self.shape_error}, most_full_solutions={self.most_full_solutions})"
        )


def _one_by_one(
    stiffness: FloatArray, mass: FloatArray, n_modes: int
) -> tuple[FloatArray, FloatArray]:
    """As :func:`batch_of_modes`, which for larger matrices computes what is not asked for."""
    eigenvalues = np.full((len(stiffness), n_modes), np.nan)
    vectors = np.full((*stiffness.shape[:2], n_modes), np.nan)
    for i, (k, m) in enumerate(zip(stiffness, mass, strict=True)):
        with suppress(NoModesError):
            eigenvalues[i], vectors[i] = dense_modes(k, m, n_modes)
    return eigenvalues, vectors


def _excess(bounds: Bounds, frequency_error: float, shape_error: float) -> FloatArray:
    """The larger of both errors, in units of what is wanted."""
    return np.maximum(bounds.frequency / frequency_error, bounds.shape / shape_error)
