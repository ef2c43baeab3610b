"""Predictions: draws through the structure, bands, and averages over model classes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import assert_refused
from threadpoolctl import threadpool_info, threadpool_limits

import bayes_ssi as bs
from bayes_ssi.inference.posterior.model_at_draws import configuration_modes
from bayes_ssi.results.predictions.posterior_draws import PosteriorDraws, Prediction, thinned_draws
from bayes_ssi.results.predictions.predictions import (
    MOST_PLACES,
    Predictions,
    StoredPredictions,
    shown_places,
)
from bayes_ssi.results.stored_result import as_stored
from bayes_ssi.structures.response import GroundMotion, Output, time_histories, transfer_functions

PHI = (1.0 + math.sqrt(5.0)) / 2.0
FLOORS = ("floor 1", "floor 2")
FREQUENCIES = np.linspace(0.1, 2.5, 30)
ACCELERATION = Output("acceleration", FLOORS)


@pytest.fixture
def classes(tiny_ranking):
    return {each.name: each for each in tiny_ranking.study.model_classes}


@pytest.fixture
def posteriors(tiny_ranking):
    return {each.name: each for each in tiny_ranking.posteriors}


def of_class(name, classes, posteriors, n_draws):
    return Predictions(name, (thinned_draws(posteriors[name], classes[name], n_draws),))


@pytest.fixture
def predicted(classes, posteriors):
    return of_class("each k", classes, posteriors, 200)


@pytest.fixture
def average(tiny_ranking, classes):
    """Averages with given probabilities of the two classes, in any order."""

    def make(n_draws, posteriors=tiny_ranking.posteriors, **probabilities):
        rows = tuple(
            replace(row, probability=probabilities[row.name.replace(" ", "_")])
            for row in tiny_ranking.comparison.classes
        )
        comparison = replace(tiny_ranking.comparison, classes=rows)
        ranking = replace(tiny_ranking, comparison=comparison, posteriors=tuple(posteriors))
        return StoredPredictions(as_stored(ranking), classes, n_draws, "").of()

    return make


def test_draws_are_thinned_evenly(classes, posteriors):
    posterior = posteriors["each k"]
    actual = thinned_draws(posterior, classes["each k"], 10)
    rows = [math.floor(i * (len(posterior.values) / 10)) for i in range(10)]
    np.testing.assert_array_equal(actual.values, posterior.values[rows])
    everything = thinned_draws(posterior, classes["each k"], 2 * len(posterior.values))
    np.testing.assert_array_equal(everything.values, np.repeat(posterior.values, 2, axis=0))


def test_bands_of_many_points_and_of_one():
    draws = np.random.default_rng(0).standard_normal((5000, 3, 81))  # more than a part holds
    expected = np.quantile(draws, [0.1, 0.5, 0.9], axis=0)
    np.testing.assert_allclose(Prediction(draws).band(0.8), expected, rtol=1e-12)
    np.testing.assert_allclose(Prediction(draws[:, 0, 0]).band(0.8), expected[:, 0, 0], rtol=1e-12)


@pytest.mark.parametrize("level", [0.0, 1.0, 95, math.nan])
def test_the_level_of_a_band_is_a_fraction(level):
    assert_refused("level must lie strictly between 0 and 1", Prediction(np.zeros(3)).band, level)


def test_frequencies_are_the_stored_ones(predicted, posteriors):
    posterior = posteriors["each k"]
    stored = posterior.frequencies_hz.reshape(len(posterior.values), 2)
    rows = np.arange(200) * len(stored) // 200
    for mode, column in (("1", 0), ("2", 1), (1, 0), (2, 1)):
        actual = predicted.frequencies_hz(mode)
        np.testing.assert_allclose(actual.draws, stored[rows, column], rtol=1e-9)
        assert actual.share == 1.0


def test_shapes_of_a_uniform_building_have_a_closed_form(classes, posteriors):
    # One stiffness for both storeys: the shapes do not depend on it.
    one = of_class("one k", classes, posteriors, 50)
    first = np.tile([1.0 / PHI, 1.0], (50, 1))
    second = np.tile([1.0, -1.0 / PHI], (50, 1))
    np.testing.assert_allclose(one.shapes("1", FLOORS).draws, first, rtol=1e-12)
    np.testing.assert_allclose(one.shapes(2, FLOORS).draws, second, rtol=1e-12)
    # The scale does not depend on the places that are shown.
    np.testing.assert_allclose(one.shapes("1", ["floor 1"]).draws, first[:, :1], rtol=1e-12)
    # A shape points the way that it was identified, or else with its largest component upwards.
    (each,) = one.classes
    data = each.likelihood.data
    turned = replace(data, modes=tuple(replace(m, shape=-m.shape) for m in data.modes))
    for other, expected in ((turned, -second), (data.without_shapes(), second)):
        alike = replace(each, likelihood=replace(each.likelihood, data=other))
        shown = replace(one, classes=(alike,)).shapes(2, FLOORS).draws
        np.testing.assert_allclose(shown, expected, rtol=1e-12)


def test_shapes_are_those_of_the_record(model_classes):
    """Of the same draws, components are the same in a report and in predictions."""
    candidate = model_classes["3"]
    values = np.exp(0.1 * np.random.default_rng(5).standard_normal((50, 4)))
    (record,) = configuration_modes(candidate, values)
    draws = PosteriorDraws("3", candidate.likelihoods[0].given(record.pairing), values)
    predicted = Predictions("3", (draws,))
    for mode in record.updated.modes:
        band = predicted.shapes(mode.label, record.updated.places).band(0.9)
        np.testing.assert_allclose(band, mode.shape_after, rtol=1e-9)
        assert np.abs(band.median[:3]).max() == pytest.approx(1.0, abs=0.01)
    # The infill, close to resonance, moves further than any floor.
    assert np.abs(predicted.shapes("2a", ["infill 1-2"]).band().median) > 2.0


def test_all_draws_of_a_shape_point_the_same_way(predicted, monkeypatch):
    (each,) = predicted.classes
    flips = np.where(np.random.default_rng(0).random(200) < 0.5, -1.0, 1.0)
    straight = predicted.shapes("2", FLOORS).draws
    modes = type(each.structure).modes

    def flipped(self, values):
        actual = modes(self, values)
        return actual._replace(shapes=actual.shapes * flips[:, None, None])

    monkeypatch.setattr(type(each.structure), "modes", flipped)
    np.testing.assert_allclose(predicted.shapes("2", FLOORS).draws, straight, rtol=1e-12)


def test_responses_are_those_of_the_draws(predicted):
    (each,) = predicted.classes
    motion = GroundMotion(np.random.default_rng(0).standard_normal(100), 0.02)
    whole, asked = (each.structure, each.values), (FREQUENCIES, ACCELERATION, 0.02)
    for force_at in (None, "floor 1"):
        actual = predicted.transfer_functions(*asked, force_at=force_at).draws
        expected = np.abs(transfer_functions(*whole, *asked, force_at=force_at))
        np.testing.assert_allclose(actual, expected)
    actual = predicted.time_histories(motion, ACCELERATION, 0.02).draws
    np.testing.assert_allclose(actual, time_histories(*whole, motion, ACCELERATION, 0.02))


def test_blas_has_one_thread(predicted):
    threads = []

    def count(_, values):
        threads.extend(each["num_threads"] for each in threadpool_info()
                       if each["user_api"] == "blas")  # fmt: skip
        return values

    with threadpool_limits(limits=2, user_api="blas"):
        predicted._responses(count)
    assert set(threads) == {1}


def test_draws_of_a_large_structure_are_computed_in_batches(predicted, monkeypatch):
    whole = predicted.transfer_functions(FREQUENCIES, ACCELERATION, 0.02).draws
    shapes = predicted.shapes("1", FLOORS).draws
    sizes = []
    (each,) = predicted.classes
    modal_model = type(each.structure).modal_model

    def counted(self, values):
        sizes.append(len(values))
        return modal_model(self, values)

    monkeypatch.setattr(type(each.structure), "modal_model", counted)
    monkeypatch.setattr("bayes_ssi.results.predictions.posterior_draws.ARRAY_SIZE", 30 * 4 * 2 * 7)
    again = predicted.transfer_functions(FREQUENCIES, ACCELERATION, 0.02).draws
    assert sizes == [7] * 28 + [4]
    np.testing.assert_allclose(again, whole, rtol=1e-12)
    np.testing.assert_allclose(predicted.shapes("1", FLOORS).draws, shapes, rtol=1e-12)


def test_an_average_is_a_mixture(average, classes, posteriors):
    actual = average(400, one_k=0.25, each_k=0.75)
    assert {each.name: len(each.values) for each in actual.classes} == {"one k": 100, "each k": 300}
    assert actual.n_draws == 400
    parts = [
        of_class(name, classes, posteriors, n).frequencies_hz("1").draws
        for name, n in (("one k", 100), ("each k", 300))
    ]
    expected = np.quantile(np.concatenate(parts), [0.025, 0.5, 0.975])
    np.testing.assert_allclose(actual.frequencies_hz("1").band(0.95), expected, rtol=1e-12)
    assert actual.transfer_functions(FREQUENCIES, ACCELERATION, 0.02).draws.shape == (400, 2, 30)


def test_shares_are_rounded_to_the_number_of_draws(average):
    actual = average(7, one_k=0.4, each_k=0.6)  # 2.8 and 4.2
    assert {each.name: len(each.values) for each in actual.classes} == {"one k": 3, "each k": 4}
    actual = average(100, one_k=0.001, each_k=0.999)
    assert [each.name for each in actual.classes] == ["each k"]


def test_a_mode_that_a_class_does_not_explain(average, tiny_ranking):
    one, each = tiny_ranking.posteriors
    (modes,) = one.configurations
    first_only = replace(one, configurations=(replace(modes, pairing={"1": 1}),))
    actual = average(100, [each, first_only], one_k=0.3, each_k=0.7)
    assert actual.frequencies_hz("1").share == 1.0
    second = actual.frequencies_hz("2")
    assert (second.share, second.draws.shape) == (0.7, (70,))
    assert actual.shapes("2", FLOORS).share == 0.7


def test_unknown_modes(predicted, average):
    unpaired = r"each k: no model mode is paired .* '7'; choose from '1'"
    assert_refused(unpaired, predicted.frequencies_hz, "7")
    for number in (0, 3):
        with pytest.raises(ValueError, match=rf"each k: no mode {number}; choose from 1 to 2"):
            predicted.shapes(number, FLOORS)
    with pytest.raises(ValueError, match="average: mode 1 differs between the model classes"):
        average(10, one_k=0.5, each_k=0.5).frequencies_hz(1)


def test_errors_name_the_class(predicted):
    unknown = Output("displacement", ("roof",))
    motion = GroundMotion([0.0, 1.0], 0.1)
    for compute in (
        lambda: predicted.transfer_functions(FREQUENCIES, unknown, 0.02),
        lambda: predicted.time_histories(motion, unknown, 0.02),
        lambda: predicted.shapes("1", ["roof"]),
    ):
        assert_refused("model class 'each k': place 'roof': the structure", compute)
    with pytest.raises(ValueError, match="model class 'each k': damping must be"):
        predicted.transfer_functions(FREQUENCIES, ACCELERATION, 2.0)


def test_a_class_that_is_not_the_one_sampled(classes, posteriors):
    one, posterior = classes["one k"], posteriors["one k"]
    words = r"'one k' is not the one .* no stored parameter 'k1'; .* 'k'"
    assert_refused(words, thinned_draws, posterior, classes["each k"])
    heavier = replace(one.structure, masses=(1.0, 1.001))
    more = one.structure.with_element(bs.Pendulum(1, 0.1, 1.0))
    words = "at a stored draw its structure has the frequencies"
    for other in (heavier, more):
        assert_refused(words, thinned_draws, posterior, replace(one, structure=other))
    assert_refused("number of draws must be at least 1, got 0", thinned_draws, posterior, one, 0)


def test_of_many_places_those_with_sensors_are_shown_or_the_first():
    names = tuple(map(str, range(MOST_PLACES + 1)))
    data = SimpleNamespace(sensors=("3", "7", "elsewhere"))
    many, few = (SimpleNamespace(main_places=some) for some in (names, names[:-1]))
    assert shown_places(few, data) == names[:-1]
    assert shown_places(many, data) == ("3", "7")
    assert shown_places(many, SimpleNamespace(sensors=())) == names[:-1]
