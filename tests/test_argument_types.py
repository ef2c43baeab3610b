"""Arguments of the wrong type, number or shape are named in one line, wherever they are given."""

import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.foundations.argument_types import require

FUNCTIONS = [name for name in bs.__all__ if inspect.isfunction(getattr(bs, name))]
K = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
BUILDING = bs.ShearBuilding((1.0, 1.0), (K, K))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_names_an_argument_of_a_wrong_type(name):
    parameters = inspect.signature(getattr(bs, name)).parameters.values()
    required = [each for each in parameters if each.default is inspect.Parameter.empty]
    first = next(each.name for each in required if each.annotation not in (Any, "Any"))
    with pytest.raises(TypeError, match=rf"^{name}: {first} must be .*, got <object") as error:
        getattr(bs, name)(**{each.name: object() for each in required})
    assert "\n" not in str(error.value)


def frequencies(a):
    return [a], [[1.0]]


def structures():
    matrix = bs.MatrixStructure([(K, np.eye(3))], np.eye(3), n_modes=2)
    three = [(1.0,)] * 5
    yield BUILDING
    yield BUILDING.with_element(bs.Pendulum(2, 0.1, 1.0))
    yield bs.ShearBuilding3D((1.0,), (K,), *three[:3])
    yield bs.SpaceFrame((3.0,), (0.0, 4.0), (0.0, 4.0), K, *three, (1.0,))
    yield matrix
    yield matrix.reduced()
    yield bs.FunctionStructure(frequencies, {"a": K}, n_modes=1, sensors=("x",))


@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        ([1.0], ValueError, r"one column for each parameter \(k\), \(B, 1\), got shape \(1,\)"),
        (np.ones(3), ValueError, r"got shape \(3,\)"),
        (np.ones((4, 2)), ValueError, r"got shape \(4, 2\)"),
        (np.ones((4, 1, 1)), ValueError, r"got shape \(4, 1, 1\)"),
        (1.0, ValueError, r"got shape \(\)"),
        ("x", TypeError, "an array of numbers, got 'x'"),
        ([["x"]], TypeError, r"an array of numbers, got \[\['x'\]\]"),
        (None, ValueError, r"got shape \(\)"),
    ],
)
def test_every_structure_checks_its_values(values, error, message):
    for structure in structures():
        name = type(structure).__name__
        has_masses = type(structure).modal_model is not bs.Structure.modal_model
        for method in ("modes", "modal_model") if has_masses else ("modes",):
            with pytest.raises(error, match=rf"^{name}\.{method}: values must .*{message}") as said:
                getattr(structure, method)(values)
            assert "\n" not in str(said.value)


def test_model_classes_check_their_values(model_classes):
    with pytest.raises(ValueError, match=r"'3': values must .* \(k1, k2, k3, ks\), \(B, 4\)"):
        model_classes["3"].log_likelihood([1.0, 1.0])


def test_lists_are_values_and_a_row_without_modes_is_alone():
    whole = BUILDING.modes(np.array([[1.0], [2.0]]))
    part = BUILDING.modes([[1.0], [math.nan], [-1.0], [2.0]])
    np.testing.assert_array_equal(part.frequencies_hz[[0, 3]], whole.frequencies_hz)
    assert np.isnan(part.frequencies_hz[1:3]).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: BUILDING.with_element(1), "element must be an Element, got 1"),
        (lambda: BUILDING.with_sensors([1]), r"sensors must be .* a Sensor, got \[1\]"),
        (lambda: bs.ShearBuilding((1.0,), (1.0,), elements=(1,)), "ShearBuilding: elements must"),
        (lambda: bs.ShearBuilding((1.0,), (1.0,), sensors="ab"), "ShearBuilding: sensors must be"),
        (lambda: bs.ModalData((1,), (0.0, 1.0)), "modes must be .* an IdentifiedMode"),
        (lambda: bs.FunctionStructure(frequencies, [K], n_modes=1), "arguments must be a mapping"),
        (lambda: BUILDING.sensor_matrix("floor 1"), "sensors must be a sequence, each item text"),
    ],
)
def test_constructors_and_methods_do_too(make, message):
    with pytest.raises(TypeError, match=message):
        make()


@pytest.mark.parametrize("name", ["rank", "sample", "calibrate", "search"])
def test_seeds_are_not_negative(name, tiny_study):
    argument = tiny_study if name == "rank" else tiny_study.model_classes[0]
    with pytest.raises(ValueError, match="seed must be zero or positive, got -1"):
        getattr(bs, name)(argument, seed=-1)


GOOD = [
    (1, int), (np.int64(1), int), (1, float), (np.float64(1.0), float), ("a", str),
    (None, int | None), (Path("a"), str | Path), (("a",), Sequence[str]),
    (np.ones(2), Sequence[float]), ({"a": 1}, Mapping[str, float]), (len, Callable[[int], int]),
    ("any", Literal["any"]),
    (object(), Any), (iter(()), Iterator[int]),
    ((1, "a"), tuple[int, str]), ([1.0, 2.0], tuple[float, float]), ((1, 2, 3), tuple[int, ...]),
]  # fmt: skip
BAD = [
    (True, int, "a whole number"), (1.5, int, "a whole number"), (True, float, "a number"),
    (1, str, "text"), ("ab", Sequence[str], "a sequence, each item text"),
    ([1], Sequence[str], "a sequence, each item text"), (np.array(1.0), Sequence[float], "a seq"),
    ({1: 1}, Mapping[str, int], "a mapping of text to a whole number"),
    (1, str | Path, "text or a path"), (1, Callable[[int], int], "a function"),
    ("all", Literal["any"], "'any'"),
    ((1, 2), tuple[int, str], r"\(a whole number, text\)"),
]  # fmt: skip


@pytest.mark.parametrize(("value", "hint"), GOOD)
def test_values_that_fit_a_hint(value, hint):
    require(value, hint, "it")


@pytest.mark.parametrize(("value", "hint", "words"), BAD)
def test_values_that_do_not(value, hint, words):
    with pytest.raises(TypeError, match=f"^it must be {words}.*, got "):
        require(value, hint, "it")
