"""A motion that the model does not have competes with appendages, and changes no other mode."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.special import softmax

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.pairings import PairingWeights, log_sum
from bayes_ssi.results.search_answer import search_sentences
from bayes_ssi.structures.changed_structure import SHAPES_DIFFER, FurtherMode
from bayes_ssi.studies.appendages.baselines import choose_baselines
from bayes_ssi.studies.search.family_search import screened_hypotheses
from bayes_ssi.studies.search.findings import Finding

FREQUENCY = bs.Parameter("f", bs.LogUniform(0.5, 6.0))
SENSORS = ("floor 1", "floor 2", "floor 3")


@pytest.fixture(scope="module")
def plane():
    k = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.2)) for i in (1, 2, 3)]
    return bs.ShearBuilding((1.0, 1.0, 1.0), [200.0 * each for each in k])


def test_a_further_mode_changes_no_other(plane):
    values = np.array([[1.0, 1.1, 0.9], [0.8, 1.0, 1.2]])
    own = plane.modes(values)
    whole = FurtherMode(plane, FREQUENCY, 1)
    modes = whole.modes(np.c_[values, [1.5, 2.5]])
    assert whole.n_modes == 4
    np.testing.assert_array_equal(modes.frequencies_hz, np.c_[own.frequencies_hz, [1.5, 2.5]])
    np.testing.assert_array_equal(modes.shapes[:, :, :3], own.shapes)
    np.testing.assert_array_equal(modes.shapes[:, :, 3], own.shapes[:, :, 1])
    assert whole.modal_model(np.c_[values, [1.5, 2.5]]).participation[:, 3].tolist() == [0.0, 0.0]
    *_, labelled = whole.labelled_modes(np.array([1.0, 1.1, 0.9, 1.5]))
    assert labelled.shape == (3, 4)


def test_its_shape_has_an_error_of_its_own(plane):
    """On the sphere in three dimensions, Z = 4π σ² (1 - exp(-1/σ²))."""
    shape = np.array([0.6, 0.0, 0.8])
    data = bs.ModalData((bs.IdentifiedMode("t", 2.0, shape),), (0.0, 6.0), SENSORS)
    error, values = bs.ErrorModel(0.01, 0.03), np.array([[1.0, 1.0, 1.0, 2.02]])

    def log_shape(number):
        structure = FurtherMode(plane, FREQUENCY, 0)
        made = bs.ModelClass("b", structure, data, error, pairing={"t": number})
        return made.likelihoods[0].terms(values).shape[0, 0]

    first = plane.modes(values[:, :3]).shapes[0, :, 0]
    distance = 1.0 - abs(shape @ first) / np.linalg.norm(first)
    for number, own in ((1, 0.0), (4, SHAPES_DIFFER)):
        variance = 0.03**2 + own**2
        z = 4.0 * math.pi * variance * (1.0 - math.exp(-1.0 / variance))
        assert log_shape(number) == pytest.approx(-distance / variance - math.log(z), rel=1e-9)


def test_the_sum_over_pairings_does_not_need_ascending_modes():
    """Of twelve by twelve, each identified mode within reach of its own model mode."""
    rng = np.random.default_rng(0)
    hz = np.arange(1.0, 13.0)
    ratios = np.where(np.abs(hz[:, None] - hz) < 2.5, rng.normal(0.0, 2.0, (1, 12, 12)), -99.0)
    order = rng.permutation(12)
    ascending = log_sum(PairingWeights(ratios, hz, hz[None]))
    other = log_sum(PairingWeights(ratios[:, :, order], hz, hz[None, order]))
    np.testing.assert_allclose(other, ascending, rtol=1e-12)


def probabilities(plane, modes):
    """Of every hypothesis with one feature at most, and of an appendage."""
    hz, shapes = zip(*sorted(modes, key=lambda mode: mode[0]), strict=True)
    data = bs.ModalData.from_arrays(hz, np.transpose(shapes), (0.0, 1.05 * hz[-1]), SENSORS)
    made = bs.ModelClass("plane", plane, data, bs.ErrorModel(0.01, 0.05), pairing="any")
    one = bs.SearchSettings(number_weights=(1.0, 1.0))
    family = choose_baselines(bs.Study("s", [made]), options=one)
    tried = screened_hypotheses(family, 0, bs.Run(), most_full=0)[0].values()
    shares = softmax([each.approximate_log_mass.log_evidence for each in tried])
    named = {each.model_class.name: share for each, share in zip(tried, shares, strict=True)}
    own = [any(not f.is_common for f in each.key.features) for each in tried]
    return named, float(shares @ own)


def modes_of(structure):
    modes = structure.modes(np.ones((1, 3)))
    return [(f, s[:3]) for f, s in zip(modes.frequencies_hz[0], modes.shapes[0].T, strict=True)]


def test_torsion_is_not_taken_for_an_appendage(plane):
    """Sensors on one edge see it as a second first mode, which moves no other."""
    own = modes_of(plane)
    bent = np.array([1.05, 0.97, 1.0])
    named, of_any = probabilities(plane, [*own, (1.2 * own[0][0], own[0][1] * bent)])
    assert named["motion like mode 1"] > 0.2
    assert of_any < 0.8


def test_an_appendage_moves_its_partner(plane):
    """One of 6 % of a floor in resonance with the second mode."""
    carrying = plane.with_element(bs.Pendulum(3, 0.06, modes_of(plane)[1][0]))
    named, of_any = probabilities(plane, modes_of(carrying))
    assert max(named, key=named.get) == "pendulum 3"
    assert of_any > 0.95


def test_motions_and_appendages_share_a_prior(plane):
    """Half of one feature's weight each, whatever their numbers: six places and two modes here."""
    shapes = [[1.0, 1.0], [2.0, 2.0], [3.0, -3.0]]
    data = bs.ModalData.from_arrays((1.8, 3.6), shapes, (0.0, 6.0), SENSORS)
    options = bs.SearchSettings(number_weights=(1.0, 0.7, 0.2, 0.1))
    bare = bs.Study("s", [bs.ModelClass("b", plane, data, pairing={})])
    family = choose_baselines(bare, options=options)
    features = family.features["b"]
    motions = [each for each in features if each.is_common]
    assert [each.name for each in motions] == ["motion like mode 1", "motion like mode 2"]
    assert family.prior_weight("b", 1, 0) == pytest.approx(0.7 / 12.0)
    assert family.prior_weight("b", 1, 1) == pytest.approx(0.7 / 4.0)
    for number, weight in enumerate(options.number_weights):
        common = [sum(f.is_common for f in chosen) for chosen in combinations(features, number)]
        assert sum(family.prior_weight("b", number, n) for n in common) == pytest.approx(weight)


def test_the_answer_names_the_motion_and_the_sensor_that_would_tell(found_in_case_c):
    record = found_in_case_c.record
    motions = [each for row in record.hypotheses for each in row.features if each.place.is_common]
    first = Finding(motions[0].place, 0.4, {"frequency_hz": (1.1, 1.2, 1.3)})
    said = search_sentences(replace(record, motions=(first,)), found_in_case_c.ranking.comparison)
    text = " ".join(said)
    assert (
        "A mode at 1.20 Hz (1.10 to 1.30) is, with probability 0.4000, no appendage but a motion "
        f"that the model does not have, like mode {motions[0].place.mode} at the sensors" in text
    )
    assert "A sensor at another edge of a floor" in text
