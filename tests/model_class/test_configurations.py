"""Model classes of several configurations: one likelihood, one posterior, one result."""

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import h5py
import importance
import numpy as np
import pytest
from conftest import assert_one_line_error, assert_refused, succeeded
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.calibration.least_squares import NothingToCalibrateError
from bayes_ssi.inference.criticism.misfit import edges
from bayes_ssi.inference.sampling.target import log_standard_normal
from bayes_ssi.report.tables.mode_tables import calibration_modes_table
from bayes_ssi.report.tables.ranking_tables import pairing_notes

STIFFNESS = (2.0 * math.pi) ** 2  # of a mass of 1, for 1 Hz
k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
dm = bs.Parameter("dm", bs.LogNormal(0.2, 0.5))
bare = bs.ShearBuilding((1.0, 1.0), (STIFFNESS * k, STIFFNESS))
loaded = bare.with_element(bs.AddedMass(dm, ((2, 1.0),)))
PAIRS = {"1": 1, "2": 2}


def modes_of(structure, **values):
    """Frequencies and shapes of a structure at given parameter values."""
    row = np.array([[values[p.name] for p in structure.parameters]])
    frequencies, shapes = structure.modes(row)
    return frequencies[0], shapes[0]


def data_of(structure, factors=(1.0, 1.0), band=(0.0, 3.0), **values):
    """The modes of a structure, their frequencies multiplied by ``factors``."""
    frequencies, shapes = modes_of(structure, **values)
    measured = frequencies[:2] * factors, shapes[:2, :2]
    return bs.ModalData.from_arrays(*measured, band, ("floor 1", "floor 2"))


BARE = data_of(bare, (1.004, 0.997), k=1.1)
LOADED = data_of(loaded, (0.996, 1.006), k=1.1, dm=0.25)
ERROR = bs.ErrorModel(0.01, 0.05)


def state(structure, data, name, pairing=PAIRS):
    return bs.Configuration(name, structure, data, pairing=pairing)


def joint(name="both", error=ERROR, **changes):
    tests = (state(bare, BARE, "bare"), state(loaded, LOADED, "loaded"))
    return bs.ModelClass(name, **{"configurations": tests, "error": error, **changes})


def columns(model_class, values, of):
    return values[:, [of.parameter_names.index(name) for name in model_class.parameter_names]]


@pytest.fixture
def draws():
    return joint().values(np.random.default_rng(5).standard_normal((40, 2)))


@pytest.mark.parametrize("pairing", [PAIRS, "any"])
def test_the_log_likelihood_is_the_sum_of_the_tests(draws, pairing):
    tests = (state(bare, BARE, "bare", pairing), state(loaded, LOADED, "loaded", pairing))
    both = joint(configurations=tests)
    one = bs.ModelClass("bare", bare, BARE, ERROR, pairing=pairing)
    two = bs.ModelClass("loaded", loaded, LOADED, ERROR, pairing=pairing)
    apart = one.log_likelihood(columns(one, draws, both))
    apart = apart + two.log_likelihood(columns(two, draws, both))
    np.testing.assert_allclose(both.log_likelihood(draws), apart, rtol=1e-12)
    z = importance.coordinates(both, draws)
    np.testing.assert_allclose(both.log_likelihood_at(z), apart, rtol=1e-10)


def test_one_configuration_with_a_name_is_the_class_without(draws):
    named = bs.ModelClass("x", configurations=[state(bare, BARE, "bare")], error=ERROR)
    without = bs.ModelClass("x", bare, BARE, ERROR, pairing=PAIRS)
    values = draws[:, :1]
    np.testing.assert_array_equal(named.log_likelihood(values), without.log_likelihood(values))
    assert named.structure is without.structure
    assert named.data_digest != without.data_digest  # a class without names has no 'bare'
    assert without.data_digest == BARE.digest


def test_parameters_of_structures_come_first_each_once():
    assert joint(error=bs.ErrorModel()).parameter_names == ("k", "dm", "frequency_cov", "shape_sd")


def test_digest_depends_on_names_and_data_but_not_on_order():
    tests = joint().configurations
    assert joint(configurations=tests[::-1]).data_digest == joint().data_digest
    other = (replace(tests[0], name="empty"), tests[1])
    assert joint(configurations=other).data_digest != joint().data_digest
    swapped = (replace(tests[0], data=LOADED), replace(tests[1], data=BARE))
    assert joint(configurations=swapped).data_digest != joint().data_digest


def quadrature(model_class):
    """Log evidence of a class with two parameters, by a grid over z that covers the posterior."""
    z, step = np.linspace(-5.0, 5.0, 401, retstep=True)
    grid = np.array(list(itertools.product(z, z)))
    log_terms = model_class.log_likelihood_at(grid) + log_standard_normal(grid)
    return logsumexp(log_terms) + 2.0 * math.log(step)


@pytest.fixture(scope="module")
def ranking():
    # The other class does not explain the second mode of the second test.
    tests = (state(bare, BARE, "bare"), state(loaded, LOADED, "loaded", {"1": 1}))
    study = bs.Study("Two tests", [joint(), joint("first mode only", configurations=tests)])
    return bs.rank(study, 3, bs.SamplingSettings(searches=1, effective_sample_size=400))


