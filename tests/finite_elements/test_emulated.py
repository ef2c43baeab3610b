"""Emulated modes: what is exact, what is estimated, and how well."""

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.structures.emulation.emulated_structure import (
    EmulatedStructure,
    FailingPoints,
    mode_errors,
)
from bayes_ssi.structures.emulation.gaussian_process import (
    GaussianProcess,
    _negative_log_likelihood,
)
from bayes_ssi.structures.emulation.mode_representations import ModalOperator, TrackedModes
from bayes_ssi.structures.structure import Requirement


def uncoupled(x):
    """Two oscillators, whose frequencies cross at x = 0: modes in ascending order, (B, ...)."""
    frequencies = np.column_stack([2.0 * np.exp(0.3 * x), 2.0 * np.exp(-0.2 * x)])
    order = np.argsort(frequencies, axis=1)
    shapes = np.tile(np.eye(2), (len(x), 1, 1))
    return bs.Modes(
        np.take_along_axis(frequencies, order, axis=1),
        np.take_along_axis(shapes, order[:, None, :], axis=2),
    )


@pytest.mark.parametrize("representation", [ModalOperator(2, 2), TrackedModes(2, 2)])
def test_modes_that_cross_are_emulated_exactly(representation):
    """The logarithms of their frequencies are linear, whichever comes first."""
    x, between = np.linspace(-2.0, 2.0, 21), np.linspace(-1.93, 1.93, 40)
    vectors = representation.encoded(x[:, None], uncoupled(x))
    process = GaussianProcess.fitted(x[:, None], vectors)
    modes = representation.decoded(process.mean(between[:, None]))
    assert mode_errors(modes, uncoupled(between), 2).max() < 1e-6


def test_modes_that_veer_are_emulated_by_their_operator():
    """Two coupled oscillators exchange their shapes within 0.02 of x = 0."""

    def modes(x):
        k = np.zeros((len(x), 2, 2))
        k[:, 0, 0], k[:, 1, 1] = 1.0 + 0.3 * x, 1.0 - 0.3 * x
        k[:, 0, 1] = k[:, 1, 0] = 0.003
        eigenvalues, shapes = np.linalg.eigh(k)
        return bs.Modes(np.sqrt(eigenvalues), shapes)

    x, between = np.linspace(-1.0, 1.0, 13), np.linspace(-0.9, 0.9, 50)
    errors = []
    for representation in (ModalOperator(2, 2), TrackedModes(2, 2)):
        vectors = representation.encoded(x[:, None], modes(x))
        process = GaussianProcess.fitted(x[:, None], vectors)
        decoded = representation.decoded(process.mean(between[:, None]))
        errors.append(mode_errors(decoded, modes(between), 2).max())
    assert errors[0] < 1e-3 < errors[1]


@pytest.mark.parametrize("rounding", [0.0, 1e-15, -1e-15])
def test_a_pair_of_equal_frequency_is_a_plane_whatever_rounding_makes_of_its_operator(rounding):
    """Of ((1, e), (-e, 1)) the eigenvalues are complex, of ((1, e), (e, 1)) they are not."""
    representation = ModalOperator(2, 2)
    for sign in (-1.0, 1.0):
        operator = np.eye(2) + rounding * np.array([[0.0, 1.0], [sign, 0.0]])
        vectors = np.concatenate([operator.ravel(), np.eye(2).ravel()])[None]
        modes = representation.decoded(vectors)
        np.testing.assert_allclose(modes.frequencies_hz, np.e)
        assert np.linalg.matrix_rank(modes.shapes[0]) == 2


def test_a_structure_alike_in_two_directions_is_emulated_as_well_as_another():
    """Frequencies are products of parameters and shapes fixed, so that a dozen solutions do."""
    k, r = (bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in "kr")
    stiffnesses = [(factor,) * 2 for factor in (800.0 * k, 800.0 * k, 3000.0 * r)]
    tower = bs.ShearBuilding3D((1.0, 1.0), (1.2, 1.2), *stiffnesses)
    values = np.random.default_rng(0).uniform(0.7, 1.4, (40, 2))
    accuracy = EmulatedStructure(tower).accuracy(values)
    assert accuracy.frequency < 1e-9
    assert accuracy.shape < 1e-6


