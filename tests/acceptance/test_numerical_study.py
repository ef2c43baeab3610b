"""The numerical study: evidences, posteriors and error bars against independent references."""

import functools
import math
import runpy

import importance
import numpy as np
import pytest
from conftest import MODEL_CLASSES, kept_study
from problems import several_maxima, several_maxima_class

import bayes_ssi as bs
from bayes_ssi.results.predictions.posterior_draws import thinned_draws
from bayes_ssi.results.predictions.predictions import Predictions
from bayes_ssi.structures.response import Output, transfer_functions

SEEDS = range(2)

# By adaptive importance sampling of another implementation, each log evidence to 0.002.
LOG_EVIDENCES = {"1-a": 0.248, "1-b": -10.057, "2": -9.304, "3": 16.067}
ON_FREQUENCIES = {"1-a": -2.396, "1-b": -3.677, "3": 3.622}
POSTERIORS = {
    "1-a": ([0.9160, 1.1316, 0.9011], [0.0324, 0.0391, 0.0285]),
    "1-b": ([1.3292, 0.8030, 1.1621], [0.0836, 0.0498, 0.0326]),
    "2": ([0.9719, 1.0568, 1.0043], [0.0451, 0.0568, 0.0647]),
    "3": ([1.0095, 0.9936, 1.0034, 0.9959], [0.0484, 0.0445, 0.0333, 0.0308]),
}
# Means and deviations of the references come from draws too, and are rounded to 5e-5.
REFERENCE_ERROR = 5e-4

study = functools.partial(kept_study, "shear_building")


@functools.cache
def model_class(name):
    (selected,) = study().only([name]).model_classes
    return selected


@pytest.fixture(scope="module")
def ranking():
    return bs.rank(study())


@pytest.fixture(scope="module")
def results(ranking):
    """Log evidence and summary of a model class for a number of seeds, each sampled once.

    Only what the tests ask for is kept; draws would fill the memory.
    """
    known = {each.name: [(each.evidence, each.summary)] for each in ranking.posteriors}

    def sampled(name, n):
        have = known[name]
        for seed in range(len(have), n):
            posterior = bs.sample(model_class(name), seed=seed)
            assert posterior.failed_checks == ()
            have.append((posterior.evidence, posterior.summary))
        return have[:n]

    return sampled


@pytest.mark.parametrize("name", LOG_EVIDENCES)
def test_log_evidence(name, results):
    for evidence, _ in results(name, len(SEEDS)):
        assert evidence.log_evidence == pytest.approx(LOG_EVIDENCES[name], abs=0.02)
        assert evidence.error <= 0.01


@pytest.mark.parametrize("name", POSTERIORS)
def test_posterior_means_and_standard_deviations(name, results):
    """The mean over seeds has the root of the sum of their errors' squares over their number."""
    summaries = [summary for _, summary in results(name, len(SEEDS))]
    for i, (mean, sd) in enumerate(zip(*POSTERIORS[name], strict=True)):
        for quantity, expected in (("mean", mean), ("sd", sd)):
            average = np.mean([getattr(summary[i], quantity) for summary in summaries])
            own = np.linalg.norm(
                [getattr(summary[i], f"{quantity}_error") for summary in summaries]
            )
            error = math.hypot(own / len(summaries), REFERENCE_ERROR)
            assert average == pytest.approx(expected, abs=3.0 * error)


def test_error_bars_are_those_of_the_scatter(results):
    """Thirty seeds: error bars agree with the scatter of the results."""
    sampled = results("1-a", 30)
    log_evidences = np.array([evidence.log_evidence for evidence, _ in sampled])
    reported = np.mean([evidence.error for evidence, _ in sampled])
    ratio = reported / log_evidences.std(ddof=1)
    assert 0.7 < ratio < 1.5
    # The errors are normal: this share lies within one error bar, to 3 binomial standard errors.
    within = np.abs(log_evidences - log_evidences.mean()) < reported
    expected = math.erf(ratio / math.sqrt(2.0))
    assert within.mean() == pytest.approx(
        expected, abs=3.0 * math.sqrt(expected * (1.0 - expected) / len(sampled))
    )
    for i in range(3):
        for quantity in ("mean", "sd"):
            values = [getattr(summary[i], quantity) for _, summary in sampled]
            claimed = np.mean([getattr(summary[i], f"{quantity}_error") for _, summary in sampled])
            assert 0.7 < claimed / np.std(values, ddof=1) < 1.5


