"""Posteriors of model classes: evidence, summaries, failures, and the chains that they quote."""

import math
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from targets import STIFFNESS, one_mass, two_bumps

import bayes_ssi as bs
from bayes_ssi.inference.posterior.model_at_draws import at_draws
from bayes_ssi.inference.posterior.posterior import Region
from bayes_ssi.inference.posterior_sampling.sample import _noise, _quoted_draws
from bayes_ssi.inference.sampling import engine
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.target import Target


@pytest.fixture(scope="module")
def posterior():
    return bs.sample(one_mass(), seed=3)


def by_quadrature():
    """Log evidence, mean, sd and quantiles of the one mass on a fine grid."""
    u = np.linspace(-9.0, 9.0, 200_001)
    k = np.exp(math.sqrt(math.log(1.09)) * u)
    residual = np.sqrt(k) / 1.1 - 1.0
    log_likelihood = -0.1 + math.log(0.95) - math.log(1.1 * 0.05 * math.sqrt(2.0 * math.pi))
    log_likelihood = log_likelihood - 0.5 * (residual / 0.05) ** 2
    mass = np.exp(log_likelihood - 0.5 * u**2) / math.sqrt(2.0 * math.pi) * (u[1] - u[0])
    evidence = mass.sum()
    share = mass / evidence
    mean = share @ k
    quantiles = np.interp([0.05, 0.5, 0.95], np.cumsum(share), k)
    sd = math.sqrt(share @ (k - mean) ** 2)
    return math.log(evidence), mean, sd, quantiles, share @ log_likelihood


def test_evidence_and_summary_are_those_of_quadrature(posterior):
    log_evidence, mean, sd, quantiles, fit = by_quadrature()
    result, (row,) = posterior.evidence, posterior.summary
    assert result.log_evidence == pytest.approx(log_evidence, abs=4.0 * result.error)
    *others, laplace = result.checks
    assert len(others) >= 2
    for other in others:
        assert other.log_evidence == pytest.approx(log_evidence, abs=4.0 * other.error)
    assert laplace.log_evidence == pytest.approx(log_evidence, abs=0.02)
    assert result.mean_log_likelihood == pytest.approx(fit, abs=0.03)
    assert result.information_gained == pytest.approx(fit - log_evidence, abs=0.03)
    assert row.name == "k"
    assert row.mean == pytest.approx(mean, abs=4.0 * row.mean_error)
    assert row.sd == pytest.approx(sd, abs=4.0 * row.sd_error)
    assert row.mean_error < 0.05 * sd
    assert row.sd_error < 0.05 * sd
    assert (row.quantile_05, row.median, row.quantile_95) == pytest.approx(quantiles, abs=0.1 * sd)


def test_the_other_fields_of_a_posterior(posterior):
    assert posterior.name == "one mass"
    assert posterior.data_digest == one_mass().data.digest
    frequencies = posterior.frequencies_hz.reshape(-1, 1)
    np.testing.assert_allclose(frequencies, np.sqrt(posterior.values), rtol=1e-12)
    assert posterior.configurations[0].pairing == {"1": 1}
    assert posterior.failed_checks == ()
    assert 0.99 < posterior.r_hat <= 1.01
    assert 0.2 < posterior.acceptance_fraction < 1.0
    assert posterior.burn_in == 15
    assert 1.0 <= posterior.autocorrelation_time < 10.0
    assert posterior.n_evaluations > posterior.values.size
    assert posterior.seconds > 0
    assert 2000 < posterior.effective_sample_sizes[0] <= posterior.values.size
    assert posterior.tail_effective_sample_sizes[0] > 2000
    np.testing.assert_allclose(posterior.maxima[0], 1.1**2, rtol=0.02)
    (region,) = posterior.regions
    assert region.share == 1.0
    assert region.mean == pytest.approx((posterior.summary[0].mean,))


def test_the_result_follows_from_seed_and_name():
    def log_evidence(name, seed):
        return bs.sample(one_mass(name), seed=seed).evidence.log_evidence

    first = log_evidence("a", 0)
    assert log_evidence("a", 0) == first
    assert len({first, log_evidence("a", 1), log_evidence("b", 0)}) == 3


