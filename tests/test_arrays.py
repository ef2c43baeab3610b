"""Digests and places of numbers that are known but for rounding."""

import math

import numpy as np
import pytest

from bayes_ssi.foundations.arrays import folded, place_of_largest, steady_digest

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
