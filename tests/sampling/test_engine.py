"""The five steps together, on targets with known answers."""

import itertools
import math
from dataclasses import fields

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr, ndtri
from scipy.stats import norm
from targets import two_bumps

from bayes_ssi.inference.sampling import engine
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.ensembles import FIRST_STEPS, Ensemble
from bayes_ssi.inference.sampling.importance import ImportanceSampler
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.multistart import MultistartSearch
from bayes_ssi.inference.sampling.result import SamplingResult
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target


def one_observation(z):
    """Prior N(0, 1), one observation 1.5 ~ N(z, 0.25) of the first coordinate."""
    return -0.5 * ((1.5 - z[:, 0]) / 0.5) ** 2 - math.log(0.5 * math.sqrt(2.0 * math.pi))


EXACT = -0.5 * 1.5**2 / 1.25 - 0.5 * math.log(2.0 * math.pi * 1.25)


def run(function, d=2, seed=0, **kwargs):
    return sample_target(Target(function, d), np.random.SeedSequence(seed), **kwargs)


@pytest.fixture(scope="module")
def observed():
    return run(one_observation)


@pytest.fixture(scope="module")
def bumps():
    return run(two_bumps())


def test_a_gaussian_target(observed):
    assert observed.evidence.log_evidence == pytest.approx(EXACT, abs=4.0 * observed.evidence.error)
    assert observed.evidence.error <= 0.01
    assert observed.failed_checks == []
    assert observed.region_shares.tolist() == [1.0]
    assert observed.search.maxima.laplace_estimate.log_evidence == pytest.approx(EXACT, abs=0.01)
    assert observed.importance.weights @ observed.importance.z[:, 0] == pytest.approx(1.2, abs=0.02)
    # Compressions and ensembles are independent.
    first, second = observed.compressions
    assert first.log_evidence != second.log_evidence
    first, second = observed.ensembles
    n = min(first.n_steps, second.n_steps)
    assert not np.array_equal(first.positions[:n], second.positions[:n])


def test_far_regions_keep_their_shares(bumps):
    assert bumps.regions.n_regions == 2
    order = np.argsort(-bumps.region_shares)
    assert (bumps.region_errors < 0.02).all()
    off = np.abs(bumps.region_shares[order] - [0.9, 0.1])
    np.testing.assert_array_less(off, 4.0 * bumps.region_errors[order])
    assert bumps.evidence.log_evidence == pytest.approx(0.0, abs=4.0 * bumps.evidence.error)


def with_suggestions(function, d):
    """A target that knows its problem, though it suggests nothing."""
    return Target(function, d, suggest_starts=lambda _: SuggestedStarts(np.empty((0, d)), 0))


def test_a_target_that_knows_its_problem_does_without_particles(bumps):
    result = sample_target(with_suggestions(two_bumps(), 2), np.random.SeedSequence(0))
    assert result.compressions == ()
    assert result.failed_checks == []
    assert result.evidence.log_evidence == pytest.approx(0.0, abs=4.0 * result.evidence.error)
    again = result.evidence_checks[1]
    assert again.name == "importance draws around maxima"
    assert again.log_evidence == pytest.approx(0.0, abs=4.0 * again.error)
    small = int(result.region_shares.argmin())
    assert result.region_shares[small] == pytest.approx(0.1, abs=4.0 * result.region_errors[small])
    assert result.n_evaluations < 0.7 * bumps.n_evaluations


@pytest.mark.parametrize("doubt", ["searches", "checks", "draws"])
def test_any_doubt_brings_the_particles(doubt, monkeypatch):
    if doubt == "searches":
        monkeypatch.setattr(MultistartSearch, "converged", property(lambda _: False))
    elif doubt == "checks":
        monkeypatch.setattr(SamplingResult, "failed_checks", ["something disagrees"])
    else:  # too few of them matter, and no component is added
        monkeypatch.setattr(engine, "DRAWS_PER_DIMENSION", 1e6)
        monkeypatch.setattr(ImportanceSampler, "refined", lambda _, sample, *_args: sample)
    result = sample_target(with_suggestions(one_observation, 2), np.random.SeedSequence(0))
    assert len(result.compressions) == 2


