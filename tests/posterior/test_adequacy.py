"""Does a class explain the data? Right ones do, mistakes are recognised; laws of p-values."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import STOREY_STIFFNESS, kept_study, multiplier
from scipy.optimize import minimize
from scipy.stats import binom, chi2, norm, vonmises_fisher
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import _parameter, adequacy
from bayes_ssi.inference.criticism.misfit import (
    INADEQUATE,
    log_combined,
    log_harmonic_mean,
    log_joint,
    log_two_sided,
    standard_deviations,
)
from bayes_ssi.studies.ranking.checks import ranked
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.diagnosis import _log_maximum, common_factor, repair_of_pairing

COARSE = bs.SamplingSettings(log_evidence_error=0.1, particles=100, searches=2, economical=True)
# Chains too short to pass their own checks.
ROUGH = bs.SamplingSettings(log_evidence_error=0.5, particles=48, searches=1, max_steps=50)


def at(model_class, values, rng=None):
    """The adequacy of a class at some values (B, n_parameters)."""
    modes = [each.compared_modes(own) for _, each, own in model_class.parts(values)]
    return adequacy(model_class, values, modes, rng or np.random.default_rng(0))


def simulated(candidate, rng):
    """Values of the prior and modes of the likelihood, all identified."""
    values = candidate.values(rng.standard_normal((1, len(candidate.parameters))))
    likelihood = candidate.likelihoods[0]
    modes = likelihood.modes(values)
    cov, sd = values[0, -2:]
    shapes = likelihood.shapes_at_sensors(modes)[0]
    identified = []
    for i, frequency in enumerate(modes.frequencies_hz[0]):
        unit = shapes[:, i] / np.linalg.norm(shapes[:, i])
        shape = vonmises_fisher(unit, sd**-2, seed=rng).rvs(1)[0]
        noisy = frequency * (1.0 + cov * rng.standard_normal())
        identified.append(bs.IdentifiedMode(str(i + 1), noisy, shape))
    return values, bs.ModalData(tuple(identified), (0.0, 50.0), candidate.data.sensors)


@pytest.mark.parametrize("pairing", [{"1": 1, "2": 2, "3": 3}, "any"])
def test_p_values_of_right_classes_are_uniform(frame, case_c, pairing):
    """A value of the prior is a draw from the posterior given the data simulated with it."""
    error = bs.ErrorModel(
        bs.Parameter("cov", bs.LogNormal(0.005, 0.3)), bs.Parameter("sd", bs.LogNormal(0.03, 0.3))
    )
    candidate = bs.ModelClass("right", frame, case_c, error, pairing={"1": 1, "2a": 2, "2b": 3})
    rng = np.random.default_rng(4)
    n_sets, found = 200, []
    for _ in range(n_sets):
        values, data = simulated(candidate, rng)
        test = replace(candidate.configurations[0], data=data, pairing=pairing)
        found.append(at(replace(candidate, configurations=[test]), values, rng))
    of_parts = [
        *([row.modes[i].misfit.p_value for row in found] for i in range(3)),
        *([row.parameters[i].misfit.p_value for row in found] for i in range(5)),
    ]
    for p in of_parts:
        for limit in (0.05, 0.2, 0.5, 0.8):
            assert 1e-5 < binom.cdf(int((np.array(p) < limit).sum()), n_sets, limit) < 1.0 - 1e-5
    overall = np.array([row.overall.p_value for row in found])
    # The harmonic mean of few p-values exceeds its level by a tenth.
    assert binom.sf(int((overall < INADEQUATE).sum()) - 1, n_sets, 1.1 * INADEQUATE) > 1e-3


def test_the_parts_by_hand(frame, case_c, fixed_error):
    """One class at its prior medians, part by part."""
    identified = bs.IdentificationModel(detection_probability=0.9, expected_spurious_modes=0.5)
    candidate = bs.ModelClass(
        "by hand", frame, case_c, fixed_error, pairing={"1": 1, "2b": 2},
        identification=identified, priors={"k3": bs.LogNormal(0.5, 0.2)},
    )  # fmt: skip
    found = at(candidate, np.array([[1.0, 1.0, 1.0]]))
    one, two_a, two_b, three = found.modes
    assert one.frequency_error == pytest.approx(1.0 / 0.98275928 - 1.0, rel=1e-6)
    assert one.frequency_sd == 0.01
    # Flat normal errors of two components: the distance over σ² is exponential.
    assert one.expected_mac == pytest.approx((1.0 + 0.05**2 * math.log(0.05)) ** 2, rel=1e-9)
    distance = 1.0 - math.sqrt(one.mac)
    p_shape, p_frequency = math.exp(-distance / 0.05**2), 2.0 * norm.sf(one.frequency_error / 0.01)
    both = p_shape * p_frequency
    assert one.misfit.p_value == pytest.approx(both * (1.0 - math.log(both)), rel=1e-6)
    assert (two_a.paired, two_a.mac, two_a.misfit.p_value) == (0.0, None, 1.0)
    assert three.frequency_error is None
    assert two_b.misfit.sds > 3.0
    k3 = found.parameters[2]
    z = math.log(2.0) / math.sqrt(math.log(1.04))
    assert k3.prior_sds == pytest.approx(z)
    assert k3.misfit.p_value == pytest.approx(2.0 * norm.sf(z))
    (count,) = found.counts
    assert (count.spurious, count.expected_spurious) == (2.0, 0.5)
    assert count.unidentified == pytest.approx(1.0)
    # Two or more where half a mode is expected; two or fewer of three identified.
    spurious, identified = 1.0 - 1.5 * math.exp(-0.5), 1.0 - 0.9**3
    assert count.misfit.p_value == pytest.approx(2.0 / (1.0 / spurious + 1.0 / identified))


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_an_error_size_is_a_misfit_where_it_is_larger_than_expected(bare, factor):
    size = bs.Parameter("size", bs.LogNormal(0.01, 0.3))
    candidate = replace(bare, error=bs.ErrorModel(size, 0.05), pairing={"1": 1})
    found = at(candidate, np.array([[1.0, 1.0, 1.0, 0.01 * factor]])).parameters[-1]
    z = math.log(factor) / math.sqrt(math.log(1.09))
    assert (found.is_error_size, found.prior_sds) == (True, pytest.approx(z))
    assert found.misfit.p_value == pytest.approx(norm.sf(z))


def with_data(candidate, change):
    tests = [replace(test, data=change(test.data)) for test in candidate.configurations]
    return replace(candidate, configurations=tests)


def exchanged(data):
    return replace(data, sensors=("floor 2", "floor 1", *data.sensors[2:]))


def turned(data):
    sign = np.where(np.array(data.sensors) == "floor 2", -1.0, 1.0)
    return replace(data, modes=tuple(replace(m, shape=sign * m.shape) for m in data.modes))


def in_rad_s(data):
    factor = 2.0 * math.pi
    modes = tuple(replace(m, frequency_hz=factor * m.frequency_hz) for m in data.modes)
    return replace(data, modes=modes, band_hz=tuple(factor * bound for bound in data.band_hz))


def exchanged_in_mode_3(data):
    shape = data.mode("3").shape[[1, 0, *range(2, len(data.sensors))]]
    modes = (replace(m, shape=shape) if m.label == "3" else m for m in data.modes)
    return replace(data, modes=tuple(modes))


MISTAKES = {
    "exchanged in one mode": (
        exchanged_in_mode_3,
        "channels 'floor 1' and 'floor 2' seem to be exchanged in mode '3'",
    ),
    "exchanged": (exchanged, "channels 'floor 2' and 'floor 1' seem to be exchanged"),
    "turned": (turned, "the sign of 'floor 2' seems to be wrong"),
    "rad/s": (in_rad_s, "frequencies seem to be in rad/s, not in Hz"),
}


@pytest.mark.parametrize(
    ("of", "mistake"),
    [*(("shear building", each) for each in MISTAKES), ("laboratory frame", "turned")],
)
def test_a_mistake_in_the_data_is_named(model_classes, of, mistake):
    right = model_classes["3"]
    if of == "laboratory frame":  # one stiffness for each storey, errors given
        right = kept_study("four_storey_frame").only(["each storey"]).model_classes[0]
    change, words = MISTAKES[mistake]
    ranking = bs.rank(bs.Study("wrong data", [with_data(right, change)]), settings=COARSE)
    (check,) = ranking.comparison.best.failed_checks[:1]
    assert check == ranking.comparison.best.misfit
    assert f". Likely cause: {words} (gain " in check
    hint = ranking.posteriors[0].adequacy.hints[0]
    assert hint.mistake == words
    assert hint.gain > 50.0


def test_a_factor_on_all_frequencies_is_that_of_the_model_at_its_medians(model_classes):
    def faster(data):
        modes = (replace(mode, frequency_hz=1.3 * mode.frequency_hz) for mode in data.modes)
        return replace(data, modes=tuple(modes), band_hz=(0.0, 8.0))

    (repair,) = common_factor(with_data(model_classes["3"], faster))
    assert repair.mistake == "all frequencies seem to be 1.3 times what they should be"
    ours, right = (each.data.frequencies_hz for each in (repair.model_class, model_classes["3"]))
    np.testing.assert_allclose(ours, right, rtol=1e-3)


def test_a_wrong_pairing_is_named(frame, fixed_error):
    data = exact_modes(frame, frame.degrees_of_freedom, (0.0, 6.0))
    candidate = bs.ModelClass("frame", frame, data, fixed_error, pairing={"1": 1, "2": 3, "3": 2})
    words = "mode '2' seems to be model mode 2, not model mode 3; "
    words += "mode '3' seems to be model mode 3, not model mode 2"
    ranking = bs.rank(bs.Study("wrong pairing", [candidate]), settings=ROUGH)
    assert f". Likely cause: {words} (gain " in ranking.comparison.best.misfit


def test_a_profile_that_no_class_allows_for(infill, case_c, fixed_error):
    """The laboratory frame has a soft storey, the numerical study none; no mistake explains it."""
    k = STOREY_STIFFNESS * multiplier("k")
    soft = bs.ShearBuilding((1.0, 1.0, 1.0), (k, k, 0.5 * k)).with_element(infill)
    pairing = {"1": 1, "2a": 2, "2b": 3, "3": 4}
    for study in [
        kept_study("four_storey_frame").only(["one factor"]),
        bs.Study("soft", [bs.ModelClass("soft", soft, case_c, fixed_error, pairing=pairing)]),
    ]:
        assert bs.rank(study, settings=COARSE).comparison.best.misfit.endswith(
            "Likely cause: wrong channel order, wrong units, wrong pairing, or a structure nobody "
            "wrote down"
        )


@pytest.fixture(scope="module")
def approaches(model_classes):
    """The posteriors of the paper's four approaches."""
    return sample_all(list(model_classes.values()), 0, COARSE)


