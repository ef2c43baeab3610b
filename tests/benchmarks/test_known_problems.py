"""The benchmark's known evidences, by Monte Carlo, and its measure of emcee's draws."""

import emcee
import numpy as np
import problems_scales as scales
import problems_shapes as shapes
import pytest
from catalogue import all_problems
from problems_modal import error_size_inferred, razor_ridge, repeated_modes
from problems_regions import eggbox, golf_hole, grid_of_modes, random_modes, spike_in_slab
from quoted_draws import share_of_emcee, watching_emcee

N_DRAWS = 200_000
MILD = (
    golf_hole(2, 1e-2), spike_in_slab(2, 0.031), random_modes(8, 2),
    grid_of_modes((-1.0, 1.0), 3, 0.2), eggbox(), shapes.banana(2, 0.1), shapes.banana(3, 0.3),
    shapes.bananas(2), shapes.funnel(2), shapes.ring(), shapes.nested_shells(),
    shapes.hard_ball(6, 1e-2), shapes.flat_top(), shapes.corner(2, 0.1), shapes.beyond_the_edge(2),
    shapes.staircase(), shapes.cliff(), shapes.checkerboard(), scales.cauchys_in_a_box(1),
    scales.cauchys(2), scales.student_posterior(), scales.log_gamma(2),
    scales.gaussian("correlated", np.array([0.5, -0.5]), np.array([[0.1, 0.09], [0.09, 0.2]])),
    scales.far_out(2.0), scales.fails_in_a_half(), scales.fails_in_stripes(),
    razor_ridge(2, 0.03), razor_ridge(3, 0.03), repeated_modes(), error_size_inferred(),
)  # fmt: skip


@pytest.mark.parametrize("problem", MILD, ids=lambda problem: problem.name)
def test_log_evidence_and_shares(problem):
    z = np.random.default_rng(1).standard_normal((N_DRAWS, problem.n_dimensions))
    ratios = np.exp(np.nan_to_num(problem.log_likelihood(z), nan=-np.inf) - problem.log_evidence)
    standard_error = ratios.std() / np.sqrt(N_DRAWS)
    assert standard_error < 0.1
    assert ratios.mean() == pytest.approx(1.0, abs=4.0 * standard_error)
    for test, share in problem.regions.values():
        inside = ratios * test(z)
        tolerance = 4.0 * (inside - share * ratios).std() / np.sqrt(N_DRAWS)
        assert inside.mean() == pytest.approx(share * ratios.mean(), abs=tolerance)


def test_names_are_unique():
    names = [problem.name for problem in all_problems()]
    assert len(set(names)) == len(names)


@pytest.fixture(scope="module")
def steps():
    """What eight walkers did in 60 steps of a normal distribution in two dimensions."""
    with watching_emcee() as steps_of_emcee:
        sampler = emcee.EnsembleSampler(8, 2, lambda z: -0.5 * z @ z)
        sampler.random_state = np.random.RandomState(0).get_state()
        sampler.run_mcmc(np.random.default_rng(0).standard_normal((8, 2)), 60)
        (noted,) = steps_of_emcee()
        assert steps_of_emcee() == []
    return noted


def test_walkers_after_burn_in_or_thinned_are_chains_and_draws_in_another_order_are_none(steps):
    chains = steps[20:].transpose(1, 0, 2)
    assert share_of_emcee(chains, [np.zeros((5, 2, 2)), steps]) == 1.0
    assert share_of_emcee(chains[:, ::3], [steps]) == 1.0
    assert share_of_emcee(np.random.default_rng(1).permutation(chains, axis=1), [steps]) == 0.0
    mixed = chains.copy()  # of several walkers
    mixed[:2, ::2] = chains[2:4, ::2]
    assert share_of_emcee(mixed, [steps]) == 0.75
