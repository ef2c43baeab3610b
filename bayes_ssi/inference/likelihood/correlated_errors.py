"""Prediction errors that a model repeats: in the same mode of every test, and in the next mode.

The frequency residual of mode i in test t is the sum of a prediction error ``σ_f e_ti`` and an
identification error, with

    corr(e_ti, e_sj) = ρ_tests^[t ≠ s] ρ_modes^|i - j|,

so that the residuals of all paired modes have the covariance ``σ_f² R + diag(identification
variances)``, and their joint density is exact. A mode is recognised in another test by its label;
where ``ρ_modes`` is zero, modes of different labels are independent.

A shape's error is a vector in the plane that touches the sphere of unit shapes at the model's
shape. Its components have the correlation ``ρ_tests``, and their joint normal density over the
product of the single ones multiplies the densities on the sphere. For ``ρ_tests = 0`` these are
the independent densities themselves; otherwise the integral differs from one by about
``2 (d - 1) ((d - 3)/8)² ρ² σ⁴`` for two tests with d sensors, 2·10⁻⁴ for 12 sensors and σ = 0.05.
Only tests that measured a mode at the same sensors share its error. Shapes of different modes are
at right angles and their signs are arbitrary, so ``ρ_modes`` does not apply to them.

Model modes that are paired with nothing are missed with the probability that each has by itself.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_groups import (
    ErrorGroups,
    ErrorSizes,
    ModeOfTest,
    Separation,
    conditional_errors,
    grouped,
)
from bayes_ssi.inference.likelihood.error_model import ErrorModel, is_zero
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.shape_errors import ShapeErrors
from bayes_ssi.parameters.parameters import Parameter, ProductTable, Value, as_product
from bayes_ssi.structures.modal import Modes


@dataclass(frozen=True, eq=False)
class CorrelatedErrors:
    """Prediction errors of the paired modes of all tests of a model class.

    Attributes:
        parameters: columns of ``values``; those of all likelihoods are among them.
    """

    error: ErrorModel
    likelihoods: tuple[ModalLikelihood, ...]
    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        if self._between_tests and len(self.likelihoods) > 1:
            _check_labels(self.modes, self._between_modes)

    @property
    def _between_tests(self) -> bool:
        return not is_zero(self.error.correlations[0])

    @property
    def _between_modes(self) -> bool:
        return not is_zero(self.error.correlations[1])

    @cached_property
    def modes(self) -> tuple[ModeOfTest, ...]:
        """The paired modes, test by test."""
        return tuple(
            ModeOfTest(test, label, number)
            for test, likelihood in enumerate(self.likelihoods)
            for label, number in likelihood.pairing.items()
        )

    @cached_property
    def groups(self) -> list[list[int]]:
        """Positions in :attr:`modes` of those with correlated errors, group by group."""

        def key(mode: ModeOfTest) -> Hashable:
            of_test = None if self._between_tests else mode.test
            of_mode = None if self._between_modes else mode.label
            return of_test, of_mode

        return grouped(map(key, self.modes))

    def log_ratios(self, values: FloatArray, modes: Sequence[Modes]) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B, n_groups).

        Args:
            values: (B, n_parameters).
        """
        ratios = np.zeros((len(values), len(self.groups)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if self._frequencies is not None:
                residuals = self._residuals([of_test.frequencies_hz for of_test in modes])
                members = self._frequencies.of_members(residuals[:, :, None])
                sizes = self._sizes(self.error.frequency_cov, values)
                ratios += self._frequencies.log_ratios(members, sizes)
            shapes = self._shapes.groups if self._between_tests else None
            if shapes is not None:
                errors = self._shapes.errors(shapes, modes)
                sizes = self._sizes(self.error.shape_sd, values)
                of_shapes = shapes.log_ratios(errors, sizes)
                for label, ratio in zip(self._shapes.labels, of_shapes.T, strict=True):
                    ratios[:, self._group_of(label)] += ratio
        return ratios

    @cached_property
    def _frequencies(self) -> ErrorGroups | None:
        if not self.groups:
            return None
        return ErrorGroups.of(
            self.groups,
            self.modes,
            self._frequency_var,
            by_label=not self._between_modes,
            dimensions=[1] * len(self.groups),
        )

    @cached_property
    def _frequency_var(self) -> FloatArray:
        return np.concatenate([likelihood.pairs.frequency_var for likelihood in self.likelihoods])

    @cached_property
    def _shapes(self) -> ShapeErrors:
        return ShapeErrors(self.likelihoods)

    def _group_of(self, label: str) -> int:
        """The group of a label that occurs in several tests."""
        return next(
            i
            for i, group in enumerate(self.groups)
            if any(self.modes[position].label == label for position in group)
        )

    def _residuals(self, frequencies_hz: Sequence[FloatArray]) -> FloatArray:
        """r_f = f/f_e - 1 of all paired modes, (B, N)."""
        each = zip(self.likelihoods, frequencies_hz, strict=True)
        return np.concatenate(
            [likelihood.pairs.frequency_residuals(own) for likelihood, own in each], axis=1
        )

    def _sizes(self, size: Value, values: FloatArray) -> ErrorSizes:
        """Sizes and correlations at ``values``; of length one where they are fixed."""
        products = (as_product(size), *self.error.correlations)
        table = ProductTable(products, self.parameters)
        fixed = not any(product.parameters for product in products)
        sd, tests, modes = table.evaluate(values[:1] if fixed else values).T
        return ErrorSizes(sd * sd, tests, modes)

    def independent_residuals(
        self, values: FloatArray, frequencies_hz: Sequence[FloatArray]
    ) -> FloatArray:
        """Frequency residuals (B, N) of all paired modes, as independent standard-normal numbers.

        Each is the residual given those before it in its group, over its standard deviation.

        Args:
            values: (B, n_parameters).
            frequencies_hz: model frequencies (B, n_modes) of each test at these values.
        """
        residuals = self._residuals(frequencies_hz)
        sizes = self._sizes(self.error.frequency_cov, values)
        independent = residuals / np.sqrt(sizes.variance[:, None] + self._frequency_var)
        if self._frequencies is None:
            return independent
        covariance = self._frequencies.covariance(sizes)
        members = self._frequencies.of_members(residuals[:, :, None])
        steps = [
            residual[..., 0] / np.sqrt(variance)
            for variance, residual in conditional_errors(covariance, members)
        ]
        for g, group in enumerate(self.groups):
            for position, step in zip(group, steps, strict=False):
                independent[:, position] = step[:, g]
        return independent

    def correlated_normals(self, normals: FloatArray, values: FloatArray) -> FloatArray:
        """Standard-normal numbers (B, N) with the correlation of all paired frequencies' residuals.

        ``normals`` (B, N) are independent ones.
        """
        if self._frequencies is None:
            return normals
        covariance = self._frequencies.covariance(self._sizes(self.error.frequency_cov, values))
        factors = np.linalg.cholesky(covariance)
        factors /= np.sqrt(np.einsum("...ii->...i", covariance))[..., None]
        of_members = self._frequencies.of_members(normals[:, :, None])[..., 0]
        joint = np.einsum("...ij,...j->...i", factors, of_members)
        correlated = normals.copy()
        for g, group in enumerate(self.groups):
            correlated[:, group] = joint[:, g, : len(group)]
        return correlated

    def conditional(
        self,
        values: FloatArray,
        frequencies_hz: Sequence[FloatArray],
        further: Sequence[ModeOfTest],
    ) -> tuple[FloatArray, FloatArray]:
        """Frequency errors of further modes, given the residuals of the paired ones.

        Args:
            values: (B, n_parameters).
            frequencies_hz: model frequencies (B, n_modes) of each test at these values.

        Returns:
            Means (B, M) and covariance (B or 1, M, M) of their prediction errors, as residuals.
        """
        sizes = self._sizes(self.error.frequency_cov, values)
        by_label = not self._between_modes
        paired, between, own = (
            Separation.of(rows, columns, by_label).covariance(sizes)
            for rows, columns in (
                (self.modes, self.modes),
                (self.modes, further),
                (further, further),
            )
        )
        gain = np.linalg.solve(paired + np.diag(self._frequency_var), between)
        means = (gain * self._residuals(frequencies_hz)[:, :, None]).sum(axis=1)
        return means, own - np.einsum("bnm,bnk->bmk", gain, between)


def _check_labels(modes: Sequence[ModeOfTest], by_number: bool) -> None:
    labels = [mode.label for mode in modes]
    if len(set(labels)) == len(labels):
        raise ValueError(
            "between_tests: no paired mode has the same label in two tests; give one mode one "
            f"label in all of them, got {', '.join(map(repr, labels))}"
        )
    for a, b in combinations(modes, 2):
        if by_number and (a.label == b.label) != (a.number == b.number):
            raise ValueError(
                "between_tests and between_modes: a mode must have one label and one number in all "
                f"tests, but {a.label!r} is model mode {a.number} and {b.label!r} model mode "
                f"{b.number}; leave between_modes at 0"
            )
