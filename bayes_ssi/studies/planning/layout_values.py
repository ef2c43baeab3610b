"""What layouts of sensors are worth: information about the class, and about parameters, in nats.

The information is E[log p(D | C) - log p(D)] over tests simulated from every class C, with p(D | C)
the average over the class's draws about each test. Of a layout the draws need three sums over its
sensors for each paired mode, Σ φ_e φ in two parts and Σ φ², which one more sensor adds to: nothing
is computed again, and all layouts see the same tests and the same draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import digamma, logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.studies.planning.centred_draws import CentredDraws, centred_draws
from bayes_ssi.studies.planning.planned_class import PlannedClass
from bayes_ssi.studies.planning.simulated_tests import ShapeSums, SimulatedTests, simulate

Sensors = tuple[int, ...]  # candidates, from 0, in ascending order


class Mean(NamedTuple):
    """A mean over simulated tests, with its standard error."""

    value: float
    error: float


class LayoutSums(NamedTuple):
    """The sums over the sensors of a layout."""

    tests: ShapeSums
    draws: tuple[tuple[Any, Any, Any], ...]  # by class: Σ φ_true φ, Σ ε φ, Σ φ², (N, K, J) each
    n_sensors: int


@dataclass(frozen=True, eq=False)
class SimulatedPlan:
    """Tests of all classes, and the draws of every class about all of them."""

    classes: tuple[PlannedClass, ...]
    tests: SimulatedTests
    true_class: Any  # (N,), index of the class that gave each test
    draws: tuple[CentredDraws, ...]

    @classmethod
    def of(
        cls, classes: Sequence[PlannedClass], n_tests: int, n_draws: int, seed: int
    ) -> SimulatedPlan:
        """Simulated from all classes as many tests each, since a rare one is not less in doubt."""
        streams = np.random.SeedSequence(seed).spawn(2 * len(classes))
        n = -(-n_tests // len(classes))
        own = [
            simulate(c, n, np.random.default_rng(s)) for c, s in zip(classes, streams, strict=False)
        ]
        tests = SimulatedTests.joined(own)
        draws = tuple(
            centred_draws(c, tests, n_draws, np.random.default_rng(s))
            for c, s in zip(classes, streams[len(classes) :], strict=True)
        )
        return cls(tuple(classes), tests, np.repeat(np.arange(len(classes)), n), draws)

    def part(self, n_tests: int, n_draws: int) -> SimulatedPlan:
        """Some tests of every class, with some of their draws, for searches."""
        step = max(1, len(self.true_class) // n_tests)
        rows, some = slice(None, None, step), slice(0, n_draws)
        tests = SimulatedTests(
            *(getattr(self.tests, each.name)[rows] for each in fields(SimulatedTests))
        )
        draws = tuple(
            CentredDraws(
                own.log_weights[rows, some], own.shapes[:, rows, some], own.paired[rows, some],
                own.shape_var[rows, some], own.z[rows, some],
            )
            for own in self.draws
        )  # fmt: skip
        return SimulatedPlan(self.classes, tests, self.true_class[rows], draws)

    @cached_property
    def probabilities(self) -> FloatArray:
        """Of the classes before the test."""
        return np.array([planned.probability for planned in self.classes])

    @property
    def empty(self) -> LayoutSums:
        """The sums of no sensor."""
        zero = np.zeros(self.tests.present.shape)
        none = tuple((np.float32(0.0),) * 3 for _ in self.classes)
        return LayoutSums(ShapeSums(zero, zero, zero), none, 0)

    def with_sensor(self, sums: LayoutSums, sensor: int) -> LayoutSums:
        """The sums of a layout with one more sensor."""
        tests = ShapeSums(
            *(a + b for a, b in zip(sums.tests, self.tests.sensor_sums(sensor), strict=True))
        )
        true = self.tests.shapes[:, None, sensor].astype(np.float32)
        noise = self.tests.noise[:, None, sensor].astype(np.float32)
        draws = []
        for (aligned, crossed, own), of_class in zip(sums.draws, self.draws, strict=True):
            shape = of_class.shapes[sensor]
            draws.append((aligned + true * shape, crossed + noise * shape, own + shape * shape))
        return LayoutSums(tests, tuple(draws), sums.n_sensors + 1)

    def sums(self, layout: Sequence[int]) -> LayoutSums:
        total = self.empty
        for sensor in layout:
            total = self.with_sensor(total, sensor)
        return total

    def log_weights(self, sums: LayoutSums) -> list[FloatArray]:
        """Log densities (N, K) of the tests at the draws of each class, over that of the draws."""
        d = sums.n_sensors
        if d < 2:  # a shape at one sensor says nothing
            return [own.log_weights for own in self.draws]
        a, b = (each[:, None].astype(np.float32) for each in self.tests.coefficients(sums.tests, d))
        weights = []
        for planned, own, (aligned, crossed, squares) in zip(
            self.classes, self.draws, sums.draws, strict=True
        ):
            cosine = np.abs(a * aligned + b * crossed)
            cosine /= np.sqrt(np.where(squares > 0.0, squares, np.float32(1.0)))
            distances = ((1.0 - cosine) * own.paired).sum(axis=2, dtype=float)
            variance = own.shape_var[:1, :1] if planned.has_fixed_errors else own.shape_var
            constants = log_sphere_area(d) - log_shape_normaliser(np.sqrt(variance), d)
            n_paired = own.paired.sum(axis=2)
            weights.append(own.log_weights + n_paired * constants - distances / variance)
        return weights


def log_means(log_weights: FloatArray) -> FloatArray:
    """Log of the mean (N,) over draws (N, K)."""
    return np.asarray(logsumexp(log_weights, axis=1)) - np.log(log_weights.shape[1])


def effective_draws(log_weights: FloatArray) -> FloatArray:
    """(Σ w)² / Σ w², (N,), of weights by their logs (N, K)."""
    return np.asarray(
        np.exp(2.0 * logsumexp(log_weights, axis=1) - logsumexp(2.0 * log_weights, axis=1))
    )


class Worth(NamedTuple):
    """What a layout is worth in each of N simulated tests."""

    values: FloatArray  # (N,), in nats; NaN where a test does not count
    named: FloatArray  # (N,), 1 where the class that gave the test is the most probable after it
    bias: FloatArray  # (N,), of the values, expected from the few draws
    draws: FloatArray  # (N,), effective draws of the class that gave the test


def class_worth(plan: SimulatedPlan, sums: LayoutSums) -> Worth:
    """log p(D | C) - log p(D) of every test, D being what the layout sees of it."""
    weights = plan.log_weights(sums)
    log_evidences = np.array([log_means(each) for each in weights])
    # Mean squared relative errors of the evidences.
    spread = np.array([1.0 / effective_draws(each) - 1.0 / each.shape[1] for each in weights])
    log_joint = log_evidences + np.log(plan.probabilities)[:, None]
    log_total = logsumexp(log_joint, axis=0)
    after = np.exp(log_joint - log_total)
    true, tests = plan.true_class, np.arange(len(plan.true_class))
    # E log x of an average x is log E x less half of its relative variance.
    bias = 0.5 * (after**2 * spread).sum(axis=0) - 0.5 * spread[true, tests]
    named = (log_joint.argmax(axis=0) == true).astype(float)
    draws = effective_draws_of(weights, true)
    return Worth(log_evidences[true, tests] - log_total, named, bias, draws)


def effective_draws_of(weights: Sequence[FloatArray], true: Any) -> FloatArray:
    """Effective draws (N,) of the class that gave each test."""
    return np.concatenate([effective_draws(w[true == c]) for c, w in enumerate(weights)])


# Quantities (N_c, K, q) at the draws of a class about its own tests, and their covariance before
# the test; None of a class that does not have them.
Quantities = tuple[FloatArray, FloatArray] | None


def quantity_worth(
    plan: SimulatedPlan, quantities: Sequence[Quantities], sums: LayoutSums
) -> Worth:
    """½ ln det (covariance before the test) - ½ ln det (after it), of quantities, given the class.

    For normal distributions the mean of it is the mutual information of quantities and data. The
    covariance after a test, of few draws, has the expected ln det of Wishart's distribution.
    """
    n_tests = len(plan.true_class)
    values, draws = np.full(n_tests, np.nan), np.full(n_tests, np.nan)
    for c, (own, log_weights) in enumerate(zip(quantities, plan.log_weights(sums), strict=True)):
        tests = plan.true_class == c
        draws[tests] = effective_draws(log_weights[tests])
        if own is None:
            continue
        at, before = own
        log_shares = log_weights[tests] - logsumexp(log_weights[tests], axis=1, keepdims=True)
        shares = np.exp(log_shares)[..., None]
        off = at - (shares * at).sum(axis=1, keepdims=True)
        covariance = (shares * off).swapaxes(1, 2) @ off
        q, free = at.shape[2], np.maximum(draws[tests] - 1.0, at.shape[2] + 1.0)
        expected = q * np.log(
            2.0 / (free + 1.0)
        )  # of covariances over effective draws, not one less
        expected = expected + digamma(0.5 * (free[:, None] - np.arange(q))).sum(axis=1)
        log_dets = np.linalg.slogdet(before)[1], np.linalg.slogdet(covariance)[1]
        values[tests] = 0.5 * (log_dets[0] - log_dets[1] + expected)
    return Worth(values, np.full(n_tests, np.nan), np.zeros(n_tests), draws)


def mean(plan: SimulatedPlan, of_tests: FloatArray) -> Mean:
    """The mean over classes, by their probability, of their tests; NaN does not count."""
    total, variance, probability = 0.0, 0.0, 0.0
    for c, share in enumerate(plan.probabilities):
        own = of_tests[plan.true_class == c]
        if np.isnan(own).any():
            continue
        total += share * own.mean()
        variance += share**2 * own.var(ddof=1) / len(own)
        probability += share
    if probability == 0.0:
        return Mean(float("nan"), float("nan"))
    return Mean(float(total / probability), float(np.sqrt(variance) / probability))
