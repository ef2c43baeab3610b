"""What the data determine of an appendage, whatever the prior of its mass."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from searches import exact_modes

import bayes_ssi as bs
from bayes_ssi.studies.appendages import appendage_search as module
from bayes_ssi.studies.appendages.baselines import choose_baselines
from bayes_ssi.studies.appendages.candidates import Candidate, InfillPlace, PendulumPlace
from bayes_ssi.studies.search.family_search import Draws, FamilySearch, screened_hypotheses
from bayes_ssi.studies.search.findings import feature_draws, hypotheses_by_probability

AMOUNTS = ("mass", "mass_ratio", "frequency_hz", "in_model")
FLOORS, MASS, FLOOR = 5, 0.01, 4
SENSORS = tuple(f"floor {i}" for i in range(1, FLOORS + 1))


def frame(factor):
    return bs.ShearBuilding([1.0] * FLOORS, [1000.0 * factor] * FLOORS)


@pytest.fixture(scope="module")
def main_structure():
    """Frequencies in Hz and shapes at unit modal mass, by the closed form of a uniform chain."""
    angles = (2.0 * np.arange(1, FLOORS + 1) - 1.0) * math.pi / (4.0 * FLOORS + 2.0)
    frequencies = 2.0 * math.sqrt(1000.0) * np.sin(angles) / (2.0 * math.pi)
    shapes = np.sin(2.0 * np.outer(np.arange(1, FLOORS + 1), angles))
    return frequencies, shapes / np.sqrt((shapes**2).sum(axis=0))


@pytest.fixture(scope="module")
def baseline(main_structure):
    """Data of a pendulum of a hundredth of a floor in resonance with the first mode."""
    tuned = main_structure[0][0]
    carrying = frame(1.0).with_element(bs.Pendulum(on=FLOOR, mass=MASS, frequency=tuned))
    data = exact_modes(carrying, SENSORS, (0.0, 9.0), 4)
    error = bs.ErrorModel(frequency_cov=0.003, shape_sd=0.02)
    factor = bs.Parameter("factor", bs.LogNormal(1.0, 0.1))
    return bs.ModelClass("frame", frame(factor), data, error, pairing="any")


def found(baseline, **settings):
    options = bs.SearchSettings(number_weights=(1.0, 1.0), **settings)
    baselines = choose_baselines(bs.Study("frame", [baseline]), options=options)
    pendulums = tuple(p for p in baselines.appendages("frame") if p.word == "pendulum")
    baselines.features["frame"] = pendulums
    tried = tuple(screened_hypotheses(baselines, 0, bs.Run())[0].values())
    nothing_sampled = FamilySearch(SimpleNamespace(posteriors=()), tried, ())
    draws = feature_draws(baselines, nothing_sampled)
    rows = hypotheses_by_probability(nothing_sampled, draws)
    (one,) = module.matched_appendages(draws, rows, baselines, tried)
    return one


@pytest.fixture(scope="module")
def uniform(baseline):
    return found(baseline)


@pytest.fixture(scope="module")
def of_heavy_ones(baseline):
    """With a prior under which a pendulum of a hundredth of a floor is far too light."""
    return found(baseline, mass_ratio=bs.LogNormal(0.05, 0.7))


def test_the_effective_mass_is_that_of_the_motion_of_its_place(uniform, main_structure):
    _, shapes = main_structure
    ratio = MASS * shapes[FLOOR - 1, 0] ** 2
    assert uniform.mode == 1
    assert uniform.effective_ratio[0] < ratio < uniform.effective_ratio[2]
    at_largest = uniform.effective_ratio[1] / np.abs(shapes[:, 0]).max() ** 2
    assert uniform.effective_mass[1] == pytest.approx(at_largest, rel=0.01)


def test_a_light_appendage_may_be_at_any_place_that_moves(uniform):
    """Lighter where the structure moves more: no place is preferred, the true one is left.

    Floor 1 would have lost up to a tenth of its mass, which its other modes would show.
    """
    left = {place.place.candidate.place: place.by_data for place in uniform.places_by_data}
    assert left.keys() == {2, 3, 4, 5}
    assert max(left.values()) < 0.5
    masses = {place.place.candidate.place: place.amounts["mass"][1] for place in uniform.places}
    assert sorted(masses, key=masses.get) == [5, 4, 3, 2, 1]
    assert not uniform.against_by_prior


def test_the_data_say_the_same_under_any_prior_of_the_mass(uniform, of_heavy_ones):
    """Under it a heavier one near the ground is the more probable, but not by the data."""
    by_data = {place.place.name: place.by_data for place in uniform.places}
    for place in of_heavy_ones.places:
        assert place.by_data == pytest.approx(by_data[place.place.name], abs=0.12)
    assert of_heavy_ones.places[0].place.candidate.place < FLOOR
    probabilities = {p.place.candidate.place: p.probability for p in of_heavy_ones.places}
    assert probabilities[2] > 3.0 * probabilities[5]


def test_two_appendages_are_matched_by_frequency_draw_by_draw(of_heavy_ones):
    """Of one hypothesis, half of the draws have them the other way round."""
    first, second = (place.place for place in of_heavy_ones.places[:2])
    swapped = np.array([False, True, False, True])
    low, high = np.array([1.0, 1.1, 1.2, 1.3]), np.array([4.0, 4.1, 4.2, 4.3])

    def draws(hz, ratio):
        columns = np.column_stack([10.0 * ratio, ratio, hz, 0.0 * hz])
        return Draws(AMOUNTS, columns, np.full(4, 0.25))

    of_first = draws(np.where(swapped, high, low), np.where(swapped, 0.2, 0.1))
    of_second = draws(np.where(swapped, low, high), np.where(swapped, 0.1, 0.2))
    places = (first, second)
    both = dict(zip(places, (of_first, of_second), strict=True))
    by_rank = module.ranked_draws([both], [1.0], [bs.LogUniform(0.01, 1.0)], places)
    lower, upper = (module.matched(each, places, {}) for each in by_rank)
    assert lower.frequency_hz == (1.0, 1.1, 1.3)
    assert upper.frequency_hz == (4.0, 4.1, 4.3)
    for each in (lower, upper):
        assert {p.place: p.probability for p in each.places} == {first: 0.5, second: 0.5}
        assert [p.by_data for p in each.places] == pytest.approx([0.5, 0.5])
        assert each.effective_mass is None
    # Beside the fourth mode: a mass of 2 at a place that moves by 0.9, where sensors move by 1.5.
    of_places = dict.fromkeys((first, second), np.array([[0.0, 0.0, 0.9]]))
    hz, of_sensors = np.array([1.0, 1.2, 4.4]), np.array([[0.2, 1.0, -1.5], [0.0, 0.5, 1.4]])
    known = {0: module.Motions(np.array([1, 2]), hz, of_places, of_sensors)}
    with_motions = module.matched(by_rank[1], places, known)
    assert with_motions.mode == 3
    assert with_motions.effective_mass == pytest.approx([2.0 * 0.9**2 / 1.5**2] * 3)
    assert with_motions.effective_ratio == pytest.approx([2.0 * 0.9**2] * 3)
    by_rank[1].in_model[:] = 0.1  # the modal mass without it is less
    less = module.matched(by_rank[1], places, known)
    assert less.effective_mass == pytest.approx(with_motions.effective_mass)
    assert less.effective_ratio == pytest.approx([2.0 * 0.9**2 / (1.0 - 0.2 * 0.9**2)] * 3)
    assert {p.amounts["mass"] for p in lower.places} == {(1.0, 1.0, 1.0)}
    assert {p.amounts["mass"] for p in upper.places} == {(2.0, 2.0, 2.0)}


@pytest.mark.parametrize(("kind", "ends"), [(PendulumPlace, (2,)), (InfillPlace, (1, 2))])
def test_the_effective_mass_is_of_the_structure_without_the_appendage(kind, ends, main_structure):
    """A chain that holds a fifth of a floor as mass (of an infill, twice) is uniform without it."""
    at, masses = [end - 1 for end in ends], np.ones(FLOORS)
    masses[at] += 0.2
    holding = bs.ShearBuilding(tuple(masses), [1000.0] * FLOORS).modes(np.empty((1, 0)))
    shapes = holding.shapes[0] / np.sqrt(masses @ holding.shapes[0] ** 2)
    place = kind(Candidate("there", ends[0], to=next(iter(ends[1:]), None)))
    known = np.arange(FLOORS), holding.frequencies_hz[0], {place: shapes[at]}, shapes
    of_place, largest = module.Motions(*known).without(place, 1, np.array([0.0, 0.2]))
    for i, expected in enumerate((shapes, main_structure[1])):
        assert of_place[i] == pytest.approx(np.abs(expected[at, 1].mean()))
        assert largest[i] == pytest.approx(np.abs(expected[:, 1]).max())


def test_frequencies_that_are_apart_are_two_answers(of_heavy_ones):
    """Places whose appendage explains one mode are not averaged with those that explain another."""
    first, second = (place.place for place in of_heavy_ones.places[:2])

    def of_two(share_of_first):
        third, tenth = np.full(3, 1.0 / 3.0), np.full(3, 0.1)
        low, high = (
            Draws(AMOUNTS, np.column_stack([np.ones(3), tenth, hz, np.zeros(3)]), third)
            for hz in ((3.7, 3.8, 3.9), (17.0, 17.5, 18.0))
        )
        shares = [share_of_first, 1.0 - share_of_first]
        priors = [bs.LogUniform(0.01, 1.0)] * 2
        (only,) = module.ranked_draws(
            [{first: low}, {second: high}], shares, priors, (first, second)
        )
        return module.matched(only, (first, second), {})

    answer = of_two(0.4)
    assert (answer.frequency_hz, answer.probability) == ((17.0, 17.5, 18.0), pytest.approx(0.6))
    ((share, frequency),) = answer.other_frequencies_hz
    assert (frequency, share) == ((3.7, 3.8, 3.9), pytest.approx(0.4))
    assert {each.place: each.probability for each in answer.places} == {second: pytest.approx(1.0)}
    assert of_two(0.02).other_frequencies_hz == ()


def test_a_heaviest_mass_is_in_the_unit_of_the_structure():
    prior = bs.SearchSettings(mass=(0.5, 200.0)).prior_of_mass_ratio(1000.0)
    assert prior == bs.LogUniform(0.0005, 0.2)
    for mass in ((0.0, 1.0), (2.0, 1.0), (1.0, math.inf)):
        with pytest.raises(ValueError, match="LogUniform"):
            bs.SearchSettings(mass=mass)
