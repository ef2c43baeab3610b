"""Components bent along ridges: sheets that polynomials follow, and evidences by quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm

from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.importance import ImportanceSampler
from bayes_ssi.inference.sampling.maxima import _ridge, along_ridges, find_maxima
from bayes_ssi.inference.sampling.regions import find_regions
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target

N_WIDE, WIDTH, CURVATURE = 7, 0.01, 0.1


def bowl(z):
    """The last coordinate is known to be a tenth of the squared distance of seven others."""
    return norm.logpdf(z[:, -1] - CURVATURE * (z[:, :-1] ** 2).sum(1), 0.0, WIDTH)


def exact_evidence():
    """Over the squared distance, by quadrature."""

    def integrand(r2):
        of_distance = chi2.pdf(r2, N_WIDE)
        return of_distance * norm.pdf(CURVATURE * r2, 0.0, math.hypot(1.0, WIDTH))

    return math.log(quad(integrand, 0.0, 80.0, points=[2.0, 10.0])[0])


def bowl_target():
    nothing = SuggestedStarts(np.zeros((1, N_WIDE + 1)), 1)
    return Target(bowl, N_WIDE + 1, suggest_starts=lambda _rng: nothing)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_ascents_along_axes_leave_other_directions_alone():
    target = Target(lambda z: -50.0 * (z[:, 0] - z[:, 1] ** 2) ** 2, 3)
    starts = np.array([[2.0, 1.5, -0.3], [-1.0, 0.2, 0.7]])
    ends, heights = ascend(target, starts, np.full((2, 1, 1), 0.01), np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(ends[:, 1:], starts[:, 1:])
    # Of -50 (x - y²)² - x²/2 the maximum is 100 y² / 101.
    np.testing.assert_allclose(ends[:, 0], starts[:, 1] ** 2 * 100.0 / 101.0, atol=5e-3)
    np.testing.assert_allclose(heights, target.log_posterior(ends))


def test_a_spike_is_no_ridge_however_wide_its_component_is(rng):
    """Nothing beside it weighs e^-1000 of what the component expects there."""
    target = Target(lambda z: np.where(np.abs(z).max(axis=1) < 1e-3, 1000.0, 0.0), 2)
    assert _ridge(target, np.zeros(2), np.diag([1.0, 0.01]), rng) is None


def test_the_component_of_a_sheet_is_nearly_the_posterior(rng):
    target = bowl_target()
    maxima = find_maxima(target, np.zeros((1, N_WIDE + 1)))
    ridges = along_ridges(target, maxima, rng)
    sampler = ImportanceSampler(target, rng)
    straight, bent = (sampler.sample(each) for each in (maxima.as_mixture(), ridges))
    assert straight.efficiency < 0.02
    assert bent.efficiency > 0.5
    estimate = bent.estimate
    assert abs(estimate.log_evidence - exact_evidence()) < 4.0 * estimate.error < 0.1


def test_without_thin_or_wide_directions_there_is_no_ridge(rng):
    for width in (0.01, 3.0):
        target = Target(lambda z, width=width: -0.5 * ((z / width) ** 2).sum(1), 3)
        assert along_ridges(target, find_maxima(target, np.ones((1, 3))), rng) is None


def test_a_sheet_is_one_region_in_its_chart(rng):
    target = bowl_target()
    ridges = along_ridges(target, find_maxima(target, np.zeros((1, N_WIDE + 1))), rng)
    sample = ImportanceSampler(target, rng).sample(ridges)
    draws, heights = (values[:300] for values in sample.typical_draws)
    chart = sample.mixture.chart(draws)
    np.testing.assert_allclose(chart.curved(chart.straight(draws)), draws, atol=1e-9)
    before = target.n_evaluations
    assert find_regions(target, draws, heights, chart).n_regions == 1
    in_chart = target.n_evaluations - before
    find_regions(target, draws, heights)  # of many groups there are many paths
    assert target.n_evaluations - before > 3 * in_chart


def test_a_sheet_of_many_parameters_is_sampled_well():
    result = sample_target(bowl_target(), np.random.SeedSequence(1))
    assert result.failed_checks == []
    assert not result.compressions
    assert abs(result.evidence.log_evidence - exact_evidence()) < 4.0 * result.evidence.error
    assert result.n_evaluations < 100_000
    squares = np.concatenate([part.draws for part in result.ensembles])[:, -1] / CURVATURE
    # The posterior of the squared distance, by quadrature.
    density = lambda r2: chi2.pdf(r2, N_WIDE) * norm.pdf(CURVATURE * r2, 0.0, math.hypot(1.0, 0.01))  # noqa: E731
    mean = quad(lambda r2: r2 * density(r2), 0.0, 80.0)[0] / quad(density, 0.0, 80.0)[0]
    assert squares.mean() == pytest.approx(mean, abs=0.2)
