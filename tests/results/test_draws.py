"""Draws on disk: read back to the bit, as arviz expects; evidences recomputed from them."""

import json
import re
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest
from conftest import script_of

import bayes_ssi as bs
from bayes_ssi.inference.posterior.model_at_draws import DatumTerms
from bayes_ssi.inference.posterior_sampling.refinement import Confirmation, corrected
from bayes_ssi.results.draws import _varying_terms, load_draws, save_draws
from bayes_ssi.results.stored_result import load_result, save_result


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
    load_draws(path, save(path, ("k1",)))
    other = save(tmp_path / "second.nc", ("k1", "k2"))
    path.write_bytes((tmp_path / "second.nc").read_bytes())
    np.testing.assert_array_equal(load_draws(path, other).draws, other.draws)
    path.unlink()
    assert not path.exists()


def test_arviz_finds_prior_data_and_likelihoods(tiny_ranking, tiny_result):
    tree = open_with_arviz(tiny_result.directory / "posteriors" / "each_k.nc")
    posterior = tiny_ranking.posteriors[1]
    modes = tree["log_likelihood"]["modes"]
    # Every model mode is paired: that there is no other is as probable at every draw.
    assert modes["datum"].values.tolist() == ["1", "2", "no other mode"]
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


def test_arviz_judges_by_leaving_data_out(tiny_ranking, tiny_result):
    tree = open_with_arviz(tiny_result.directory / "posteriors" / "one_k.nc")
    import arviz

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loo = arviz.loo(tree, var_name="modes")
    # Left out by importance weights: E[1/p]⁻¹ of each datum, summed.
    inverse = -tiny_ranking.posteriors[0].datum_terms.log_likelihoods.reshape(-1, 3)
    expected = -np.log(np.exp(inverse).mean(0)).sum()
    assert abs(float(loo.elpd_loo if hasattr(loo, "elpd_loo") else loo.elpd) - expected) < 0.2


@pytest.mark.parametrize("rounding", [0.0, 1e-16])
def test_a_term_that_is_constant_but_for_rounding_is_scattered_beside_one_that_varies(rounding):
    """A model mode far above the band is missed at all draws with a probability of nearly one."""
    varying, missed = np.random.default_rng(0).standard_normal((2, 2, 50))
    log_likelihoods = np.stack([varying, -0.1 + rounding * missed], axis=-1)
    data, hz = ("1", "no other mode"), np.ones(1)
    kept = _varying_terms(DatumTerms(data, log_likelihoods, ("1",), hz, varying[..., None]))
    assert kept.std(axis=(0, 1)) == pytest.approx([varying.std(), 1e-6], rel=0.2)
    np.testing.assert_allclose(kept.sum(axis=-1), log_likelihoods.sum(axis=-1), atol=1e-9)


def test_arviz_compares_classes_and_predicts_their_data(tmp_path):
    """Also where they call different modes spurious."""
    k = bs.Parameter("k", bs.LogNormal(median=1.0, cov=0.3))
    building = bs.ShearBuilding(masses=(1.0, 1.0), stiffnesses=(103.4 * k, 103.4 * k))
    modes = [bs.IdentifiedMode(str(i), f) for i, f in enumerate((1.01, 2.59, 3.1), 1)]
    data = bs.ModalData(tuple(modes), band_hz=(0.0, 4.0))
    classes = [
        bs.ModelClass(name, building, data, bs.ErrorModel(0.02), pairing={"1": 1, name: 2})
        for name in ("2", "3")
    ]
    bs.save_result(bs.rank(bs.Study("which one", classes)), tmp_path / "r")
    trees = {n: open_with_arviz(tmp_path / "r" / "posteriors" / f"{n}.nc") for n in ("2", "3")}
    import arviz

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = arviz.compare(trees)
        if hasattr(arviz, "plot_ppc_dist"):  # arviz 1
            assert arviz.plot_ppc_dist(trees["2"], num_samples=20) is not None
        else:
            assert arviz.plot_ppc(trees["2"], num_pp_samples=20) is not None
    assert next(iter(table.index)) == "2"


@pytest.fixture(scope="module")
def script():
    return script_of("recompute_evidence")