def test_evidence_by_quadrature(ranking):
    for candidate, posterior in zip(ranking.study.model_classes, ranking.posteriors, strict=True):
        evidence = posterior.evidence
        exact = quadrature(candidate)
        assert evidence.log_evidence == pytest.approx(exact, abs=max(0.01, 4.0 * evidence.error))
        assert posterior.failed_checks == ()


def test_a_posterior_knows_its_configurations(ranking):
    both, first_only = ranking.posteriors
    assert both.configuration_names == ("bare", "loaded")
    modes, frequencies = both.configuration("loaded")
    assert dict(modes.pairing) == PAIRS
    np.testing.assert_array_equal(frequencies, both.frequencies_hz[..., 2:])
    np.testing.assert_allclose(np.median(frequencies, axis=(0, 1)), LOADED.frequencies_hz,
                               rtol=0.015)  # fmt: skip
    assert dict(first_only.configuration("loaded")[0].pairing) == {"1": 1}
    with pytest.raises(ValueError, match=r"posterior of 'both': no configuration 'x'; choose from"):
        both.configuration("x")


def test_save_and_load(ranking, tmp_path):
    saved = bs.save_result(ranking, tmp_path / "r")
    loaded_again = bs.load_result(tmp_path / "r")
    assert {p.name for p in (tmp_path / "r" / "data").iterdir()} == {"bare.csv", "loaded.csv"}
    assert list(loaded_again.tests) == ["bare", "loaded"]
    assert loaded_again.tests["loaded"].digest == LOADED.digest
    assert loaded_again.comparison == ranking.comparison == saved.comparison
    for one, other in zip(loaded_again.posteriors, ranking.posteriors, strict=True):
        assert one.configurations == other.configurations
        np.testing.assert_array_equal(one.frequencies_hz, other.frequencies_hz)
    with pytest.raises(ValueError, match="r has 2 configurations; choose one of 'bare', 'loaded'"):
        _ = loaded_again.data
    with h5py.File(tmp_path / "r" / "posteriors" / "both.nc") as file:
        labels = [label.decode() for label in file["model"]["model_mode"]]
    assert labels == ["bare: 1", "bare: 2", "loaded: 1", "loaded: 2"]
    (tmp_path / "r" / "data" / "bare.csv").unlink()
    assert_refused(r"bare\.csv: no such file", bs.load_result, tmp_path / "r")


@pytest.mark.parametrize("shape_weight", [0.0, None])
def test_calibration_recovers_what_made_both_tests(shape_weight):
    tests = (
        state(bare, data_of(bare, k=1.3), "bare"),
        state(loaded, data_of(loaded, k=1.3, dm=0.37), "loaded"),
    )
    calibration = bs.calibrate(joint(configurations=tests), shape_weight)
    assert calibration.parameter_names == ("k", "dm")
    np.testing.assert_allclose(calibration.best.values, [1.3, 0.37], rtol=1e-6)
    assert calibration.best.objective == pytest.approx(0.0, abs=1e-8)
    assert [(m.configuration, m.label) for m in calibration.best.modes] == [
        ("bare", "1"), ("bare", "2"), ("loaded", "1"), ("loaded", "2"),
    ]  # fmt: skip
    assert [m.mac for m in calibration.best.modes] == pytest.approx([1.0] * 4, abs=1e-9)
    cells = list(calibration_modes_table(calibration).columns[0].cells)
    assert [str(cell) for cell in cells] == ["bare: 1", "bare: 2", "loaded: 1", "loaded: 2"]


def test_the_objective_is_over_the_pairs_of_all_tests():
    # One storey: the residual of a test is known, f_model/f_e - 1, whatever k is.
    one = bs.ShearBuilding((1.0,), (STIFFNESS * k,))
    data = [bs.ModalData((bs.IdentifiedMode("1", f),), (0.0, 3.0)) for f in (1.0, 1.25)]
    tests = [bs.Configuration(str(i), one, d, pairing={"1": 1}) for i, d in enumerate(data)]
    calibration = bs.calibrate(bs.ModelClass("x", configurations=tests, error=ERROR), 0.0)
    # min over f of ½[(f - 1)² + (f/1.25 - 1)²]: f = (1 + 0.8) / (1 + 0.64)
    f = 1.8 / 1.64
    expected = math.sqrt(0.5 * ((f - 1.0) ** 2 + (0.8 * f - 1.0) ** 2))
    assert calibration.best.objective == pytest.approx(expected, rel=1e-6)


def test_an_inferred_pairing_is_reported_for_each_configuration():
    posterior = bs.sample(joint(configurations=[replace(c, pairing="any") for c in
                                                joint().configurations]))  # fmt: skip
    assert [c.inferred_pairing.best for c in posterior.configurations] == [PAIRS, PAIRS]
    assert [heading for heading, _ in pairing_notes(posterior)] == [
        "Modes of 'both' in configuration 'bare':", "Modes of 'both' in configuration 'loaded':",
    ]  # fmt: skip
    with pytest.raises(NothingToCalibrateError, match="its pairing is 'any'"):
        bs.calibrate(bs.ModelClass("x", configurations=joint().configurations, pairing="any"))


