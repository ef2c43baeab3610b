"""The economical path: known evidences, agreement with the other path, and its cost."""

import math

import numpy as np
import pytest
from click.testing import CliRunner
from delegating import DelegatingStructure
from scipy import stats
from scipy.special import ndtr

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.posterior.checks import failed_checks
from bayes_ssi.results.load import load_result
from bayes_ssi.sampling.engine import sample_target
from bayes_ssi.sampling.importance import ImportanceSample
from bayes_ssi.sampling.settings import SamplingSettings
from bayes_ssi.sampling.target import Target, log_standard_normal

ECONOMICAL = SamplingSettings(log_evidence_error=0.05, economical=True)
STOREYS = 6


def sampled(function, d, seed=0, settings=ECONOMICAL):
    return sample_target(Target(function, d), np.random.SeedSequence(seed), settings)


def correlated_gaussian(d):
    """A likelihood N(z; m, C) over z ~ N(0, I): the evidence is N(m; 0, I + C)."""
    rng = np.random.default_rng(d)
    root = 0.2 * rng.standard_normal((d, d))
    covariance = root @ root.T + 0.01 * np.eye(d)
    mean = rng.standard_normal(d)
    likelihood = stats.multivariate_normal(mean, covariance)
    evidence = stats.multivariate_normal(np.zeros(d), np.eye(d) + covariance).logpdf(mean)
    return lambda z: np.atleast_1d(likelihood.logpdf(z)), float(evidence)


@pytest.mark.parametrize("d", [2, 4, 8])
def test_the_evidence_of_a_gaussian(d):
    function, exact = correlated_gaussian(d)
    results = [sampled(function, d, seed) for seed in range(3)]
    for result in results:
        assert result.evidence.error <= 0.05
        assert result.evidence.log_evidence == pytest.approx(exact, abs=4.0 * result.evidence.error)
        assert failed_checks(result) == []
    # One seed in six takes 300 more for another adaptation.
    assert np.mean([result.n_evaluations for result in results]) < 1500 + 500 * d


def test_a_curved_ridge():
    """The first eigenvalue of Yuen's two-storey building alone: a ridge; by quadrature 9.68747."""
    measured = np.array([0.386, 0.3922, 0.4157, 0.3592, 0.3615])

    def log_likelihood(z):
        k1, k2 = 0.8 + 1.4 * ndtr(z[:, 0]), 0.4 + 0.8 * ndtr(z[:, 1])
        h = 0.5 * k1 + k2
        lowest = h - np.sqrt(h * h - k1 * k2)
        return stats.norm.logpdf(lowest[:, None], measured, 0.0191).sum(axis=1)

    errors = [sampled(log_likelihood, 2, seed).evidence.log_evidence - 9.68747 for seed in range(4)]
    assert math.sqrt(np.mean(np.square(errors))) < 0.12


def test_draws_are_those_of_the_posterior():
    """Standard normal prior, one datum of variance 1/9 at 1: the posterior is N(0.9, 0.1)."""
    result = sampled(lambda z: -4.5 * (z[:, 0] - 1.0) ** 2, 1)
    for ensemble in result.ensembles:
        draws = ensemble.draws[:, 0]
        independent = len(draws) / float(ensemble.autocorrelation_times[0])
        assert independent >= 250
        assert draws.mean() == pytest.approx(0.9, abs=4.0 * math.sqrt(0.1 / independent))
        assert draws.var() == pytest.approx(0.1, rel=4.0 * math.sqrt(2.0 / independent))


def test_resampled_draws_count_by_their_weights():
    weights = np.array([0.5, 0.25, 0.25, 0.0])
    with np.errstate(divide="ignore"):
        log_likelihoods = np.log(weights)
    z = np.arange(4.0)[:, None]
    # Weights are likelihood · prior / proposal; a proposal like the prior leaves the likelihood.
    sample = ImportanceSample(None, z, log_likelihoods, log_standard_normal(z), None)
    draws = sample.resampled(np.random.default_rng(0))
    assert sorted(draws.draws[:, 0]) == [0.0, 0.0, 1.0, 2.0]
    assert draws.autocorrelation_times[0] == pytest.approx(4.0 * (0.25 + 2.0 * 0.0625))
    assert draws.acceptance == 0.75