def test_the_paper_s_approaches(model_classes, approaches):
    """Only the best class fails for its misfit; that of the others is in their rows."""
    study = bs.Study("four", list(model_classes.values()))
    comparison = ranked(study, approaches, 0, COARSE, bs.Run()).comparison
    rows = {row.name: row for row in comparison.classes}
    assert rows["3"].misfit_p_value > 0.5
    assert rows["1-b"].misfit_p_value < INADEQUATE < rows["2"].misfit_p_value
    assert rows["1-b"].misfit_sds > 2.5758
    assert not any(row.misfit for row in comparison.classes)


def test_a_probable_class_that_does_not_explain_the_data(model_classes, approaches):
    """With a prior weight that outweighs the evidence the other class is still named."""
    names = ("1-b", "3")
    study = bs.Study("weighted", [model_classes[name] for name in names],
                     prior_weights={"1-b": 1e20, "3": 1.0})  # fmt: skip
    posteriors = [each for each in approaches if each.name in names]
    best = ranked(study, posteriors, 0, COARSE, bs.Run()).comparison.best
    assert best.name == "1-b"
    assert "Only less probable classes explain them ('3'). Likely cause: " in best.misfit


def test_no_other_pairing_is_tried_where_errors_are_correlated(frame, case_c, fixed_error):
    candidate = bs.ModelClass("a", frame, case_c, fixed_error, pairing={"1": 1, "3": 3})
    (repair,) = repair_of_pairing(candidate)
    assert repair.model_class.pairing == "any"
    repeated = replace(candidate, error=replace(fixed_error, between_tests=0.5))
    assert list(repair_of_pairing(repeated)) == []


