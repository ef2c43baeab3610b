"""Starts of searches in narrow regions of a posterior, by least squares in the residuals.

Precise data make a posterior narrow: with identification errors of 0.01 % a region may hold less
than a millionth of the prior, and all of the evidence. With any pairing it has no slope that leads
there, either, for away from it all modes count as spurious. The residuals between model modes and
identified modes have a slope everywhere. From draws of the prior, each with a pairing that is
plausible where errors are wide, a descent follows them while the errors are narrowed:

1. Of the identified modes, in random order, some are paired, in proportion to the weights of the
   pairings if all errors were the widest. Where the pairing is given, it is that.
2. The sum of squares of the residuals over their errors, and of the coordinates, which is the
   prior's pull, is reduced. Then the errors are narrowed and pairs drawn again, so that those drop
   out that do not fit. Each descent begins at a width of its own: from narrow errors it leads to
   the nearest fit, from wide ones to that which is nearest to the prior's median.
3. The other identified modes are paired one by one, where the region then has more mass: of modes
   that a wrong model does not fit together, those that come first stay.
4. Where sizes of errors are inferred, the most probable ones with these residuals are taken, pairs
   drawn and the descent continued with them, in turn.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from bayes_ssi.foundations.arrays import BoolArray, FloatArray, IntArray, joined
from bayes_ssi.inference.calibration.least_squares import descend
from bayes_ssi.inference.likelihood.any_pairing import AnyPairing
from bayes_ssi.inference.likelihood.error_model import ErrorModel
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import PairingWeights, sample_pairings
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target, log_standard_normal
from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.structures.modal import Modes

# Of one search. Where a wrong model fits some of the modes only, in one of many ways, each of
# its regions is reached by two in three searches of 16 descents, and by nearly all of 32.
DESCENTS = 24
# The first size of errors: the spread of frequencies where a stiffness may be off by half.
WIDEST = 0.3
# From width to width a linear fit keeps its place, and wrong pairs fall behind by ten times.
NARROWING = math.sqrt(10.0)
LOWEST_SIZE = -3.0  # plausible one of inferred errors, in prior sds from the median
STEPS_AT_WIDTH = 2  # which the next width continues
STEPS_WITH_PAIR = 8  # with the errors' own size, where a fit takes half as many
STEPS_TO_END = 20
# Of errors, the first, the last and their number: an exact fit of n residuals draws them down
# by about n prior standard deviations of their logarithm, which ascents complete.
SIZES = (-6.0, 3.0, 13)
ROUNDS_OF_SIZES = 3  # in which sizes, pairs and the descent take turns
DRAWS = 30  # tried for each descent, where the model fails at most of them


def starts_in_narrow_regions(
    model_class: ModelClass, workers: Workers | None, rng: np.random.Generator
) -> SuggestedStarts:
    """Starts of one search, in standard-normal coordinates.

    Structures that are solved one by one are solved by the workers, if there are any.
    """
    descents = _Descents(model_class, workers, rng)
    return SuggestedStarts(descents.ends(), descents.n_evaluations)


def class_target(
    model_class: ModelClass,
    workers: Workers | None = None,
    cache: Cache | None = None,
    known_starts: FloatArray | None = None,
) -> Target:
    """The log-likelihood of a class, which suggests starts in its posterior's narrow regions."""
    pairs_none = all(each.pairing_is_given and not each.pairing for each in model_class.likelihoods)
    return Target(
        model_class.log_likelihood_at,
        len(model_class.parameters),
        workers,
        cache,
        partial(starts_in_narrow_regions, model_class, workers),
        known_starts,
        model_class.values,
        pairs_none,
    )


