"""Close modes: which turn together, their law by matrices drawn at random, and likelihoods."""

import itertools
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import i0, i1, ive
from scipy.stats import kstest, multivariate_normal

import bayes_ssi as bs
from bayes_ssi.inference.criticism.adequacy import adequacy
from bayes_ssi.inference.likelihood.close_modes import ClosePairs, close_pairs
from bayes_ssi.inference.likelihood.pairings import (
    PairingWeights,
    log_sum,
    pair_probabilities,
    sample_pairings,
)
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser
from bayes_ssi.inference.posterior.model_at_draws import (
    at_draws,
    configuration_modes,
    remarks_on_close_modes,
)
from bayes_ssi.structures.changed_structure import FurtherMode

PLACES = ("x 1", "x 2", "y 1", "y 2")
X, Y = np.array([0.5, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.5, 1.0])


class Pair(bs.Structure):
    """Two modes a distance apart about 2 Hz, in x and in y, and one far above."""

    parameters = (bs.Parameter("distance", bs.Uniform(0.0, 1.0)),)
    degrees_of_freedom = PLACES
    n_modes = 3

    def modes(self, values):
        half = 0.5 * values[:, 0]
        frequencies = 2.0 * np.column_stack([1.0 - half, 1.0 + half, np.full(len(half), 3.0)])
        shapes = np.column_stack([X, Y, [1.0, -0.5, 0.0, 0.0]])
        return bs.Modes(frequencies, np.tile(shapes, (len(half), 1, 1)))


def turned_data(degrees, distance=0.003, labels="ab", error=0.0):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    shapes = {"a": c * X + s * Y, "b": c * Y - s * X}
    frequencies = {"a": 2.0 * (1.0 - 0.5 * distance), "b": 2.0 * (1.0 + 0.5 * distance)}
    noise = error * np.random.default_rng(0).standard_normal((2, 4))
    modes = [
        bs.IdentifiedMode(label, frequencies[label], shapes[label] + more)
        for label, more in zip(labels, noise, strict=False)
    ]
    return bs.ModalData(tuple(modes), (0.0, 4.0), PLACES)


def likelihood(data, distance, pairing=None, error=None):
    error = error or bs.ErrorModel(0.01, 0.03)
    if pairing is None:
        pairing = {label: i for i, label in enumerate(data.labels, 1)}
    candidate = bs.ModelClass("pair", Pair(), data, error, pairing=pairing)
    return float(candidate.log_likelihood(np.array([[distance]]))[0])


def every_pairing(n_modes, labels):
    """Of identified modes with so many of the model."""
    for numbers in itertools.product(range(n_modes + 1), repeat=len(labels)):
        paired = {label: number for label, number in zip(labels, numbers, strict=True) if number}
        if len(set(paired.values())) == len(paired):
            yield paired


def any_and_given(data, distance):
    """Log-likelihoods over any pairing, and of each one."""
    given = [likelihood(data, distance, pairing) for pairing in every_pairing(3, data.labels)]
    return likelihood(data, distance, "any"), given


def test_angle_and_frequencies_are_those_of_matrices_drawn_at_random():
    """A = diag(λ) + 2 σ λ̄ W: given the distance of its eigenvalues, the density of their turn."""
    rng = np.random.default_rng(1)
    n, sd, distance = 400_000, 0.01, 0.015
    w = rng.standard_normal((n, 2, 2))
    w = 0.5 * (w + w.transpose(0, 2, 1))  # off the diagonal the variance is a half
    squares = np.array([1.0 - 0.5 * distance, 1.0 + 0.5 * distance]) ** 2
    eigenvalues, vectors = np.linalg.eigh(np.diag(squares) + 2.0 * sd * squares.mean() * w)
    f = np.sqrt(eigenvalues)
    d = (f[:, 1] - f[:, 0]) / (0.5 * (f[:, 1] + f[:, 0]))
    t = np.arctan2(vectors[:, 1, 0], vectors[:, 0, 0])
    for low, high in ((0.002, 0.004), (0.01, 0.012), (0.03, 0.034)):
        some = (d > low) & (d < high)
        own = ClosePairs(
            np.zeros(1, int), np.zeros(1, int), np.array([distance]), np.array([[sd**2, 1e-9]])
        )
        (kappa,) = own.concentrations(np.array([d[some].mean()]), np.zeros(1, int))
        assert kappa == pytest.approx(d[some].mean() * distance / (2.0 * sd**2), rel=1e-3)
        mean, error = np.cos(2.0 * t[some]).mean(), 1.0 / math.sqrt(2 * some.sum())
        assert mean == pytest.approx(i1(kappa) / i0(kappa), abs=4.0 * error + 2e-3)
        angles = np.linspace(0.0, math.pi / 2, 2001)
        density = np.exp(kappa * np.cos(2.0 * angles)) / i0(kappa)
        law = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        size = np.abs((t[some] + math.pi / 2) % math.pi - math.pi / 2)
        assert kstest(size, partial(np.interp, xp=angles, fp=law / law[-1])).pvalue > 1e-3


