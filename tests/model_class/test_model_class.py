"""Model classes: their parameters, their records, and what is refused."""

import json
import math
import pickle

import numpy as np
import pytest

import bayes_ssi as bs
from bayes_ssi.foundations.codec import from_record, to_record
from bayes_ssi.inference.model_class.class_record import ClassRecord, class_record


def test_the_correct_model_fits_the_study_exactly(model_classes):
    # Four pairs, no spurious and no missed mode; three sensors.
    exact = -0.1 + 4.0 * math.log(0.95 / (0.01 * math.sqrt(2.0 * math.pi)))
    exact -= sum(math.log(f) for f in (0.98275928, 2.6042925, 3.00473295, 3.98405175))
    exact -= 4.0 * math.log(4.0 * math.pi * 0.0025)
    assert model_classes["3"].log_likelihood(np.ones((1, 4)))[0] == pytest.approx(exact, abs=1e-6)


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
    expected = [[52.0, math.exp(math.sqrt(math.log(1.09))), 0.01 + 0.02 * 0.8413447460685429]]
    np.testing.assert_allclose(candidate.values(np.ones((1, 3))), expected, rtol=1e-12)


def test_pickling(model_classes):
    """Before and after its use."""
    whole, values = model_classes["3"], np.ones((1, 4))
    for copy in (pickle.loads(pickle.dumps(whole)) for _ in range(2)):
        np.testing.assert_array_equal(copy.log_likelihood(values), whole.log_likelihood(values))
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


K50 = bs.Parameter("k", bs.LogNormal(50.0, 0.3))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        *(
            ({"name": name}, ValueError, f"name must be text and not empty, got {name!r}")
            for name in ("", "  ", None, 3)
        ),
        *(
            ({field: "frame"}, TypeError, f"model class 'x': {field} must be an? {kind}, got 'f")
            for field, kind in (
                ("structure", "Structure"),
                ("data", "ModalData"),
                ("error", "ErrorModel"),
                ("identification", "IdentificationModel"),
            )
        ),
        ({"pairing": {"4": 1}}, ValueError, "model class 'x': pairing: no identified mode '4'"),
        (
            {"structure": bs.ShearBuilding((1.0, 1.0, 1.0), (50.0, 50.0, 50.0))},
            ValueError,
            "model class 'x': nothing is inferred",
        ),
        (
            {"structure": bs.ShearBuilding((1.0, 1.0), (K50, K50))},
            ValueError,
            "model class 'x': sensor 'floor 3': the structure has",
        ),
        (
            {"error": bs.ErrorModel(bs.Parameter("k1", bs.LogNormal(0.01, 1.0)), 0.05)},
            ValueError,
            "model class 'x': two different parameters are named",
        ),
    ],
)
def test_what_is_no_class_is_refused(rigid, case_c, fixed_error, changes, error, message):
    fields = {"name": "x", "structure": rigid, "data": case_c, "error": fixed_error}
    with pytest.raises(error, match=message):
        bs.ModelClass(**{**fields, "pairing": {"1": 1}, **changes})


class _Answers(bs.Structure):
    """A structure that returns a given answer."""

    parameters = (bs.Parameter("k", bs.LogNormal(1.0, 0.3)),)
    degrees_of_freedom = ("floor 1",)
    n_modes = 1

    def __init__(self, answer):
        self.answer = answer

    def modes(self, values):
        return self.answer(values)


def of_answer(answer):
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
    return bs.ModelClass("a", _Answers(answer), data, bs.ErrorModel(0.01), pairing={"1": 1})


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
    with pytest.raises(ValueError, match=f"model class 'a': structure {message}"):
        bs.sample(of_answer(answer))


def test_a_structure_may_answer_with_a_plain_pair():
    candidate = of_answer(lambda v: (np.sqrt(v), np.ones((len(v), 1, 1))))
    assert np.isfinite(candidate.log_likelihood(np.array([[1.0]]))).all()


def test_a_class_that_pairs_nothing_is_sampled():
    building = bs.ShearBuilding((1.0,), (40.0 * bs.Parameter("k", bs.LogNormal(1.0, 0.3)),))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0),), (0.0, 2.0))
    for seed in range(4):
        posterior = bs.sample(bs.ModelClass("none", building, data, pairing={}), seed)
        assert np.isfinite(posterior.evidence.check("bridge sampling").error)
        assert posterior.failed_checks == ()
