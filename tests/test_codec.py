"""Objects to records and back, digests of numbers but for rounding, and lines at fault."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.foundations.arrays import FloatArray, folded, place_of_largest, steady_digest
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.foundations.error_places import with_place
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


NUMBERS = np.random.default_rng(0).standard_normal((40, 30))
PLACES = np.indices(NUMBERS.shape).reshape(2, -1)


def digest_of(numbers):
    return steady_digest(numbers.ravel(), *PLACES)


def test_a_digest_hardly_ever_changes_with_rounding():
    rng = np.random.default_rng(1)
    digests = {
        digest_of(NUMBERS * (1.0 + 1e-15 * rng.standard_normal((40, 30)))) for _ in range(50)
    }
    assert digests == {digest_of(NUMBERS)}


@pytest.mark.parametrize("change", [1e-5, 1.0])
def test_a_digest_tells_any_one_number_from_another(change):
    for place in np.ndindex(5, 5):
        other = NUMBERS.copy()
        other[place] += change
        assert digest_of(other) != digest_of(NUMBERS)


def test_a_digest_tells_places_and_signs():
    digests = [digest_of(each) for each in (NUMBERS, -NUMBERS, NUMBERS[::-1], NUMBERS[:, ::-1])]
    assert len(set(digests)) == 4
    assert steady_digest(np.zeros(3), np.arange(3)) == steady_digest(-np.zeros(3), np.arange(3))
    far, (a, b) = 10_000 + np.arange(2), np.array([[3.0, 4.0], [4.0, 3.0]])
    assert steady_digest(a, far) != steady_digest(b, far)


@pytest.mark.parametrize("off", [-1e-12, 0.0, 1e-12])
def test_the_first_of_equally_large_numbers(off):
    sizes = np.array([[1.0, 3.0, 3.0 + off], [2.0 + off, 2.0, 1.0], [1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(place_of_largest(sizes), [1, 0, 2])


@pytest.mark.parametrize("n", [1, 2, 3, 7, 24, 97])
def test_sums_by_halves(n):
    """As accurate sums have them, and the same to the last digit for a column by itself."""
    terms = np.random.default_rng(n).standard_normal((n, 5))
    sums = folded(terms)
    assert sums == pytest.approx([math.fsum(column) for column in terms.T], abs=1e-14)
    assert [folded(terms[:, [j]])[0] for j in range(5)] == sums.tolist()
    assert folded(terms[:, 0]) == sums[0]


def inner():
    raise ValueError("no such\nfloor")


def outer():
    inner()


def test_it_is_the_last_of_the_users_lines():
    lines = Path(__file__).read_text("utf-8").splitlines()
    line = 1 + next(i for i, text in enumerate(lines) if "raise ValueError" in text)
    try:
        outer()
    except ValueError as error:
        said = with_place(error)
    assert said == f"ValueError: no such floor ({Path(__file__).name}, line {line})"
