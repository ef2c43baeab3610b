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

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.sparse.csgraph import connected_components

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray
from bayes_ssi.inference.likelihood.error_model import ErrorModel
from bayes_ssi.inference.likelihood.joint_errors import (
    ErrorGroup,
    ErrorSizes,
    JointErrors,
    ModeOfTest,
    Separation,
    in_common_plane,
    tangents,
)
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.parameters.parameters import Parameter, ProductTable, as_product

# Size of the largest array of a batch: 2e7 numbers of 8 bytes are 160 MB.
LARGEST_ARRAY = 20_000_000


@dataclass(frozen=True, eq=False)
class CorrelatedErrors:
    error: ErrorModel
    likelihoods: tuple[ModalLikelihood, ...]
    # Columns of ``values``; those of all likelihoods are among them.
    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        if not (self.error.repeats_between_tests and len(self.likelihoods) > 1):
            return
        labels = [mode.label for mode in self.modes]
        if len(set(labels)) == len(labels):
            raise ValueError(
                "between_tests: no paired mode has the same label in two tests; give one mode one "
                f"label in all of them, got {', '.join(map(repr, labels))}"
            )
        for a, b in combinations(self.modes, 2) if self.error.repeats_between_modes else ():
            if (a.label == b.label) != (a.number == b.number):
                raise ValueError(
                    "between_tests and between_modes: a mode must have one label and one number in "
                    f"all tests, but {a.label!r} is model mode {a.number} and {b.label!r} model "
                    f"mode {b.number}; leave between_modes at 0"
                )

    @cached_property
    def modes(self) -> tuple[ModeOfTest, ...]:
        """The N paired modes, test by test."""
        return tuple(
            ModeOfTest(test, label, number)
            for test, likelihood in enumerate(self.likelihoods)
            for label, number in likelihood.pairing.items()
        )

    @cached_property
    def _pairs_of_tests(self) -> list[PairedModes]:
        """The pairs of each test, none where the pairing is inferred."""
        return [test.given(test.pairing).pairs for test in self.likelihoods]

    @cached_property
    def identified(self) -> IntArray:
        """Places (N,) of the paired modes among the identified ones of all tests in turn."""
        data = [test.data for test in self.likelihoods]
        first = np.cumsum([0, *(len(identified.modes) for identified in data)])
        places = [first[m.test] + data[m.test].labels.index(m.label) for m in self.modes]
        return np.array(places, dtype=np.intp)

    @cached_property
    def groups(self) -> list[list[int]]:
        """Positions in :attr:`modes` of those with correlated errors, group by group."""
        if not (self.modes and (self.error.is_correlated or self._have_covariance.any())):
            return []
        tests, modes = self._separation
        same_test = tests == 0.0
        linked = same_test | self.error.repeats_between_tests
        linked &= (modes == 0.0) | self.error.repeats_between_modes
        linked |= same_test & self._have_covariance
        n_groups, group_of = connected_components(linked, directed=False)
        groups = [np.flatnonzero(group_of == i) for i in range(n_groups)]
        return [g.tolist() for g in groups if len(g) > 1 or self._have_covariance[g].any()]

    @cached_property
    def _separation(self) -> Separation:
        return Separation.of(self.modes)

    @cached_property
    def _have_covariance(self) -> BoolArray:
        """Which paired modes (N,) are of data with a joint covariance."""
        tests = [self.likelihoods[mode.test] for mode in self.modes]
        return np.array([test.data.covariance is not None for test in tests], dtype=bool)

    @cached_property
    def _places(self) -> tuple[int, list[IntArray]]:
        """The number n of sensors of all tests, and where each one's shapes are in (S n,)."""
        sensors = list(dict.fromkeys(s for test in self.likelihoods for s in test.data.sensors))
        places, first = [], 0
        for likelihood, pairs in zip(self.likelihoods, self._pairs_of_tests, strict=True):
            columns = np.array([sensors.index(s) for s in likelihood.data.sensors], dtype=np.intp)
            shapes = first + np.arange(len(pairs.with_shape))
            places.append((len(sensors) * shapes[:, None] + columns).ravel())
            first += len(shapes)
        return len(sensors), places

    @cached_property
    def _pairs(self) -> PairedModes:
        """The N pairs of all tests, S of them with a shape that is scored, at all n sensors."""
        return PairedModes.joined(self._pairs_of_tests, *self._places)

    @cached_property
    def _identification(self) -> FloatArray:
        """Covariance (N, N) of identification errors, (N + S n, N + S n) where shapes' is joint."""
        if not self._have_covariance.any():
            return np.diag(self._pairs.frequency_var)
        n = len(self.modes)
        whole = np.zeros((n + self._pairs.unit_shapes.size,) * 2)
        parts = zip(self.likelihoods, self._pairs_of_tests, self._places[1], strict=True)
        for test, (likelihood, pairs, shapes) in enumerate(parts):
            frequencies = np.flatnonzero([mode.test == test for mode in self.modes])
            rows = np.concatenate([frequencies, n + shapes])
            whole[np.ix_(rows, rows)] = pairs.identification_covariance(likelihood.data)
        return whole

    @cached_property
    def _shape_groups(self) -> list[list[int]]:
        """The shapes of one mode at the same sensors in several tests, if they err together."""
        groups: dict[Hashable, list[int]] = {}
        shapes = zip(self._pairs.with_shape, self._pairs.measured.T, strict=True)
        for s, (pair, seen) in enumerate(shapes):
            key = (self.modes[pair].label, tuple(seen)) if self.error.repeats_between_tests else s
            groups.setdefault(key, []).append(s)
        return list(groups.values())

    @cached_property
    def _joint(self) -> list[JointErrors]:
        """Each group's frequencies, and shapes where data have a joint covariance."""
        joint = []
        for group in self.groups:
            shapes: list[int] = []
            if self._have_covariance[group].any():
                shapes = np.flatnonzero(np.isin(self._pairs.with_shape, group)).tolist()
            same = [[shapes.index(s) for s in g] for g in self._shape_groups if g[0] in shapes]
            repeated = same if len(same) < len(shapes) else []
            whole, separation = self._identification, self._separation.within(group)
            frequencies = ErrorGroup(group, whole[np.ix_(group, group)], separation)
            joint.append(JointErrors.of(whole, self._pairs, frequencies, shapes, repeated))
        return joint

    @cached_property
    def _repeated_shapes(self) -> list[tuple[int, ErrorGroup]]:
        """The shapes of one mode in several tests, in groups with these indices and no others."""
        pairs, repeated = self._pairs, []
        group_of = {pair: i for i, group in enumerate(self.groups) for pair in group}
        for shapes in self._shape_groups:
            first = int(pairs.with_shape[shapes[0]])
            if len(shapes) > 1 and not self._joint[group_of[first]].shapes:
                of_pairs = self._separation.within(pairs.with_shape[shapes].tolist())
                dimensions = pairs.n_measured[shapes[0]] - 1.0
                same = ErrorGroup(shapes, np.diag(pairs.shape_var[shapes]), of_pairs, dimensions)
                repeated.append((group_of[first], same))
        return repeated

    def _sizes(self, values: FloatArray) -> tuple[ErrorSizes, ErrorSizes]:
        """Those of frequencies and of shapes at ``values``."""
        of_shapes = self.error.shape_sd if self._pairs.n_measured else self.error.frequency_cov
        sizes = as_product(self.error.frequency_cov), as_product(of_shapes)
        frequency, shape, tests, modes = (
            ProductTable((product,), self.parameters).evaluate(
                values if product.parameters else values[:1]
            )[:, 0]
            for product in (*sizes, *self.error.correlations)
        )
        return ErrorSizes(frequency**2, tests, modes), ErrorSizes(shape**2, tests, modes)

    def _residuals(self, frequencies_hz: Sequence[FloatArray]) -> FloatArray:
        """r_f = f/f_e - 1 of all paired modes, (B, N)."""
        tests = zip(self._pairs_of_tests, frequencies_hz, strict=True)
        return np.concatenate([pairs.frequency_residuals(hz) for pairs, hz in tests], axis=1)

    def _unit_shapes(self, modes: Sequence[ComparedModes]) -> FloatArray:
        """Model shapes (B, S, n) of the pairs at unit length, zero where not measured."""
        n, n_shapes = self._pairs.unit_shapes.shape
        shapes = np.zeros((len(modes[0].frequencies_hz), n_shapes * n))
        for places, compared in zip(self._places[1], modes, strict=True):
            if len(places) and compared.unit_shapes.size:
                shapes[:, places] = compared.unit_shapes
        return shapes.reshape(len(shapes), n_shapes, n)

    def log_ratios(self, values: FloatArray, modes: Sequence[ComparedModes]) -> FloatArray:
        """Log of the joint density over the product of the single ones, (B, n_groups).

        ``modes`` are those of each test at ``values`` (B, n_parameters).
        """
        largest = max((joint.largest_array for joint in self._joint), default=1)
        n_rows = max(1, LARGEST_ARRAY // largest)
        if len(values) > n_rows:
            parts = (slice(i, i + n_rows) for i in range(0, len(values), n_rows))
            ratios_of = [self.log_ratios(values[p], [m.rows(p) for m in modes]) for p in parts]
            return np.concatenate(ratios_of)
        ratios = np.zeros((len(values), len(self.groups)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            sizes = self._sizes(values)
            residuals = self._residuals([compared.frequencies_hz for compared in modes])
            shapes = self._unit_shapes(modes)
            for i, (group, joint) in enumerate(zip(self.groups, self._joint, strict=True)):
                ratios[:, i] = joint.log_ratio(residuals[:, group], shapes[:, joint.shapes], sizes)
            for i, repeated in self._repeated_shapes:
                at_model = shapes[:, repeated.members]
                errors = tangents(at_model, self._pairs.unit_shapes.T[repeated.members])
                ratios[:, i] += repeated.log_ratio(in_common_plane(errors, at_model), sizes[1])
        return ratios

    def independent_residuals(
        self, values: FloatArray, modes: Sequence[ComparedModes]
    ) -> tuple[FloatArray, dict[int, FloatArray]]:
        """All residuals as independent standard-normal numbers; arguments as in :meth:`log_ratios`.

        Returns:
            Those of frequencies (B, N): residuals, given those before them in their group, over
            their standard deviations. And all those of groups with data of a joint covariance,
            (B, P + K) by the group's index, of shapes, too.
        """
        sizes = self._sizes(values)
        residuals = self._residuals([compared.frequencies_hz for compared in modes])
        variances = sizes[0].variance[:, None] + self._pairs.frequency_var
        independent = residuals / np.sqrt(variances)
        shapes, together = self._unit_shapes(modes), {}
        for i, (group, joint) in enumerate(zip(self.groups, self._joint, strict=True)):
            white = joint.white(residuals[:, group], shapes[:, joint.shapes], sizes).numbers
            independent[:, group] = white[:, : len(group)]
            if self._have_covariance[group].any():
                together[i] = white
        return independent, together

    def correlated_normals(self, normals: FloatArray, values: FloatArray) -> FloatArray:
        """Independent ``normals`` (B, N) with the correlation of paired frequencies' residuals."""
        sizes, _ = self._sizes(values)
        correlated = normals.copy()
        for group, joint in zip(self.groups, self._joint, strict=True):
            covariance = joint.frequencies.covariance(sizes)
            factors = np.linalg.cholesky(covariance)
            factors /= np.sqrt(np.einsum("...ii->...i", covariance))[..., None]
            correlated[:, group] = np.einsum("...ij,...j->...i", factors, normals[:, group])
        return correlated

    def conditional(
        self, values: FloatArray, frequencies_hz: Sequence[FloatArray], others: Sequence[ModeOfTest]
    ) -> tuple[FloatArray, FloatArray]:
        """Prediction errors of other modes' frequencies, given the residuals of the paired ones.

        Means (B, M) and covariance (B or 1, M, M), as residuals; ``frequencies_hz`` (B, n_modes)
        are the model's in each test at ``values`` (B, n_parameters).
        """
        sizes, _ = self._sizes(values)
        every, n = (*self.modes, *others), len(self.modes)
        covariance = Separation.of(every).covariance(sizes)
        between = covariance[:, :n, n:]
        paired = covariance[:, :n, :n] + self._identification[:n, :n]
        gain = np.linalg.solve(paired, between)
        means = (gain * self._residuals(frequencies_hz)[:, :, None]).sum(axis=1)
        return means, covariance[:, n:, n:] - np.einsum("bnm,bnk->bmk", gain, between)
