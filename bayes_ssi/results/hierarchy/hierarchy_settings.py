"""Numbers that decide how hierarchies are computed, and when they fail."""

from dataclasses import dataclass


@dataclass(frozen=True)
class HierarchySettings:
    """Numbers behind :func:`~bayes_ssi.results.hierarchy.ranked_populations.hierarchy`."""

    fewest_tests: int = 2  # fewer say nothing of how parameters vary
    # Of each test that are used: their likelihoods are known, so that more say little more.
    most_draws: int = 1000
    # Root mean square error of a log-likelihood, in nats, at which no more bumps are needed: with
    # that of each of a hundred tests, their sum is off by a fifth of a nat, before the draws
    # correct it.
    fit_error: float = 0.02
    # The same of a likelihood that is normal in form, but for rounding.
    exact_fit_error: float = 1e-6
    # That are tried, until they lower the error by less than ``least_gain``.
    numbers_of_bumps: tuple[int, ...] = (2, 4, 8)
    least_gain: float = 0.8  # largest ratio of errors for which more bumps are worth it
    # For each number that is fitted. Likelihoods at draws have no noise: a few pin it down, where
    # draws alone would need many.
    draws_per_number: int = 4
    # With which the stored evidence counts in a fit. It is known to about a hundredth of a nat; by
    # a tenth, its error is that of a likelihood known to a thousandth.
    evidence_weight: float = 0.1
    most_evaluations: int = 60  # in one search for the least squares
    # Of a population's parameters, at which the draws of the tests are asked, and which are kept:
    # enough for 90 % intervals.
    population_draws: int = 500
    # By which the stored evidence of a test and that of its bumps may differ, in nats: so far may
    # full solutions have corrected that of an approximate structure.
    evidence_tolerance: float = 0.5
    # Most numbers in an array of a batch, so that it stays in the processor's cache.
    array_size: int = 200_000
    # From the draws of the tests, in nats; with a larger one, two standard errors are more than a
    # bare mention on the scale of Bayes factors.
    largest_error: float = 0.5
    # Of frequencies, in their standard deviations; smaller ones are those that the prior leaves.
    smallest_repeated_error: float = 0.3
    # Probability with which errors that agree between tests by chance are taken for repeated ones.
    repeated_by_chance: float = 0.001
    next_tests: int = 1000  # draws of the parameters in the next test that are written to a file


SETTINGS = HierarchySettings()