def test_a_mode_at_the_edge_of_the_band_is_named_with_its_configuration():
    top = modes_of(loaded, k=1.1, dm=0.25)[0][1]
    cut = bs.ModalData(LOADED.modes[:1], (0.0, 1.001 * top), LOADED.sensors)
    tests = (state(bare, BARE, "bare"), state(loaded, cut, "loaded", {"1": 1}))
    candidate = joint(configurations=tests)
    z = importance.coordinates(candidate, [[1.1, 0.25]] * 10)
    modes = candidate.modes(candidate.values(z))
    (edge,) = edges(candidate, z, np.hstack([test.frequencies_hz for test in modes]))
    assert (edge.configuration, edge.end, edge.parameter) == ("loaded", 1, None)
    assert edge.statement.startswith("configuration 'loaded': model mode 2 is paired with nothing")


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: joint(configurations=[state(bare, BARE, "a"), state(loaded, LOADED, "a")]),
         ValueError, "model class 'both': two configurations are named 'a'"),
        (lambda: joint(configurations=[state(bare, BARE, ""), state(loaded, LOADED, "a")]),
         ValueError, "model class 'both': a configuration has no name; where there are several"),
        (lambda: joint(configurations=[]), ValueError,
         "model class 'both': configurations is empty"),
        (lambda: joint(configurations=[bare]), TypeError,
         "model class 'both': configurations must be Configurations, got ShearBuilding"),
        (lambda: bs.ModelClass("x", bare, BARE), TypeError, "model class 'x': no pairing; give"),
        (lambda: bs.ModelClass("x", pairing="any"), TypeError, "model class 'x': no structure;"),
        (lambda: state(bare, BARE, "a", {"1": 3}), ValueError,
         "configuration 'a': pairing: identified mode '1' is paired with model mode 3"),
        (lambda: state(bare, "modes.csv", "a"), TypeError,
         "configuration 'a': data must be a ModalData, got 'modes.csv'"),
        (lambda: state(bare, BARE, 3), ValueError, "Configuration: name must be text and not"),
        (lambda: state(bare, BARE, "a\nb"), ValueError, "Configuration: name may not begin"),
        (lambda: joint().structure, ValueError,
         "model class 'both' has 2 configurations; choose one of 'bare', 'loaded'"),
        (lambda: joint().data, ValueError, "model class 'both' has 2 configurations"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(make, error, message):
    with pytest.raises(error, match="^" + re.escape(message)) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda tests: (tests[0], replace(tests[1], data=BARE)), " in configuration 'loaded', so"),
        (lambda tests: (tests[0], replace(tests[1], name="full")),
         " (configurations 'bare', 'loaded'; and 'bare', 'full'), so"),
        (lambda tests: tests[:1], " (configurations 'bare', 'loaded'; and 'bare'), so"),
    ],
)  # fmt: skip
def test_classes_of_different_tests_are_not_compared(change, where):
    study = bs.Study("s", [joint(), joint("other", configurations=change(joint().configurations))])
    message = f"model classes 'both' and 'other' explain different data{where}"
    assert_refused(re.escape(message), study.require_same_data)


STUDY = """\
import math

import bayes_ssi as bs

K = (2.0 * math.pi) ** 2
k, dm = bs.Parameter("k", bs.LogNormal(1.0, 0.3)), bs.Parameter("dm", bs.LogNormal(0.2, 0.5))
frame = bs.ShearBuilding((1.0,), (K * k,))


def modes(frequency_hz):
    return bs.ModalData((bs.IdentifiedMode("1", frequency_hz),), (0.0, 3.0), source="test")


def hypothesis(name, structure):
    tests = [
        bs.Configuration("bare", frame, modes(1.0), pairing={"1": 1}),
        bs.Configuration("with/mass", structure, modes(0.9), pairing={"1": 1}),
    ]
    return bs.ModelClass(name, configurations=tests, error=bs.ErrorModel(0.01))


mass = bs.AddedMass(dm, ((1, 1.0),))
study = bs.Study("Was a mass added?", [hypothesis("yes", frame.with_element(mass)),
                                       hypothesis("no", frame)])
"""


def test_a_study_of_two_configurations_from_the_command_line(run):
    Path("masses.py").write_text(STUDY, encoding="utf-8")
    succeeded(run("rank", "masses.py", "--out", "r", "--error", "0.05"))
    result = bs.load_result("r")
    assert result.comparison.best.name == "yes"
    assert list(result.tests) == ["bare", "with/mass"]
    assert Path("r/data/with_mass.csv").is_file()
    assert "with/mass: 1" in succeeded(run("calibrate", "masses.py", "--class", "yes")).output
    assert_one_line_error(run("search", "masses.py", "--in", "with", "--out", "s"), "'with/mass'")
    assert not Path("s").exists()
