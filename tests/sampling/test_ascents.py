"""Local ascents side by side: each as if it were alone, in few batches."""

import numpy as np

from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.target import Target, log_standard_normal


class Valley:
    """Likelihood times prior falls as the function of Rosenbrock (1960), highest at (1, 1)."""

    def __init__(self):
        self.batches = []

    def __call__(self, z):
        self.batches.append(len(z))
        height = -((1.0 - z[:, 0]) ** 2) - 5.0 * (z[:, 1] - z[:, 0] ** 2) ** 2
        return height - log_standard_normal(z)


def ascents(starts):
    valley, unit = Valley(), np.tile(np.eye(2), (len(starts), 1, 1))
    return *ascend(Target(valley, 2), starts, unit), valley.batches


def test_ascents_do_not_depend_on_their_neighbours():
    starts = np.random.default_rng(0).standard_normal((12, 2))
    z, heights, batches = ascents(starts)
    np.testing.assert_allclose(z, np.ones((12, 2)), atol=0.03)
    np.testing.assert_allclose(heights, 0.0, atol=1e-3)
    alone = [ascents(start[None]) for start in starts]
    np.testing.assert_array_equal(z, np.concatenate([each[0] for each in alone]))
    np.testing.assert_array_equal(heights, np.concatenate([each[1] for each in alone]))
    assert sum(batches) == sum(sum(each[2]) for each in alone)
    assert len(batches) == max(len(each[2]) for each in alone)


def test_a_full_step_after_a_full_step_takes_one_batch():
    """A step takes 4 tries and 2 points for the gradient, apart unless the last was a full one."""
    *_, batches = ascents(np.array([[-1.5, -1.0]]))
    kinds = [batches.count(n) for n in (3, 4, 2, 6)]
    assert kinds[0] == 1
    assert sum(kinds) == len(batches)
    assert kinds[3] > 0.4 * len(batches)