def test_errors_of_points_left_out_are_those_of_fits_without_them():
    rng = np.random.default_rng(0)
    x = rng.standard_normal((30, 2))
    y = np.column_stack([np.sin(x).sum(axis=1), x[:, 0] * x[:, 1] ** 2])
    whole = GaussianProcess(x, y, np.array([1.5, 2.0]), 1e-6)
    left_out, spreads = whole.left_out
    for row in (0, 7, 29):
        rest = np.delete(np.arange(30), row)
        without = GaussianProcess(x[rest], y[rest], whole.lengths, whole.noise)
        np.testing.assert_allclose(left_out[row], without.mean(x[[row]])[0], rtol=1e-6)
        assert spreads[row] == pytest.approx(float(without.spreads(x[[row]])[0]), rel=1e-6)


def test_a_polynomial_of_second_degree_is_exact():
    rng = np.random.default_rng(1)
    x, new = rng.standard_normal((40, 3)), rng.standard_normal((10, 3))
    y = (1.0 + x[:, 0] - 2.0 * x[:, 1] * x[:, 2])[:, None]
    process = GaussianProcess.fitted(x, y)
    exact = 1.0 + new[:, 0] - 2.0 * new[:, 1] * new[:, 2]
    np.testing.assert_allclose(process.mean(new)[:, 0], exact, atol=1e-6)


def test_a_row_of_a_batch_does_not_depend_on_the_others():
    structure = EmulatedStructure(building())
    values = np.exp(0.3 * np.random.default_rng(4).standard_normal((600, 3)))
    whole = structure.modes(values)
    for row in (0, 17, 256, 599):
        alone = structure.modes(values[[row]])
        np.testing.assert_array_equal(alone.frequencies_hz[0], whole.frequencies_hz[row])
        np.testing.assert_array_equal(alone.shapes[0], whole.shapes[row])


def test_claimed_errors_are_those_of_points_never_seen():
    """At 300 draws of the prior, within a factor of two."""
    exact = building()
    emulated = EmulatedStructure(exact)
    values = np.exp(0.3 * np.random.default_rng(3).standard_normal((300, 3)))
    errors = mode_errors(emulated.modes(values), exact.modes(values), exact.n_modes)
    claimed = np.array(emulated.accuracy(values)[:2])
    np.testing.assert_array_less(np.median(errors, axis=0) / 2.0, claimed)
    better = emulated
    for _ in range(3):
        better = better.accurate_at(Requirement(values, *(0.1 * claimed)))
    errors_after = mode_errors(better.modes(values), exact.modes(values), exact.n_modes)
    assert (np.median(errors_after, axis=0) < np.median(errors, axis=0)).all()


def test_a_half_space_that_fails_is_recognised():
    rng = np.random.default_rng(2)
    x, new = rng.standard_normal((200, 3)), rng.standard_normal((500, 3))
    failed = x[:, 0] + x[:, 1] > 1.0
    failing = FailingPoints(x[failed], x[failed], x[~failed])
    sums = new[:, 0] + new[:, 1]
    by_odds, by_nearest = failing.votes(new)
    is_open = by_odds != by_nearest
    assert is_open.mean() < 0.2
    wrong = (failing.expected(new) != (sums > 1.0)) & ~is_open
    assert wrong.mean() < 0.01


def building():
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in (1, 2, 3)]
    return bs.ShearBuilding((1.0,) * 3, [4000.0 * k for k in factors])


def test_the_gradient_of_a_process_is_that_of_its_likelihood():
    """By central differences."""
    rng = np.random.default_rng(3)
    x, y = rng.standard_normal((14, 2)), rng.standard_normal((14, 3))
    logs, step = np.array([0.3, -0.2, -3.0]), 1e-5
    values = [
        [_negative_log_likelihood(logs + sign * step * e, x, y)[0] for e in np.eye(3)]
        for sign in (1.0, -1.0)
    ]
    by_differences = np.subtract(*values) / (2.0 * step)
    np.testing.assert_allclose(
        _negative_log_likelihood(logs, x, y)[1], by_differences, rtol=1e-6, atol=1e-8
    )
