"""Classes with a setting varied, by their draws: against new sampling and closed forms."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.posterior.posterior import known_at_draws
from bayes_ssi.studies.ranking.variations import (
    reweighted,
    with_missed,
    with_spurious,
    with_wider_priors,
)

SIZES = {"frequency_cov": 0.02, "shape_sd": 0.05}


@pytest.fixture(scope="module")
def known(tiny_ranking):
    pairs = zip(tiny_ranking.study.model_classes, tiny_ranking.posteriors, strict=True)
    return {each.name: known_at_draws(each, posterior) for each, posterior in pairs}


@pytest.fixture(scope="module")
def answers(tiny_ranking, known):
    """Name of a variation → model class → what its draws say."""
    changes = {}
    for times, factor in (("× 2", 2.0), ("× ½", 0.5)):
        changes[f"missed modes {times}"] = partial(with_missed, factor)
        changes[f"spurious modes {times}"] = partial(with_spurious, factor)
        changes[f"width of priors {times}"] = partial(with_wider_priors, factor, {"k", "k1", "k2"})
        for name, size in SIZES.items():
            changed = bs.ChangedSettings(**{name: factor * size})
            changes[f"{name} {times}"] = changed.applied_to
    posteriors = tiny_ranking.posteriors
    return {
        name: {p.name: reweighted(p, known[p.name], change(known[p.name])) for p in posteriors}
        for name, change in changes.items()
    }


def test_missed_modes(answers, tiny_ranking):
    """Both modes are identified, so every class's likelihood changes by 2 log(p'/p) throughout.

    p falls from 0.95 to 0.90, and rises to 0.975.
    """
    for name, p in (("missed modes × 2", 0.90), ("missed modes × ½", 0.975)):
        for posterior in tiny_ranking.posteriors:
            change = answers[name][posterior.name].log_ratio.log_evidence
            assert change == pytest.approx(2.0 * math.log(p / 0.95), abs=1e-9)


def test_spurious_modes(answers):
    """Nothing is spurious in any class, so only e^-ν changes: by 0.1 nats if ν doubles."""
    for answer in answers["spurious modes × 2"].values():
        assert answer.log_ratio.log_evidence == pytest.approx(-0.1, abs=1e-9)


@pytest.mark.parametrize("name", SIZES)
@pytest.mark.parametrize(("times", "factor"), [("× 2", 2.0), ("× ½", 0.5)])
def test_error_sizes_against_sampling_with_them(answers, tiny_ranking, name, times, factor):
    sizes = {**SIZES, name: factor * SIZES[name]}
    for candidate in tiny_ranking.study.model_classes:
        (configuration,) = candidate.configurations
        again = bs.ModelClass(
            candidate.name, configuration.structure, configuration.data, bs.ErrorModel(**sizes),
            pairing=configuration.pairing,
        )  # fmt: skip
        evidence = bs.sample(again, seed=1).evidence
        estimate = answers[f"{name} {times}"][candidate.name].log_evidence
        tolerance = 4.0 * math.hypot(estimate.error, evidence.error)
        assert estimate.log_evidence == pytest.approx(evidence.log_evidence, abs=tolerance)


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_widths_of_priors_by_quadrature(answers, tiny_ranking, factor):
    """One parameter, so its evidence is an integral over the wider or narrower lognormal."""
    answer = answers[f"width of priors × {'2' if factor == 2.0 else '½'}"]["one k"]
    candidate = next(c for c in tiny_ranking.study.model_classes if c.name == "one k")
    assert answer.problem == ""
    z = np.linspace(-8.0, 8.0, 4001)
    values = np.exp(factor * math.sqrt(math.log(1.09)) * z)[:, None]
    integrand = np.exp(candidate.log_likelihood(values) - 0.5 * z**2) / math.sqrt(2.0 * math.pi)
    estimate = answer.log_evidence
    expected = math.log(np.trapezoid(integrand, z))
    assert estimate.log_evidence == pytest.approx(expected, abs=4.0 * estimate.error)


@pytest.mark.parametrize(
    ("p", "factor", "expected"), [(0.95, 2.0, 0.90), (0.3, 2.0, 0.15), (0.9, 0.5, 0.95)]
)
def test_a_detection_probability_stays_one(tiny_study, p, factor, expected):
    """Twice a probability of 0.7 to be missed would be none: half of what is left is taken."""
    candidate = replace(
        tiny_study.model_classes[0], identification=bs.IdentificationModel(detection_probability=p)
    )
    changed = with_missed(factor, candidate)
    assert changed.identification.detection_probability == pytest.approx(expected, rel=1e-12)
