"""Objects to records and back: equal, and refused by the path to what is wrong."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.parameters.priors import Prior


class Estimate(NamedTuple):
    value: float
    error: float


class Shape:
    record_tag = "shape"


@dataclass(frozen=True)
class Disc(Shape):
    radius: float


@dataclass(frozen=True)
class Box(Shape):
    sides: tuple[float, float]


@dataclass(frozen=True)
class Result:
    name: str
    count: int
    done: bool
    estimate: Estimate
    shapes: tuple[Shape, ...]
    prior: Prior | None
    pairing: Mapping[str, int] | str
    shares: Mapping[str, Mapping[int, float]]
    interval: tuple[float, float, float] | None = None


RESULT = Result(
    "a or b", 3, True, Estimate(-math.inf, math.inf), (Disc(1.0), Box((1.0, 2.0))),
    bs.TruncatedNormal(1.0, 0.5, lower=0.0), {"1": 1}, {"2a": {0: 0.25, 3: 0.75}}, (1.0, 2.0, 3.0),
)  # fmt: skip


def through_json(value, **options):
    return json.loads(json.dumps(to_record(value, **options), allow_nan=False))


def test_round_trip():
    assert from_record(Result, through_json(RESULT)) == RESULT


@pytest.mark.parametrize(
    "prior", [None, bs.LogNormal(np.float32(4.0), 0.3), bs.HalfNormal(np.int64(2))]
)
def test_round_trip_of_an_optional_choice(prior):
    record = through_json(RESULT) | {"prior": through_json(prior), "interval": None}
    again = from_record(Result, record)
    assert again.prior == prior
    assert again.interval is None


def test_a_prior_is_its_distribution_and_its_numbers():
    assert to_record(bs.TruncatedNormal(1.0, 0.5, 0.0, math.inf)) == {
        "distribution": "TruncatedNormal", "mean": 1.0, "sd": 0.5, "lower": 0.0, "upper": "inf",
    }  # fmt: skip


def test_arrays_with_what_is_no_number():
    @dataclass(frozen=True, eq=False)
    class Draws:
        values: FloatArray
        name: str

    draws = Draws(np.array([[1.0, np.nan], [-np.inf, 1e-300]]), "x")
    record = through_json(draws, without=("name",))
    assert record == {"values": [[1.0, "nan"], ["-inf", 1e-300]]}
    Draws.__annotations__["values"] = FloatArray  # a local class cannot be looked up by name
    again = from_record(Draws, record, name="y")
    np.testing.assert_array_equal(again.values, draws.values)
    assert again.name == "y"


def test_what_a_record_cannot_hold_is_refused():
    with pytest.raises(TypeError, match="a record cannot hold <function"):
        to_record({"a": [test_round_trip]})


def edited(*path_and_value):
    *path, last, value = path_and_value
    record = inner = through_json(RESULT)
    for key in path:
        inner = inner[key]
    inner[last] = value
    return record


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (edited("estimate", "error", None), "estimate.error: expected a number, got None"),
        (edited("estimate", "error", "wide"), "estimate.error: expected a number, got 'wide'"),
        (edited("estimate", "error", True), "estimate.error: expected a number, got True"),
        (edited("count", 1.5), "count: expected a whole number, got 1.5"),
        (edited("count", True), "count: expected a whole number, got True"),
        (edited("done", 1), "done: expected true or false, got 1"),
        (edited("name", ["x"] * 99), "name: expected text, got ['x', 'x', "),
        (edited("interval", [1.0, 2.0]), "interval: expected a list of 3, got [1.0, 2.0]"),
        (edited("shapes", 1, "sides", 0, {}), "shapes[1].sides[0]: expected a number, got {}"),
        (edited("shapes", 0, "shape", "Ball"), "shapes[0]: no shape 'Ball'; choose from 'Disc', "),
        (edited("shapes", "Disc"), "shapes: expected a list, got 'Disc'"),
        (edited("shapes", 0, "Disc"), "shapes[0]: expected a record, got 'Disc'"),
        (edited("prior", "sd", -1.0), "prior: TruncatedNormal: sd must be positive, got -1.0"),
        (edited("shares", "2a", {"x": 1.0}), "shares.2a.x: expected a key that is a whole number"),
        ({"name": "x"}, "count: missing"),
        ([], "record: expected a record, got []"),
    ],
)
def test_a_wrong_record_is_refused_by_the_path_to_what_is_wrong(record, message):
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - the whole message is compared
        from_record(Result, record)
    assert str(caught.value).startswith(message)
    assert len(str(caught.value)) < 200