def test_components_are_added_where_draws_around_the_maxima_miss_something():
    """Laplace's approximation at a corner of the support is nothing like the posterior."""

    def corner(z):
        return np.where((z > 1.0).all(axis=1), -300.0 * (z - 1.0).sum(axis=1), -50.0)

    result = sample_target(with_suggestions(corner, 2), np.random.SeedSequence(0))
    # ∫ φ(z) exp(-300 (z - 1)) over z > 1, of each of the two.
    of_one = 300.0 + 0.5 * 300.0**2 + log_ndtr(-301.0)
    assert result.compressions == ()
    assert result.failed_checks == []
    for estimate in (result.evidence, *result.evidence_checks[:2]):
        assert estimate.log_evidence == pytest.approx(2.0 * of_one, abs=4.0 * estimate.error)


@pytest.mark.parametrize("wanted", [0.05, 0.002])
def test_the_wanted_error_is_reached(wanted):
    result = run(two_bumps(), settings=SamplingSettings(log_evidence_error=wanted))
    assert result.evidence.error <= wanted
    assert (len(result.importance.z) > 2 * ImportanceSampler.batch) == (wanted < 0.01)


def test_a_run_counts_its_evaluations_and_leaves_the_global_random_state_alone():
    calls = []

    def counting(z):
        calls.append(len(z))
        return one_observation(z)

    np.random.seed(3)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    assert run(counting).n_evaluations == sum(calls)
    assert np.random.random() == expected  # noqa: NPY002


def test_progress_covers_every_step_in_order():
    seen = []
    run(one_observation, progress=lambda step, done: seen.append((step, done)))
    assert list(dict.fromkeys(step for step, _ in seen)) == [
        "searches", "compression of the prior", "ensembles", "evidence",
    ]  # fmt: skip
    assert all(0.0 <= done <= 1.0 for _, done in seen)
    for step in dict(seen):
        of_step = [done for name, done in seen if name == step]
        assert of_step == sorted(of_step)
        assert of_step[-1] == 1.0


@pytest.mark.parametrize("value", [0, -1, math.nan, math.inf])
def test_settings_that_are_not_positive_and_finite_are_refused(value):
    for name in (field.name for field in fields(SamplingSettings) if field.name != "economical"):
        what = "above 1" if name == "r_hat" else "positive"
        message = f"SamplingSettings: {name} must be {what} and finite, got {value}"
        with pytest.raises(ValueError, match=message):
            SamplingSettings(**{name: value})


def test_particles_follow_the_number_of_parameters():
    assert SamplingSettings().n_particles(40) > SamplingSettings().n_particles(2) > 100
    assert SamplingSettings(particles=64).n_particles(2) == 64
    with pytest.raises(ValueError, match="particles must be at least 80 for 10 parameters"):
        SamplingSettings(particles=79).n_particles(10)


@pytest.mark.parametrize(
    "settings", [{"particles": 16}, {"particles": 17}, {"searches": 1}, {"max_steps": 1}]
)
def test_the_least_settings_that_are_accepted_work(settings):
    result = run(one_observation, settings=SamplingSettings(**settings))
    assert result.evidence.log_evidence == pytest.approx(EXACT, abs=0.1)


def test_chains_and_evidence_share_their_evaluations():
    """Of a Gaussian with a good mixture, hardly anything else is evaluated for chains."""
    evaluated = []

    def counting(z):
        evaluated.append(z.copy())
        return one_observation(z)

    result = sample_target(with_suggestions(counting, 2), np.random.SeedSequence(3))
    points = {row.tobytes() for row in np.concatenate(evaluated)}
    assert result.n_evaluations == sum(map(len, evaluated))
    importance = {row.tobytes() for row in result.importance.z}
    draws = np.concatenate([ensemble.draws for ensemble in result.ensembles])
    assert np.mean([row.tobytes() in importance for row in draws]) > 0.8
    assert points >= {row.tobytes() for row in draws}
    assert result.chains.smallest_size > 2000


def two_places(z):
    """Likelihood times prior: equal Gaussians of width 0.2 at ±6, where no prior draw comes."""
    squares = [((z - [sign * 6.0, 0.0]) ** 2).sum(1) for sign in (1.0, -1.0)]
    return np.logaddexp(*(-0.5 * each / 0.04 for each in squares)) + 0.5 * (z**2).sum(1)