def test_an_error_names_the_class():
    impossible = one_mass("far off", bs.Uniform(100.0, 101.0), error=1e-3)
    impossible = replace(impossible, structure=WithoutModes(impossible.structure.parameters))
    with pytest.raises(ValueError, match=r"^model class 'far off': the likelihood is zero at all"):
        bs.sample(impossible)


class WithoutModes(bs.Structure):
    """A structure that has modes only where its parameter exceeds a limit."""

    degrees_of_freedom = ("floor 1",)
    n_modes = 1
    parameters = ()

    def __init__(self, parameters, limit=np.inf):
        self.parameters = parameters
        self.limit = limit

    def modes(self, values):
        k = np.where(values[:, :1] > self.limit, values[:, :1], np.nan)
        return bs.Modes(np.sqrt(k), np.ones((len(k), 1, 1)))


def test_a_model_that_breaks_down_in_places_is_reported():
    whole = one_mass()
    result = bs.sample(replace(whole, structure=WithoutModes(whole.parameters, limit=0.9)), seed=1)
    (check,) = result.failed_checks
    number = r"[0-9.e+-]+"
    assert re.fullmatch(
        rf"the model failed at \d+ of {result.n_evaluations} evaluations, which count as "
        rf"likelihood zero; the first time at k = {number}: the answer is NaN",
        check,
    )
    assert result.values.min() > 0.9


def test_a_few_failures_in_the_far_tails_of_a_prior_are_accepted():
    whole = one_mass()
    broken = replace(whole, structure=WithoutModes(whole.parameters, limit=0.3))
    assert bs.sample(broken, seed=1).failed_checks == ()


def test_draws_that_are_no_chains_count_as_the_chains_that_they_come_from(make_posterior):
    """An error that is estimated from one chain has itself an error of 5 to 7 %."""
    draws = np.random.default_rng(4).standard_normal((1, 4000, 2))
    sizes = np.array([100.0, 25.0])
    posterior = make_posterior("x", draws=draws, effective_sample_sizes=sizes)
    for row, size in zip(posterior.summary, sizes, strict=True):
        assert row.mean_error == pytest.approx(row.sd / math.sqrt(size), rel=0.2)
        assert row.sd_error == pytest.approx(row.sd / math.sqrt(2.0 * size), rel=0.2)
    # Errors of the shares of two regions move the mean of one parameter, at ± 3, and not the other.
    regions = tuple(Region(0.5, 0.1, 4, (place, 0.0)) for place in (-3.0, 3.0))
    moved, same = replace(posterior, regions=regions).summary
    first, second = posterior.summary
    assert moved.mean_error == pytest.approx(math.hypot(first.mean_error, 0.6), rel=1e-3)
    assert same.mean_error == pytest.approx(second.mean_error, rel=0.01)


def noisy_spring(noise):
    rng = np.random.default_rng(4)

    def frequency(k):
        return [math.sqrt(k) * (1.0 + noise * rng.standard_normal())], None

    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    structure = bs.FunctionStructure(frequency, {"k": 1.0 * k}, n_modes=1)
    return one_mass("spring", error=0.01).with_structures(lambda *_: structure)


def assert_of_noise(text, noise):
    """The largest of three differences of two normal numbers, relative, is near its expectation."""
    share = float(re.match(r"asked twice at 3 draws, .* by (\S+) at most \(as a ", text)[1])
    assert 0.2 < share / (math.sqrt(2.0) * noise) < 4.0


@pytest.mark.parametrize(
    ("noise", "shared", "said"),
    [(1e-10, False, 0), (1e-4, False, 1), (1e-4, True, 1), (3e-2, False, 2)],
)
def test_a_model_that_answers_differently_when_asked_twice(noise, shared, said, copied_workers):
    """What it remembers does not hide it: each answer of the function is remembered."""
    noisy = noisy_spring(noise)
    values = np.linspace(1.18, 1.24, 5)[:, None]
    model = at_draws(noisy, values)
    totals = model.log_likelihoods.sum(axis=1)
    found = _noise(noisy, values, totals, model, copied_workers if shared else None)
    assert [len(each) for each in found] == [said == 1, said == 2]
    for text in (*found[0], *found[1]):
        assert_of_noise(text, noise)


