"""The numerical study over all pairings: evidences, and that the pairing is found."""

from pathlib import Path

import pytest

import bayes_ssi as bs
from bayes_ssi.studies.ranking.study import load_study

ROOT = Path(__file__).parents[2]
# The mass-only structure and the augmented one.
LOG_EVIDENCES = {"1-a or 1-b or 2": 0.249, "3": 16.069}


@pytest.fixture(scope="module")
def ranking():
    return bs.rank(load_study(ROOT / "model_classes" / "shear_building.py").with_any_pairing())


def test_log_evidence(ranking):
    log_evidences = {row.name: row.log_evidence for row in ranking.comparison.classes}
    assert log_evidences == pytest.approx(LOG_EVIDENCES, abs=0.02)
    assert ranking.comparison.failed_checks == ()


@pytest.mark.parametrize(
    ("name", "pairing"),
    [
        ("1-a or 1-b or 2", {"1": 1, "2a": 2, "3": 3}),
        ("3", {"1": 1, "2a": 2, "2b": 3, "3": 4}),
    ],
)
def test_the_pairing_is_found(ranking, name, pairing):
    (posterior,) = [p for p in ranking.posteriors if p.name == name]
    (modes,) = posterior.configurations
    assert modes.pairing == pairing == modes.inferred_pairing.best
    assert modes.inferred_pairing.pairings[0].probability > 0.99
