"""What a search takes from a finite-element model."""

import pytest
from code_blocks import ROOT

import bayes_ssi as bs
from bayes_ssi.studies.appendages.baselines import choose_baselines

STUDY = ROOT / "model_classes" / "finite_elements" / "footbridge.py"


def test_the_footbridge_knows_its_scale_of_mass_and_where_its_nodes_are():
    label = "bottom left 8 z"
    family = choose_baselines(bs.load_study(STUDY), candidates=[bs.Candidate(label, label)])
    (name,) = family.study.names
    assert family.scales[name].name == "median modal mass"
    assert family.scales[name].mass == pytest.approx(2.062e4, rel=1e-3)
    (pendulum,) = family.appendages(name)
    assert pendulum.coordinates == (20.0, 0.0, 0.0)
    assert pendulum.direction == (0.0, 0.0, 1.0)
    assert (len(family.geometry.nodes), family.geometry.unit) == (52, "m")
    assert not family.unobserved