def test_small_noise_is_said_once_and_fails_nothing():
    posterior = bs.sample(noisy_spring(1e-4), settings=bs.SamplingSettings(log_evidence_error=0.1))
    assert posterior.failed_checks == ()
    assert len(posterior.regions) == 1
    (remark,) = posterior.remarks
    assert_of_noise(remark, 1e-4)


def test_draws_are_the_walkers_of_emcee_step_by_step(monkeypatch):
    """One frequency of two springs in series: either may be the soft one; two regions."""
    run, ensembles = engine.run_ensembles, []

    def recorded(*args, **kwargs):
        ensembles.append(run(*args, **kwargs))
        return ensembles[-1]

    monkeypatch.setattr(engine, "run_ensembles", recorded)
    k1, k2 = (bs.Parameter(name, bs.LogNormal(1.0, 1.0)) for name in ("k1", "k2"))
    building = bs.ShearBuilding((1.0, 1.0), (STIFFNESS * k1, STIFFNESS * k2))
    data = bs.ModalData((bs.IdentifiedMode("1", 0.35), bs.IdentifiedMode("2", 1.6)), (0.0, 3.0))
    pairing = {"1": 1, "2": 2}
    exchange = bs.ModelClass("exchange", building, data, bs.ErrorModel(0.01), pairing=pairing)
    posterior = bs.sample(exchange)
    assert len(posterior.regions) == 2
    assert posterior.failed_checks == posterior.remarks == ()
    by = posterior.thinned_by
    chains = np.concatenate([ensemble.chains[:, by - 1 :: by] for ensemble in ensembles[-1][0]])
    assert posterior.draws.shape == chains.shape
    values = exchange.values(chains.reshape(-1, 2)).reshape(chains.shape)
    np.testing.assert_array_equal(posterior.draws, values)
    # A walker that does not move repeats itself: of shuffled draws, hardly any does.
    moved = np.any(np.diff(posterior.draws, axis=1) != 0.0, axis=2)
    assert moved.mean() == pytest.approx(posterior.acceptance_fraction, abs=0.02)
    first = exchange.log_likelihood(posterior.draws[3])
    np.testing.assert_allclose(posterior.log_likelihoods[3], first, atol=1e-9)
    columns = np.moveaxis(posterior.draws, -1, 0)
    r_hats = [float(arviz_functions().rhat(column)) for column in columns]
    assert posterior.r_hat == pytest.approx(max(r_hats), rel=1e-9)


def arviz_functions():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz


def test_draws_of_chains_that_do_not_mix_have_the_shares_of_the_regions():
    settings = bs.SamplingSettings(max_steps=12, r_hat=1.0001)
    sampled = sample_target(Target(two_bumps(), 2), np.random.SeedSequence(3), settings)
    chains = np.concatenate([ensemble.chains for ensemble in sampled.ensembles])
    assert any(check.startswith("the chains differ") for check in sampled.failed_checks)
    draws, log_likelihoods, (remark,) = _quoted_draws(sampled, np.random.default_rng(0))
    assert remark.startswith("the draws are no chains: those of 352 steps")
    assert draws.shape == (1, chains[..., 0].size, 2)
    small = sampled.region_shares.min()
    assert small == pytest.approx(0.1, abs=4.0 * sampled.region_errors.max())
    assert np.mean(draws[0, :, 0] < 0.0) == pytest.approx(small, abs=1.0 / draws.shape[1])
    assert abs(np.mean(chains[..., 0] < 0.0) - small) > 3.0 / draws.shape[1]
    np.testing.assert_allclose(log_likelihoods[0], two_bumps()(draws[0]), atol=1e-9)