@pytest.mark.parametrize("pairing", [None, "any"])
def test_it_does_not_matter_how_a_pair_of_one_frequency_is_turned(pairing):
    values = [
        likelihood(turned_data(degrees, error=0.03), 0.0, pairing) for degrees in (0, 5, 30, 45, 90)
    ]
    exact = [likelihood(turned_data(degrees), 0.0, pairing) for degrees in (0, 5, 30, 45, 90)]
    np.testing.assert_allclose(exact, exact[0], atol=1e-4)  # as accurate as means over turns
    assert np.ptp(values) < 8.0  # the noise is not turned


def test_a_pair_of_one_frequency_is_a_plane_and_a_direction_in_it():
    """Uniform turns: the mean of exp(-(1 - |cos t|)(1/σ_a² + 1/σ_b²)) over a circle."""
    sd = 0.03
    mean, _ = quad(
        lambda t: math.exp(-2.0 * (1.0 - math.cos(t)) / sd**2) / math.pi, -0.3, 0.3,
        points=[0.0], epsrel=1e-12,
    )  # fmt: skip
    data = turned_data(30.0, 0.0)
    assert likelihood(data, 0.0, {"a": 1}, bs.ErrorModel(0.01, sd)) < likelihood(data, 0.0)
    candidate = bs.ModelClass(
        "pair", Pair(), data, bs.ErrorModel(0.01, sd), pairing={"a": 1, "b": 2}
    )
    shapes = candidate.likelihoods[0].terms(np.zeros((1, 1))).shape.sum()
    normaliser = 2.0 * float(log_shape_normaliser(np.array([sd]), 4)[0])
    assert shapes == pytest.approx(math.log(mean) - normaliser, abs=1e-4)


def test_far_modes_are_as_if_nothing_turned_and_the_limit_is_continuous():
    error = bs.ErrorModel(0.01, 0.03)
    limit = 0.01 / (math.sqrt(2.0) * 0.03)
    data = turned_data(1.0, limit)
    for distance, turns in ((1.001 * limit, False), (0.999 * limit, True)):
        own = bs.ModelClass("pair", Pair(), data, error, pairing={"a": 1, "b": 2}).likelihoods[0]
        values = np.array([[distance]])
        modes = own.compared_modes(values)
        assert bool(modes.turned.any()) is turns
        alone = -own.pairs.shape_distances(own.shapes_at_sensors(own.modes(values))).sum() / 0.03**2
        alone -= 2.0 * float(log_shape_normaliser(np.array([0.03]), 4)[0])
        terms = own.terms(values, modes).shape.sum()
        assert terms == pytest.approx(alone, abs=0.0 if not turns else 2e-3)


def test_a_pair_of_which_one_was_identified():
    """κ of the model's distance alone; the shape may point anywhere in a plane of one frequency."""
    values = [likelihood(turned_data(degrees, labels="a"), 0.0) for degrees in (0, 30, 90)]
    np.testing.assert_allclose(values, values[0], atol=1e-7)
    sd, distance = 0.03, 0.02
    kappa = distance**2 / (2.0 * 0.01**2)
    kappa /= 1.0 - 4.0 * kappa * sd**2
    mean, _ = quad(
        lambda t: math.exp(
            kappa * (math.cos(2.0 * t) - 1.0) - (1.0 - abs(math.cos(t - math.radians(30)))) / sd**2
        ),
        -0.5 * math.pi, 0.5 * math.pi, points=[math.radians(30)], epsrel=1e-11,
    )  # fmt: skip
    data = turned_data(30.0, labels="a")
    candidate = bs.ModelClass("one", Pair(), data, bs.ErrorModel(0.01, sd), pairing={"a": 1})
    shape = candidate.likelihoods[0].terms(np.array([[distance]])).shape.sum()
    normaliser = float(log_shape_normaliser(np.array([sd]), 4)[0])
    expected = math.log(mean / (math.pi * ive(0, kappa))) - normaliser
    assert shape == pytest.approx(expected, abs=1e-4)


