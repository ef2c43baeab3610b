"""Sensitivity of rankings to settings, against new sampling and closed forms."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.posterior.posterior import known_at_draws
from bayes_ssi.report.tables.ranking_tables import sensitivity_notes, sensitivity_table
from bayes_ssi.results.stored_result import save_result
from bayes_ssi.results.stored_what_if import every_setting
from bayes_ssi.studies.ranking.changed_settings import Sensitivity, SensitivityRow, sensitivity
from bayes_ssi.studies.ranking.variations import (
    SampledClasses,
    Variation,
    default_variations,
    with_errors,
    with_missed,
)


@pytest.fixture(scope="module")
def moved(tiny_ranking):
    return every_setting(tiny_ranking)


@pytest.fixture(scope="module")
def known(tiny_ranking):
    pairs = zip(tiny_ranking.study.model_classes, tiny_ranking.posteriors, strict=True)
    return {each.name: known_at_draws(each, posterior) for each, posterior in pairs}


@pytest.fixture(scope="module")
def answers(tiny_ranking, known):
    """Name of a variation → model class → what its draws say."""
    sampled = SampledClasses({p.name: p for p in tiny_ranking.posteriors}, known)
    return {each.name: sampled.varied(each) for each in default_variations()}


def test_the_first_row_is_the_ranking(moved, tiny_ranking):
    first = moved.rows[0]
    assert first.name == "unchanged"
    for row in tiny_ranking.comparison.classes:
        assert first.probabilities[row.name] == pytest.approx(row.probability, rel=1e-12)


def test_every_setting_is_halved_and_doubled(moved, answers):
    assert [row.name for row in moved.rows[1:]] == list(answers)
    assert len(moved.rows) == 11
    for row in moved.known[1:]:
        one, other = (answers[row.name][name].log_evidence.log_evidence for name in row.ranked)
        assert row.lead == pytest.approx(one - other, rel=1e-9)


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


@pytest.mark.parametrize("name", ["σ_f × 2", "σ_f × ½", "σ_φ × 2", "σ_φ × ½"])
def test_error_sizes_against_sampling_with_them(answers, tiny_ranking, name):
    factor = 2.0 if name.endswith("2") else 0.5
    sizes = {"frequency_cov": 0.02, "shape_sd": 0.05}
    sizes["frequency_cov" if "f" in name else "shape_sd"] *= factor
    for candidate in tiny_ranking.study.model_classes:
        (configuration,) = candidate.configurations
        again = bs.ModelClass(
            candidate.name, configuration.structure, configuration.data, bs.ErrorModel(**sizes),
            pairing=configuration.pairing,
        )  # fmt: skip
        evidence = bs.sample(again, seed=1).evidence
        estimate = answers[name][candidate.name].log_evidence
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


@pytest.fixture
def far_wider(monkeypatch):
    """Ten times the error size makes a posterior far wider than the draws."""
    wide = Variation("far wider", lambda c: with_errors(10.0, 10.0, c))
    monkeypatch.setattr(
        "bayes_ssi.studies.ranking.changed_settings.default_variations", lambda **_: (wide,)
    )
    return wide


@pytest.mark.usefixtures("far_wider")
def test_draws_that_do_not_cover_the_changed_class_are_not_used(tiny_ranking):
    found = every_setting(tiny_ranking)
    assert found.rows[1].probabilities == {}
    (problem,) = found.problems
    for name in tiny_ranking.study.names:
        assert f"{name!r}: the draws do not cover the changed class" in problem
    assert sensitivity_notes(found)[1:] == [f"  (!) {problem}"]
    assert sensitivity_table(found).row_count == 2


def test_what_the_draws_do_not_cover_is_sampled_again(tiny_ranking, far_wider):
    classes = tiny_ranking.study.model_classes
    found = every_setting(tiny_ranking, classes)
    assert found.problems == ()
    evidences = [bs.sample(far_wider.change(each), seed=1).evidence for each in classes]
    expected = abs(evidences[0].log_evidence - evidences[1].log_evidence)
    tolerance = 4.0 * math.hypot(0.03, 0.03, *(each.error for each in evidences))
    assert found.rows[1].lead == pytest.approx(expected, abs=tolerance)


def test_prior_weights_count(tiny_ranking, known):
    weights = {"one k": 1.0, "each k": 1e6}
    posteriors = {each.name: each for each in tiny_ranking.posteriors}
    first = sensitivity(SampledClasses(posteriors, known), weights).rows[0]
    best = bs.compare(tiny_ranking.posteriors, weights).best
    assert (first.best, first.probabilities[first.best]) == (
        best.name, pytest.approx(best.probability, rel=1e-12)
    )  # fmt: skip


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


def rows(*best):
    shares = {"a": {"a": 0.9, "b": 0.1}, "b": {"a": 0.2, "b": 0.8}}
    return tuple(SensitivityRow(f"row {i}", shares[name]) for i, name in enumerate(best))


def test_rows_in_which_another_class_ranks_first_are_named():
    of_three = Sensitivity(rows("a", "b", "a"))
    assert [row.name for row in of_three.turning] == ["row 1"]
    assert sensitivity_notes(of_three) == [
        "'a' does not rank first under every setting: 'b' does with row 1."
    ]
    assert of_three.rows[0].lead == pytest.approx(math.log(9.0))
    assert sensitivity_table(of_three).row_count == 3


def test_a_robust_ranking_is_reported_as_such():
    assert sensitivity_notes(Sensitivity(rows("a", "a"))) == [
        "'a' ranks first under every setting."
    ]


def test_a_class_alone_leads_by_infinity():
    row = SensitivityRow("unchanged", {"a": 1.0})
    assert row.lead == math.inf
    assert math.isnan(SensitivityRow("x", {"a": 1.0 - 1e-9, "b": 1e-9}, unsaid=("b",)).lead)
    assert sensitivity_table(Sensitivity((row,))).row_count == 1


def test_from_the_command_line(tmp_path, run, tiny_ranking, moved):
    out = save_result(tiny_ranking, tmp_path / "r").directory
    result = run("what-if", out)
    assert result.exit_code == (3 if moved.problems else 0), result.output
    assert "Sensitivity to settings" in result.output
    assert sensitivity_notes(moved)[0] in result.output.replace("\n", " ")
    record = json.loads(run("what-if", out, "--json").stdout)["sensitivity"]
    for stored, row in zip(record["rows"], moved.rows, strict=True):
        assert stored["probabilities"] == pytest.approx(row.probabilities, rel=1e-9)


def test_classes_are_sampled_again_from_the_command_line(
    tmp_path, run, tiny_ranking, tiny_study_file, far_wider, monkeypatch
):
    coarse = bs.SamplingSettings(log_evidence_error=0.2)
    monkeypatch.setattr("bayes_ssi.results.stored_what_if.SamplingSettings", lambda **_: coarse)
    out = save_result(tiny_ranking, tmp_path / "r", study_file=str(tiny_study_file)).directory
    assert run("what-if", out).exit_code == 3
    done = run("what-if", out, "--sample-again")
    assert done.exit_code == 0, done.output
    assert far_wider.name in done.stdout
    assert "not known" not in done.stdout
    refused = run("what-if", out, "--sample-again", "--spurious", "1")
    assert "--sample-again: applies where no setting is given" in refused.stderr