def rows(script, capsys, directory):
    """Name → log evidence as recomputed, log prior mass with its error, and how far apart."""
    script.main([directory])
    number = r"(-?[\d.]+)"
    pair = rf"{number} ± {number}"
    found = re.findall(rf"^(\w[\w ]*?) +{pair} +{pair} +{pair} +{number} se$",
                       capsys.readouterr().out, re.MULTILINE)  # fmt: skip
    return {name: [float(value) for value in values] for name, *values in found}


def test_what_is_saved_gives_the_evidence_again(script, tiny_result, tiny_ranking, capsys):
    again = rows(script, capsys, tiny_result.directory)
    assert list(again) == ["one k", "each k"]
    for posterior in tiny_ranking.posteriors:
        stored, _, value, error, mass, mass_error, apart = again[posterior.name]
        assert value == pytest.approx(posterior.evidence.log_evidence, abs=6e-4)  # as printed
        assert stored == value
        assert error == pytest.approx(posterior.evidence.error, abs=6e-4)
        assert abs(mass) < 4.0 * mass_error
        assert apart < 0.01


def test_one_parameter_s_evidence_is_that_of_a_quadrature(script, tiny_result, tiny_ranking):
    (model_class, _) = tiny_ranking.study.model_classes
    z = np.linspace(-8.0, 8.0, 20001)
    density = np.exp(model_class.log_likelihood(model_class.values(z[:, None])) - 0.5 * z**2)
    exact = np.log(np.trapezoid(density, z) / np.sqrt(2.0 * np.pi))
    (value, error), _ = script.recomputed(
        np.load(tiny_result.directory / "posteriors" / "one_k.npz")
    )
    assert abs(value - exact) < 4.0 * error


@pytest.mark.parametrize(
    ("array", "added"), [("log_likelihoods", 0.1), ("log_proposals", -0.1), ("z", 1.0)]
)
def test_other_draws_give_another_evidence(script, tiny_result, tmp_path, capsys, array, added):
    path = shutil.copytree(tiny_result.directory, tmp_path / "r") / "posteriors" / "each_k.npz"
    arrays = dict(np.load(path))
    np.savez(path, **(arrays | {array: arrays[array] + added}))
    assert rows(script, capsys, tmp_path / "r")["each k"][-1] > 3.0


def test_a_correction_by_exact_solutions_is_recomputed(script, tiny_ranking, tmp_path, capsys):
    """Half of the exact likelihoods are twice, half equal to those sampled: 1.5 in the mean."""
    changes = np.log(np.tile([1.0, 2.0], 8))
    error = float(np.exp(changes).std(ddof=1) / 1.5 / 4.0)
    confirmation = Confirmation(
        np.ones((16, 1)), np.log(1.5), error, changes, (1e-6, None), "full solutions"
    )
    first, second = tiny_ranking.posteriors
    assert corrected(first, confirmation).evidence.mean_log_likelihood == pytest.approx(
        first.evidence.mean_log_likelihood + 0.5 * np.log(2.0)
    )
    ranking = replace(tiny_ranking, posteriors=(corrected(first, confirmation), second))
    save_result(ranking, tmp_path / "r")
    stored, stored_error, value, error, *_, apart = rows(script, capsys, tmp_path / "r")["one k"]
    assert value == pytest.approx(first.evidence.log_evidence + np.log(1.5), abs=6e-4)
    assert (stored, stored_error) == (value, error)
    assert apart < 0.01


def test_results_without_such_draws_are_only_read(script, tiny_result, tiny_ranking, tmp_path):
    """As those that were saved before there were any."""
    directory = shutil.copytree(tiny_result.directory, tmp_path / "r")
    digests = json.loads((directory / "digests.json").read_text(encoding="utf-8"))
    for file in directory.glob("posteriors/*.npz"):
        file.unlink()
        del digests[file.relative_to(directory).as_posix()]
    (directory / "digests.json").write_text(json.dumps(digests), encoding="utf-8")
    assert load_result(directory).comparison == tiny_ranking.comparison
    with pytest.raises(SystemExit, match=r"one_k.npz: no such file; rank the study again$"):
        script.main([directory])