def test_the_closest_of_three_turn_together():
    frequencies = np.array([[1.0, 1.03, 1.04], [1.0, 1.01, 1.04], [1.0, 1.3, 1.7], [1.0, 1.0, 1.0]])
    variances = np.array([[1e-4, 1e-3]])
    close = close_pairs(frequencies, np.full((2, 1), np.nan), variances)
    pairs = {*zip(close.rows.tolist(), close.lower.tolist(), strict=True)}
    assert pairs == {(0, 1), (1, 0), (3, 0)}
    assert close_pairs(frequencies[[2]], np.full((2, 1), np.nan), variances) is None
    assert close_pairs(frequencies[[2]], np.full((2, 1), np.nan), np.array([[1e-4, 1e-320]]))


def test_of_many_close_modes_the_closest_turn_together_then_the_closest_of_those_left():
    # Steps within 0.5 to 5 %, in tenths: some are equal, and some too far to turn.
    steps = 1.0 + 0.001 * np.random.default_rng(4).integers(5, 51, (300, 9))
    frequencies = np.cumprod(np.hstack([np.ones((300, 1)), steps]), axis=1)
    close = close_pairs(frequencies, np.full((9, 1), np.nan), np.array([[1e-4, 0.06]]))
    limit = math.sqrt(1e-4 / (2.0 * 0.06))
    expected = set()
    for row, f in enumerate(frequencies):
        distances = 2.0 * (f[1:] - f[:-1]) / (f[1:] + f[:-1])
        for lower in np.argsort(distances, kind="stable").tolist():
            if distances[lower] < limit and not {(row, lower - 1), (row, lower + 1)} & expected:
                expected.add((row, lower))
    assert set(zip(close.rows.tolist(), close.lower.tolist(), strict=True)) == expected
    assert len(close.rows) == len(expected) > 600


class Chain(Pair):
    """Three modes, the middle one of which passes from the lower to the upper."""

    def modes(self, values):
        middle = 2.0 + 0.02 * (values[:, 0] - 0.5)
        frequencies = np.column_stack(
            [np.full(len(middle), 1.98), middle, np.full(len(middle), 2.02)]
        )
        shapes = np.column_stack([X, Y, [1.0, -0.5, 0.0, 0.0]])
        return bs.Modes(frequencies, np.tile(shapes, (len(middle), 1, 1)))


def test_which_of_three_turn_does_not_change_where_distances_of_the_model_cross():
    """The log-likelihood has no step: its differences are those of a smooth function."""
    shapes = {"a": X + 0.2 * Y, "b": Y - 0.2 * X, "c": np.array([1.0, -0.5, 0.2, -0.1])}
    modes = [
        bs.IdentifiedMode(label, hz, shapes[label])
        for label, hz in zip("abc", (1.98, 2.001, 2.02), strict=True)
    ]
    data = bs.ModalData(tuple(modes), (0.0, 4.0), PLACES)
    pairing = {label: i for i, label in enumerate("abc", 1)}
    candidate = bs.ModelClass("chain", Chain(), data, bs.ErrorModel(0.01, 0.03), pairing=pairing)
    values = np.linspace(0.4, 0.6, 51)[:, None]  # where both distances are 1 % at the middle
    assert np.abs(np.diff(candidate.log_likelihood(values), 2)).max() < 1e-4
    (likelihood,) = candidate.likelihoods
    close = likelihood.close_pairs(values, likelihood.modes(values).frequencies_hz)
    assert set(close.lower.tolist()) == {1}  # b and c, as identified


def test_the_weight_of_a_pair_is_the_largest_where_shapes_are_those_of_the_model():
    """Of two so far apart that nothing turns."""
    error, values = bs.ErrorModel(0.01, 0.03), np.array([[0.3]])
    candidate = bs.ModelClass("pair", Pair(), turned_data(0.0, 0.3), error, pairing="any")
    (likelihood,) = candidate.likelihoods
    close = ClosePairs(np.array([0]), np.array([0]), values[0], likelihood.prediction_var(values))
    most = likelihood._most_log_weights(close, likelihood.modes(values).frequencies_hz)
    weights = likelihood.pairing_weights(values).log_ratios[0]
    np.testing.assert_allclose(np.diag(most[0]), np.diag(weights), rtol=1e-12)


