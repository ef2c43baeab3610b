"""The measure of whether quoted draws are emcee's: it knows a chain, and what is none."""

import emcee
import numpy as np
import pytest
from quoted_draws import share_of_emcee, watching_emcee


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


def test_walkers_after_burn_in_or_thinned_are_chains(steps):
    chains = steps[20:].transpose(1, 0, 2)
    assert share_of_emcee(chains, [np.zeros((5, 2, 2)), steps]) == 1.0
    assert share_of_emcee(chains[:, ::3], [steps]) == 1.0


def test_draws_in_another_order_or_of_several_walkers_are_none(steps):
    chains = steps[20:].transpose(1, 0, 2)
    shuffled = np.random.default_rng(1).permutation(chains, axis=1)
    assert share_of_emcee(shuffled, [steps]) == 0.0
    mixed = chains.copy()
    mixed[:2, ::2] = chains[2:4, ::2]
    assert share_of_emcee(mixed, [steps]) == 0.75