def test_two_regions_have_their_shares():
    """Two Gaussians, 0.7 and 0.3 of the evidence, 3 prior standard deviations apart."""
    centres, shares = np.array([[-1.5, 0.0], [1.5, 0.0]]), np.array([0.7, 0.3])

    def log_likelihood(z):
        squares = ((z[:, None] - centres) ** 2).sum(-1) / 0.2**2
        # Divided by the prior, so that the posterior is the mixture itself.
        prior = -0.5 * (z**2).sum(1)
        return np.logaddexp.reduce(np.log(shares) - 0.5 * squares, axis=1) - prior

    result = sampled(log_likelihood, 2)
    assert result.regions.n_regions == 2
    np.testing.assert_allclose(
        np.sort(result.region_shares),
        [0.3, 0.7],
        atol=4.0 * result.region_errors.max(),
    )


def test_a_posterior_for_which_it_is_not_made_is_flagged():
    """Two thin shells in five dimensions: no mixture of this size covers them."""

    def log_likelihood(z):
        x = -6.0 + 12.0 * ndtr(z)
        centre = np.array([3.5, 0.0, 0.0, 0.0, 0.0])
        distances = [np.linalg.norm(x - sign * centre, axis=1) for sign in (1.0, -1.0)]
        return np.logaddexp(*(stats.norm.logpdf(d, 2.0, 0.1) for d in distances))

    assert failed_checks(sampled(log_likelihood, 5))


class Counting(DelegatingStructure):
    """A black-box shear building that counts its evaluations."""

    def __init__(self, building):
        super().__init__(building)
        self.n_asked = 0

    def modes(self, values):
        self.n_asked += len(values)
        return super().modes(values)


@pytest.fixture(scope="module")
def black_box():
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, STOREYS + 1)]
    building = bs.ShearBuilding((1.0,) * STOREYS, [4000.0 * k for k in factors])
    frequencies, shapes = building.modes(np.array([[1.1, 0.9, 1.2, 0.8, 1.0, 1.15]]))
    modes = tuple(
        bs.IdentifiedMode(str(j + 1), float(frequencies[0, j]), shapes[0, [0, 2, 5], j])
        for j in range(4)
    )
    band = (0.0, float(frequencies[0, 3:5].mean()))
    data = bs.ModalData(modes, band, ("floor 1", "floor 3", "floor 6"))
    pairing = {str(j): j for j in range(1, 5)}
    return bs.ModelClass(
        "six storeys", Counting(building), data, bs.ErrorModel(0.01, 0.05), pairing=pairing
    )


@pytest.fixture(scope="module")
def whole(black_box):
    """The same class by the other path."""
    return bs.sample(black_box, seed=0)


@pytest.mark.parametrize("seed", range(3))
def test_a_black_box_of_six_parameters_in_5000_evaluations(black_box, whole, seed):
    """The other path needs some 90,000; both give the same evidence and the same means."""
    structure = black_box.structure
    structure.n_asked = 0
    result = bs.sample(black_box, seed=seed, settings=ECONOMICAL)
    assert structure.n_asked <= 5000
    assert result.failed_checks == ()
    assert result.evidence.error <= 0.05
    error = math.hypot(result.evidence.error, whole.evidence.error)
    assert result.evidence.log_evidence == pytest.approx(
        whole.evidence.log_evidence, abs=4.0 * error
    )
    for row, other in zip(result.summary, whole.summary, strict=True):
        error = math.hypot(row.mean_error, other.mean_error)
        assert row.mean == pytest.approx(other.mean, abs=4.0 * error)


def test_results_follow_from_the_seed(tiny_study):
    candidate = tiny_study.model_classes[1]
    one, again, other = (bs.sample(candidate, seed=s, settings=ECONOMICAL) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.draws, again.draws)
    assert one.evidence == again.evidence
    assert one.evidence != other.evidence


def test_from_the_command_line(tmp_path, tiny_study_file):
    arguments = ["rank", str(tiny_study_file), "--economical", "--error", "0.05"]
    invoked = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "r")])
    assert invoked.exit_code == 0, invoked.output
    result = load_result(tmp_path / "r")
    assert all(posterior.n_evaluations < 3000 for posterior in result.posteriors)
