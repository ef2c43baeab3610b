"""Moves of particles above a level of the likelihood."""

import numpy as np
import pytest

from bayes_ssi.inference.sampling.level_moves import _correlation


@pytest.mark.parametrize("n", [5, 7, 50])  # for some, the mean of copies is rounded
def test_copies_of_one_particle_are_where_they_began(n):
    copies = np.full((n, 2), 0.1)
    assert _correlation(copies, np.random.default_rng(0).standard_normal((n, 2))) == 1.0


def test_the_correlation_is_the_mean_over_dimensions():
    before = np.random.default_rng(1).standard_normal((50, 2))
    after = np.column_stack([before[:, 0], -2.0 * before[:, 1]])
    assert _correlation(before, after) == pytest.approx(0.0, abs=1e-12)
