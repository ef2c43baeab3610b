"""Draws on disk: read back to the bit, and laid out as arviz expects."""

import warnings

import numpy as np
import pytest

from bayes_ssi.results.draws import StoredDraws, load_draws, save_draws


def stored(names=("k1", "k2")):
    rng = np.random.default_rng(2)
    return StoredDraws(
        tuple(names),
        rng.standard_normal((6, 40, len(names))),
        rng.standard_normal((6, 40)),
        rng.random((6, 40, 3)),
        (1, 2, 3),
    )


def open_with_arviz(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz.from_netcdf(path, engine="h5netcdf")


@pytest.mark.parametrize(
    "names",
    [("k1", "k2"), ("only",), ("θ 1", "k[a]", "EI.x", "2")],
)
def test_round_trip(tmp_path, names):
    draws = stored(names)
    save_draws(tmp_path / "x.nc", draws)
    loaded = load_draws(tmp_path / "x.nc", draws.parameter_names)
    assert loaded.parameter_names == names
    for array, expected in zip(loaded[1:], draws[1:], strict=True):
        np.testing.assert_array_equal(array, expected)


@pytest.mark.parametrize("name", ["EI/L", "draw", "chain", "model_mode", "frequency_hz"])
def test_any_name_that_a_parameter_may_have_can_be_stored(tmp_path, name):
    draws = stored((name, "k2"))
    save_draws(tmp_path / "x.nc", draws)
    loaded = load_draws(tmp_path / "x.nc", draws.parameter_names)
    np.testing.assert_array_equal(loaded.draws, draws.draws)


def test_arviz_finds_its_groups(tmp_path):
    draws = stored()
    save_draws(tmp_path / "x.nc", draws)
    tree = open_with_arviz(tmp_path / "x.nc")
    k2 = tree["posterior"]["k2"]
    assert k2.dims == ("chain", "draw")
    assert k2.shape == (6, 40)
    np.testing.assert_array_equal(k2.values, draws.draws[..., 1])
    total = tree["sample_stats"]["log_likelihood_total"]
    np.testing.assert_array_equal(total.values, draws.log_likelihoods)
    frequency = tree["posterior_predictive"]["frequency_hz"]
    assert frequency.dims == ("chain", "draw", "model_mode")
    assert frequency["model_mode"].values.tolist() == [1, 2, 3]


def test_a_file_can_be_deleted_once_it_is_read(tmp_path):
    save_draws(tmp_path / "x.nc", stored())
    load_draws(tmp_path / "x.nc", ("k1",))
    (tmp_path / "x.nc").unlink()
    assert not list(tmp_path.iterdir())


def damage(path, how):
    if how == "missing":
        path.unlink()
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "text":
        path.write_text("no netCDF")
    else:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize("how", ["missing", "empty", "text", "half"])
def test_a_damaged_file_is_refused_in_one_line(tmp_path, how):
    path = tmp_path / "x.nc"
    save_draws(path, stored())
    damage(path, how)
    with pytest.raises(ValueError, match=r"x\.nc: not a stored posterior") as caught:
        load_draws(path, ("k1",))
    assert "\n" not in str(caught.value)


def test_a_missing_parameter_is_refused(tmp_path):
    save_draws(tmp_path / "x.nc", stored())
    with pytest.raises(ValueError, match=r"x\.nc: not a stored posterior.*k3"):
        load_draws(tmp_path / "x.nc", ("k1", "k3"))


def test_a_file_that_is_replaced_is_read_afresh(tmp_path):
    path = tmp_path / "x.nc"
    first = stored()
    save_draws(path, first)
    load_draws(path, first.parameter_names)
    save_draws(tmp_path / "second.nc", first._replace(draws=first.draws + 1.0))
    # In place: whoever still holds the file open would see the old draws.
    path.write_bytes((tmp_path / "second.nc").read_bytes())
    again = load_draws(path, first.parameter_names)
    np.testing.assert_array_equal(again.draws, first.draws + 1.0)


def test_arviz_finds_prior_data_and_likelihoods(tiny_ranking, tmp_path):
    from bayes_ssi.results.save import save_result

    save_result(tiny_ranking, tmp_path / "r")
    tree = open_with_arviz(tmp_path / "r" / "posteriors" / "each_k.nc")
    posterior = tiny_ranking.posteriors[1]
    modes = tree["log_likelihood"]["modes"]
    # Every model mode is paired: that there is no other is as probable at every draw.
    assert modes["datum"].values.tolist() == ["1 and no other mode", "2"]
    np.testing.assert_allclose(modes.sum("datum").values, posterior.log_likelihoods)
    # A lognormal of median 1: half of the prior lies below it.
    below = float((tree["prior"]["k1"] < 1.0).mean())
    assert abs(below - 0.5) < 5 * 0.5 / np.sqrt(tree["prior"]["k1"].size)
    observed = tree["observed_data"]["identified_hz"].values
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    np.testing.assert_allclose(observed, [1.0 / golden, golden])
    predicted = tree["posterior_predictive"]["identified_hz"]
    assert predicted.dims == ("chain", "draw", "identified_mode")
    np.testing.assert_allclose(predicted.mean(("chain", "draw")), observed, rtol=0.02)


def test_arviz_judges_by_leaving_data_out(tiny_ranking, tmp_path):
    from bayes_ssi.results.save import save_result

    save_result(tiny_ranking, tmp_path / "r")
    tree = open_with_arviz(tmp_path / "r" / "posteriors" / "one_k.nc")
    import arviz

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = arviz.loo(tree, var_name="modes")
    # Left out by importance weights: E[1/p]⁻¹ of each datum, summed.
    inverse = -tiny_ranking.posteriors[0].datum_terms.log_likelihoods.reshape(-1, 3)
    expected = -np.log(np.exp(inverse).mean(0)).sum()
    elpd = found.elpd_loo if hasattr(found, "elpd_loo") else found.elpd
    assert abs(float(elpd) - expected) < 0.2