def mixture_at(*places):
    means = np.array([[place, 0.0] for place in places])
    k = len(means)
    choleskys = np.tile(0.2 * np.eye(2), (k, 1, 1))
    return StudentMixture(np.full(k, 1.0 / k), means, choleskys, np.full(k, 30.0))


def ensemble_at(*places, n=1500):
    """Independent draws of narrow Gaussians at the places on the first axis."""
    positions = 0.2 * np.random.default_rng(len(places)).standard_normal((n, 1, 2))
    positions[:, 0, 0] += np.resize(places, n)
    return Ensemble(positions, two_places(positions[:, 0])[:, None], 0, 1.0, 0.5)


def refitted(mixture, *ensembles):
    target, rng = Target(two_places, 2), np.random.default_rng(0)
    one_maximum = find_maxima(target, np.array([[5.9, 0.1]]))
    run = engine._Sampling(target, SamplingSettings(), [], rng, lambda _step, _done: None)
    trial = run.sampler.sample(mixture)
    return trial, run._refitted(one_maximum.as_mixture(), ensembles, trial)


def test_a_refit_covers_what_the_mixture_before_it_lacked():
    """Importance draws of the mixture in one place are efficient, and see nothing of the other."""
    lacking, there = mixture_at(6.0), np.array([[-6.0, 0.0]])
    both = ensemble_at(6.0, -6.0)
    trial, again = refitted(lacking, both, both)
    assert trial.efficiency > 0.9
    assert again.mixture.log_pdf(there)[0] > lacking.log_pdf(there)[0] + 5.0
    assert (again.z[:, 0] < 0.0).mean() == pytest.approx(0.5, abs=0.15)


def test_a_refit_to_draws_that_lost_a_region_is_not_taken():
    trial, again = refitted(mixture_at(6.0, -6.0), ensemble_at(6.0), ensemble_at(6.0, -6.0))
    assert again is trial


def test_components_around_maxima_have_the_shares_of_their_regions():
    """Of 64 equal regions, to which fewer components are fitted, importance draws are good."""
    d, sd, rng = 6, 0.1, np.random.default_rng(2)
    centres = np.array(list(itertools.product((1.0, -1.0), repeat=d)))
    n = len(centres)

    def log_likelihood(z):
        sides = norm.logpdf(z[..., None], [1.0, -1.0], sd) - math.log(2.0)
        return (np.logaddexp.reduce(sides, axis=2) - norm.logpdf(z)).sum(axis=1)

    def draws():
        return rng.choice(centres, 3000) + sd * rng.standard_normal((3000, d))

    factors, tails = np.tile(sd * np.eye(d), (n, 1, 1)), np.full(n, 5.0)
    around_maxima = StudentMixture(np.full(n, 1.0 / n), centres, factors, tails)
    target = Target(log_likelihood, d)
    run = engine._Sampling(target, SamplingSettings(), [], rng, lambda _step, _done: None)
    sample = run._fitted(around_maxima, draws(), draws())
    assert sample.efficiency > 0.4
    assert abs(sample.estimate.log_evidence) < 4.0 * sample.estimate.error < 0.1


ELSEWHERE = StudentMixture(np.ones(1), np.full((1, 2), 9.0), np.eye(2)[None], np.ones(1))


def test_misplaced_draws_around_the_maxima_miss_nothing(monkeypatch):
    sample = ImportanceSampler.sample

    def misplaced(self, _mixture):
        monkeypatch.setattr(ImportanceSampler, "sample", sample)
        return sample(self, ELSEWHERE)

    monkeypatch.setattr(ImportanceSampler, "sample", misplaced)
    result = sample_target(with_suggestions(two_bumps(), 2), np.random.SeedSequence(0))
    assert result.evidence.log_evidence == pytest.approx(0.0, abs=4.0 * result.evidence.error)
    assert result.failed_checks == []


def test_a_mixture_that_fits_worse_than_the_last_is_dropped(monkeypatch):
    """So it does not end in compressions of the prior."""

    def misfitted(self, *_draws):
        return self.sampler.sample(ELSEWHERE)

    monkeypatch.setattr(engine._Sampling, "_fitted", misfitted)
    result = sample_target(with_suggestions(two_bumps(), 2), np.random.SeedSequence(0))
    assert not result.compressions
    assert result.failed_checks == []
    assert result.evidence.log_evidence == pytest.approx(0.0, abs=4.0 * result.evidence.error)


