"""Searches for maxima, one and several: results, agreement, ascents side by side, and the end."""

import math

import numpy as np
import pytest
from problems import four_regions
from scipy.special import ndtri
from targets import peaks

from bayes_ssi.inference.sampling import multistart
from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.maxima import Maxima, find_maxima
from bayes_ssi.inference.sampling.multistart import DRAWS, search_maxima, search_starts
from bayes_ssi.inference.sampling.multistart import MOST_TIMES_WANTED as PATIENCE
from bayes_ssi.inference.sampling.regions import NEIGHBOURS, nearest_neighbours
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target, log_standard_normal

# One search of a well-behaved posterior climbs from at most 40 draws, in some 10 gradients each:
# this many evaluations a dimension suffice.
ASCENTS = 450


A, B = np.array([1.8, 0.0]), np.array([-1.8, 0.0])


def two_peaks(share_of_b):
    return Target(peaks(np.array([A, B]), 0.15, np.array([1.0 - share_of_b, share_of_b])), 2)


def searches(target, n_searches=4, seed=0, **kwargs):
    return search_maxima(target, n_searches, np.random.SeedSequence(seed), **kwargs)


def finds(maxima, points):
    """Whether each point is a maximum, to within one standard deviation a coordinate."""
    return maxima.are_at(points).any(axis=0)


def scripted(monkeypatch, script):
    """Searches that climb to the scripted maxima, "A", "B" or "AB", repeating the last."""
    names = iter(script)
    last = ["A"]

    def starts(*_):
        last[0] = next(names, last[0])
        return np.array([{"A": A, "B": B}[name] for name in last[0]]), np.empty((0, 2))

    monkeypatch.setattr(multistart, "search_starts", starts)


@pytest.mark.parametrize("d", [1, 2, 4, 10])
def test_all_tops_are_found_by_every_search(d):
    """At ±1.8 on the first two axes, or the only one."""
    axes = 1.8 * np.eye(d)[:2]
    centres, shares = np.concatenate([axes, -axes]), np.arange(2.0 * len(axes), 0.0, -1.0)
    shares /= shares.sum()
    target = Target(peaks(centres, 0.3, shares), d)
    result = searches(target)
    np.testing.assert_allclose(result.maxima.z, centres, atol=0.01)  # the highest first
    np.testing.assert_allclose(np.exp(result.maxima.log_masses), shares, rtol=1e-2)
    assert 4 * DRAWS < target.n_evaluations < 4 * (DRAWS + ASCENTS * d)
    assert result.reached_by.shape == (4, len(centres))
    assert result.reached_by.all()
    assert result.converged


@pytest.mark.parametrize("seed", [7, 27])
def test_a_narrow_basin_is_found_by_most_searches(seed):
    """Of four normals in a box of side 10 the narrowest has most of the posterior."""
    problem = four_regions(seed)
    centres = ndtri(0.5 + 0.1 * np.random.default_rng(seed).uniform(-3.0, 3.0, (4, 4)))
    is_in_basin, _ = problem.regions["region 1"]
    prior = np.random.default_rng(1).standard_normal((100_000, 4))
    assert 0.002 < is_in_basin(prior).mean() < 0.004  # of 4000 draws a dozen
    target = Target(problem.log_likelihood, 4)
    hits = []
    for seed in range(20):
        alone = multistart._Searches(target, 40)
        alone.climb([search_starts(target, DRAWS, np.random.default_rng(seed))])
        hits.append(finds(alone.maxima, centres))
    assert np.mean(hits, axis=0)[0] > 0.7
    assert np.mean(hits, axis=0)[1:].min() > 0.9


@pytest.mark.parametrize(("share", "n_kept"), [(1e-4, 2), (1e-6, 1)])
def test_maxima_of_negligible_mass_are_left_out(share, n_kept):
    assert len(find_maxima(two_peaks(share), np.array([A, B])).z) == n_kept


def test_searches_climb_on_where_there_are_many_maxima():
    """Four searches from no more than the 40 highest draws agree on 31 of these 32."""
    centres = np.random.default_rng(5).uniform(-2.0, 2.0, (32, 3))
    result = searches(Target(peaks(centres, 0.05, np.full(32, 1.0 / 32.0)), 3), seed=1)
    assert finds(result.maxima, centres).all()
    assert result.n_searches == 4


def test_searches_record_the_maxima_they_found(monkeypatch):
    scripted(monkeypatch, ["A", "AB", "B", "BA"])
    result = searches(two_peaks(0.3), 4)
    np.testing.assert_allclose(result.maxima.z, [A, B], atol=0.01)
    assert result.reached_by.tolist() == [[True, False], [True, True], [False, True], [True, True]]


