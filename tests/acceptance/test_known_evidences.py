"""Problems of the literature whose log evidence is known, far from modal data."""

import math

import numpy as np
import pytest
from known_evidence import Problem, log_normal_pdf, shifted
from problems import beck_au, edge, four_regions, linear_gaussian, one_dimension, shells, yuen
from scipy.special import ndtr

from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.target import Target


def observed(width):
    """An observation that determines its parameter: t = 3 + 0.01 noise, prior U(0, w)."""
    return Problem(
        f"width {width:g}", 2, lambda z: log_normal_pdf(3.0, width * ndtr(z[:, 0]), 0.01),
        -math.log(width),
    )  # fmt: skip


# A prior a hundred times wider costs ln 100.
SMALL = {
    problem.name: problem
    for problem in (
        beck_au(), *(yuen(case) for case in (1, 2, 3)), linear_gaussian(2), linear_gaussian(6),
        shells(2), edge(), one_dimension(), observed(10.0), observed(1000.0),
    )
}  # fmt: skip
LARGE = {problem.name: problem for problem in (linear_gaussian(12), shells(5))}
FOUR_REGIONS = {f"four regions, {seed}": four_regions(seed) for seed in (101, 102, 103)}
PROBLEMS = {**SMALL, **LARGE, **FOUR_REGIONS}


def sampled(problem, seed=0):
    target = Target(problem.log_likelihood, problem.n_dimensions)
    return sample_target(target, np.random.SeedSequence(seed))


@pytest.fixture(scope="module")
def samples():
    """Name → the result of sampling that problem."""
    return {name: sampled(problem) for name, problem in PROBLEMS.items()}


def assert_evidence_is_known(result, problem, largest_error=math.inf):
    for estimate in (result.evidence, result.evidence_checks[0]):
        off = abs(estimate.log_evidence - problem.log_evidence)
        assert off <= min(4.0 * estimate.error, largest_error)
    assert result.failed_checks == []


@pytest.mark.parametrize("name", SMALL)
def test_log_evidence(name, samples):
    assert samples[name].evidence.error <= 0.02
    assert_evidence_is_known(samples[name], SMALL[name])


@pytest.mark.parametrize("name", [*LARGE, *FOUR_REGIONS])
def test_log_evidence_of_larger_problems(name, samples):
    assert_evidence_is_known(samples[name], PROBLEMS[name], largest_error=0.06)


@pytest.mark.parametrize("name", [name for name, known in PROBLEMS.items() if known.regions])
def test_shares_of_regions(name, samples):
    sample = samples[name].importance
    for test, share in PROBLEMS[name].regions.values():
        inside = test(sample.z)
        error = sample.share_errors(inside.astype(int), 2)[1]
        assert error < 0.01
        assert sample.weights @ inside == pytest.approx(share, abs=4.0 * error + 5e-5)  # as rounded


@pytest.mark.parametrize(("name", "shift"), [("Beck-Au", 1000.0), ("edge", -1000.0)])
def test_a_constant_moves_the_log_evidence_by_that(name, shift, samples):
    here, there = samples[name], sampled(shifted(SMALL[name], shift))
    laplace = [each.search.maxima.laplace_estimate.log_evidence for each in (here, there)]
    assert laplace[1] - laplace[0] == pytest.approx(shift, abs=1e-6)
    # Chains amplify the rounding of what they begin with: other draws of the same distribution.
    for before, after in (
        (here.evidence, there.evidence),
        (here.evidence_checks[0], there.evidence_checks[0]),
    ):
        tolerance = 4.0 * math.hypot(before.error, after.error)
        assert after.log_evidence - before.log_evidence == pytest.approx(shift, abs=tolerance)


def test_posterior_of_beck_and_au(samples):
    """Mean and mean square from the importance draws."""
    sample = samples["Beck-Au"].importance
    t1 = np.exp(0.5102367348 + 0.4978679246 * sample.z[:, 0])
    values = np.column_stack([t1, t1**2])
    means = sample.weights @ values
    errors = np.sqrt((sample.weights**2) @ (values - means) ** 2)
    expected = [1.1179, 0.6635**2 + 1.1179**2]
    # The references are rounded: 5e-5 in a mean, 2e-4 in a mean square.
    np.testing.assert_array_less(np.abs(means - expected), 4.0 * errors + 2e-4)