@pytest.mark.parametrize(("between_tests", "is_adequate"), [(0.0, True), (0.95, False)])
def test_tests_that_differ_by_more_than_repeated_errors_allow(between_tests, is_adequate):
    """One frequency 1 % too high and 1 % too low: 1.4 sd of their difference, or 6.3."""
    structure = bs.ShearBuilding((1.0,), ((2.0 * math.pi) ** 2 * multiplier("k"),))
    tests = [
        bs.Configuration(name, structure, bs.ModalData((bs.IdentifiedMode("1", f),), (0.0, 2.0)),
                         pairing={"1": 1})
        for name, f in (("May", 1.01), ("June", 0.99))
    ]  # fmt: skip
    error = bs.ErrorModel(0.01, 0.05, between_tests)
    found = at(bs.ModelClass("differ", configurations=tests, error=error), np.array([[1.0]]))
    assert found.is_adequate == is_adequate
    assert all(mode.misfit.sds == pytest.approx(1.0, abs=0.02) for mode in found.modes)


def test_a_mistake_in_one_of_two_tests(model_classes):
    (test,) = model_classes["3"].configurations
    tests = [replace(test, name="May", data=exchanged(test.data)), replace(test, name="June")]
    both = bs.ModelClass("both", configurations=tests, error=model_classes["3"].error)
    misfit = bs.rank(bs.Study("two tests", [both]), settings=COARSE).comparison.best.misfit
    assert misfit.startswith("the data are not explained: mode 'May: ")
    words = "channels 'floor 2' and 'floor 1' seem to be exchanged in configuration 'May' (gain "
    assert f". Likely cause: {words}" in misfit