@pytest.mark.parametrize(
    ("script", "n_searches", "reached_by"),
    [
        (["A", "A", "AB", "A", "AB", "A"], 3, [5, 2]),
        (["A"], 1, [2]),
        *((["AB", "A"], n, [PATIENCE * n, 1]) for n in (1, 2, 4)),  # patience ends
    ],
)
def test_searches_continue_until_two_agree(monkeypatch, script, n_searches, reached_by):
    scripted(monkeypatch, script)
    result = searches(two_peaks(0.3), n_searches)
    assert result.reached_by.sum(axis=0).tolist() == reached_by
    assert result.n_searches == reached_by[0]
    assert result.converged == (1 not in reached_by)


@pytest.mark.parametrize(("script", "n_searches"), [(["AB"], 2), (["A", "A", "AB"], 4)])
def test_an_earlier_search_counts_as_one(monkeypatch, script, n_searches):
    scripted(monkeypatch, script)
    target = two_peaks(0.3)
    target.known_starts = np.array([A, B]) + 0.05
    result = searches(target, 2)
    assert result.n_searches == n_searches
    assert result.reached_by[0].all()
    assert result.converged
    # It made its draws long ago.
    assert result.n_draws == (n_searches - 1) * DRAWS


@pytest.mark.parametrize(
    ("shares", "reached_by", "converged"),
    [
        ([1.0], [[True], [True]], True),
        ([1.0], [[True], [False], [False]], False),
        ([0.7, 0.3], [[True, True], [True, True]], True),
        ([0.7, 0.3], [[True, True], [True, False]], False),
        ([0.7, 0.3], [[True, False], [True, True], [False, True]], True),
        ([0.9995, 0.0005], [[True, True], [True, False]], True),
        ([0.9985, 0.0015], [[True, True], [True, False]], False),
    ],
)
def test_a_maximum_found_twice_is_converged(shares, reached_by, converged):
    """Of maxima far apart whose masses are these shares of the posterior."""
    precisions = np.full((len(shares), 1, 1), 2.0 * math.pi)  # mass is then height
    maxima = Maxima(10.0 * np.arange(len(shares))[:, None], np.log(shares), precisions)
    assert multistart.MultistartSearch(maxima, np.array(reached_by), 1).converged is converged


@pytest.mark.parametrize("d", [1, 3])
def test_a_flat_likelihood_has_the_maximum_of_the_prior(d):
    result = searches(Target(lambda z: np.full(len(z), -7.0), d))
    np.testing.assert_allclose(result.maxima.z, np.zeros((1, d)), atol=0.1)
    np.testing.assert_allclose(result.maxima.precisions, np.eye(d)[None], atol=1e-3)
    beside = math.sqrt(d) * np.outer([0.8, 1.2], np.eye(d)[0])  # sds, of each coordinate
    assert result.maxima.are_at(beside).tolist() == [[True, False]]
    assert result.maxima.laplace_estimate.log_evidence == pytest.approx(-7.0, abs=2e-3)
    assert result.converged


def test_a_likelihood_that_is_zero_nearly_everywhere():
    """A normal cut off three of its standard deviations away, with two prior draws in 1000."""
    centre, sd = np.array([1.5, -1.0]), 0.06

    def cut_off(z):
        away = ((z - centre) ** 2).sum(1) / sd**2
        return np.where(away < 9.0, -0.5 * away, -np.inf)

    draws = np.random.default_rng(2).standard_normal((100_000, 2))
    assert 5e-4 < np.isfinite(cut_off(draws)).mean() < 4e-3
    result = searches(Target(cut_off, 2))
    # Prior and likelihood are normal, so their product is: precision 1 + 1/sd².
    np.testing.assert_allclose(result.maxima.z, [centre / (1.0 + sd**2)], atol=0.05 * sd)
    np.testing.assert_allclose(result.maxima.precisions[0] / (1.0 + sd**-2), np.eye(2), atol=1e-3)
    assert result.reached_by.all()


SPIKE, SPIKE_SHARE = np.array([0.4, -0.8, 1.1]), 0.99


def spike_in_slab(z):
    """A normal of standard deviation 1e-4 with 99 % of the posterior; the rest is the prior."""
    of_spike = peaks(SPIKE[None], 1e-4, np.array([SPIKE_SHARE]))
    return np.logaddexp(math.log(1.0 - SPIKE_SHARE), of_spike(z))


