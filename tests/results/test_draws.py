"""Draws on disk: read back to the bit, and laid out as arviz expects."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from bayes_ssi.results.draws import load_draws, save_draws


@pytest.fixture
def save(make_posterior):
    """Saves the draws of a posterior of these parameters; returns the posterior."""

    def save(path, names=("k1", "k2")):
        posterior = make_posterior("m", names=names)
        save_draws(path, posterior)
        return posterior

    return save


def open_with_arviz(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz.from_netcdf(path, engine="h5netcdf")


@pytest.mark.parametrize(
    "names",
    [
        ("k1", "k2"), ("only",), ("θ 1", "k[a]", "EI.x", "2"), ("EI/L", "EI_L"), ("draw", "draw_"),
        ("chain",), ("model_mode",), ("frequency_hz",),
    ],
)  # fmt: skip
def test_round_trip(tmp_path, save, names):
    posterior = save(tmp_path / "x.nc", names)
    blank = replace(posterior, draws=None, log_likelihoods=None, frequencies_hz=None)
    loaded = load_draws(tmp_path / "x.nc", blank)
    for field in ("draws", "log_likelihoods", "frequencies_hz"):
        np.testing.assert_array_equal(getattr(loaded, field), getattr(posterior, field))


def test_arviz_finds_its_groups(tmp_path, save):
    posterior = save(tmp_path / "x.nc")
    tree = open_with_arviz(tmp_path / "x.nc")
    k2 = tree["posterior"]["k2"]
    assert k2.dims == ("chain", "draw")
    np.testing.assert_array_equal(k2.values, posterior.draws[..., 1])
    total = tree["sample_stats"]["log_likelihood_total"]
    np.testing.assert_array_equal(total.values, posterior.log_likelihoods)
    frequency = tree["model"]["frequency_hz"]
    assert frequency.dims == ("chain", "draw", "model_mode")
    assert frequency["model_mode"].values.tolist() == [1, 2]


def test_a_file_that_is_read_is_closed(tmp_path, save):
    """A file left open would still show its old draws after it is rewritten."""
    path = tmp_path / "x.nc"
    first = save(path, ("k1",))
    load_draws(path, first)
    other = save(tmp_path / "second.nc", ("k1", "k2"))
    path.write_bytes((tmp_path / "second.nc").read_bytes())
    np.testing.assert_array_equal(load_draws(path, other).draws, other.draws)
    path.unlink()
    assert not path.exists()


def test_arviz_finds_the_prior(tiny_result):
    """A lognormal of median 1: half of the prior lies below it."""
    tree = open_with_arviz(tiny_result.directory / "posteriors" / "each_k.nc")
    below = float((tree["prior"]["k1"] < 1.0).mean())
    assert abs(below - 0.5) < 5 * 0.5 / np.sqrt(tree["prior"]["k1"].size)
