"""The benchmark's known evidences, against simple Monte Carlo with draws from the prior.

Where the posterior is too small for that, the same formula is tested with milder figures.
"""

import numpy as np
import pytest
from catalogue import all_problems
from problems_modal import error_size_inferred, razor_ridge, repeated_modes
from problems_regions import eggbox, golf_hole, grid_of_modes, random_modes, spike_in_slab
from problems_scales import (
    cauchys,
    cauchys_in_a_box,
    fails_in_a_half,
    fails_in_stripes,
    far_out,
    gaussian,
    log_gamma,
    student_posterior,
)
from problems_shapes import (
    banana,
    bananas,
    beyond_the_edge,
    checkerboard,
    cliff,
    corner,
    flat_top,
    funnel,
    hard_ball,
    nested_shells,
    ring,
    staircase,
)

N_DRAWS = 200_000
MILD = (
    golf_hole(2, 1e-2),
    spike_in_slab(2, 0.031),
    random_modes(8, 2),
    grid_of_modes((-1.0, 1.0), 3, 0.2),
    eggbox(),
    banana(2, 0.1),
    banana(3, 0.3),
    bananas(2),
    funnel(2),
    ring(),
    nested_shells(),
    hard_ball(6, 1e-2),
    flat_top(),
    corner(2, 0.1),
    beyond_the_edge(2),
    staircase(),
    cliff(),
    checkerboard(),
    cauchys_in_a_box(1),
    cauchys(2),
    student_posterior(),
    log_gamma(2),
    gaussian("correlated", np.array([0.5, -0.5]), np.array([[0.1, 0.09], [0.09, 0.2]])),
    far_out(2.0),
    fails_in_a_half(),
    fails_in_stripes(),
    razor_ridge(2, 0.03),
    razor_ridge(3, 0.03),
    repeated_modes(),
    error_size_inferred(),
)


@pytest.mark.parametrize("problem", MILD, ids=lambda problem: problem.name)
def test_log_evidence_and_shares(problem):
    z = np.random.default_rng(1).standard_normal((N_DRAWS, problem.n_dimensions))
    log_likelihoods = np.nan_to_num(problem.log_likelihood(z), nan=-np.inf)
    ratios = np.exp(log_likelihoods - problem.log_evidence)
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
