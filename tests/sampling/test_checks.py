"""Checks of a result: each fires when it should and alone, and none where all is well."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import log_ndtr, ndtr, ndtri
from scipy.stats import expon, halfnorm
from targets import STIFFNESS, one_mass, two_bumps

import bayes_ssi as bs
from bayes_ssi.inference.criticism.misfit import edges
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.ensembles import ChainStatistics
from bayes_ssi.inference.sampling.regions import Regions
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

PHI = (1.0 + math.sqrt(5.0)) / 2.0


def edge_checks_of(model_class, z):
    found = edges(model_class, z, model_class.modes(model_class.values(z))[0].frequencies_hz)
    return [edge.statement for edge in found]


@pytest.fixture(scope="module")
def sampled():
    """A result in which all is well, to be spoilt one thing at a time; two regions."""
    return sample_target(Target(two_bumps(0.3), 2), np.random.SeedSequence(4))


def test_nothing_fails_where_all_is_well(sampled):
    assert sampled.regions.n_regions == 2
    assert sampled.failed_checks == []


def spoil_r_hat(s):
    # One ensemble stays in one of the two regions.
    first, second = s.ensembles
    kept = second.positions[..., 0] > 0
    positions = np.resize(second.positions[kept], second.positions.shape)
    log_posteriors = np.resize(second.log_posteriors[kept], second.log_posteriors.shape)
    stuck = replace(second, positions=positions, log_posteriors=log_posteriors)
    chains = ChainStatistics(np.concatenate([first.chains, stuck.chains]))
    return replace(s, ensembles=(first, stuck), chains=chains)


def spoil_bridge(s):
    bridge, *others = s.evidence_checks
    apart = 5.0 * math.hypot(bridge.error, s.evidence.error)
    bridge = replace(bridge, log_evidence=s.evidence.log_evidence + apart)
    return replace(s, evidence_checks=(bridge, *others))


def spoil_compression(s):
    *others, compression, laplace = s.evidence_checks
    compression = replace(compression, log_evidence=compression.log_evidence + 4.0)
    return replace(s, evidence_checks=(*others, compression, laplace))


def spoil_weights(s):
    # One draw with 3 % of the total weight; everything else agrees to within that.
    heavy = s.importance.log_likelihoods.copy()
    total = np.logaddexp.reduce(s.importance.log_weights)
    heavy[0] += total + math.log(0.03 / 0.97) - s.importance.log_weights[0]
    return replace(s, importance=replace(s.importance, log_likelihoods=heavy))


def spoil_tail(s):
    # The largest weights exceed the others by quantiles of a Pareto distribution with k = 1.
    weights = s.importance.weights
    order = np.argsort(weights)[-int(3.0 * math.sqrt(len(weights))) :]
    chances = (np.arange(len(order)) + 0.5) / len(order)
    heavy = weights[order[0]] + 0.15 / len(weights) * chances / (1.0 - chances)
    log_likelihoods = s.importance.log_likelihoods.copy()
    log_likelihoods[order] += np.log(heavy / weights[order])
    importance = replace(s.importance, log_likelihoods=log_likelihoods)
    return replace(s, settings=bs.SamplingSettings(log_evidence_error=1e9), importance=importance)


def spoil_coverage(s):
    # Six draws of a hundred of one ensemble are where the mixture is e^20 times too low.
    first, second = s.ensembles
    higher = first.log_posteriors.copy()
    higher.ravel()[:: 100 // 6] += 20.0
    return replace(s, ensembles=(replace(first, log_posteriors=higher), second))


def spoil_reach(s):
    # All importance draws lie far out in one coordinate, and weigh what they weighed.
    z = s.importance.z.copy()
    z[:, 1] = 37.5
    away = log_standard_normal(s.importance.z) - log_standard_normal(z)
    sample = replace(s.importance, z=z, log_likelihoods=s.importance.log_likelihoods + away)
    return replace(s, importance=sample)


def spoil_size(s):
    # Few steps of a few chains.
    few = ChainStatistics(s.chains.chains[:8, ::5][:, :20])
    return replace(s, chains=few, settings=bs.SamplingSettings(r_hat=2.0))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_r_hat, r"^the chains differ: R-hat is 1\.\d{3}, above 1\.01, after \d+ steps$"),
        (spoil_bridge, r"and bridge sampling disagree on the log evidence: -?0\.\d+ ± 0\.\d+ and "),
        (spoil_compression, r"importance sampling and compression of the prior disagree on the"),
        (spoil_weights, r"^the standard error of the log evidence is 0\.03\d after \d+ importance"),
        (spoil_tail, r"^a few importance draws may carry .* Pareto k is 0\.[89]\d, above 0\.7$"),
        (spoil_coverage, r"^the importance draws may miss 6\.\d % of the posterior: draws of the"),
        (spoil_reach, r"^100 % of the posterior is 37 prior standard deviations or more from the"),
        (spoil_size, r"^effective sample size of the chains [1-3]\d\d, at least 400 needed$"),
    ],
)
def test_each_check_fires_alone(sampled, spoil, message):
    (check,) = spoil(sampled).failed_checks
    assert re.search(message, check)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_estimate_that_is_no_number_disagrees(sampled, value):
    bridge, *others = sampled.evidence_checks
    wrong = replace(bridge, log_evidence=value)
    checks = replace(sampled, evidence_checks=(wrong, *others)).failed_checks
    assert [check for check in checks if "bridge sampling" in check and "disagree" in check]


def in_first_region(sampled, z):
    return sampled.regions.assign(z) == 0


def test_a_region_that_the_compressions_missed_is_reported(sampled):
    missing = []
    for each in sampled.compressions:
        kept = np.resize(np.flatnonzero(in_first_region(sampled, each.draws)), len(each.draws))
        heights = each.log_posteriors[kept]
        missing.append(replace(each, draws=each.draws[kept], log_posteriors=heights))
    (check,) = replace(sampled, compressions=tuple(missing)).failed_checks
    share = 100 * sampled.region_shares[1]
    assert check.startswith(f"a region with {share:.1f} % of the posterior")
    assert "missed by 2 of 2 compressions of the prior" in check


def test_a_region_that_the_chains_never_visited_is_reported(sampled):
    ensembles = []
    for ensemble in sampled.ensembles:
        kept = ensemble.draws[in_first_region(sampled, ensemble.draws)]
        ensembles.append(replace(ensemble, positions=np.resize(kept, ensemble.positions.shape)))
    checks = replace(sampled, ensembles=tuple(ensembles)).failed_checks
    share = 100 * sampled.region_shares[1]
    assert f"a region with {share:.1f} % of the posterior was never visited by the chains" in checks


def test_a_small_region_may_be_missed(sampled):
    """Only regions with more than 2 % of the posterior are asked for."""
    log_likelihoods = sampled.importance.log_likelihoods.copy()
    log_likelihoods[sampled.regions.assign(sampled.importance.z) == 1] -= 6.0
    small = replace(
        sampled,
        importance=replace(sampled.importance, log_likelihoods=log_likelihoods),
        compressions=tuple(
            replace(c, draws=np.resize(c.draws[in_first_region(sampled, c.draws)], c.draws.shape))
            for c in sampled.compressions
        ),
    )
    assert small.region_shares[1] < 0.02
    assert not [check for check in small.failed_checks if "region" in check]
    # Nor are regions of one asked for.
    one = Regions(sampled.regions.draws, np.zeros_like(sampled.regions.labels))
    assert replace(sampled, regions=one).failed_checks == []


def searched(sampled, reached_by_second):
    """The same result with the second region found by this number of searches only."""
    of_second = sampled.regions.assign(sampled.search.maxima.z) == 1
    reached_by = sampled.search.reached_by.copy()
    reached_by[reached_by_second:, of_second] = False
    return replace(sampled, search=replace(sampled.search, reached_by=reached_by))


@pytest.mark.parametrize("n", [0, 1, 2])
def test_a_region_that_fewer_than_two_searches_found_is_reported(sampled, n):
    share = 100 * sampled.region_shares[1]
    assert sampled.searches_of_regions.tolist() == [4, 4]
    expected = (
        f"a region with {share:.1f} % of the posterior was found by {n} of 4 independent searches; "
        "there may be others"
    )
    assert searched(sampled, n).failed_checks == ([expected] if n < 2 else [])


def test_a_region_that_every_search_drew_in_is_not_doubted(sampled):
    """The prior mass of its bulk times the draws of a search decides, at five draws."""
    unfound = searched(sampled, 0)
    needed = 5.0 / sampled.prior_masses_of_regions[1] * sampled.search.n_searches
    for factor, doubted in ((0.9, True), (1.1, False)):
        search = replace(unfound.search, n_draws=round(factor * needed))
        checks = replace(unfound, search=search).failed_checks
        assert any("found by 0" in check for check in checks) == doubted


def cut_off_bump(z):
    """A normal of height 1, cut off at e^-690: above that in 8e-6 of the prior."""
    return np.maximum(-0.5 * ((z - np.array([1.5, -1.0])) ** 2).sum(1) / 2.5e-4**2, -690.0)


# Of the last, importance draws are where coordinates end, or beyond.
@pytest.mark.parametrize("seed", [0, 1, 18])
def test_a_floor_is_passed_or_reported(seed):
    result = sample_target(Target(cut_off_bump, 2), np.random.SeedSequence(seed))
    exact = math.log(2.0 * math.pi) + 2.0 * math.log(2.5e-4)
    exact += float(log_standard_normal(np.array([[1.5, -1.0]]))[0])
    if abs(result.evidence.log_evidence - exact) < 0.05:
        # One compression may have stayed at the floor, which is said.
        assert not [check for check in result.failed_checks if "floor" in check]
    else:
        (check,) = result.failed_checks
        assert check == (
            "the log-likelihood is -690 wherever it was evaluated: either no parameter has an "
            "influence on it, or this is a floor at which small likelihoods are cut off, and all "
            "above it lies in regions of less than 0.0002 of the prior, which were not found"
        )


def test_a_likelihood_of_one_in_a_small_part_of_the_prior_is_no_floor():
    """Φ(-1.5) of the prior, and impossible elsewhere: parameters do have an influence."""

    def log_likelihood(z):
        return np.where(z[:, 0] > 1.5, 0.0, -np.inf)

    result = sample_target(Target(log_likelihood, 2), np.random.SeedSequence(2))
    assert result.failed_checks == []
    error = 4.0 * result.evidence.error
    assert result.evidence.log_evidence == pytest.approx(log_ndtr(-1.5), abs=error)


# Beyond ±3.09 lies one prior draw in a thousand.
@pytest.mark.parametrize(("end", "sign"), [("lower", 1.0), ("upper", -1.0)])
@pytest.mark.parametrize(
    ("beyond", "per_cent", "reported"),
    [(0.9e-3, 100, True), (1.1e-3, 100, False), (1e-9, 51, True), (1e-9, 49, False)],
)
def test_a_posterior_at_the_edge_of_a_prior_is_reported(end, sign, beyond, per_cent, reported):
    z = np.zeros((100, 1))
    z[:per_cent] = sign * ndtri(beyond)
    expected = (
        f"parameter 'k': {per_cent} % of the posterior lies at the {end} edge of its prior, "
        "Uniform(lower=2.0, upper=4.0), where only one in a thousand prior draws lies"
    )
    checks = edge_checks_of(one_mass(prior=bs.Uniform(2.0, 4.0)), z)
    assert checks == ([expected] if reported else [])


@pytest.mark.parametrize(
    ("lower", "end", "density", "said"),
    [(2.0, "lower", expon, True), (2.0, "upper", expon, True), (2.0, "lower", halfnorm, False),
     (0.0, "lower", expon, False)],
    ids=["lower", "upper", "the bound may be the truth", "zero"],
)  # fmt: skip
def test_a_posterior_that_falls_from_a_bound_of_its_prior_is_reported(lower, end, density, said):
    """1 - 1/e of an exponential density is within a standard deviation, 0.45 of half a normal."""
    z = ndtri(0.02 * density.ppf((np.arange(1000) + 0.5) / 1000))[:, None]
    prior = bs.Uniform(lower, 4.0)
    checks = edge_checks_of(one_mass(prior=prior), z if end == "lower" else -z)
    expected = (
        f"parameter 'k': 63 % of the posterior lies at the {end} edge of its prior, {prior!r}, "
        "within one of its own standard deviations"
    )
    assert checks == ([expected] if said else [])


@pytest.mark.parametrize("prior", [bs.LogUniform(0.001, 0.5), bs.LogNormal(1.0, 0.3)])
def test_draws_that_a_prior_itself_gives_are_at_no_edge(prior):
    """77 % of draws of LogUniform(0.001, 0.5) are less than their standard deviation from 0.001."""
    assert not edge_checks_of(one_mass(prior=prior), ndtri((np.arange(1000) + 0.5) / 1000)[:, None])
    in_tail = ndtri(1.0 - 0.02 * expon.ppf((np.arange(1000) + 0.5) / 1000))[:, None]
    assert len(edge_checks_of(one_mass(prior=prior), in_tail)) == np.isfinite(prior.support[1])


def test_sampling_reports_the_edge_of_a_prior():
    """k is 1.21 for a perfect fit."""

    def likelihood(k):
        return math.exp(-0.5 * ((math.sqrt(k) / 1.1 - 1.0) / 0.01) ** 2)

    (edge,) = bs.sample(one_mass(prior=bs.Uniform(2.0, 4.0), error=0.01)).edges
    assert (edge.parameter, edge.configuration, edge.end) == ("k", None, 0)
    result = re.match(r"parameter 'k': (\d+) % of the posterior lies at the lower", edge.statement)
    share = quad(likelihood, 2.0, 2.0 + 2.0 * ndtr(-3.09))[0] / quad(likelihood, 2.0, 2.2)[0]
    assert float(result[1]) == pytest.approx(100 * share, abs=4.0)


@pytest.mark.parametrize(
    ("factor", "per_cent", "reported"),
    [(0.95, 99, False), (0.97, 51, True), (0.97, 49, False), (1.03, 99, True), (1.05, 100, False)],
)
def test_a_mode_at_the_edge_of_the_band_is_reported(factor, per_cent, reported):
    """Frequencies √k/φ and √k φ Hz; the second was not identified, and k is 1 in so many draws.

    The band ends at this multiple of φ Hz; errors of 2 % count twice.
    """
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0 / PHI),), band_hz=(0.0, factor * PHI))
    building = bs.ShearBuilding((1.0, 1.0), (STIFFNESS * k, STIFFNESS * k))
    error = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.05)
    candidate = bs.ModelClass("two storeys", building, data, error, pairing={"1": 1})
    z = np.full((100, 1), 2.0)
    z[:per_cent] = 0.0
    expected = (
        f"model mode 2 is paired with nothing and lies at the edge of the band 0 to "
        f"{factor * PHI:g} Hz in {per_cent} % of the posterior: whether it counts as missed "
        "depends on where the band ends"
    )
    assert edge_checks_of(candidate, z) == ([expected] if reported else [])