def test_importance_draws_that_serve_need_no_long_chains():
    result = sample_target(with_suggestions(one_observation, 1), np.random.SeedSequence(0))
    assert not result.failed_checks
    assert not result.compressions
    assert [each.n_steps + each.burn_in for each in result.ensembles] == [FIRST_STEPS] * 2


def test_a_thin_curved_ridge_is_followed_to_its_ends():
    """z2 = z1² - 1 to 0.003: given z1, the other coordinate's integral is Gaussian."""
    width = 0.003

    def ridge(z):
        return -0.5 * ((z[:, 1] - z[:, 0] ** 2 + 1.0) / width) ** 2

    x = np.linspace(-8.0, 8.0, 100_001)
    of_rest = stats.norm(0.0, math.hypot(1.0, width)).pdf(x**2 - 1.0)
    exact = np.trapezoid(stats.norm.pdf(x) * of_rest, x) * width * math.sqrt(2.0 * math.pi)
    exact = math.log(exact)
    result = run(ridge, settings=SamplingSettings(log_evidence_error=0.02))
    assert result.evidence.log_evidence == pytest.approx(exact, abs=4.0 * result.evidence.error)
    assert result.importance.efficiency > 0.2
    assert result.importance.share_beyond(result.ensembles) <= 2.0 * result.evidence.error


@pytest.mark.parametrize("width", [0.1, 0.3])
def test_a_stripe_without_likelihood_through_the_mode_is_no_reason_for_doubt(width):
    """A normal, NaN in a stripe about its top: what lies on either side is found or reached."""

    def log_likelihood(z):
        squares = ((z - 0.5) ** 2).sum(1) / 0.25
        return np.where(np.abs(z[:, 0] - 0.4) < 0.5 * width, np.nan, -0.5 * squares)

    result = run(log_likelihood)
    whole = 2.0 * stats.norm(0.0, math.sqrt(1.25)).logpdf(0.5) + math.log(2.0 * math.pi * 0.25)
    exact = whole + math.log1p(1.0 - 2.0 * stats.norm(0.0, math.sqrt(0.2)).cdf(0.5 * width))
    assert result.evidence.log_evidence == pytest.approx(exact, abs=4.0 * result.evidence.error)
    assert result.regions.n_regions == 2
    assert result.failed_checks == []


def half_normal_errors(z):
    """Three exact data, and the size of their errors with a half-normal prior."""
    return norm.logpdf(z[:, 1:], 0.0, -ndtri(0.5 * ndtr(-z[:, :1]))).sum(1)


def test_the_neck_of_a_funnel_has_its_share_of_the_draws():
    """By quadrature over the size, 14 % of the posterior is below a tenth of its prior's scale."""
    result = sample_target(Target(half_normal_errors, 4), np.random.SeedSequence(1))
    assert result.failed_checks == []
    density = lambda s: np.exp(-0.5 * s * s) * (1.0 + s * s) ** -1.5  # noqa: E731
    whole, neck = (quad(density, 0.0, end)[0] for end in (40.0, 0.1))
    draws = np.concatenate([part.draws for part in result.ensembles])[:, 0]
    below = draws < norm.ppf(2.0 * norm.cdf(0.1) - 1.0)
    size = result.chains.smallest_size
    share = neck / whole
    assert below.mean() == pytest.approx(share, abs=4.0 * math.sqrt(share * (1.0 - share) / size))


def test_pieces_of_a_region_that_searches_drew_in_are_no_reason_for_doubt():
    def chessboard(z):
        black = (np.floor(z[:, 0] / 0.25) + np.floor(z[:, 1] / 0.25)) % 2 == 1
        return np.where(black, -np.inf, norm.logpdf(z, 0.3, 0.5).sum(1))

    result = sample_target(Target(chessboard, 2), np.random.SeedSequence(6))
    assert result.failed_checks == []
    assert result.searches_of_regions.min() == 0  # no search climbed to one of three pieces
    # Half of the prior near the mode.
    assert 0.05 < result.prior_masses_of_regions.sum() < 0.5
