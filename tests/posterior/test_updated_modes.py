"""Modes at posterior draws: updated ones, and likelihoods for which nothing is solved."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.inference.model_class.class_record import described
from bayes_ssi.inference.posterior import model_at_draws
from bayes_ssi.inference.posterior.posterior import draws_with_shapes, known_at_draws
from bayes_ssi.structures.modal import mac


@pytest.fixture
def values():
    return np.exp(0.1 * np.random.default_rng(5).standard_normal((150, 4)))


@pytest.fixture
def updated(model_classes, values):
    # With this error no modes are close enough to turn together.
    candidate = replace(model_classes["3"], error=bs.ErrorModel(0.001, 0.05))
    (modes,) = model_at_draws.configuration_modes(candidate, values)
    return modes.updated


def test_frequencies_and_macs(model_classes, case_c, values, updated):
    frequencies, shapes = model_classes["3"].structure.modes(values)
    for i, (label, mode) in enumerate(zip(case_c.labels, updated.modes, strict=True)):
        assert (mode.label, mode.model_mode) == (label, i + 1)
        assert mode.after_hz == pytest.approx(np.quantile(frequencies[:, i], [0.05, 0.5, 0.95]))
        result = [
            mac(shape[:3, i : i + 1], case_c.unit_shapes[:, i : i + 1])[0, 0] for shape in shapes
        ]
        assert mode.mac_after == pytest.approx(np.quantile(result, [0.05, 0.5, 0.95]))
        # At the prior medians this is the model that made the data.
        assert mode.before_hz == pytest.approx(case_c.modes[i].frequency_hz, rel=1e-6)
        assert mode.mac_before == pytest.approx(1.0, abs=1e-9)


def test_shapes_are_scaled_and_turned_to_the_identified_ones(case_c, model_classes):
    (modes,) = model_at_draws.configuration_modes(model_classes["3"], np.ones((2, 4)))
    updated = modes.updated
    for i, mode in enumerate(updated.modes):
        identified = case_c.unit_shapes[:, i]
        expected = identified / np.abs(identified).max()
        for each in mode.shape_after:  # the same at all draws
            np.testing.assert_allclose(each[:3], expected, atol=1e-6)
    assert updated.appendages == ("infill 1-2",)


def test_shapes_of_a_large_structure_are_kept_at_its_sensors():
    n = model_at_draws.MOST_PLACES + 1
    k = bs.Parameter("k", bs.LogNormal(1000.0, 0.1))
    mode = bs.IdentifiedMode("1", 0.08, np.array([0.5, 1.0]))
    data = bs.ModalData((mode,), band_hz=(0.0, 0.1), sensors=("floor 50", f"floor {n}"))
    tower = bs.ShearBuilding((1.0,) * n, (k,) * n)
    candidate = bs.ModelClass("tower", tower, data, bs.ErrorModel(0.02, 0.05), pairing={"1": 1})
    (modes,) = model_at_draws.configuration_modes(candidate, np.array([[1000.0], [1010.0]]))
    assert modes.updated.places == ("floor 50", f"floor {n}")
    # A uniform shear building's first mode: u_i ∝ sin(i π / (2n + 1)).
    ends = [np.sin(i * np.pi / (2 * n + 1)) for i in (50, n)]
    _, median, _ = modes.updated.modes[0].shape_after
    np.testing.assert_allclose(median, [ends[0] / ends[1], 1.0])


@pytest.mark.parametrize("name", ["1-a", "2", "3"])
def test_log_likelihoods_of_the_data_add_up(model_classes, values, name):
    candidate = model_classes[name]
    own = values[:, : len(candidate.parameters)]
    result = model_at_draws.at_draws(candidate, own)
    np.testing.assert_allclose(result.log_likelihoods.sum(1), candidate.log_likelihood(own))
    expected = candidate.modes(own)[0].frequencies_hz
    np.testing.assert_array_equal(result.frequencies_hz, expected)
    if name == "2":  # 2a and 2b are spurious: ν over the band and over the half of 4π
        expected = np.log(0.1 / 6.0) - np.log(4.0 * np.pi)
        np.testing.assert_allclose(result.log_likelihoods[:, 1:3], expected)


def test_an_inferred_pairing_gives_one_datum_per_test(model_classes, values):
    candidate = model_classes["3"].with_any_pairing("any")
    result = model_at_draws.at_draws(candidate, values)
    np.testing.assert_allclose(result.log_likelihoods[:, 0], candidate.log_likelihood(values))


def test_predicted_frequencies_scatter_as_the_errors_say(model_classes):
    candidate = model_classes["1-a"]
    n = 20000
    values = np.ones((n, 3))
    result = model_at_draws.at_draws(candidate, values)
    terms = model_at_draws.datum_terms(
        candidate, values, result, [candidate.pairing], (20, n // 20), np.random.default_rng(1)
    )
    assert terms.data == ("1", "2a", "2b", "3", "no other mode")
    predicted = terms.predicted_hz.reshape(n, 4)
    model = candidate.structure.modes(np.ones((1, 3))).frequencies_hz[0]
    identified = candidate.data.frequencies_hz
    for column, mode in ((0, 0), (1, 1), (3, 2)):
        sd = 0.01 * identified[column]
        assert predicted[:, column].mean() == pytest.approx(model[mode], abs=5 * sd / np.sqrt(n))
        assert predicted[:, column].std() == pytest.approx(sd, rel=0.03)
    spurious = predicted[:, 2]  # anything in the band from 0 to 6 Hz
    assert spurious.mean() == pytest.approx(3.0, abs=5 * 6.0 / np.sqrt(12 * n))
    assert 0.0 <= spurious.min() < 0.1 < 5.9 < spurious.max() <= 6.0


def test_a_structure_in_words(augmented):
    lines = dict(described(augmented))
    assert lines["shear building"].startswith("A planar shear building on a fixed base")
    assert lines["masses"] == "1, 1, 1"
    assert "· k1" in lines["stiffnesses"]
    infill = "infill 1-2; between 1, 2; mass = 0.15; frequency = 2.80194; stiffness factor = ks"
    assert lines["out of plane infill"] == infill


def test_finite_element_models_in_words():
    e, t = (bs.Parameter(name, bs.LogNormal(1.0, 0.2)) for name in ("E", "t"))
    k = np.diag([2.0, 3.0])
    terms = [(2.0 * e, k), (t**3, k), k]
    frame = bs.MatrixStructure(terms, (t, np.eye(2)), sensors={"tip": 1}, n_modes=2)
    whole, reduced = dict(described(frame)), dict(described(frame.reduced()))
    assert whole["size"] == "2 degrees of freedom, 1 of them observed"
    assert whole["stiffness"] == "K0 + E · K1 + t**3 · K2"
    assert whole["mass"] == "t · M1"
    assert whole["degrees of freedom"] == "tip"
    assert reduced["stiffness"] == whole["stiffness"]
    assert "at most 150 full solutions" in reduced["reduced basis"]

    def beam(stiffness, place):
        return stiffness * k, place * k

    given = {"stiffness": 5.0 * e, "place": 3}
    called = dict(described(bs.FunctionStructure(beam, given, n_modes=2)))
    assert called["function"].endswith("beam")
    assert called["arguments"] == "stiffness: 5 · E; place: 3"


def test_every_draw_has_the_pairing_of_its_own():
    """A light pendulum's mode is below the building's in some draws, and above it in others.

    In all of them the building's mode has its frequency of 1 Hz, to a share of 1e-4, and its shape.
    """
    frequency = bs.Parameter("frequency", bs.LogUniform(0.3, 3.0))
    building = bs.ShearBuilding((1.0,), ((2.0 * np.pi) ** 2,))
    structure = building.with_element(bs.Pendulum(on=1, mass=1e-4, frequency=frequency))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0, [1.0]),), (0.0, 2.0), ("floor 1",))
    candidate = bs.ModelClass("p", structure, data, bs.ErrorModel(0.01, 0.05), pairing="any")
    values = np.repeat([[0.5], [2.0]], [40, 60], axis=0)
    (modes,) = model_at_draws.configuration_modes(candidate, values)
    assert modes.pairing == {"1": 1}
    (mode,) = modes.updated.modes
    assert mode.model_mode == 1
    assert mode.after_hz == pytest.approx((1.0, 1.0, 1.0), rel=1e-3)
    np.testing.assert_allclose(np.array(mode.shape_after)[:, 0], 1.0)


def two_tests(case_c, frame, augmented, fixed_error):
    """A class of two tests; the second has more modes, other sensors and a spurious mode."""
    modes = tuple(replace(m, shape=m.shape[:2] if m.label != "1" else None) for m in case_c.modes)
    some = bs.ModalData(modes, case_c.band_hz, case_c.sensors[:2])
    return bs.ModelClass(
        "two tests",
        error=fixed_error,
        configurations=[
            bs.Configuration("bare", frame, case_c, pairing={"1": 1, "3": 3}),
            bs.Configuration("filled", augmented, some, pairing={"1": 1, "2b": 3, "2a": 2}),
        ],
    )


def changed(model_class):
    identification = bs.IdentificationModel(0.8, 0.7)
    error = bs.ErrorModel(frequency_cov=0.02, shape_sd=0.07)
    return replace(model_class, identification=identification, error=error)


@pytest.fixture(params=["any pairing", "inferred errors", "two tests", "correlated errors"])
def model_class(request, case_c, frame, augmented, fixed_error):
    if request.param == "two tests":
        return two_tests(case_c, frame, augmented, fixed_error)
    if request.param == "correlated errors":
        repeated = replace(fixed_error, between_tests=0.5)
        return replace(two_tests(case_c, frame, augmented, fixed_error), error=repeated)
    pairing = "any" if request.param == "any pairing" else {"1": 1, "3": 4}
    error = bs.ErrorModel() if request.param == "inferred errors" else fixed_error
    return bs.ModelClass("a", augmented, case_c, error, pairing=pairing)


def test_likelihoods_are_those_of_the_structure(model_class):
    short = bs.SamplingSettings(1.0, particles=48, searches=1, max_steps=10)
    posterior = bs.sample(model_class, settings=short)
    values = posterior.values[draws_with_shapes(len(posterior.values))]
    known = known_at_draws(model_class, posterior)
    assert known.parameters == model_class.parameters
    np.testing.assert_array_equal(known.log_likelihood(values), model_class.log_likelihood(values))
    if "frequency_cov" not in model_class.parameter_names:
        ours, own = (changed(each).log_likelihood(values[5:9]) for each in (known, model_class))
        np.testing.assert_array_equal(ours, own)
    with pytest.raises(ValueError, match="known at the stored draws only"):
        known.log_likelihood(values + 1.0)
