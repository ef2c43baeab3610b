"""Evidences of a saved ranking, recomputed by numpy alone from the draws beside it."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from conftest import script_of

from bayes_ssi.inference.posterior_sampling.refinement import Confirmation, corrected
from bayes_ssi.results.stored_result import load_result, save_result


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
