"""The paper's steel frame with pseudo-experimental modes: model, data, tables and ranking."""

import functools
import runpy

import numpy as np
import pytest
from conftest import MODEL_CLASSES, ROOT, kept_study
from importance import log_evidence

import bayes_ssi as bs

NOMINAL_HZ = [3.23, 4.02, 5.70, 9.74, 14.55, 18.42]
APPROACHES = ("1-a", "1-b", "2")
# Log evidences by full sampling, and about where the posterior lies: mean, standard deviation.
SAMPLED = {"3 M3+": 294.31, "3 M1+": 289.84, "1-a M1": 213.49}
POSTERIOR = {
    "3 M3+": {"Icx1": (0.666, 0.035), "Icy1": (0.870, 0.046), "Ibx": (1.20, 0.073),
              "Iby": (0.979, 0.10), "m1": (0.830, 0.019), "m2": (0.782, 0.022),
              "JO1": (0.813, 0.018), "JO2": (0.741, 0.023), "ms": (1.15, 0.12),
              "fs": (1.010, 0.0064), "frequency_cov": (0.0033, 0.0016),
              "shape_sd": (0.0116, 0.0039)},
    "3 M1+": {"Icx1": (0.767, 0.034), "Icy1": (0.840, 0.032), "m1": (0.857, 0.024),
              "m2": (0.757, 0.016), "JO1": (0.830, 0.021), "JO2": (0.726, 0.017),
              "ms": (1.07, 0.14), "fs": (1.020, 0.0071), "frequency_cov": (0.0054, 0.0024),
              "shape_sd": (0.0125, 0.0040)},
    "1-a M1": {"Icx1": (0.880, 0.044), "Icy1": (0.872, 0.040), "m1": (0.960, 0.028),
               "m2": (0.773, 0.018), "JO1": (0.873, 0.027), "JO2": (0.754, 0.021),
               "frequency_cov": (0.0104, 0.0028), "shape_sd": (0.0139, 0.0043)},
}  # fmt: skip

study = functools.partial(kept_study, "steel_frame")


@functools.cache
def tables():
    return runpy.run_path(str(ROOT / "runs" / "tables_2_to_5.py"))


def model_class(name):
    return study().only([name]).model_classes[0]


def paper_values(structure):
    values = tables()["paper_values"]("3 M3+")
    return np.array([[values[parameter.name] for parameter in structure.parameters]])


def test_twelve_sets_on_the_same_three_tests():
    assert study().names == tuple(tables()["PAPER"])
    study().require_same_data()
    for candidate in study().model_classes:
        assert candidate.configuration_names == ("BC", "SC", "NC")
        published = tables()["PAPER"][candidate.name][:-1]
        values = dict(zip(tables()["PARAMETERS"], published, strict=False))
        updated = {parameter.name for parameter in candidate.structural_parameters}
        assert updated == {name for name, value in values.items() if value != 1}
        for test in candidate.configurations:
            assert "PSEUDO-EXPERIMENTAL" in test.data.source


def test_the_nominal_frame():
    bare = model_class("1-a M1").configurations[0].structure
    modes = bare.modes(bare.prior_medians())
    np.testing.assert_allclose(modes.frequencies_hz[0], NOMINAL_HZ, rtol=5e-3)
    fourth = modes.shapes[0, :, 3].reshape(2, 3)
    assert np.abs(fourth[:, [0, 2]]).max() < 1e-9  # y alone
    assert fourth[0, 1] * fourth[1, 1] < 0.0  # the second of its direction


def test_the_braces_split_the_second_transverse_mode():
    bare = model_class("2 M3").configurations[0].structure
    augmented = model_class("3 M3+").configurations[0].structure
    single = bare.modes(paper_values(bare))
    modes = augmented.modes(paper_values(augmented))
    np.testing.assert_allclose(modes.frequencies_hz[0, 3:5], [9.665, 11.011], rtol=2e-3)
    assert modes.frequencies_hz[0, 3] < single.frequencies_hz[0, 3] < modes.frequencies_hz[0, 4]
    x_and_torsion = [1, 2, 5, 6], [1, 2, 4, 5]
    np.testing.assert_allclose(
        modes.frequencies_hz[0, x_and_torsion[0]], single.frequencies_hz[0, x_and_torsion[1]]
    )
    one, other = (modes.shapes[0, :6, number] for number in (3, 4))
    mac = (one @ other) ** 2 / ((one @ one) * (other @ other))
    assert mac > 0.85  # nearly undistinguishable at the storeys


