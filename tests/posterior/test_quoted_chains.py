"""What a posterior quotes: chains as emcee made them, or draws that are said to be none."""

import warnings

import numpy as np
import pytest
from targets import STIFFNESS, two_bumps

import bayes_ssi as bs
from bayes_ssi.inference.posterior_sampling.sample import _quoted_draws
from bayes_ssi.inference.sampling import engine
from bayes_ssi.inference.sampling.engine import sample_target
from bayes_ssi.inference.sampling.target import Target


def test_draws_are_the_walkers_of_emcee_step_by_step(monkeypatch):
    """One frequency of two springs in series: either may be the soft one; two regions."""
    run, ensembles = engine.run_ensembles, []

    def recorded(*args, **kwargs):
        ensembles.append(run(*args, **kwargs))
        return ensembles[-1]

    monkeypatch.setattr(engine, "run_ensembles", recorded)
    k1, k2 = (bs.Parameter(name, bs.LogNormal(1.0, 1.0)) for name in ("k1", "k2"))
    building = bs.ShearBuilding((1.0, 1.0), (STIFFNESS * k1, STIFFNESS * k2))
    modes = (bs.IdentifiedMode("1", 0.35), bs.IdentifiedMode("2", 1.6))
    data = bs.ModalData(modes, (0.0, 3.0))
    pairing = {"1": 1, "2": 2}
    exchange = bs.ModelClass("exchange", building, data, bs.ErrorModel(0.01), pairing=pairing)
    posterior = bs.sample(exchange)
    assert len(posterior.regions) == 2
    assert posterior.failed_checks == posterior.remarks == ()
    by = posterior.thinned_by
    chains = np.concatenate([ensemble.chains[:, by - 1 :: by] for ensemble in ensembles[-1][0]])
    assert posterior.draws.shape == chains.shape
    values = exchange.values(chains.reshape(-1, 2)).reshape(chains.shape)
    np.testing.assert_array_equal(posterior.draws, values)
    # A walker that does not move repeats itself: of shuffled draws, hardly any does.
    moved = np.any(np.diff(posterior.draws, axis=1) != 0.0, axis=2)
    assert moved.mean() == pytest.approx(posterior.acceptance_fraction, abs=0.02)
    first = exchange.log_likelihood(posterior.draws[3])
    np.testing.assert_allclose(posterior.log_likelihoods[3], first, atol=1e-9)
    columns = np.moveaxis(posterior.draws, -1, 0)
    r_hats = [float(arviz_functions().rhat(column)) for column in columns]
    assert posterior.r_hat == pytest.approx(max(r_hats), rel=1e-9)


def arviz_functions():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz


def test_draws_of_chains_that_do_not_mix_have_the_shares_of_the_regions():
    settings = bs.SamplingSettings(max_steps=12, r_hat=1.0001)
    sampled = sample_target(Target(two_bumps(), 2), np.random.SeedSequence(3), settings)
    chains = np.concatenate([ensemble.chains for ensemble in sampled.ensembles])
    assert any(check.startswith("the chains differ") for check in sampled.failed_checks)
    draws, log_likelihoods, (remark,) = _quoted_draws(sampled, np.random.default_rng(0))
    assert remark.startswith("the draws are no chains: those of 352 steps")
    assert draws.shape == (1, chains[..., 0].size, 2)
    small = sampled.region_shares.min()
    assert small == pytest.approx(0.1, abs=4.0 * sampled.region_errors.max())
    share = np.mean(draws[0, :, 0] < 0.0)
    assert share == pytest.approx(small, abs=1.0 / draws.shape[1])
    assert abs(np.mean(chains[..., 0] < 0.0) - small) > 3.0 / draws.shape[1]
    np.testing.assert_allclose(log_likelihoods[0], two_bumps()(draws[0]), atol=1e-9)