def test_the_correct_model_is_certain(ranking):
    assert ranking.comparison.best.name == "3"
    assert ranking.comparison.best.probability > 0.9999
    assert ranking.comparison.not_distinguishable == ()
    assert [row.name for row in ranking.comparison.classes] == ["3", "1-a", "2", "1-b"]
    assert ranking.comparison.failed_checks == ()


@pytest.mark.parametrize("name", ON_FREQUENCIES)
@pytest.mark.parametrize("seed", range(2))
def test_log_evidence_from_frequencies_alone(name, seed):
    whole = model_class(name)
    bare = bs.ModelClass(
        name, whole.structure, whole.data.without_shapes(), whole.error, pairing=whole.pairing
    )
    evidence = bs.sample(bare, seed=seed).evidence
    assert evidence.log_evidence == pytest.approx(ON_FREQUENCIES[name], abs=0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_several_maxima(seed):
    """No region of the posterior is lost, and each of the three has its share."""
    known, posterior = several_maxima(), bs.sample(several_maxima_class(), seed=seed)
    assert posterior.evidence.log_evidence == pytest.approx(known.log_evidence, abs=0.03)
    for test, share in known.regions.values():
        # Of the region of a share of 3 %, to 1 %.
        tolerance = 0.03 if share > 0.1 else 0.01
        assert test(importance.coordinates(several_maxima_class(), posterior.values)).mean() == (
            pytest.approx(share, abs=tolerance)
        )
    np.testing.assert_allclose(
        [row.mean for row in posterior.summary], [1.0747, 0.9298, 1.0600, 0.9659], atol=0.02
    )
    assert posterior.failed_checks == ()


def test_data_are_those_of_the_correct_model(case_c):
    """Frequencies and shapes by an independent computation, to the digits given."""
    data = model_class("3").data
    np.testing.assert_allclose(data.frequencies_hz, case_c.frequencies_hz, atol=5e-9)
    np.testing.assert_allclose(np.abs(data.unit_shapes), np.abs(case_c.unit_shapes), atol=5e-8)


# The roof, around the second mode.
ROOF = Output("acceleration", ("floor 3",))
AROUND_MODE_2 = np.linspace(2.2, 3.4, 121)


def band_of(posterior):
    """What a class predicts of the roof (n_frequencies,), in its band of 95 %."""
    draws = thinned_draws(posterior, model_class(posterior.name))
    predicted = Predictions(posterior.name, (draws,))
    low, _, high = predicted.transfer_functions(AROUND_MODE_2, ROOF, 0.02).band(0.95)
    return low[0], high[0]


def test_the_roof_s_response_lies_in_the_band_of_class_3_and_outside_that_of_1_a(ranking):
    correct = runpy.run_path(str(MODEL_CLASSES / "non_structural_elements.py"))["correct"]
    of_truth = transfer_functions(correct["c"], np.empty((1, 0)), AROUND_MODE_2, ROOF, 0.02)
    truth = np.abs(of_truth)[0, 0]
    low, high = band_of(ranking.posterior("3"))
    assert ((low < truth) & (truth < high)).all()
    low, high = band_of(ranking.posterior("1-a"))
    inside = (low < truth) & (truth < high)
    # From the flank of mode 2a on; only where the two curves cross is it inside.
    assert inside[AROUND_MODE_2 > 2.65].mean() < 0.1
    at_2b = np.abs(AROUND_MODE_2 - 3.005).argmin()
    assert truth[at_2b] > 2.0 * high[at_2b]
    dip = np.abs(AROUND_MODE_2 - 2.8).argmin()
    assert truth[dip] < 0.5 * low[dip]


def test_over_all_pairings_the_pairing_is_found():
    """Of the mass-only structure and of the augmented one."""
    ranking = bs.rank(study().with_any_pairing())
    assert ranking.comparison.failed_checks == ()
    log_evidences = {row.name: row.log_evidence for row in ranking.comparison.classes}
    assert log_evidences == pytest.approx({"1-a or 1-b or 2": 0.249, "3": 16.069}, abs=0.02)
    for name, pairing in (
        ("1-a or 1-b or 2", {"1": 1, "2a": 2, "3": 3}),
        ("3", {"1": 1, "2a": 2, "2b": 3, "3": 4}),
    ):
        (modes,) = ranking.posterior(name).configurations
        assert modes.pairing == pairing == modes.inferred_pairing.best
        assert modes.inferred_pairing.pairings[0].probability > 0.99
