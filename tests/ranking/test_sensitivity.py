"""Sensitivity of rankings to settings, against new sampling and closed forms."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import bayes_ssi as bs
from bayes_ssi.cli import main
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.report.tables.ranking_tables import sensitivity_notes, sensitivity_table
from bayes_ssi.results.stored_result import load_result
from bayes_ssi.studies.ranking.sensitivity import (
    Sensitivity,
    SensitivityRow,
    sensitivity,
)
from bayes_ssi.studies.ranking.variations import (
    Variation,
    default_variations,
    with_errors,
    with_missed,
)


@pytest.fixture(scope="module")
def moved(tiny_ranking):
    return sensitivity(tiny_ranking)


def varied(name):
    return next(variation for variation in default_variations() if variation.name == name)


def row_of(moved, name):
    return next(row for row in moved.rows if row.name == name)


def test_the_first_row_is_the_ranking(moved, tiny_ranking):
    first = moved.rows[0]
    assert first.name == "unchanged"
    for row in tiny_ranking.comparison.classes:
        assert first.log_evidences[row.name] == Estimate(row.log_evidence, row.error)
        assert first.probabilities[row.name] == pytest.approx(row.probability, rel=1e-12)


def test_every_setting_is_halved_and_doubled(moved):
    assert [row.name for row in moved.rows[1:]] == [v.name for v in default_variations()]
    assert len(moved.rows) == 11


def test_missed_modes(moved, tiny_ranking):
    """Both modes are identified, so every class's likelihood changes by 2 log(p'/p) throughout.

    p falls from 0.95 to 0.90, and rises to 0.975.
    """
    for name, p in (("missed modes × 2", 0.90), ("missed modes × ½", 0.975)):
        row = row_of(moved, name)
        assert row.sampled == ()
        for posterior in tiny_ranking.posteriors:
            change = row.log_evidences[posterior.name].log_evidence - (
                posterior.evidence.log_evidence
            )
            assert change == pytest.approx(2.0 * math.log(p / 0.95), abs=1e-9)


def test_spurious_modes(moved, tiny_ranking):
    """Nothing is spurious in any class, so only e^-ν changes: by 0.1 nats if ν doubles."""
    row = row_of(moved, "spurious modes × 2")
    for posterior in tiny_ranking.posteriors:
        change = row.log_evidences[posterior.name].log_evidence - posterior.evidence.log_evidence
        assert change == pytest.approx(-0.1, abs=1e-9)


@pytest.mark.parametrize("name", ["σ_f × 2", "σ_f × ½", "σ_φ × 2", "σ_φ × ½"])
def test_error_sizes_against_sampling_with_them(moved, tiny_ranking, name):
    row, factor = row_of(moved, name), 2.0 if name.endswith("2") else 0.5
    sizes = {"frequency_cov": 0.02, "shape_sd": 0.05}
    sizes["frequency_cov" if "f" in name else "shape_sd"] *= factor
    for candidate in tiny_ranking.study.model_classes:
        (configuration,) = candidate.configurations
        again = bs.ModelClass(
            candidate.name, configuration.structure, configuration.data, bs.ErrorModel(**sizes),
            pairing=configuration.pairing,
        )  # fmt: skip
        evidence = bs.sample(again, seed=1).evidence
        estimate = row.log_evidences[candidate.name]
        tolerance = 4.0 * math.hypot(estimate.error, evidence.error)
        assert estimate.log_evidence == pytest.approx(evidence.log_evidence, abs=tolerance)


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_widths_of_priors_by_quadrature(moved, tiny_ranking, factor):
    """One parameter, so its evidence is an integral over the wider or narrower lognormal."""
    row = row_of(moved, f"width of priors × {'2' if factor == 2.0 else '½'}")
    candidate = next(c for c in tiny_ranking.study.model_classes if c.name == "one k")
    assert row.sampled == ()
    z = np.linspace(-8.0, 8.0, 4001)
    values = np.exp(factor * math.sqrt(math.log(1.09)) * z)[:, None]
    integrand = np.exp(candidate.log_likelihood(values) - 0.5 * z**2) / math.sqrt(2.0 * math.pi)
    estimate = row.log_evidences["one k"]
    expected = math.log(np.trapezoid(integrand, z))
    assert estimate.log_evidence == pytest.approx(expected, abs=4.0 * estimate.error)


def test_draws_that_do_not_cover_the_changed_class_are_not_used(tiny_ranking):
    """Ten times the error size makes a posterior far wider than the draws."""
    wide = Variation("far wider", lambda c: with_errors(10.0, 10.0, c))
    (_, row) = sensitivity(tiny_ranking, [wide]).rows
    assert set(row.sampled) == set(tiny_ranking.study.names)


def test_prior_weights_count(tiny_ranking):
    weighted = bs.Study(
        tiny_ranking.study.name,
        tiny_ranking.study.model_classes,
        prior_weights={"one k": 1.0, "each k": 1e6},
    )
    ranking = replace(
        tiny_ranking,
        study=weighted,
        comparison=bs.compare(tiny_ranking.posteriors, weighted.prior_weights),
    )
    (row,) = sensitivity(ranking, []).rows
    best = ranking.comparison.best
    assert (row.best, row.probabilities[row.best]) == (
        best.name, pytest.approx(best.probability, rel=1e-12)
    )  # fmt: skip


def test_two_variations_of_one_name_are_refused(tiny_ranking):
    twice = [varied("σ_f × 2"), varied("σ_f × 2")]
    with pytest.raises(ValueError, match="two variations are named 'σ_f × 2'"):
        sensitivity(tiny_ranking, twice)


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
    return tuple(
        SensitivityRow(f"row {i}", {"a": Estimate(0.0, 0.1), "b": Estimate(0.0, 0.1)}, shares[name])
        for i, name in enumerate(best)
    )


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
    row = SensitivityRow("unchanged", {"a": Estimate(0.0, 0.1)}, {"a": 1.0})
    assert row.lead == math.inf
    assert sensitivity_table(Sensitivity((row,))).row_count == 1


def test_failed_checks_are_reported():
    (row,) = rows("a")
    flagged = Sensitivity((replace(row, failed_checks=("a: a chain is too short",)),))
    assert sensitivity_notes(flagged)[-1] == "  (!) row 0: a: a chain is too short"


def test_a_record_is_read_back(moved):
    record = json.loads(json.dumps(to_record(moved)))
    assert from_record(Sensitivity, record) == moved
    assert len(record["rows"]) == 11
    assert set(record["rows"][0]["log_evidences"]["one k"]) == {"log_evidence", "error"}


def test_from_the_command_line(tmp_path, tiny_study_file):
    arguments = ["rank", str(tiny_study_file), "--only", "one k", "--error", "0.05"]
    out = tmp_path / "r"
    result = CliRunner().invoke(main, [*arguments, "--sensitivity", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "Sensitivity to settings" in result.output
    assert "'one k' ranks first under every setting." in result.output
    assert len(load_result(out).sensitivity.rows) == 11
