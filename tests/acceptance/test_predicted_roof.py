"""The numerical study's roof: the right class predicts it within its band, the wrong one misses."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.results.predictions.posterior_draws import thinned_draws
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.structures.response import Output, transfer_functions
from bayes_ssi.studies.ranking.study import load_study

CLASSES = Path(__file__).parents[2] / "model_classes"
ROOF = Output("acceleration", ("floor 3",))
AROUND_MODE_2 = np.linspace(2.2, 3.4, 121)


@pytest.fixture(scope="module")
def truth():
    cases = runpy.run_path(str(CLASSES / "non_structural_elements.py"))
    correct = cases["correct"]["c"]
    return np.abs(transfer_functions(correct, np.empty((1, 0)), AROUND_MODE_2, ROOF, 0.02))[0, 0]


def band_of(name):
    (model_class,) = load_study(CLASSES / "shear_building.py").only([name]).model_classes
    predicted = Predictions(name, (thinned_draws(bs.sample(model_class), model_class),))
    low, _, high = predicted.transfer_functions(AROUND_MODE_2, ROOF, 0.02).band(0.95)
    return low[0], high[0]


def test_the_truth_lies_in_the_band_of_class_3(truth):
    low, high = band_of("3")
    assert ((low < truth) & (truth < high)).all()


def test_the_truth_lies_outside_the_band_of_class_1_a(truth):
    low, high = band_of("1-a")
    inside = (low < truth) & (truth < high)
    # From the flank of mode 2a on; only where the two curves cross is it inside.
    beyond = AROUND_MODE_2 > 2.65
    assert inside[beyond].mean() < 0.1
    at_2b = np.abs(AROUND_MODE_2 - 3.005).argmin()
    assert truth[at_2b] > 2.0 * high[at_2b]
    dip = np.abs(AROUND_MODE_2 - 2.8).argmin()
    assert truth[dip] < 0.5 * low[dip]
