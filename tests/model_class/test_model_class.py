"""Model classes: their parameters, and the evidences of the numerical study by quadrature."""

import itertools
import json
import math
import pickle

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.inference.model_class.class_record import ClassRecord, class_record
from bayes_ssi.structures.structure import Structure

# Log evidence, posterior means and standard deviations of the numerical study, computed
# independently by adaptive importance sampling (error of a log evidence below 0.002).
STUDY = {
    "1-a": (0.248, [0.9160, 1.1316, 0.9011], [0.0324, 0.0391, 0.0285]),
    "1-b": (-10.057, [1.3292, 0.8030, 1.1621], [0.0836, 0.0498, 0.0326]),
    "2": (-9.304, [0.9719, 1.0568, 1.0043], [0.0451, 0.0568, 0.0647]),
    "3": (16.067, [1.0095, 0.9936, 1.0034, 0.9959], [0.0484, 0.0445, 0.0333, 0.0308]),
}
LOG_SD = math.sqrt(math.log(1.09))


def gauss_hermite(model_class, mean, sd, n):
    """Log evidence, posterior mean and sd by product quadrature that moves to the posterior."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(n)
    u = np.array(list(itertools.product(nodes, repeat=len(mean))))
    log_w = np.log(list(itertools.product(weights, repeat=len(mean)))).sum(1)
    log_w += 0.5 * (u**2).sum(1) - 0.5 * len(mean) * math.log(2.0 * math.pi)
    centre = np.log(mean) / LOG_SD
    root = np.diag(np.array(sd) / mean / LOG_SD)
    for _ in range(4):
        z = centre + u @ root.T
        log_terms = log_w + model_class.log_likelihood_at(z) - 0.5 * (z**2).sum(1)
        terms = np.exp(log_terms - log_terms.max())
        log_evidence = log_terms.max() + math.log(terms.sum() * np.linalg.det(root))
        terms /= terms.sum()
        values = np.exp(LOG_SD * z)
        mean = terms @ values
        sd = np.sqrt(terms @ (values - mean) ** 2)
        centre = terms @ z
        root = np.linalg.cholesky((terms * (z - centre).T) @ (z - centre))
    return log_evidence, mean, sd


@pytest.mark.parametrize("name", STUDY)
def test_evidence_and_posterior_of_the_numerical_study(model_classes, name):
    log_evidence, mean, sd = STUDY[name]
    computed = gauss_hermite(model_classes[name], mean, sd, n=14)
    assert computed[0] == pytest.approx(log_evidence, abs=0.0025)
    np.testing.assert_allclose(computed[1], mean, atol=5e-4)
    np.testing.assert_allclose(computed[2], sd, atol=5e-4)


@pytest.mark.parametrize(("name", "log_evidence"), [("1-a", -2.396), ("1-b", -3.677)])
def test_evidence_from_frequencies_alone(model_classes, name, log_evidence):
    shapes = model_classes[name]
    bare = bs.ModelClass(
        name, shapes.structure, shapes.data.without_shapes(), shapes.error, pairing=shapes.pairing
    )
    computed, _, _ = gauss_hermite(bare, *STUDY[name][1:], n=24)
    assert computed == pytest.approx(log_evidence, abs=0.005)


def test_the_correct_model_fits_the_study_exactly(model_classes):
    # Four pairs, no spurious and no missed mode; three sensors.
    exact = -0.1 + 4.0 * math.log(0.95 / (0.01 * math.sqrt(2.0 * math.pi)))
    exact -= sum(math.log(f) for f in (0.98275928, 2.6042925, 3.00473295, 3.98405175))
    exact -= 4.0 * math.log(4.0 * math.pi * 0.0025)
    total = model_classes["3"].log_likelihood(np.ones((1, 4)))
    assert total[0] == pytest.approx(exact, abs=1e-6)


def test_default_errors_come_after_the_structure(augmented, case_c):
    candidate = bs.ModelClass("x", augmented, case_c, pairing={"1": 1})
    assert candidate.parameter_names == ("k1", "k2", "k3", "ks", "frequency_cov", "shape_sd")
    bare = bs.ModelClass("x", augmented, case_c.without_shapes(), pairing={"1": 1})
    assert bare.parameter_names == ("k1", "k2", "k3", "ks", "frequency_cov")


def test_each_parameter_has_its_own_prior(case_c):
    k = bs.Parameter("k", bs.Normal(50.0, 2.0))
    m = bs.Parameter("m", bs.LogNormal(1.0, 0.3))
    building = bs.ShearBuilding((m, 1.0, 1.0), (k, 50.0, 50.0))
    error = bs.ErrorModel(bs.Parameter("e", bs.Uniform(0.01, 0.03)), 0.05)
    candidate = bs.ModelClass("x", building, case_c, error, pairing={"1": 1})
    assert candidate.parameter_names == ("k", "m", "e")
    expected = [[52.0, math.exp(LOG_SD), 0.01 + 0.02 * 0.8413447460685429]]
    np.testing.assert_allclose(candidate.values(np.ones((1, 3))), expected, rtol=1e-12)


def test_pickling(model_classes):
    """Before and after its use."""
    whole, values = model_classes["3"], np.ones((1, 4))
    for copy in (pickle.loads(pickle.dumps(whole)) for _ in range(2)):
        expected = whole.log_likelihood(values)
        np.testing.assert_array_equal(copy.log_likelihood(values), expected)
        assert copy.parameters == whole.parameters
        assert copy.data.digest == whole.data.digest


def test_a_pairing_that_is_changed_afterwards_does_not_change_the_class(rigid, case_c, fixed_error):
    pairing = {"1": 1, "3": 3}
    candidate = bs.ModelClass("x", rigid, case_c, fixed_error, pairing=pairing)
    pairing["2a"] = 99
    assert dict(candidate.pairing) == {"1": 1, "3": 3}
    assert class_record(candidate).configurations[0].spurious == ("2a", "2b")


def test_summary_is_a_json_record(model_classes):
    record = class_record(model_classes["1-a"])
    summary = json.loads(json.dumps(to_record(record)))
    assert from_record(ClassRecord, summary) == record
    assert summary["name"] == "1-a"
    (configuration,) = summary["configurations"]
    assert configuration["structure"] == "ShearBuilding"
    assert configuration["degrees_of_freedom"] == ["floor 1", "floor 2", "floor 3"]
    assert summary["parameters"][0] == {
        "name": "k1",
        "unit": "",
        "prior": {"distribution": "LogNormal", "median": 1.0, "cov": 0.3},
        "is_error": False,
    }
    assert configuration["pairing"] == {"1": 1, "2a": 2, "3": 3}
    assert configuration["spurious"] == ["2b"]
    assert (summary["detection_probability"], summary["expected_spurious_modes"]) == (0.95, 0.1)
    assert summary["data_digest"] == model_classes["3"].data.digest


def build(structure, data, error, name="x", pairing=None, **kwargs):
    return bs.ModelClass(name, structure, data, error, pairing=pairing or {"1": 1}, **kwargs)


@pytest.mark.parametrize("name", ["", "  ", None, 3])
def test_a_class_without_name_is_refused(rigid, case_c, fixed_error, name):
    with pytest.raises(ValueError, match=f"name must be text and not empty, got {name!r}"):
        build(rigid, case_c, fixed_error, name=name)


@pytest.mark.parametrize(
    ("field", "kind"),
    [
        ("structure", "Structure"),
        ("data", "ModalData"),
        ("error", "ErrorModel"),
        ("identification", "IdentificationModel"),
    ],
)
def test_a_field_of_the_wrong_kind_is_refused(rigid, case_c, fixed_error, field, kind):
    fields = {"structure": rigid, "data": case_c, "error": fixed_error, field: "frame"}
    message = f"model class 'x': {field} must be an? {kind}, got 'frame'"
    with pytest.raises(TypeError, match=message):
        build(**fields)


def test_errors_begin_with_the_name_of_the_class(rigid, case_c, fixed_error):
    message = "^model class '1-a': pairing: no identified mode '4'"
    with pytest.raises(ValueError, match=message):
        build(rigid, case_c, fixed_error, name="1-a", pairing={"4": 1})


def test_a_class_without_parameters_is_refused(case_c, fixed_error):
    fixed = bs.ShearBuilding((1.0, 1.0, 1.0), (50.0, 50.0, 50.0))
    with pytest.raises(ValueError, match=r"^model class 'x': nothing is inferred"):
        build(fixed, case_c, fixed_error)


def test_a_sensor_without_degree_of_freedom_is_refused(case_c, fixed_error):
    k = bs.Parameter("k", bs.LogNormal(50.0, 0.3))
    two = bs.ShearBuilding((1.0, 1.0), (k, k))
    with pytest.raises(ValueError, match=r"^model class 'x': sensor 'floor 3': the structure has"):
        build(two, case_c, fixed_error)


def test_two_parameters_of_one_name_are_refused(augmented, case_c):
    error = bs.ErrorModel(bs.Parameter("ks", bs.LogNormal(0.01, 1.0)), 0.05)
    with pytest.raises(ValueError, match=r"^model class 'x': two different parameters are named"):
        build(augmented, case_c, error)


class _Answers(Structure):
    """A structure that returns a given answer."""

    parameters = (bs.Parameter("k", bs.LogNormal(1.0, 0.3)),)
    degrees_of_freedom = ("floor 1",)
    n_modes = 1

    def __init__(self, answer):
        self.answer = answer

    def modes(self, values):
        return self.answer(values)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda _: 1 / 0, "_Answers fails at the prior medians: ZeroDivisionError"),
        (
            lambda v: (np.ones((len(v), 2)), np.ones((len(v), 1, 2))),
            r"_Answers returns .* expected \(1, 1\) and",
        ),
    ],
)
def test_a_structure_that_does_not_answer_is_named(answer, message):
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
    candidate = bs.ModelClass("a", _Answers(answer), data, bs.ErrorModel(0.01), pairing={"1": 1})
    with pytest.raises(ValueError, match=f"model class 'a': structure {message}"):
        bs.sample(candidate)


def test_a_structure_may_answer_with_a_plain_pair():
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
    answer = lambda v: (np.sqrt(v), np.ones((len(v), 1, 1)))  # noqa: E731
    candidate = bs.ModelClass("a", _Answers(answer), data, bs.ErrorModel(0.01), pairing={"1": 1})
    assert np.isfinite(candidate.log_likelihood(np.array([[1.0]]))).all()


def test_a_class_that_pairs_nothing_is_sampled():
    building = bs.ShearBuilding((1.0,), (40.0 * bs.Parameter("k", bs.LogNormal(1.0, 0.3)),))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
    for seed in range(4):
        posterior = bs.sample(bs.ModelClass("none", building, data, pairing={}), seed)
        assert np.isfinite(posterior.evidence.check("bridge sampling").error)
        assert posterior.failed_checks == ()