@pytest.mark.parametrize("pairing", [{"a": 1, "b": 2}, "any"])
def test_a_turned_pair_is_shown_as_it_turns_and_is_no_misfit(pairing):
    data = turned_data(30.0, 0.003)
    candidate = bs.ModelClass("pair", Pair(), data, bs.ErrorModel(0.01, 0.03), pairing=pairing)
    values = np.full((50, 1), 0.003)
    (modes,) = configuration_modes(candidate, values)
    for mode in modes.updated.modes:
        assert mode.mac_after[1] > 0.9999
        shown = np.array(mode.shape_after[1])
        identified = data.mode(mode.label).unit_shape
        np.testing.assert_allclose(shown, identified / np.abs(identified).max(), atol=0.01)
    model = at_draws(candidate, values)
    assert adequacy(candidate, values, model.modes, np.random.default_rng(0)).is_adequate
    (remark,) = remarks_on_close_modes(candidate, values, model)
    assert remark.startswith("model modes 1 and 2, 0.3 % apart, turn together")
    far = bs.ModelClass("far", Pair(), data, bs.ErrorModel(0.0001, 0.03), pairing=pairing)
    assert not list(remarks_on_close_modes(far, values, at_draws(far, values)))


@pytest.mark.parametrize("pairing", [{"a": 1, "b": 2}, "any"])
def test_joint_errors_that_are_independent_change_nothing_of_a_turned_pair(pairing):
    """Nor do signs of shapes, with any errors."""
    data = turned_data(30.0, 0.003, error=0.02)
    sds = {"frequency_cov": 0.004, "shape_sd": 0.02}
    alone = replace(data, modes=tuple(replace(mode, **sds) for mode in data.modes))
    variances = np.repeat([0.004**2, 0.02**2], [2, 8])
    joint = replace(data, covariance=np.diag(variances))
    assert likelihood(joint, 0.004, pairing) == pytest.approx(likelihood(alone, 0.004, pairing))
    uneven = replace(data, covariance=np.diag(variances * np.linspace(0.5, 2.0, 10)))
    other = replace(uneven, modes=tuple(replace(one, shape=-one.shape) for one in data.modes))
    assert likelihood(other, 0.004, pairing) == pytest.approx(likelihood(uneven, 0.004, pairing))


@pytest.mark.parametrize("apart", [0.0, 60.0])
def test_the_probability_of_pairs_is_that_of_the_pairings_with_them(apart):
    """Of two modes that turn together, with a third identified mode beside them.

    Also where each alone is negligible, as of shapes that fit only once they have turned.
    """
    rng = np.random.default_rng(0)
    ratios = rng.normal(2.0, 2.0, (1, 3, 3))
    gains = np.zeros((1, 2, 3, 3))  # of the first two of three model modes
    gains[0, 0] = rng.normal(0.0, 2.0, (3, 3)) + 2.0 * apart
    ratios[:, :, :2] -= apart
    weights = PairingWeights(ratios, np.arange(3.0), np.arange(3.0)[None], log_gains=gains)
    total, of_pairs = 0.0, np.zeros((3, 3))
    for chosen in itertools.product(range(-1, 3), repeat=3):
        paired = [i for i in chosen if i >= 0]
        if len(set(paired)) < len(paired):
            continue
        log_weight = sum(ratios[0, j, i] for j, i in enumerate(chosen) if i >= 0)
        if 0 in chosen and 1 in chosen:
            log_weight += gains[0, 0, chosen.index(0), chosen.index(1)]
        assert weights.log_weight(np.array(chosen))[0] == pytest.approx(log_weight)
        total += math.exp(log_weight)
        for j, i in enumerate(chosen):
            of_pairs[j, i] += math.exp(log_weight) if i >= 0 else 0.0
    assert log_sum(weights)[0] == pytest.approx(math.log(total), rel=1e-12)
    np.testing.assert_allclose(pair_probabilities(weights)[0], of_pairs / total, rtol=1e-10)
    many = PairingWeights(
        np.repeat(ratios, 20_000, axis=0), np.arange(3.0), np.tile(np.arange(3.0), (20_000, 1)),
        log_gains=np.repeat(gains, 20_000, axis=0),
    )  # fmt: skip
    drawn = sample_pairings(many, rng)
    for j in range(3):
        shares = [(drawn[:, j] == i).mean() for i in range(3)]
        np.testing.assert_allclose(shares, of_pairs[j] / total, atol=4.0 * 0.5 / math.sqrt(20_000))


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 90.0])
def test_any_pairing_is_the_sum_over_given_ones_where_modes_are_close(degrees, joint):
    """With joint errors, too: those of two modes that turn together are of shapes so turned."""
    data = turned_data(degrees, 0.01, error=0.03)
    if joint:
        of_shapes = np.square([0.02, 0.005, 0.01, 0.03])
        variances = np.concatenate([[1e-6, 1e-6], of_shapes, of_shapes[::-1]])
        data = replace(data, covariance=np.diag(variances))
    total, terms = any_and_given(data, 0.012)
    assert total == pytest.approx(np.logaddexp.reduce(terms), rel=1e-9)