def test_searches_climb_from_suggested_starts():
    def near_spike(rng):
        return SuggestedStarts(SPIKE + 2e-4 * rng.standard_normal((2, 3)), 7)

    alone = Target(spike_in_slab, 3)
    lost = searches(alone)
    np.testing.assert_allclose(np.exp(lost.maxima.log_masses), [1.0 - SPIKE_SHARE], rtol=1e-2)
    target = Target(spike_in_slab, 3, suggest_starts=near_spike)
    result = searches(target)
    np.testing.assert_allclose(result.maxima.z, [SPIKE, np.zeros(3)], atol=1e-5)
    # The spike's top is 21 nats above that of the prior, which still has its share.
    expected = [SPIKE_SHARE, 1.0 - SPIKE_SHARE]
    np.testing.assert_allclose(np.exp(result.maxima.log_masses), expected, rtol=1e-2)
    assert result.reached_by.all()
    # Beside suggestions, which count, fewer draws suffice.
    assert 4 * 7 + result.n_draws < target.n_evaluations < alone.n_evaluations


def test_the_largest_unseen_mass_is_missed_by_one_search_in_twenty():
    mass = searches(two_peaks(0.3), 4).largest_unseen_mass
    assert (1.0 - mass) ** (4 * DRAWS) == pytest.approx(0.05, rel=1e-6)
    # Poisson: three expected draws, none with probability e^-3.
    assert mass == pytest.approx(3.0 / (4 * DRAWS), rel=2e-3)


@pytest.mark.parametrize("n", [1, 2, 8, 9, 10])
def test_nearest_neighbours_of_a_few_points(n):
    points = np.random.default_rng(n).standard_normal((n, 2))
    nearest = nearest_neighbours(points)
    distances = np.linalg.norm(points[:, None] - points, axis=-1)
    np.testing.assert_array_equal(nearest, distances.argsort(axis=1)[:, : NEIGHBOURS + 1])


@pytest.mark.parametrize("value", [-np.inf, np.nan])
def test_an_impossible_likelihood_is_reported(value):
    target = Target(lambda z: np.full(len(z), value), 2)
    assert [len(each) for each in search_starts(target, 9, np.random.default_rng(0))] == [0, 0]
    with pytest.raises(ValueError, match=f"^the likelihood is zero at all of {4 * DRAWS} draws"):
        searches(target)


def test_searches_are_independent(monkeypatch):
    firsts = []

    def watched(*arguments):
        firsts.append(arguments[-1].random())
        return search_starts(*arguments)

    monkeypatch.setattr(multistart, "search_starts", watched)
    searches(two_peaks(0.3))
    assert len(set(firsts)) == 4


def test_progress_ends_at_one_and_stays_there(monkeypatch):
    scripted(monkeypatch, ["AB", "A"])
    seen = []
    searches(two_peaks(0.3), 2, progress=seen.append)
    # Two side by side, each when its starts are known; then the others, twice each.
    assert seen == [0.25, 0.5] + [1.0] * (1 + 2 * (2 * PATIENCE - 2))


def test_the_number_of_evaluations_is_bounded():
    """A posterior with a thousand maxima; no two searches find the same ones."""

    def rough(z):
        return 8.0 * np.sin(40.0 * z).sum(axis=1)

    target = Target(rough, 2)
    assert not searches(target, 1).converged
    # At most 40 ascents of 60 steps with four tries and a gradient each, and some to gather up.
    of_ascents = 40 * 60 * (4 + 2) * 2
    assert target.n_evaluations < PATIENCE * (DRAWS + 2 * of_ascents)


@pytest.mark.parametrize("noise", [1e-4, 1e-2, 0.1])
def test_noise_does_not_split_a_maximum(noise):
    """A normal of standard deviation 0.03, with noise that depends on the last digits.

    Searches that agree all the same may not notice the smallest noise.
    """
    noticed = []
    for seed in range(6):
        rng = np.random.default_rng(seed)

        def noisy(z, rng=rng):
            heights = -0.5 * (((z - 0.3) / 0.03) ** 2).sum(axis=1)
            return heights + noise * rng.standard_normal(len(z))

        target = Target(noisy, 3)
        found = search_maxima(target, 4, np.random.SeedSequence(2))
        assert found.converged
        assert found.n_searches <= 6
        noticed += [target.noise / noise] if target.noise or noise > 1e-4 else []
        sds = np.sqrt(np.diagonal(found.maxima.covariances[0]))
        assert np.linalg.norm((found.maxima.z[0] - 0.3) / 0.03) < 1.7
        assert sds == pytest.approx(0.03, rel=0.3)
    assert noticed
    assert 0.2 < min(noticed) <= max(noticed) < 6.0  # the largest of three differences


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
