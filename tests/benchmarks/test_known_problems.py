"""The benchmark's known evidences, against simple Monte Carlo with draws from the prior.

Where the posterior is too small for that, the same formula is tested with milder figures.
"""

import numpy as np
import problems_scales as scales
import problems_shapes as shapes
import pytest
from catalogue import all_problems
from problems_modal import error_size_inferred, razor_ridge, repeated_modes
from problems_regions import eggbox, golf_hole, grid_of_modes, random_modes, spike_in_slab

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