def test_a_mistake_that_inferred_errors_and_pairings_absorb(model_classes):
    """By the class's own prior the error of the shapes is only a little too large."""
    anything = replace(model_classes["3"], error=bs.ErrorModel()).with_any_pairing("any")
    study = bs.Study("absorbed", [with_data(anything, exchanged_in_mode_3)])
    ranking = bs.rank(study, settings=ROUGH)
    assert ranking.posteriors[0].adequacy.overall.p_value > INADEQUATE
    words = "channels 'floor 1' and 'floor 2' seem to be exchanged in mode '3' (gain "
    misfit = ranking.comparison.best.misfit
    assert misfit.startswith("the data are explained far better without a mistake in them. ")
    assert f". Likely cause: {words}" in misfit


def test_exchanged_channels_that_free_errors_absorb():
    """With large errors the repaired data of the laboratory frame have a maximum, too."""
    free = kept_study("four_storey_frame").only(["each storey, free errors"]).model_classes[0]
    ranking = bs.rank(bs.Study("absorbed", [with_data(free, exchanged)]), settings=ROUGH)
    words = "Likely cause: channels 'floor 2' and 'floor 1' seem to be exchanged (gain "
    assert words in ranking.comparison.best.misfit


@pytest.mark.parametrize(("median", "fails"), [(0.03, True), (0.08, False)])
def test_an_inferred_error_beyond_five_per_cent_is_a_model_that_does_not_fit(median, fails):
    """Frequencies off by ± 9 % of those of two equal storeys; unless such errors are expected."""
    f = 2.0 * np.sin(np.array([1.0, 3.0]) * math.pi / 10.0)
    modes = tuple(
        bs.IdentifiedMode(str(i), off * hz)
        for i, (off, hz) in enumerate(zip((1.09, 0.91), f, strict=True), 1)
    )
    k = bs.Parameter("k", bs.LogNormal((2.0 * math.pi) ** 2, 0.3))
    error = bs.ErrorModel(bs.Parameter("frequency_cov", bs.LogNormal(median, 1.0)), 0.05)
    candidate = bs.ModelClass(
        "rough", bs.ShearBuilding((1.0, 1.0), (k, k)), bs.ModalData(modes, (0.0, 3.0)), error,
        pairing={"1": 1, "2": 2},
    )  # fmt: skip
    coarse = bs.SamplingSettings(log_evidence_error=0.05)
    result = bs.rank(bs.Study("s", [candidate]), settings=coarse)
    (posterior,) = result.posteriors
    assert not posterior.adequacy.overall.is_small
    assert posterior.adequacy.is_adequate != fails
    said = "the model does not fit: it infers an error of "
    assert result.comparison.misfit.startswith(f"'rough': {said}") == fails
    assert bool(result.comparison.failed_checks) == fails


