"""Gains of layouts of sensors, in nats, and a search for the layout that gains most.

Information about the class is E[log p(D | C) - log p(D)] over tests simulated from every class C,
with p(D | C) the average over the class's draws about each test. A layout reads its rows of the
same tests and of the same draws: nothing is simulated again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.studies.planning.centred_draws import CentredDraws, centred_draws
from bayes_ssi.studies.planning.planned_class import PlannedClass, SimulatedTests, simulate

N_OF_A_SIZE = 2  # layouts that draws serve, of two sensors and of as many as are planned
LEAST_THAT_COUNTS = 0.01  # of probability after a test: below it an evidence says nothing
MOST_EXHAUSTIVE = 500  # layouts that are all tried; with more, the search is greedy

Sensors = tuple[int, ...]  # candidates, from 0, in ascending order


def served_layouts(fixed: Sensors, free: Sensors, n_sensors: int, seed: int) -> list[Sensors]:
    """All candidates, and layouts of two and of ``n_sensors`` sensors, each at other candidates."""
    order = np.random.default_rng(seed).permutation(free)
    layouts = {tuple(sorted((*fixed, *free))): None}
    for size in (2, n_sensors):
        more = max(0, size - len(fixed))
        for turn in range(N_OF_A_SIZE):
            some = np.roll(order, -turn * more)[:more].tolist()
            layouts[tuple(sorted((*fixed, *some)))] = None
    return list(layouts)


class Gains(NamedTuple):
    """What a layout gains in each of N simulated tests."""

    values: FloatArray  # (N,), in nats; NaN where a test does not count
    named: FloatArray  # (N,), 1 where the class that gave the test is the most probable after it
    bias: FloatArray  # (N,), of the values, expected from the few draws
    draws: FloatArray  # (N,), effective draws, the fewest of a class that counts


@dataclass(frozen=True, eq=False)
class SimulatedPlan:
    """Tests of all classes, and the draws of every class about all of them."""

    classes: tuple[PlannedClass, ...]
    tests: SimulatedTests
    true_class: NDArray[np.intp]  # (N,), index of the class that gave each test
    draws: tuple[CentredDraws, ...]

    @classmethod
    def of(
        cls,
        classes: Sequence[PlannedClass],
        layouts: Sequence[Sensors],
        n_tests: int,
        n_draws: int,
        seed: int,
    ) -> "SimulatedPlan":
        """As many tests of every class, since a rare one is not less in doubt.

        Draws serve these layouts, and frequencies alone, which most parameters explain.
        """
        seeds = np.random.SeedSequence(seed).spawn(2 * len(classes))
        streams = [np.random.default_rng(each) for each in seeds]
        n = -(-n_tests // len(classes))
        own = [simulate(c, n, rng) for c, rng in zip(classes, streams[::2], strict=True)]
        tests = SimulatedTests.joined(own)
        about = zip(classes, streams[1::2], strict=True)
        draws = tuple(centred_draws(c, tests, [(), (), *layouts], n_draws, r) for c, r in about)
        return cls(tuple(classes), tests, np.repeat(np.arange(len(classes)), n), draws)

    def part(self, n_tests: int, n_draws: int) -> "SimulatedPlan":
        """Some tests of every class, with some of their draws, for searches."""
        rows = slice(None, None, max(1, len(self.true_class) // n_tests))
        draws = []
        for own in self.draws:
            shapes = np.ascontiguousarray(own.shapes[rows, :, :n_draws])
            some = CentredDraws._make(array[rows, :n_draws] for array in own)
            draws.append(some._replace(shapes=shapes))
        return SimulatedPlan(
            self.classes, self.tests.rows(rows), self.true_class[rows], tuple(draws)
        )

    @property
    def probabilities(self) -> FloatArray:
        """Of the classes before the test."""
        return np.array([planned.probability for planned in self.classes])

    def log_weights(self, layout: Sequence[int]) -> list[FloatArray]:
        """Log densities (N, K) of the tests at the draws of each class, over that of the draws."""
        layout, d = list(layout), len(layout)
        if d < 2:  # a shape at one sensor says nothing
            return [own.log_weights for own in self.draws]
        seen = self.tests.identified_shapes(layout).astype(np.float32)
        weights = []
        for own in self.draws:
            n, _, k, n_modes = own.shapes.shape
            cosine, squares = np.zeros((2, n, k, n_modes), dtype=np.float32)
            for i, sensor in enumerate(layout):
                shape = own.shapes[:, sensor]
                cosine += shape * seen[:, i, None]
                squares += shape * shape
            # Both are zero of modes that are not paired.
            cosine /= np.sqrt(np.maximum(squares, np.finfo(np.float32).tiny))
            distances = own.n_paired - np.abs(cosine).sum(axis=2, dtype=float)
            constant = log_sphere_area(d) - log_shape_normaliser(np.sqrt(own.shape_var), d)
            constants = own.log_weights + own.n_paired * constant
            weights.append(constants - distances / own.shape_var)
        return weights

    def mean(self, of_tests: FloatArray) -> tuple[float, float]:
        """Mean over classes by their probability, and their tests, and its standard error.

        Classes whose tests are NaN do not count.
        """
        total, variance, weight = 0.0, 0.0, 0.0
        for c, probability in enumerate(self.probabilities):
            own = of_tests[self.true_class == c]
            if not np.isnan(own).any():
                total += probability * own.mean()
                variance += probability**2 * own.var(ddof=1) / len(own)
                weight += probability
        return (total / weight, np.sqrt(variance) / weight) if weight else (np.nan, np.nan)


def effective_draws(log_weights: FloatArray) -> FloatArray:
    """(Σ w)² / Σ w², (N,), of weights by their logs (N, K)."""
    twice = 2.0 * logsumexp(log_weights, axis=1)
    return np.asarray(np.exp(twice - logsumexp(2.0 * log_weights, axis=1)))


def class_gains(plan: SimulatedPlan, layout: Sequence[int]) -> Gains:
    """log p(D | C) - log p(D) of every test, D being what the layout sees of it."""
    weights = plan.log_weights(layout)
    n_draws = weights[0].shape[1]
    log_evidences = np.array([logsumexp(each, axis=1) - np.log(n_draws) for each in weights])
    draws = np.array([effective_draws(each) for each in weights])
    spread = 1.0 / draws - 1.0 / n_draws  # relative variances of the evidences
    log_joint = log_evidences + np.log(plan.probabilities)[:, None]
    log_total = logsumexp(log_joint, axis=0)
    after = np.exp(log_joint - log_total)
    own = plan.true_class, np.arange(len(plan.true_class))
    # The mean log of an average is below the log of its mean by half of its relative variance.
    bias = 0.5 * (after**2 * spread).sum(axis=0) - 0.5 * spread[own]
    counts = (after > LEAST_THAT_COUNTS) | (np.arange(len(after))[:, None] == plan.true_class)
    fewest = np.where(counts, draws, np.inf).min(axis=0)
    named = (log_joint.argmax(axis=0) == plan.true_class).astype(float)
    return Gains(log_evidences[own] - log_total, named, bias, fewest)


def quantity_gains(
    plan: SimulatedPlan, layout: Sequence[int], quantities: Sequence[tuple[FloatArray, FloatArray]]
) -> Gains:
    """½ ln det (covariance before the test) - ½ ln det (after it), given the class.

    For normal distributions the mean of it is the mutual information of quantity and data. The
    covariance after a test, of few draws, has the expected ln det of Wishart's distribution.

    Args:
        quantities: of each class its quantity at the draws about its own tests (n, K, q), and at
            draws before them (B, q); q is 0 in a class that does not have it.
    """
    values, draws = np.full((2, len(plan.true_class)), np.nan)
    for c, log_weights in enumerate(plan.log_weights(layout)):
        tests, (at, draws_before) = plan.true_class == c, quantities[c]
        draws[tests] = effective_draws(log_weights[tests])
        q = at.shape[2]
        if not q:
            continue
        before = np.cov(draws_before, rowvar=False).reshape(q, q)
        log_shares = log_weights[tests] - logsumexp(log_weights[tests], axis=1, keepdims=True)
        shares = np.exp(log_shares)[..., None]
        off = at - (shares * at).sum(axis=1, keepdims=True)
        after = np.linalg.slogdet((shares * off).swapaxes(1, 2) @ off)[1]
        free = np.maximum(draws[tests] - 1.0, q + 1.0)[:, None]
        expected = digamma(0.5 * (free - np.arange(q))).sum(axis=1)
        expected += q * np.log(2.0 / (free[:, 0] + 1.0))
        values[tests] = 0.5 * (np.linalg.slogdet(before)[1] - after + expected)
    nothing = np.zeros(len(values))
    return Gains(values, nothing, nothing, draws)


@dataclass(eq=False)
class LayoutSearch:
    """A search for the layout of candidates that gains most."""

    gain: Callable[[Sensors], float]
    fixed: Sensors  # in every layout
    free: Sensors  # that may be
    tried: dict[Sensors, float] = field(default_factory=dict)

    def is_exhaustive(self, number: int) -> bool:
        return comb(len(self.free), number - len(self.fixed)) <= MOST_EXHAUSTIVE

    def best(self, number: int, start: Sensors) -> Sensors:
        """The best layout of ``number`` sensors; a greedy search begins with those of ``start``."""
        if not self.is_exhaustive(number):
            return self.exchanged(self.grown(start, number))
        more = combinations(self.free, number - len(self.fixed))
        return max((self._valued((*self.fixed, *own)) for own in more), key=self.tried.__getitem__)

    def grown(self, layout: Sensors, number: int) -> Sensors:
        """The layout with the best sensor added, one after the other."""
        while len(layout) < number:
            larger = [self._valued((*layout, i)) for i in self.free if i not in layout]
            layout = max(larger, key=self.tried.__getitem__)
        return layout

    def exchanged(self, layout: Sensors) -> Sensors:
        """The layout after exchanges of one sensor, until none makes it better."""
        layout, before = self._valued(layout), self.fixed[:0]
        while layout != before:
            before = layout
            for sensor in before:
                if sensor not in self.fixed:
                    rest = tuple(other for other in layout if other != sensor)
                    layout = self.grown(rest, len(before))
        return layout

    def _valued(self, layout: Sensors) -> Sensors:
        layout = tuple(sorted(layout))
        if layout not in self.tried:
            self.tried[layout] = self.gain(layout)
        return layout


def effective_independence(shapes: FloatArray, number: int, fixed: Sequence[int] = ()) -> Sensors:
    """Sensors that keep the shapes of one model linearly independent, as placed by habit.

    The candidate that contributes least to the rank of the shapes goes, until ``number`` are left
    (Kammer 1991, Journal of Guidance, Control, and Dynamics 14). Shapes (n_candidates, n_modes) are
    at unit modal mass; fixed candidates stay.
    """
    left = list(range(len(shapes)))
    while len(left) > number:
        own = shapes[left]
        contributions = np.einsum("cm,mc->c", own, np.linalg.pinv(own))
        # With fewer sensors than modes all contribute 1: the one that moves least goes.
        order = np.lexsort((np.square(own).sum(axis=1), contributions.round(9)))
        left.remove(next(left[i] for i in order if left[i] not in fixed))
    return tuple(left)
