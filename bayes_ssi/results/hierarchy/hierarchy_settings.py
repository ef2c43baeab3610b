"""Numbers that decide how hierarchies are computed, and when they fail."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HierarchySettings:
    """Numbers behind :func:`~bayes_ssi.results.hierarchy.ranked_populations.hierarchy`.

    Attributes:
        fewest_tests: fewer say nothing of how parameters vary.
        most_draws: of each test that are used: their likelihoods are known, so that more say
            little more.
        fit_error: root mean square error of a log-likelihood, in nats, at which no more bumps are
            needed: with that of each of a hundred tests, their sum is off by a fifth of a nat,
            before the draws correct it.
        exact_fit_error: the same of a likelihood that is normal in form, but for rounding.
        numbers_of_bumps: that are tried, until they lower the error by less than ``least_gain``.
        least_gain: largest ratio of errors for which more bumps are worth it.
        draws_per_number: for each number that is fitted. Likelihoods at draws have no noise: a few
            pin it down, where draws alone would need many.
        evidence_weight: with which the stored evidence counts in a fit. It is known to about a
            hundredth of a nat; by a tenth, its error is that of a likelihood known to a thousandth.
        most_evaluations: in one search for the least squares.
        population_draws: of a population's parameters, at which the draws of the tests are asked,
            and which are kept: enough for 90 % intervals.
        evidence_tolerance: by which the stored evidence of a test and that of its bumps may differ,
            in nats: so far may full solutions have corrected that of an approximate structure.
        array_size: most numbers in an array of a batch, so that it stays in the processor's cache.
        largest_error: from the draws of the tests, in nats; with a larger one, two standard errors
            are more than a bare mention on the scale of Bayes factors.
        smallest_repeated_error: of frequencies, in their standard deviations; smaller ones are
            those that the prior leaves.
        repeated_by_chance: probability with which errors that agree between tests by chance are
            taken for repeated ones.
        next_tests: draws of the parameters in the next test that are written to a file.
    """

    fewest_tests: int = 2
    most_draws: int = 1000
    fit_error: float = 0.02
    exact_fit_error: float = 1e-6
    numbers_of_bumps: tuple[int, ...] = (2, 4, 8)
    least_gain: float = 0.8
    draws_per_number: int = 4
    evidence_weight: float = 0.1
    most_evaluations: int = 60
    population_draws: int = 500
    evidence_tolerance: float = 0.5
    array_size: int = 200_000
    largest_error: float = 0.5
    smallest_repeated_error: float = 0.3
    repeated_by_chance: float = 0.001
    next_tests: int = 1000


SETTINGS = HierarchySettings()
