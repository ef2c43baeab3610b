"""Errors of all paired modes of a class that are correlated: of identification and of prediction.

The frequency residual of mode i in test t is the sum of a prediction error ``σ_f e_ti`` and an
identification error, with

    corr(e_ti, e_sj) = ρ_tests^[t ≠ s] ρ_modes^|i - j|,

so that the residuals of all paired modes have the covariance ``C + σ_f² R``, and their joint
density is exact. C is that of identification errors, diagonal where a test's data have no joint
covariance. A mode is recognised in another test by its label; where ``ρ_modes`` is zero, the
prediction errors of modes of different labels are independent.

A shape's error is a vector in the plane that touches the sphere of unit shapes at the model's
shape. Its components have the correlation ``ρ_tests``, and their joint normal density over the
product of the single ones multiplies the densities on the sphere. For ``ρ_tests = 0`` these are
the independent densities themselves; otherwise the integral differs from one by about
``2 (d - 1) ((d - 3)/8)² ρ² σ⁴`` for two tests with d sensors, 2·10⁻⁴ for 12 sensors and σ = 0.05.
Only tests that measured a mode at the same sensors share its error. Shapes of different modes are
at right angles and their signs are arbitrary, so ``ρ_modes`` does not apply to them. Where the data
of a test have a joint covariance, its shapes and frequencies are one group
(:mod:`~bayes_ssi.inference.likelihood.joint_errors`).

Model modes that are paired with nothing are missed with the probability that each has by itself.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.sparse.csgraph import connected_components

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_groups import (
    ErrorGroups,
    ErrorSizes,
    ModeOfTest,
    Separation,
    conditional_errors,
)
from bayes_ssi.inference.likelihood.error_model import ErrorModel, is_zero
from bayes_ssi.inference.likelihood.joint_errors import (
    JointErrors,
    ShapeAxes,
    identification_covariance,
)
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.shape_planes import in_common_plane, tangents
from bayes_ssi.parameters.parameters import Parameter, ProductTable, as_product

# Size of the largest array of a batch: 2e7 numbers of 8 bytes are 160 MB.
LARGEST_ARRAY = 20_000_000


class ScoredShapes(NamedTuple):
    """The shapes of S paired modes that are scored, test by test, at all n sensors.

    Attributes:
        positions: (S,), of the modes among the paired ones.
        unit: (S, n), the identified shapes; zero where not measured.
        single_var: (S,), of identification errors.
        dimensions: (S,), directions in which each can err.
        columns: of each test's sensors among all.
        groups: the shapes of one mode at the same sensors in several tests, where they err
            together; others alone.
    """

    positions: list[int]
    unit: FloatArray
    single_var: FloatArray
    dimensions: FloatArray
    columns: list[NDArray[np.intp]]
    groups: list[list[int]]


@dataclass(frozen=True, eq=False)
class CorrelatedErrors:
    """Errors of the paired modes of all tests of a model class.

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
        """The N paired modes, test by test."""
        return tuple(
            ModeOfTest(test, label, number)
            for test, likelihood in enumerate(self.likelihoods)
            for label, number in likelihood.pairing.items()
        )

    @cached_property
    def _pairs(self) -> list[PairedModes]:
        """The pairs of each test, none where the pairing is inferred."""
        return [PairedModes.of(own.data, own.pairing.items()) for own in self.likelihoods]

    @cached_property
    def identified(self) -> NDArray[np.intp]:
        """Places (N,) of the paired modes among the identified ones of all tests in turn."""
        first = np.cumsum([0, *(len(own.data.modes) for own in self.likelihoods)])
        data = [own.data for own in self.likelihoods]
        places = [first[m.test] + data[m.test].labels.index(m.label) for m in self.modes]
        return np.array(places, dtype=np.intp)

    @cached_property
    def groups(self) -> list[list[int]]:
        """Positions in :attr:`modes` of those with correlated errors, group by group."""
        if not (self.modes and (self.error.is_correlated or self._have_covariance.any())):
            return []
        tests, modes = self._separation
        same_test = tests == 0.0
        linked = (same_test | self._between_tests) & (
            (modes == 0.0) | (np.isfinite(modes) & self._between_modes)
        )
        linked |= same_test & self._have_covariance
        n_groups, group_of = connected_components(linked, directed=False)
        groups = [np.flatnonzero(group_of == i) for i in range(n_groups)]
        return [own.tolist() for own in groups if len(own) > 1 or self._have_covariance[own].any()]

    @cached_property
    def _separation(self) -> Separation:
        return Separation.of(self.modes, self.modes, not self._between_modes)

    @cached_property
    def _have_covariance(self) -> NDArray[np.bool_]:
        """Which paired modes (N,) are of data with a joint covariance."""
        tests = [self.likelihoods[mode.test] for mode in self.modes]
        return np.array([own.data.covariance is not None for own in tests], dtype=bool)

    @cached_property
    def _frequency_covariance(self) -> FloatArray:
        """Covariance (N, N) of the identification errors of frequencies."""
        blocks = []
        for likelihood in self.likelihoods:
            places = [likelihood.data.labels.index(label) for label in likelihood.pairing]
            blocks.append(identification_covariance(likelihood.data)[np.ix_(places, places)])
        return np.asarray(block_diag(*blocks), dtype=float)

    @cached_property
    def _shapes(self) -> ScoredShapes:
        n_before = np.cumsum([0, *(len(own.pairing) for own in self.likelihoods)])
        pairs = self._pairs
        known: dict[str, int] = {}
        columns = [
            np.array([known.setdefault(s, len(known)) for s in own.data.sensors], dtype=np.intp)
            for own in self.likelihoods
        ]
        positions: list[int] = []
        groups: dict[Hashable, list[int]] = {}
        unit = np.zeros((sum(len(own.with_shape) for own in pairs), len(known)))
        for first, own, at in zip(n_before, pairs, columns, strict=False):
            for pair, shape, measured in zip(
                own.with_shape, own.unit_shapes.T, own.measured.T, strict=True
            ):
                s, position = len(positions), int(first + pair)
                seen = tuple(sorted(at[measured == 1.0].tolist()))
                key = (self.modes[position].label, seen) if self._between_tests else s
                groups.setdefault(key, []).append(s)
                unit[s, at] = shape
                positions.append(position)
        return ScoredShapes(
            positions,
            unit,
            np.concatenate([own.shape_var for own in pairs]),
            np.concatenate([own.n_measured for own in pairs]) - 1.0,
            columns,
            list(groups.values()),
        )

    @cached_property
    def _joint(self) -> dict[int, JointErrors]:
        """Groups of frequencies and shapes of data with a joint covariance, and others' with them.

        By the index of the group.
        """
        shapes, joint = self._shapes, {}
        for i, group in enumerate(self.groups):
            own = [s for s, position in enumerate(shapes.positions) if position in group]
            if not (own and self._have_covariance[group].any()):
                continue
            axes, columns = [], []
            for test in dict.fromkeys(self.modes[position].test for position in group):
                labels = [self.modes[p].label for p in group if self.modes[p].test == test]
                axes.append(ShapeAxes.of(self.likelihoods[test].data, labels))
                columns.append(shapes.columns[test])
            repeated = [[own.index(s) for s in each] for each in shapes.groups if each[0] in own]
            joint[i] = JointErrors(
                frequencies=self._frequencies_of([i]),
                shapes=own,
                axes=ShapeAxes.joined(axes, columns, shapes.unit.shape[1]),
                identified=shapes.unit[own],
                single_var=shapes.single_var[own],
                dimensions=shapes.dimensions[own],
                repeated=repeated if max(map(len, repeated)) > 1 else [],
            )
        return joint

    def _frequencies_of(self, groups: list[int]) -> ErrorGroups:
        """The frequencies of groups of equal size."""
        members = np.array([self.groups[i] for i in groups], dtype=np.intp)
        identification = self._frequency_covariance[members[:, :, None], members[:, None, :]]
        return ErrorGroups(groups, members, identification, self._separation.within(members))

    @cached_property
    def _frequencies(self) -> list[ErrorGroups]:
        """The frequencies of groups that are not in ``_joint``, those of equal size together."""
        rest = [i for i in range(len(self.groups)) if i not in self._joint]
        return [
            self._frequencies_of([i for i in rest if len(self.groups[i]) == n])
            for n in sorted({len(self.groups[i]) for i in rest})
        ]

    @cached_property
    def _repeated_shapes(self) -> list[ErrorGroups]:
        """The shapes of one mode in several tests of such groups, likewise."""
        shapes, found = self._shapes, []
        modes = [self.modes[position] for position in shapes.positions]
        separation = Separation.of(modes, modes, by_label=True)
        group_of = {position: i for i, group in enumerate(self.groups) for position in group}
        by_size: dict[int, list[list[int]]] = {}
        for own in shapes.groups:
            if len(own) > 1 and group_of[shapes.positions[own[0]]] not in self._joint:
                by_size.setdefault(len(own), []).append(own)
        for groups in by_size.values():
            members = np.array(groups, dtype=np.intp)
            identification = shapes.single_var[members][:, :, None] * np.eye(members.shape[1])
            found.append(
                ErrorGroups(
                    [group_of[shapes.positions[own[0]]] for own in groups],
                    members,
                    identification,
                    separation.within(members),
                    shapes.dimensions[members[:, :1]],
                )
            )
        return found

    def _sizes(self, values: FloatArray) -> tuple[ErrorSizes, ErrorSizes]:
        """Those of frequencies and of shapes at ``values``."""
        of_shapes = self.error.shape_sd if self._shapes.positions else self.error.frequency_cov
        sizes = as_product(self.error.frequency_cov), as_product(of_shapes)
        frequency, shape, tests, modes = (
            ProductTable((each,), self.parameters).evaluate(
                values if each.parameters else values[:1]
            )[:, 0]
            for each in (*sizes, *self.error.correlations)
        )
        return ErrorSizes(frequency**2, tests, modes), ErrorSizes(shape**2, tests, modes)

    def _residuals(self, frequencies_hz: Sequence[FloatArray]) -> FloatArray:
        """r_f = f/f_e - 1 of all paired modes, (B, N)."""
        each = zip(self._pairs, frequencies_hz, strict=True)
        return np.concatenate([pairs.frequency_residuals(own) for pairs, own in each], axis=1)

    def _unit_shapes(self, modes: Sequence[ComparedModes]) -> FloatArray:
        """Model shapes (B, S, n) of the pairs at unit length, zero where not measured."""
        known = self._shapes
        shapes = np.zeros((len(modes[0].frequencies_hz), *known.unit.shape))
        first = 0
        for pairs, columns, of_test in zip(self._pairs, known.columns, modes, strict=True):
            end = first + len(pairs.with_shape)
            if end > first and of_test.unit_shapes.size:
                of_pairs = of_test.unit_shapes.reshape(len(shapes), end - first, len(columns))
                shapes[:, first:end, columns] = of_pairs
            first = end
        return shapes

    def log_ratios(self, values: FloatArray, modes: Sequence[ComparedModes]) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B, n_groups).

        Args:
            values: (B, n_parameters).
            modes: of each test at these values.
        """
        largest = max((joint.largest_array for joint in self._joint.values()), default=1)
        n_rows = max(1, LARGEST_ARRAY // largest)
        if len(values) > n_rows:
            parts = [slice(i, i + n_rows) for i in range(0, len(values), n_rows)]
            return np.concatenate(
                [self.log_ratios(values[part], [own.rows(part) for own in modes]) for part in parts]
            )
        ratios = np.zeros((len(values), len(self.groups)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            sizes = self._sizes(values)
            residuals = self._residuals([of_test.frequencies_hz for of_test in modes])
            for stack in self._frequencies:
                errors = residuals[:, stack.members][..., None]
                ratios[:, stack.groups] = stack.log_ratios(errors, sizes[0])
            if not (self._joint or self._repeated_shapes):
                return ratios
            shapes = self._unit_shapes(modes)
            for stack in self._repeated_shapes:
                at_model = shapes[:, stack.members]
                errors = tangents(at_model, self._shapes.unit[stack.members])
                of_shapes = stack.log_ratios(in_common_plane(errors, at_model), sizes[1])
                for i, ratio in zip(stack.groups, of_shapes.T, strict=True):
                    ratios[:, i] += ratio
            for i, joint in self._joint.items():
                own = residuals[:, self.groups[i]], shapes[:, joint.shapes]
                ratios[:, i] = joint.log_ratio(*own, sizes)
        return ratios

    def independent_residuals(
        self, values: FloatArray, modes: Sequence[ComparedModes]
    ) -> tuple[FloatArray, dict[int, FloatArray]]:
        """All residuals as independent standard-normal numbers.

        Args:
            values: (B, n_parameters).
            modes: of each test at these values.

        Returns:
            Those of frequencies (B, N): residuals, given those before them in their group, over
            their standard deviations. And all those of groups with data of a joint covariance,
            (B, P + K) by the group's index, of shapes, too.
        """
        sizes = self._sizes(values)
        residuals = self._residuals([of_test.frequencies_hz for of_test in modes])
        variances = sizes[0].variance[:, None] + self._frequency_covariance.diagonal()
        independent = residuals / np.sqrt(variances)
        for stack in self._frequencies:
            errors = residuals[:, stack.members][..., None]
            variances, errors = conditional_errors(stack.covariance(sizes[0]), errors)
            independent[:, stack.members] = errors[..., 0] / np.sqrt(variances)
        together = {}
        for i, group in enumerate(self.groups):
            if i in self._joint:
                shapes = self._unit_shapes(modes)[:, self._joint[i].shapes]
                together[i] = self._joint[i].white(residuals[:, group], shapes, sizes).numbers
                independent[:, group] = together[i][:, : len(group)]
            elif self._have_covariance[group].any():
                together[i] = independent[:, group]
        return independent, together

    def correlated_normals(self, normals: FloatArray, values: FloatArray) -> FloatArray:
        """Standard-normal numbers (B, N) with the correlation of all paired frequencies' residuals.

        ``normals`` (B, N) are independent ones.
        """
        sizes, _ = self._sizes(values)
        correlated = normals.copy()
        for stack in (*self._frequencies, *(joint.frequencies for joint in self._joint.values())):
            covariance = stack.covariance(sizes)
            factors = np.linalg.cholesky(covariance)
            factors /= np.sqrt(np.einsum("...ii->...i", covariance))[..., None]
            numbers = normals[:, stack.members]
            correlated[:, stack.members] = np.einsum("...ij,...j->...i", factors, numbers)
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
        sizes, _ = self._sizes(values)
        by_label = not self._between_modes
        paired, between, own = (
            Separation.of(rows, columns, by_label).covariance(sizes)
            for rows, columns in (
                (self.modes, self.modes),
                (self.modes, further),
                (further, further),
            )
        )
        gain = np.linalg.solve(paired + self._frequency_covariance, between)
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
