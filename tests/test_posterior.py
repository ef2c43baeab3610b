"""Posteriors of model classes: summaries, and every check that can fail."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.checks import failed_checks
from bayes_ssi.modal import Modes
from bayes_ssi.regions import Regions
from bayes_ssi.sampling import sample_target
from bayes_ssi.structures.base import Structure
from bayes_ssi.target import Target

STIFFNESS = (2.0 * math.pi) ** 2  # of a unit mass at 1 Hz


def one_mass(name="one mass", prior=None, frequency_hz=1.1, error=0.05):
    """A unit mass on a spring; its frequency is √k Hz."""
    k = bs.Parameter("k", prior or bs.LogNormal(1.0, 0.3))
    data = bs.ModalData((bs.IdentifiedMode("1", frequency_hz),), band_hz=(0.0, 3.0))
    building = bs.ShearBuilding((1.0,), (STIFFNESS * k,))
    return bs.ModelClass(name, building, data, bs.ErrorModel(error, 0.05), pairing={"1": 1})


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
    found, (row,) = posterior.evidence, posterior.summary
    assert found.log_evidence == pytest.approx(log_evidence, abs=4.0 * found.error)
    assert found.bridge.log_evidence == pytest.approx(log_evidence, abs=4.0 * found.bridge.error)
    assert found.tempered.log_evidence == pytest.approx(log_evidence, abs=0.3)
    assert found.laplace == pytest.approx(log_evidence, abs=0.02)
    assert found.mean_log_likelihood == pytest.approx(fit, abs=0.03)
    assert row.name == "k"
    assert row.mean == pytest.approx(mean, abs=4.0 * row.mean_error)
    assert row.sd == pytest.approx(sd, abs=4.0 * row.sd_error)
    assert row.mean_error < 0.05 * sd
    assert row.sd_error < 0.05 * sd
    found_quantiles = (row.quantile_05, row.median, row.quantile_95)
    assert found_quantiles == pytest.approx(quantiles, abs=0.1 * sd)


def test_information_gained_is_fit_less_evidence(posterior):
    log_evidence, *_, fit = by_quadrature()
    assert posterior.evidence.information_gained == pytest.approx(fit - log_evidence, abs=0.03)


def test_the_draws_belong_together(posterior):
    n_chains, n_steps, n_parameters = posterior.draws.shape
    assert n_parameters == 1
    assert posterior.log_likelihoods.shape == (n_chains, n_steps)
    assert posterior.values.shape == (n_chains * n_steps, 1)
    frequencies = posterior.frequencies_hz.reshape(-1, 1)
    np.testing.assert_allclose(frequencies, np.sqrt(posterior.values), rtol=1e-12)
    np.testing.assert_allclose(
        posterior.log_likelihoods.ravel(), one_mass().log_likelihood(posterior.values), atol=1e-8
    )


def test_what_else_a_posterior_tells(posterior):
    assert posterior.name == "one mass"
    assert posterior.data_digest == one_mass().data.digest
    assert posterior.pairing == {"1": 1}
    assert posterior.failed_checks == ()
    assert posterior.r_hat < 1.01
    assert 0.2 < posterior.acceptance < 1.0
    assert 1.0 <= posterior.autocorrelation_time < 10.0
    assert posterior.n_evaluations > posterior.values.size
    assert posterior.seconds > 0
    assert 300 < posterior.effective_sample_sizes[0] <= posterior.values.size
    np.testing.assert_allclose(posterior.maxima[0], 1.1**2, rtol=0.02)
    (region,) = posterior.regions
    assert (region.share, region.shares_of_starts) == (1.0, (1.0, 1.0))
    assert region.mean == pytest.approx((posterior.summary[0].mean,))


def test_the_result_follows_from_seed_and_name():
    def log_evidence(name, seed):
        return bs.sample(one_mass(name), seed=seed).evidence.log_evidence

    assert log_evidence("a", 0) == log_evidence("a", 0)
    assert len({log_evidence("a", 0), log_evidence("a", 1), log_evidence("b", 0)}) == 3


def test_an_error_names_the_class():
    impossible = one_mass("far off", bs.Uniform(100.0, 101.0), error=1e-3)
    impossible = replace(impossible, structure=WithoutModes(impossible.structure.parameters))
    with pytest.raises(ValueError, match=r"^model class 'far off': the likelihood is zero at all"):
        bs.sample(impossible)


class WithoutModes(Structure):
    """A structure that has modes only where its parameter exceeds a limit."""

    degrees_of_freedom = ("floor 1",)
    n_modes = 1
    parameters = ()

    def __init__(self, parameters, limit=np.inf):
        self.parameters = parameters
        self.limit = limit

    def modes(self, values):
        k = np.where(values[:, :1] > self.limit, values[:, :1], np.nan)
        return Modes(np.sqrt(k), np.ones((len(k), 1, 1)))


def test_a_model_that_breaks_down_in_places_is_reported():
    whole = one_mass()
    broken = replace(whole, structure=WithoutModes(whole.parameters, limit=0.9))
    found = bs.sample(broken, seed=1)
    (check,) = found.failed_checks
    number = r"[0-9.e+-]+"
    assert re.fullmatch(
        rf"the model failed at \d+ of {found.n_evaluations} evaluations, which count as likelihood "
        rf"zero; the first time at k = {number}: the answer is NaN",
        check,
    )
    assert found.values.min() > 0.9


def test_a_chain_that_is_cut_short_is_reported():
    found = bs.sample(one_mass(), settings=bs.SamplingSettings(max_steps=20))
    assert found.draws.shape[1] == 20
    expected = "a chain of 20 steps is shorter than 50 autocorrelation times"
    assert len([check for check in found.failed_checks if check.startswith(expected)]) == 2


def two_bumps(z):
    parts = [
        math.log(share) - 0.5 * (((z - centre) / 0.1) ** 2).sum(1) - 2.0 * math.log(0.1)
        for share, centre in ((0.7, 2.0), (0.3, -2.0))
    ]
    return np.logaddexp(*parts) + 0.5 * (z**2).sum(1)


@pytest.fixture(scope="module")
def sampled():
    """A result in which all is well, to be spoilt one thing at a time; two regions."""
    return sample_target(Target(two_bumps, 2), np.random.SeedSequence(4))


def test_nothing_fails_where_all_is_well(sampled):
    assert sampled.regions.n_regions == 2
    assert failed_checks(sampled) == []


def spoil_length(s):
    return replace(s, ensembles=tuple(
        replace(e, autocorrelation_times=np.full(2, e.n_steps / 49.0)) for e in s.ensembles[:1]
    ) + s.ensembles[1:])  # fmt: skip


def spoil_r_hat(s):
    first, second = s.ensembles
    return replace(s, ensembles=(first, replace(second, positions=second.positions + 0.7)))


def spoil_bridge(s):
    apart = 5.0 * math.hypot(s.bridge.error, s.evidence.error)
    bridge = replace(s.bridge, log_evidence=s.evidence.log_evidence + apart)
    return replace(s, bridge=bridge)


def spoil_tempered(s):
    starts = tuple(replace(start, log_evidence=start.log_evidence + 4.0) for start in s.starts)
    return replace(s, starts=starts)


def spoil_weights(s):
    # One draw with 3 % of the total weight; everything else agrees to within that.
    heavy = s.importance.log_likelihoods.copy()
    total = np.logaddexp.reduce(s.importance.log_weights)
    heavy[0] += total + math.log(0.03 / 0.97) - s.importance.log_weights[0]
    return replace(s, importance=replace(s.importance, log_likelihoods=heavy))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_length, r"^a chain of \d+ steps is shorter than 50 autocorrelation times of \d+"),
        (spoil_r_hat, r"^the ensembles differ: R-hat is 1\.\d{3}, above 1\.01"),
        (spoil_bridge, r"importance sampling, -?0\.\d+ ± 0\.\d+, and by bridge sampling, .* dis"),
        (spoil_tempered, r"importance sampling, .*, and by the tempered start, .*, disagree"),
        (spoil_weights, r"^one importance draw carries 3 % of the evidence"),
    ],
)
def test_each_check_fires_alone(sampled, spoil, message):
    (check,) = failed_checks(spoil(sampled))
    assert re.search(message, check)


def test_a_few_failures_in_the_far_tails_of_a_prior_are_let_pass():
    whole = one_mass()
    broken = replace(whole, structure=WithoutModes(whole.parameters, limit=0.3))
    assert bs.sample(broken, seed=1).failed_checks == ()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_estimate_that_is_no_number_disagrees(sampled, value):
    checks = failed_checks(replace(sampled, bridge=replace(sampled.bridge, log_evidence=value)))
    assert [check for check in checks if "bridge sampling" in check and "disagree" in check]


def in_first_region(sampled, z):
    return sampled.regions.assign(z) == 0


def test_a_region_that_the_tempered_starts_missed_is_reported(sampled):
    starts = []
    for start in sampled.starts:
        kept = start.positions[in_first_region(sampled, start.positions)]
        starts.append(replace(start, positions=np.resize(kept, start.positions.shape)))
    (check,) = failed_checks(replace(sampled, starts=tuple(starts)))
    assert check.startswith(
        f"a region with {100 * sampled.region_shares[1]:.1f} % of the posterior"
    )
    assert "tempered start" in check


def test_a_region_that_the_chains_never_visited_is_reported(sampled):
    ensembles = []
    for ensemble in sampled.ensembles:
        kept = ensemble.draws[in_first_region(sampled, ensemble.draws)]
        ensembles.append(replace(ensemble, positions=np.resize(kept, ensemble.positions.shape)))
    checks = failed_checks(replace(sampled, ensembles=tuple(ensembles)))
    assert any(
        check == f"a region with {100 * sampled.region_shares[1]:.1f} % of the posterior was never "
        "visited by the chains"
        for check in checks
    )


def test_a_small_region_may_be_missed(sampled):
    """Only regions with more than 2 % of the posterior are asked for."""
    log_likelihoods = sampled.importance.log_likelihoods.copy()
    groups = sampled.regions.assign(sampled.importance.z)
    log_likelihoods[groups == 1] -= 6.0
    small = replace(
        sampled,
        importance=replace(sampled.importance, log_likelihoods=log_likelihoods),
        starts=tuple(
            replace(s, positions=np.resize(s.positions[in_first_region(sampled, s.positions)],
                                           s.positions.shape)) for s in sampled.starts
        ),
    )  # fmt: skip
    assert small.region_shares[1] < 0.02
    assert not [check for check in failed_checks(small) if "region" in check]


def test_regions_of_one_are_not_asked_for(sampled):
    one = Regions(sampled.regions.draws, np.zeros_like(sampled.regions.labels))
    assert failed_checks(replace(sampled, regions=one)) == []


def test_the_summary_counts_draws_by_their_effective_number(make_posterior):
    posterior = make_posterior("x", effective_sample_sizes=np.array([100.0, 25.0]))
    values = posterior.values
    for i, (row, size) in enumerate(zip(posterior.summary, (100.0, 25.0), strict=True)):
        assert row.mean == pytest.approx(values[:, i].mean())
        assert row.sd == pytest.approx(values[:, i].std())
        assert row.mean_error == pytest.approx(row.sd / math.sqrt(size))
        # Of a normal distribution the standard deviation's error is sd / √(2 n).
        assert row.sd_error == pytest.approx(row.sd / math.sqrt(2.0 * size), rel=0.1)
        expected = np.quantile(values[:, i], [0.05, 0.5, 0.95])
        assert (row.quantile_05, row.median, row.quantile_95) == pytest.approx(expected)