@pytest.mark.parametrize("labels", ["ab", "a"])
def test_shapes_that_fit_at_no_turn_do_not_matter(labels):
    """Off by one to a dozen of their errors: the sum over given pairings, as above."""
    for off in np.linspace(0.03, 0.36, 23):
        total, terms = any_and_given(turned_data(20.0, 0.01, labels, error=off), 0.012)
        assert total == pytest.approx(np.logaddexp.reduce(terms), abs=3e-4)


@pytest.mark.parametrize("hz", [1.72, 2.02])
def test_any_pairing_with_a_further_motion_is_the_sum_over_given_ones(hz):
    """The motion's shape has an error of its own, in joint densities as in single ones."""
    of_shapes = np.square([0.02, 0.005, 0.01, 0.03])
    variances = np.concatenate([[1e-6, 1e-6], of_shapes, of_shapes])
    data = replace(turned_data(20.0, 0.3, error=0.03), covariance=np.diag(variances))
    structure = FurtherMode(Pair(), bs.Parameter("hz", bs.LogUniform(1.0, 3.0)), like=0)
    error, values = bs.ErrorModel(0.01, 0.03), np.array([[0.3, hz]])

    def log_likelihood(pairing):
        candidate = bs.ModelClass("motion", structure, data, error, pairing=pairing)
        return float(candidate.log_likelihood(values)[0])

    terms = [log_likelihood(pairing) for pairing in every_pairing(4, data.labels)]
    assert log_likelihood("any") == pytest.approx(np.logaddexp.reduce(terms), rel=1e-9)


def test_a_further_motion_has_an_error_of_shape_in_joint_densities():
    """Against normal densities in the plane at right angles to the identified shape."""
    own, prediction, spread = 0.05, 0.03, np.diag(np.square([0.02, 0.005, 0.01, 0.03]))
    joint = turned_data(20.0, 0.3, error=0.03)
    covariance = np.diag(np.repeat([1e-6, 1e-4], [2, 8]))
    covariance[2:6, 2:6] = spread
    joint = replace(joint, covariance=covariance)
    structure = FurtherMode(Pair(), bs.Parameter("hz", bs.LogUniform(1.0, 3.0)), like=0)
    error, values = bs.ErrorModel(0.01, prediction), np.array([[0.3, 1.72]])
    (likelihood,) = bs.ModelClass("m", structure, joint, error, pairing="any").likelihoods
    modes = likelihood.compared_modes(values)
    ratios = likelihood.joint_pairs.log_ratios(*likelihood.residuals(values, modes))
    unit = joint.unit_shapes[:, 0]
    model = X / np.linalg.norm(X) * np.sign(unit @ X)
    basis = np.linalg.svd(np.eye(4) - np.outer(unit, unit))[0][:, :3]
    along = basis.T @ (model - (unit @ model) * unit) / math.sqrt(0.5 * (1.0 + unit @ model))
    in_plane, further = basis.T @ spread @ basis, (prediction**2 + own**2) * np.eye(3)
    together, alone = (
        multivariate_normal.logpdf(along, cov=of_data + further)
        for of_data in (in_plane, np.trace(in_plane) / 3.0 * np.eye(3))
    )
    assert ratios[0, 3] == pytest.approx(together - alone, rel=1e-9)