class PairedResiduals:
    """Residuals of one configuration's J identified modes, S of them with a shape that is scored.

    Each is paired with a model mode or none. Where the pairing is given, only its modes count.
    """

    def __init__(self, likelihood: ModalLikelihood, rng: np.random.Generator) -> None:
        self.likelihood, self.rng = likelihood, rng
        self.inferred = likelihood if isinstance(likelihood, AnyPairing) else None
        labels = likelihood.data.labels if self.inferred else tuple(likelihood.pairing)
        # Mode j of the chosen model modes belongs to identified mode j.
        self.pairs = PairedModes.of(likelihood.data, ((x, j) for j, x in enumerate(labels, 1)))
        self.given = np.array(list(likelihood.pairing.values()), dtype=np.intp) - 1
        self.n_identified = len(labels)

    def residuals(
        self, modes: Modes, chosen: IntArray, errors: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Residuals over ``errors``, (B, m), where identified mode j is model mode ``chosen``.

        Zero where it is -1, for a spurious mode.
        """
        column, paired = np.maximum(chosen, 0), chosen >= 0
        frequencies = np.take_along_axis(modes.frequencies_hz, column, axis=1)
        of_frequencies = self.pairs.frequency_residuals(frequencies) / errors[0]
        parts = [np.where(paired, of_frequencies, 0.0)]
        if len(self.pairs.with_shape):
            shapes = self.likelihood.shapes_at_sensors(modes)
            shapes = np.take_along_axis(shapes, column[:, None, :], axis=2)
            of_shapes = self.pairs.shape_differences(shapes) / errors[1][:, None, :]
            of_shapes = np.where(paired[:, None, self.pairs.with_shape], of_shapes, 0.0)
            parts.append(of_shapes.reshape(len(chosen), -1))
        return np.concatenate(parts, axis=1)

    def errors(self, values: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
        """Errors of frequencies (B, J) and shapes (B, S), their own and ``width`` together."""
        sizes = self.likelihood.standard_errors(values)
        # With any pairing the pairs of an identified mode with all model modes follow each other.
        step = self.likelihood.structure.n_modes if self.inferred else 1
        frequency, shape = (np.sqrt(size[:, ::step] ** 2 + width**2) for size in sizes)
        return frequency, shape

    def pairings(
        self, values: FloatArray, modes: Modes, width: float, considered: BoolArray
    ) -> IntArray:
        """A pairing (B, J) for each row, of the considered modes (B, J); -1 for spurious modes."""
        if self.inferred is None:
            return np.tile(self.given, (len(values), 1))
        weights = self._weights(values, modes, width)
        log_ratios = np.where(considered[:, :, None], weights.log_ratios, -np.inf)
        return sample_pairings(replace(weights, log_ratios=log_ratios), self.rng)

    def with_pair(
        self, values: FloatArray, modes: Modes, chosen: IntArray, identified: IntArray, width: float
    ) -> IntArray:
        """The pairings ``chosen`` (B, J) with one more mode (B,) of each row, paired at random.

        In proportion to the weights of pairs if all errors were of this width.
        """
        rows = np.arange(len(values))
        log_weights = self._weights(values, modes, width).log_ratios[rows, identified]
        row, column = np.nonzero(chosen >= 0)
        log_weights[row, chosen[row, column]] = -np.inf
        extended, noise = chosen.copy(), self.rng.gumbel(size=log_weights.shape)
        extended[rows, identified] = (log_weights + noise).argmax(1)
        return extended

    def _weights(self, values: FloatArray, modes: Modes, width: float) -> PairingWeights:
        """Weights of pairs if all errors were of this width; of their own size where it is 0."""
        likelihood = self.inferred
        assert likelihood is not None
        compared = likelihood.compared_modes(values, modes)
        if width > 0.0:
            # Modes turned one by one are near enough, and with such errors all would be close.
            compared = compared._replace(log_gains=np.zeros((len(values), 0, 0, 0)))
            likelihood = replace(likelihood, error=ErrorModel(width, width))
        return likelihood.pairing_weights(values, compared)


class _Descents:
    """The descents of one search, each a row of ``z`` (n, d)."""

    def __init__(
        self, model_class: ModelClass, workers: Workers | None, rng: np.random.Generator
    ) -> None:
        self.model_class, self.rng = model_class, rng
        self.n_evaluations = 0
        self.tests = [PairedResiduals(each, rng) for each in self.model_class.likelihoods]
        self.n_structural = len(self.model_class.structural_parameters)
        # The coordinates that are not of the structures.
        self.sizes = range(self.n_structural, len(self.model_class.parameters))
        # Other structures are solved faster here than sent.
        slow = any(test.structure.is_solved_by_rows for test in self.model_class.configurations)
        self._workers = workers if slow else None

    def _modes(self, z: FloatArray) -> list[Modes]:
        """Modes of each configuration at ``z`` (B, n_parameters); NaN where there are none."""
        self.n_evaluations += len(z)
        values = self.model_class.values(z)
        solve = self.model_class.modes_or_nan
        if self._workers is None or not len(z):
            return solve(values)
        parts = np.array_split(values, min(len(z), self._workers.n_parts))
        return [joined(modes) for modes in zip(*self._workers.call_each(solve, parts), strict=True)]

    def ends(self) -> FloatArray:
        """Where the descents ended, (m, d), each place once."""
        z = self._draws()
        if not (len(z) and self.n_structural and any(test.n_identified for test in self.tests)):
            return z[:0]
        # From small errors every other descent leads to what is fitted exactly.
        z[::2, self.sizes] = LOWEST_SIZE
        n = len(z)
        orders = [self.rng.random((n, t.n_identified)).argsort(axis=1) for t in self.tests]
        z = self._extended(*self._narrowed(z, orders), orders)
        everything = [np.ones(order.shape, dtype=bool) for order in orders]
        for _ in range(ROUNDS_OF_SIZES if self.sizes else 1):
            z = self._with_probable_sizes(z)
            chosen = self._pairings(z, 0.0, everything)
            z, curvatures = self._descended(z, chosen, 0.0, STEPS_TO_END)
        return self._distinct(z, curvatures)

    def _draws(self) -> FloatArray:
        """Prior draws (n, d) at which the structures have modes."""
        drawn: list[FloatArray] = []
        missing = DESCENTS
        for _ in range(DRAWS):
            z = self.rng.standard_normal((missing, len(self.model_class.parameters)))
            solved = [np.isfinite(modes.frequencies_hz) for modes in self._modes(z)]
            drawn.append(z[np.concatenate(solved, axis=1).all(axis=1)])
            missing -= len(drawn[-1])
            if not missing:
                break
        return np.concatenate(drawn)

    def _narrowed(
        self, z: FloatArray, orders: Sequence[IntArray]
    ) -> tuple[FloatArray, list[IntArray]]:
        """Ends with errors narrowed step by step, and the pairings there.

        Of the identified modes, in ``orders``, a random number of the first ones is paired.
        """
        widths = self._widths(z.shape[1])
        n = len(z)
        first = self.rng.integers(len(widths), size=n)
        counts = [self.rng.integers(1, order.shape[1] + 1, size=(n, 1)) for order in orders]
        considered = [order.argsort(axis=1) < m for order, m in zip(orders, counts, strict=True)]
        chosen = self._pairings(z, WIDEST, considered)
        for k, width in enumerate(widths):
            again = np.flatnonzero(first < k)
            if len(again):
                drawn = self._pairings(z[again], width, [modes[again] for modes in considered])
                for pairing, new in zip(chosen, drawn, strict=True):
                    pairing[again] = new
            now = np.flatnonzero(first <= k)
            if len(now):
                pairings = [pairing[now] for pairing in chosen]
                z[now], _ = self._descended(z[now], pairings, width, STEPS_AT_WIDTH)
        return z, chosen

    def _widths(self, n_parameters: int) -> FloatArray:
        """Widths of errors, from the widest to the smallest plausible error."""
        low = np.zeros((1, n_parameters))
        low[:, self.sizes] = LOWEST_SIZE
        sizes = np.concatenate([size.ravel() for test in self._errors(low, 0.0) for size in test])
        n = math.ceil(math.log(WIDEST / sizes.min(initial=WIDEST)) / math.log(NARROWING))
        return WIDEST / NARROWING ** np.arange(n + 1.0)

    def _extended(
        self, z: FloatArray, chosen: Sequence[IntArray], orders: Sequence[IntArray]
    ) -> FloatArray:
        """Ends with further modes paired, one by one in their order, where that has more mass."""
        if not any(test.inferred for test in self.tests):
            return z
        width = WIDEST / NARROWING
        z, curvatures = self._descended(z, chosen, 0.0, STEPS_TO_END)
        masses = self._log_masses(z, curvatures)
        for t, test in enumerate(self.tests):
            for mode in orders[t].T if test.inferred else ():
                rows = np.flatnonzero(chosen[t][np.arange(len(z)), mode] < 0)
                if not len(rows):
                    continue
                tried = [pairing[rows] for pairing in chosen]
                values, modes = self._values(z[rows])[t], self._modes(z[rows])[t]
                tried[t] = test.with_pair(values, modes, tried[t], mode[rows], width)
                ends, curvatures = self._descended(z[rows], tried, 0.0, STEPS_WITH_PAIR)
                new = self._log_masses(ends, curvatures)
                better = new > masses[rows]
                z[rows[better]], masses[rows[better]] = ends[better], new[better]
                chosen[t][rows[better]] = tried[t][better]
        return z

    def _values(self, z: FloatArray) -> list[FloatArray]:
        return [values for _, _, values in self.model_class.parts(self.model_class.values(z))]

    def _errors(self, z: FloatArray, width: float) -> list[tuple[FloatArray, FloatArray]]:
        tests = zip(self.tests, self._values(z), strict=True)
        return [test.errors(values, width) for test, values in tests]

    def _pairings(
        self, z: FloatArray, width: float, considered: Sequence[BoolArray]
    ) -> list[IntArray]:
        if not any(test.inferred for test in self.tests):
            return [np.tile(test.given, (len(z), 1)) for test in self.tests]
        tests = zip(self.tests, self._values(z), self._modes(z), considered, strict=True)
        return [test.pairings(values, modes, width, own) for test, values, modes, own in tests]

    def _descended(
        self, z: FloatArray, chosen: Sequence[IntArray], width: float, most_steps: int
    ) -> tuple[FloatArray, FloatArray]:
        """Ends (n, d) of descents in the structures' coordinates, and JᵀJ there."""
        errors = self._errors(z, width)

        def residuals(structural: FloatArray, rows: IntArray) -> FloatArray:
            whole = np.concatenate([structural, z[rows, self.n_structural :]], axis=1)
            tests = zip(self.tests, self._modes(whole), chosen, errors, strict=True)
            parts = [
                test.residuals(modes, pairing[rows], (frequency[rows], shape[rows]))
                for test, modes, pairing, (frequency, shape) in tests
            ]
            return np.concatenate([*parts, structural], axis=1)

        ends, curvatures = descend(residuals, z[:, : self.n_structural], most_steps)
        return np.concatenate([ends, z[:, self.n_structural :]], axis=1), curvatures

    def _with_probable_sizes(self, z: FloatArray) -> FloatArray:
        """The same with the most probable of the tried sizes of errors, one after the other."""
        if not self.sizes:
            return z
        z = z.copy()
        sizes = np.linspace(*SIZES)
        n = len(sizes)
        repeated = [
            Modes(*(np.repeat(array, n, axis=0) for array in modes)) for modes in self._modes(z)
        ]
        for column in self.sizes:
            tried = np.repeat(z, n, axis=0)
            tried[:, column] = np.tile(sizes, len(z))
            heights = self._log_posteriors(tried, repeated).reshape(len(z), n)
            z[:, column] = sizes[heights.argmax(axis=1)]
        return z

    def _log_posteriors(self, z: FloatArray, modes: Sequence[Modes]) -> FloatArray:
        log_likelihoods = self.model_class.log_density_of_modes(self.model_class.values(z), modes)
        log_likelihoods[np.isnan(log_likelihoods)] = -np.inf
        return log_likelihoods + log_standard_normal(z)

    def _log_masses(self, z: FloatArray, curvatures: FloatArray) -> FloatArray:
        """Laplace's approximation of the evidence (n,) around ends of descents."""
        heights = self._log_posteriors(z, self._modes(z))
        return Maxima(z[:, : self.n_structural], heights, curvatures).log_masses

    def _distinct(self, z: FloatArray, curvatures: FloatArray) -> FloatArray:
        """The highest of those within a standard deviation of one another."""
        heights = self._log_posteriors(z, self._modes(z))
        left = np.argsort(-heights, kind="stable")[: int(np.isfinite(heights).sum())]
        structural = z[:, : self.n_structural]
        kept: list[int] = []
        while len(left):
            kept.append(left[0])
            top = Maxima(structural[left[:1]], heights[left[:1]], curvatures[left[:1]])
            left = left[1:][~top.are_at(structural[left[1:]])[0]]
        return z[kept]