def test_repairs_are_compared_with_the_maximum_of_the_class_itself(bare):
    """That of scipy's minimiser, where the stored maximum is one of correlated errors."""

    def less(z):
        return -float(bare.log_likelihood_at(z[None])[0] + norm.logpdf(z).sum())

    start = np.full(len(bare.parameters), 0.3)
    stored = SimpleNamespace(maxima=bare.values(start[None]))
    highest = -minimize(less, start, method="Nelder-Mead", options={"xatol": 1e-6}).fun
    assert _log_maximum(bare, stored, climbs=True) == pytest.approx(highest, abs=1e-3)
    assert _log_maximum(bare, stored, climbs=False) == pytest.approx(-less(start), rel=1e-9)


def test_the_mode_that_a_large_error_hides_is_named():
    """The farthest frequency, and the least MAC of those that have one."""
    modes = (
        SimpleNamespace(label="a", frequency_error=0.01, mac=0.97, expected_mac=0.95),
        SimpleNamespace(label="b", frequency_error=-0.03, mac=0.90, expected_mac=0.95),
        SimpleNamespace(label="c", frequency_error=None, mac=None, expected_mac=None),
    )
    large = SimpleNamespace(
        name="frequency_cov", value=0.05, prior_median=0.01, prior_sds=2.5, is_error_size=True
    )
    said = _parameter(large, SimpleNamespace(modes=modes))
    assert said.endswith("above (mode 'b' is 3 % off, mode 'b' has MAC 0.90)")
    modes[1].mac = 0.96
    assert _parameter(large, SimpleNamespace(modes=modes)).endswith("above (mode 'b' is 3 % off)")


def test_two_sided():
    residuals = np.array([-1.959964, 0.0, 3.0])
    np.testing.assert_allclose(np.exp(log_two_sided(residuals)), 2.0 * norm.sf(abs(residuals)))
    # The tail of a normal distribution: φ(x)/x.
    (far,) = log_two_sided(np.array([100.0]))
    assert far == pytest.approx(-5000 + math.log(2) - 5.524, abs=1e-3)


def test_fishers_combination_of_those_that_count():
    p = np.array([[0.1, 0.2, 0.9], [0.03, 0.5, 0.01]])
    counted = np.array([[True, True, False], [True, True, True]])
    expected = [chi2.sf(-2.0 * math.log(0.02), 4), chi2.sf(-2.0 * math.log(0.00015), 6)]
    np.testing.assert_allclose(np.exp(log_joint(np.log(p), counted)), expected)
    assert log_joint(np.full((1, 2), np.nan), np.zeros((1, 2), dtype=bool)).tolist() == [0.0]
    far = log_joint(np.array([[-5000.0, -3000.0], [-np.inf, 0.0]]), np.ones((2, 2), dtype=bool))
    assert far[0] == pytest.approx(-8000.0 + math.log(8001.0))
    assert far[1] < -1e299


@pytest.mark.parametrize("n", [1, 3, 30])
def test_combined_p_values_are_p_values(n):
    """Independent ones: the harmonic mean makes little of 0.01 more than 0.01."""
    n_sets = 200_000 // max(n, 3)
    log_p = np.log(np.random.default_rng(5).random((n_sets, n)))
    error = 3.0 * math.sqrt(0.01 * 0.99 / n_sets)
    for combined in (log_harmonic_mean(log_p, axis=1), log_combined(log_p)):
        assert (combined < math.log(0.01)).mean() < 0.012 + error


def test_the_harmonic_mean():
    assert np.exp(log_harmonic_mean(np.log([0.1, 0.2, 0.4]), axis=0)) == pytest.approx(3.0 / 17.5)
    # Equal ones, as of draws that all say the same, stay what they are.
    assert log_harmonic_mean(np.full(400, -7.0), axis=0) == pytest.approx(-7.0)
    assert log_harmonic_mean(np.array([-np.inf, 0.0]), axis=0) < -1e299


@pytest.mark.parametrize("sds", [0.0, 0.5, 2.5758, 8.0, 30.0])
def test_standard_deviations(sds):
    assert standard_deviations(math.log(2.0) + norm.logsf(sds)) == pytest.approx(sds, abs=1e-9)
