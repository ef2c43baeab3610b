"""Structures computed by a user's function, and the handling of its errors."""

import math

import importance
import numpy as np
import pytest
import scipy.sparse as sp
from conftest import assert_refused, multiplier

import bayes_ssi as bs
from bayes_ssi.inference.sampling.target import Target

FLOORS = {"floor 1": 0, "floor 2": 1}


def matrices(a, b):
    return np.array([[a + b, -b], [-b, b]]), np.eye(2)


def modes(a, b):
    if a > 3.0:
        raise ZeroDivisionError("the mesh\nfell apart")
    eigenvalues, vectors = np.linalg.eigh(matrices(a, b)[0])
    if b > 3.0:
        eigenvalues = eigenvalues * math.nan
    return np.sqrt(np.abs(eigenvalues)) / (2 * math.pi), vectors


def structure(function=matrices, sensors=FLOORS, **arguments):
    arguments = arguments or {"a": 1.0 * multiplier("k1"), "b": 2.0 * multiplier("k2")}
    return bs.FunctionStructure(function, arguments, n_modes=2, sensors=sensors)


def test_matrices_and_modes_are_the_same_structure():
    values = np.array([[1.0, 1.0], [0.8, 1.3]])
    by_matrices = structure().modes(values)
    by_modes = structure(modes, sensors=("floor 1", "floor 2")).modes(values)
    frame = bs.ShearBuilding(
        masses=(1.0, 1.0), stiffnesses=(multiplier("k1"), 2.0 * multiplier("k2"))
    )
    expected = frame.modes(values)
    np.testing.assert_allclose(by_matrices.frequencies_hz, expected.frequencies_hz, rtol=1e-12)
    np.testing.assert_allclose(by_modes.frequencies_hz, expected.frequencies_hz, rtol=1e-12)
    for made in (by_matrices, by_modes):
        np.testing.assert_allclose(np.abs(made.shapes), np.abs(expected.shapes), rtol=1e-9)


def test_unsorted_modes_are_put_in_order():
    shuffled = structure(lambda a, b: ([b, a], np.array([[0.0, 1.0], [1.0, 0.0]])),
                         sensors=("x", "y"), a=2.0, b=multiplier("k"))  # fmt: skip
    frequencies, shapes = shuffled.modes(np.array([[5.0], [1.0]]))
    np.testing.assert_array_equal(frequencies, [[2.0, 5.0], [1.0, 2.0]])
    np.testing.assert_array_equal(shapes[0], np.eye(2))


def test_exchanged_axes_are_named():
    exchanged = structure(lambda a: ([a, 2.0], np.ones((2, 3))), sensors=("x", "y", "z"), a=1.0)
    with pytest.raises(ValueError, match=r"\(3, 2\), got ndarray of shape \(2, 3\), its transpose"):
        exchanged.modes(np.empty((1, 0)))


def test_frequencies_alone():
    def only(a):
        return (a, 2.0 * a), None

    made = bs.FunctionStructure(only, {"a": multiplier("k")}, n_modes=2)
    assert made.modes(np.array([[3.0]])).shapes.shape == (1, 0, 2)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "must return two things"),
        ((np.eye(2),), "must return two things"),
        ((np.eye(2), np.eye(3)), "M has 3 rows"),
        ((np.triu(np.ones((2, 2))), np.eye(2)), "K must be symmetric"),
        ((np.ones((1, 2)), np.eye(2)), "K must be square"),
        ((sp.eye_array(400), 0.0 * sp.eye_array(400)), "gives 0 modes, fewer than the 2"),
        ((sp.eye_array(400), -sp.eye_array(400)), "M is not positive semi-definite"),
        ((-np.eye(2), np.eye(2)), "not positive definite"),
        (([1.0], np.eye(2)), r"at least 2 frequencies, got shape \(1,\)"),
        (([1.0, math.nan], np.eye(2)), "numbers that are not finite"),
        (([0.0, 1.0], np.eye(2)), "a frequency of 0 Hz, which is not positive"),
        (([1.0, 2.0], np.eye(3)), r"one column per mode, \(2, 2\), got ndarray of shape \(3, 3\)"),
        (([1.0, 2.0], 1j * np.eye(2)), "must return real shapes"),
    ],
)
def test_wrong_answers_are_reported_with_their_values(answer, message):
    def wrong(a):  # noqa: ARG001
        return answer

    made = bs.FunctionStructure(wrong, {"a": multiplier("k")}, n_modes=2, sensors=FLOORS)
    assert_refused(f"^at k = 1.25: .*{message}", made.modes, np.array([[1.25]]))


def test_arguments_are_those_of_the_function():
    assert_refused("missing a required argument: 'b'", structure, a=1.0)
    assert_refused("unexpected keyword argument 'c'", structure, a=1.0, b=1.0, c=1.0)


def test_a_function_that_exits_does_not_end_the_program():
    def leaves(a):  # noqa: ARG001
        raise SystemExit(3)

    made = bs.FunctionStructure(leaves, {"a": multiplier("k")}, n_modes=2, sensors=FLOORS)
    with pytest.raises(ValueError, match=r"at k = 1\.25: RuntimeError: .*leaves called exit\(3\)"):
        made.modes(np.array([[1.25]]))


def test_each_set_of_values_is_computed_once():
    calls = []

    def counted(a):
        calls.append(a)
        if a < 0:
            raise RuntimeError("negative")
        return a * np.eye(2), np.eye(2)

    made = bs.FunctionStructure(counted, {"a": multiplier("k")}, n_modes=2, sensors=FLOORS)
    assert_refused("at k = -1: RuntimeError: negative", made.modes, np.array([[1.0], [-1.0]]))
    made.modes(np.array([[1.0]]))
    assert_refused("at k = -1", made.modes, np.array([[-1.0]]))
    hz = made.modes_or_nan(np.array([[-1.0], [1.0]])).frequencies_hz
    np.testing.assert_allclose(hz, [[math.nan] * 2, [0.5 / math.pi] * 2])
    assert calls == [1.0, -1.0]


@pytest.mark.parametrize("in_workers", [False, True])
@pytest.mark.parametrize(
    ("values", "message"),
    [([4.0, 1.0], "at k1 = 4, k2 = 1: ZeroDivisionError: the mesh fell apart"),
     ([1.0, 4.0], "at k1 = 1, k2 = 4: modes returned numbers that are not finite")],
)  # fmt: skip
def test_errors_and_nan_of_a_function_are_reported(copied_workers, in_workers, values, message):
    data = bs.ModalData((bs.IdentifiedMode("1", 0.1),), (0.0, 1.0))
    candidate = bs.ModelClass(
        "f", structure(modes, ("x", "y")), data, bs.ErrorModel(0.01, 0.05), pairing={"1": 1}
    )
    z = importance.coordinates(candidate, [[1.0, 1.0], values])
    target = Target(candidate.log_likelihood_at, 2, copied_workers if in_workers else None)
    likelihoods = target.log_likelihood(z)
    assert np.isfinite(likelihoods[0])
    assert np.isneginf(likelihoods[1])
    assert message in target.first_failure[1]


def test_descriptions_tell_functions_apart():
    assert repr(structure()) != repr(structure(modes, ("x", "y")))
    assert " at 0x" not in repr(structure(lambda a, b: matrices(a, b)))