def test_masses_lower_all_frequencies_and_one_sided_ones_couple_the_motions():
    results = {}
    for test in model_class("3 M3+").configurations:
        results[test.name] = test.structure.modes(paper_values(test.structure))
    bare, all_blocks, half = (results[name].frequencies_hz[0] for name in ("BC", "SC", "NC"))
    assert (all_blocks < half).all()
    assert (half < bare).all()
    in_y, in_torsion = [1, 4], [2, 5]
    for name, coupled in (("BC", False), ("SC", False), ("NC", True)):
        first = np.abs(results[name].shapes[0, :, 0])  # the first transverse mode
        assert (first[in_torsion].max() > 1e-3 * first[in_y].max()) == coupled


def test_the_data_are_what_the_script_makes(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["make", str(tmp_path)])
    runpy.run_path(str(ROOT / "runs" / "make_steel_frame.py"), run_name="__main__")
    assert capsys.readouterr().out.count("wrote") == 3
    for name in ("BC", "SC", "NC"):
        file = f"steel_frame_{name}.csv"
        made, kept = (
            bs.read_modal_data(where / file) for where in (tmp_path, MODEL_CLASSES / "data")
        )
        assert made.source == kept.source
        np.testing.assert_allclose(made.frequencies_hz, kept.frequencies_hz, atol=1.01e-4)
        np.testing.assert_allclose(made.unit_shapes, kept.unit_shapes, atol=2e-4)


def test_the_data_have_the_scatter_that_they_say():
    deviations, components = [], []
    for test in model_class("3 M3+").configurations:
        structure = test.structure
        modes = structure.modes(paper_values(structure))
        deviations += list(test.data.frequencies_hz / modes.frequencies_hz[0] - 1.0)
        shapes = structure.sensor_matrix(test.data.sensors).apply(modes.shapes)[0]
        shapes /= np.linalg.norm(shapes, axis=0)
        signs = np.sign((shapes * test.data.unit_shapes).sum(axis=0))
        components += list((test.data.unit_shapes * signs - shapes).ravel())
    # 21 frequencies and 168 components, less what unit length takes away.
    assert np.std(deviations) == pytest.approx(0.006, rel=3 / np.sqrt(2 * 21))
    assert np.std(components) == pytest.approx(0.03 * np.sqrt(7 / 8), rel=3 / np.sqrt(2 * 147))


def test_the_distances_of_the_published_tables():
    results = {
        approach: tables()["distance"](*map(tables()["paper_values"], (f"{approach} M3", "3 M3+")))
        for approach in APPROACHES
    }
    assert results == pytest.approx({"1-a": 17.6, "1-b": 72.9, "2": 2.1}, abs=0.06)


def calibrated(name):
    calibration = bs.calibrate(model_class(name), 0.075, n_starts=2)
    best = calibration.best
    return dict(zip(calibration.parameter_names, best.values, strict=True)), best.objective


def test_approach_2_lies_nearer_to_the_best_model_than_1_a_and_that_nearer_than_1_b():
    best, best_objective = calibrated("3 M3+")
    distances, objectives = {}, {}
    for approach in APPROACHES:
        values, objectives[approach] = calibrated(f"{approach} M3")
        distances[approach] = tables()["distance"](values, best)
    assert distances == pytest.approx({"1-a": 15.6, "1-b": 66.1, "2": 2.3}, abs=0.15)
    # In the paper, too, f_ob is nearly halved by leaving mode 4 out, or by the augmented model.
    assert max(best_objective, objectives["2"]) < 0.65 * min(objectives["1-a"], objectives["1-b"])
    # Within what many seeds give: 5 to 11 %.
    assert tables()["distance"](best, tables()["paper_values"]("3 M3+")) < 11.0


def test_two_fitted_numbers_give_the_published_distances():
    """Of M3 of approaches 1-a and 1-b from what made the modes: 17.6 and 72.9 %, no scatter."""
    unpublished = runpy.run_path(str(ROOT / "runs" / "steel_frame_unpublished.py"))
    results = unpublished["calibrated"](["1-a M3", "1-b M3"], unpublished["FLOORS"], 0.075)
    truth = tables()["paper_values"]("3 M3+")
    distances = [tables()["distance"](values, truth) for values, _ in results.values()]
    assert distances == pytest.approx([17.6, 72.9], abs=0.4)
    # 1-a fits better than 1-b, as in the paper.
    assert results["1-a M3"][1] < 0.6 * results["1-b M3"][1]


@pytest.mark.parametrize("name", SAMPLED)
def test_evidence_is_that_of_importance_sampling(name):
    evidence, error = log_evidence(model_class(name), POSTERIOR[name])
    assert error < 0.06
    assert evidence == pytest.approx(SAMPLED[name], abs=0.03 + 4.0 * error)
