"""Reweighted posteriors against quadrature over one parameter, and what is not trusted."""

import math
import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.posterior.posterior import known_at_draws
from bayes_ssi.studies.ranking import variations


@pytest.fixture(scope="module")
def one_k(tiny_study):
    return next(c for c in tiny_study.model_classes if c.name == "one k")


@pytest.fixture(scope="module")
def posterior(tiny_ranking):
    return next(p for p in tiny_ranking.posteriors if p.name == "one k")


@pytest.fixture(scope="module")
def known(one_k, posterior):
    return known_at_draws(one_k, posterior)


def with_prior(prior):
    return lambda c: replace(c, priors={"k": prior})


def with_band(high):
    def change(c):
        (test,) = c.configurations
        data = replace(test.data, band_hz=(0.0, high))
        return replace(c, configurations=(replace(test, data=data),))

    return change


CHANGES = {
    "twice as wide": partial(variations.with_wider_priors, 2.0, {"k", "k1"}),
    "half as wide": partial(variations.with_wider_priors, 0.5, {"k", "k1"}),
    "moved": with_prior(bs.LogNormal(1.2, 0.1)),
    "another family": with_prior(bs.Normal(1.0, 0.2)),
    "bounded": with_prior(bs.Uniform(0.7, 1.02)),
    "errors": lambda c: replace(c, error=bs.ErrorModel(frequency_cov=0.03, shape_sd=0.08)),
    "detection": lambda c: replace(c, identification=bs.IdentificationModel(0.7, 0.4)),
    "band": with_band(1.7),
}


@pytest.mark.parametrize("name", CHANGES)
def test_evidence_and_parameters_by_quadrature(one_k, posterior, known, name):
    answer = variations.reweighted(posterior, known, CHANGES[name](known))
    assert answer.problem == ""
    changed = CHANGES[name](one_k)
    k = np.linspace(0.6, 1.5, 20_001)
    density = changed.log_likelihood(k[:, None]) + changed.parameters[0].prior.log_density(k)
    density = np.exp(density)
    evidence = np.trapezoid(density, k)
    mean = np.trapezoid(k * density, k) / evidence
    sd = math.sqrt(np.trapezoid((k - mean) ** 2 * density, k) / evidence)
    estimate, (spread,) = answer.log_evidence, answer.parameters
    assert estimate.log_evidence == pytest.approx(math.log(evidence), abs=4.0 * estimate.error)
    assert estimate.error < 0.05
    assert spread.mean == pytest.approx(mean, abs=4.0 * spread.mean_error)
    # The error of a normal sample's standard deviation, over that of its mean, is 1/√2.
    assert spread.sd == pytest.approx(sd, abs=4.0 * spread.mean_error)
    assert spread.mean_error < 0.1 * sd


def test_without_a_change_nothing_changes(posterior, known):
    answer = variations.reweighted(posterior, known, known)
    assert answer.log_ratio.log_evidence == pytest.approx(0.0, abs=1e-12)
    assert answer.pareto_k == -math.inf
    assert answer.parameters[0].mean == pytest.approx(posterior.summary[0].mean, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_prior(bs.LogNormal(3.0, 0.05)), r"do not cover .*: Pareto k is \S+, above 0\.7"),
        (with_prior(bs.Uniform(5.0, 6.0)), "no draw is possible"),
    ],
)
def test_draws_that_do_not_cover_the_change_are_refused(posterior, known, change, words):
    answer = variations.reweighted(posterior, known, change(known))
    assert answer.problem
    assert re.search(words, answer.problem)


def test_a_prior_that_reaches_beyond_the_sampled_one_is_refused_where_the_posterior_ends(one_k):
    """Half of the posterior lies beyond a bound that was sampled: no draw shows it."""
    low = with_prior(bs.Uniform(0.9, 1.0))(one_k)
    sampled = bs.sample(low, settings=bs.SamplingSettings(log_evidence_error=0.05))
    known_low = known_at_draws(low, sampled)
    beyond = variations.reweighted(sampled, known_low, with_prior(bs.Uniform(0.9, 1.1))(known_low))
    assert "now reaches beyond 1, where the posterior had not died out" in beyond.problem
    inside = variations.reweighted(sampled, known_low, with_prior(bs.Uniform(0.95, 1.0))(known_low))
    assert inside.problem == ""
    k = np.linspace(0.9, 1.0, 2001)
    density = np.exp(one_k.log_likelihood(k[:, None]))
    above = np.trapezoid(density[k >= 0.95], k[k >= 0.95]) / np.trapezoid(density, k)
    expected, estimate = math.log(2.0 * above), inside.log_ratio
    assert estimate.log_evidence == pytest.approx(expected, abs=4.0 * estimate.error)


@pytest.mark.parametrize(
    ("p", "factor", "expected"), [(0.95, 2.0, 0.90), (0.3, 2.0, 0.15), (0.9, 0.5, 0.95)]
)
def test_times_as_many_missed_or_spurious_modes(one_k, p, factor, expected):
    """Twice a probability of 0.7 to be missed would be none: half of what is left is taken."""
    changed = replace(one_k, identification=bs.IdentificationModel(p, 0.1))
    for change in (variations.with_missed, variations.with_spurious):
        changed = change(factor, changed)
    assert changed.identification.detection_probability == pytest.approx(expected, rel=1e-12)
    assert changed.identification.expected_spurious_modes == pytest.approx(0.1 * factor, rel=1e-12)


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_priors_of_the_named_parameters_become_wider(one_k, factor):
    (k,) = variations.with_wider_priors(factor, {"k"}, one_k).parameters
    x, log_sd = np.linspace(0.5, 2.0, 9), factor * math.sqrt(math.log(1.09))
    expected = bs.LogNormal(1.0, math.sqrt(math.expm1(log_sd**2))).log_density(x)
    np.testing.assert_allclose(k.prior.log_density(x), expected, rtol=1e-9)
    assert variations.with_wider_priors(factor, {"k1"}, one_k).parameters == one_k.parameters
