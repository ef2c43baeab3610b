"""Correlated prediction and joint identification errors against a dense covariance."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from conftest import FLOORS, multiplier
from dense_errors import Dense
from scipy.stats import chi2

import bayes_ssi as bs
from bayes_ssi.inference.criticism.misfit import log_chi_square, misfit
from bayes_ssi.inference.likelihood import joint_errors
from bayes_ssi.inference.posterior.model_at_draws import at_draws, datum_terms
from bayes_ssi.studies.ranking.checks import ranked

SD, SHAPE_SD = 0.004, 0.05  # with which no modes are close
RHO = bs.Parameter("rho", bs.Uniform(0.0, 1.0))
NEXT = bs.Parameter("next", bs.Uniform(0.0, 0.9))
SIZE = bs.Parameter("size", bs.LogNormal(SD, 0.4))


def configuration(name, top_mass, numbers, seed, sensors=(), renamed=()):
    """A test in which modes ``numbers`` were identified, mode i with the label "mode i"."""
    rng = np.random.default_rng(seed)
    factors = [multiplier(f"k{i}") for i in range(4)]
    structure = bs.ShearBuilding((1.0, 1.0, 1.0, top_mass), [900.0 * k for k in factors])
    frequencies, shapes = structure.modes(structure.prior_medians())
    rows = [structure.degrees_of_freedom.index(sensor) for sensor in sensors]
    names = {number: f"mode {number}" for number in numbers} | dict(renamed)
    modes = [
        bs.IdentifiedMode(
            names[number],
            frequencies[0, number - 1] * (1.0 + 0.03 * rng.standard_normal()),
            shapes[0, rows, number - 1] + 0.03 * rng.standard_normal(len(rows)) if rows else None,
            frequency_cov=None if number == 1 else 0.004 * number,
            shape_sd=0.01 * number if rows else None,
        )
        for number in numbers
    ]
    data = bs.ModalData(tuple(modes), (0.0, 12.0), sensors)
    pairing = {label: number for number, label in names.items()}
    return bs.Configuration(name, structure, data, pairing=pairing)


def model_class(error, tests):
    return bs.ModelClass("joint", configurations=tests, error=error)


def values_of(candidate, n=20):
    z = 0.5 * np.random.default_rng(0).standard_normal((n, len(candidate.parameters)))
    return candidate.values(z)


THREE = ("floor 1", "floor 3", "floor 4")


def jointly_identified(test, seed, unseen=()):
    """The test with a joint covariance of its data, without a sensor in some modes' shapes.

    Signs of shapes mean nothing; a fourth mode has none.
    """
    rng, modes = np.random.default_rng(seed), []
    for mode in test.data.modes:
        shape = rng.choice([-1.0, 1.0]) * mode.shape
        if mode.label in unseen:
            shape[1] = math.nan
        shape = None if mode.label == "mode 4" else shape
        modes.append(bs.IdentifiedMode(mode.label, mode.frequency_hz, shape))
    size = len(modes) * (1 + len(test.data.sensors))
    factor = 0.012 * rng.standard_normal((size, size + 2))
    return replace(test, data=replace(test.data, modes=tuple(modes), covariance=factor @ factor.T))


ALL_AT_ONCE = {
    "tests": bs.ErrorModel(SD, SHAPE_SD, 0.8),
    "modes": bs.ErrorModel(SD, SHAPE_SD, between_modes=0.6),
    "both": bs.ErrorModel(SD, SHAPE_SD, 0.8, 0.6),
    "inferred": bs.ErrorModel(SIZE, bs.Parameter("sd", bs.LogNormal(SHAPE_SD, 0.4)), RHO, NEXT),
    "all one size": bs.ErrorModel(SIZE, 10.0 * SIZE, RHO),
    "independent": bs.ErrorModel(SIZE, SHAPE_SD),
}


def jointly_identified_tests():
    """Two tests with a joint covariance and one without; one mode is seen at other sensors."""
    a, b, c = (
        configuration(name, mass, numbers, seed, THREE)
        for seed, (name, mass, numbers) in enumerate(
            (("a", 1.0, (1, 2, 3)), ("b", 1.5, (1, 3, 4)), ("c", 2.0, (3, 1)))
        )
    )
    return jointly_identified(a, 1), jointly_identified(b, 2, ("mode 1",)), c


@pytest.mark.parametrize(
    ("name", "are_joint"),
    [*product(ALL_AT_ONCE, (True, False))][:-1],  # some errors are related
)
def test_joint_identification_errors_and_correlated_prediction_errors_at_once(name, are_joint):
    error, tests = ALL_AT_ONCE[name], jointly_identified_tests()
    if not are_joint:
        tests = tuple(replace(test, data=test.data.without_covariance()) for test in tests)
    candidate = model_class(error, tests)
    independent = replace(error, between_tests=0.0, between_modes=0.0)
    alone = model_class(independent, candidate.configurations).with_independent_errors()
    values = values_of(candidate, 8)
    expected = alone.log_likelihood(values[:, : len(alone.parameters)])
    modes = [each.compared_modes(own) for _, each, own in candidate.parts(values)]
    _, numbers = candidate.correlated_errors.independent_residuals(values, modes)
    squares = sum((each**2).sum(axis=1) for each in numbers.values())
    for k, row in enumerate(values):
        dense = Dense(candidate, row[None])
        expected[k] += dense.log_ratio()
        if error.between_tests != 0.0 and are_joint:  # all modes are in one group
            distance = dense.residuals @ np.linalg.solve(dense.covariance, dense.residuals)
            assert squares[k] == pytest.approx(distance, rel=1e-9)
        # Of the same modes in another state, given the frequencies.
        further = [joint_errors.ModeOfTest(3, "mode 3", 3), joint_errors.ModeOfTest(3, "mode 2", 2)]
        of_frequencies = [i for i, kind in enumerate(dense.kinds) if kind[3] == "frequency"]
        kinds = [(*mode, "frequency", None) for mode in further]
        between = np.array([[dense.prediction(dense.kinds[i], b) for b in kinds]
                            for i in of_frequencies])  # fmt: skip
        own = np.array([[dense.prediction(a, b) for b in kinds] for a in kinds])
        gain = np.linalg.solve(dense.covariance[np.ix_(of_frequencies, of_frequencies)], between)
        model_hz = [each.frequencies_hz[[k]] for each in modes]
        means, covariance = candidate.correlated_errors.conditional(row[None], model_hz, further)
        np.testing.assert_allclose(means[0], dense.residuals[of_frequencies] @ gain, rtol=1e-8)
        np.testing.assert_allclose(covariance[0], own - gain.T @ between, rtol=1e-8)
    np.testing.assert_allclose(candidate.log_likelihood(values), expected, rtol=1e-10)


@pytest.mark.parametrize(
    "error", [bs.ErrorModel(SIZE, SHAPE_SD, RHO), bs.ErrorModel(SD, SHAPE_SD, 0.8, NEXT)]
)
def test_terms_of_data_join_what_is_correlated(error):
    tests = [configuration(*each, ("floor 1", "floor 4"))
             for each in (("a", 1.0, (1, 2, 3), 1), ("b", 1.5, (1, 2, 4), 2))]  # fmt: skip
    candidate = model_class(error, tests)
    values = values_of(candidate)
    result = at_draws(candidate, values)
    np.testing.assert_allclose(result.log_likelihoods.sum(axis=1), candidate.log_likelihood(values))
    pairings = [test.pairing for test in tests]
    terms = datum_terms(candidate, values, result, pairings, (2, 10), np.random.default_rng(1))
    no_other = ("a: no other mode", "b: no other mode")
    if error.between_modes == 0.0:
        joint = ("a: mode 1 and b: mode 1", "a: mode 2 and b: mode 2", "a: mode 3")
        assert terms.data == (*joint, no_other[0], "b: mode 4", no_other[1])
    else:
        own = [f"{test.name}: {label}" for test in tests for label in test.data.labels]
        assert terms.data == (" and ".join(own), *no_other)


def test_predicted_data_have_correlated_errors():
    tests = [configuration(*each, THREE)
             for each in (("bare", 1.0, (1, 2, 3), 1), ("loaded", 1.5, (1, 3, 4), 2))]  # fmt: skip
    candidate = model_class(bs.ErrorModel(SD, SHAPE_SD, 0.8, 0.5), tests)
    n = 20_000
    values = np.ones((n, len(candidate.parameters)))
    result = at_draws(candidate, values)
    pairings = [test.pairing for test in tests]
    terms = datum_terms(candidate, values, result, pairings, (2, n // 2), np.random.default_rng(1))
    dense = Dense(candidate, values[:1])
    of_frequencies = [i for i, kind in enumerate(dense.kinds) if kind[3] == "frequency"]
    covariance = dense.covariance[np.ix_(of_frequencies, of_frequencies)]
    sds = np.sqrt(np.diag(covariance))
    drawn = np.corrcoef(terms.predicted_hz.reshape(n, -1).T)
    np.testing.assert_allclose(drawn, covariance / np.outer(sds, sds), atol=5.0 / math.sqrt(n))


@pytest.mark.parametrize(
    ("error", "tests", "message"),
    [
        (bs.ErrorModel(0.02, 0.05, 0.5), "any", "pairing 'any' needs independent prediction err"),
        (bs.ErrorModel(0.02, 0.05, 0.5), {1: "x", 2: "y"}, "no paired mode has the same label in"),
        (bs.ErrorModel(0.02, 0.05, 0.5, 0.5), {1: "mode 2", 2: "mode 1"}, "one label and one num"),
        (bs.ErrorModel(0.02, 0.05, 0.5, 0.5), {1: "x"}, "'mode 1' is model mode 1 and 'x' model"),
    ],
)
def test_tests_that_correlated_errors_cannot_join_are_refused(error, tests, message):
    second = configuration("b", 1.5, (1, 2), 2, renamed={} if tests == "any" else tests)
    if tests == "any":
        second = replace(second, pairing="any")
    with pytest.raises(ValueError, match=f"model class 'joint': .*{message}"):
        model_class(error, (configuration("a", 1.0, (1, 2), 1), second))


def test_labels_may_have_other_numbers_where_modes_are_not_correlated():
    """An appendage adds a mode: '2' stays the same mode, whatever its number."""
    second = configuration("b", 1.5, (1, 2, 3), 2, renamed={2: "appendage", 3: "mode 2"})
    tests = (configuration("a", 1.0, (1, 2), 1), second)
    candidate = model_class(bs.ErrorModel(SD, SHAPE_SD, 0.8), tests)
    groups = candidate.correlated_errors.groups
    named = [[candidate.correlated_errors.modes[i][:2] for i in group] for group in groups]
    assert named == [[(0, "mode 1"), (1, "mode 1")], [(0, "mode 2"), (1, "mode 2")]]


@pytest.mark.parametrize(
    ("tests", "modes"), [(0.0, 0.0), (0.8, 0.0), (0.0, 0.6), (0.8, 0.6), (0.3, 0.9)]
)
def test_the_least_error_is_that_of_the_difference_that_data_determine_best(tests, modes):
    """The smallest eigenvalue of σ² ρ_tests^[t ≠ s] ρ_modes^|i - j| of 300 modes in two tests.

    It comes down to its bound for any number of modes like 1/n². Shapes share ρ_tests alone.
    """
    mode = np.arange(300)
    of_modes = modes ** np.abs(mode[:, None] - mode)
    of_tests = np.array([[1.0, tests], [tests, 1.0]])
    of_frequencies = np.linalg.eigvalsh(np.kron(of_tests, of_modes))[0]
    of_shapes = np.linalg.eigvalsh(of_tests)[0]
    two = tuple(
        configuration(name, mass, (1, 2), seed, ("floor 1", "floor 2", "floor 4"))
        for name, mass, seed in (("a", 1.0, 1), ("b", 2.0, 2))
    )
    candidate = model_class(bs.ErrorModel(SD, SHAPE_SD, tests, modes), two)
    for _, likelihood, own in candidate.parts(values_of(candidate)):
        frequency, shape = likelihood.least_errors(own)
        # Of the mode with the smallest identification errors, none of frequency and 0.01 of shape.
        np.testing.assert_allclose(frequency, SD * math.sqrt(of_frequencies), rtol=2e-3)
        np.testing.assert_allclose(shape, math.sqrt(SHAPE_SD**2 * of_shapes + 0.01**2), rtol=1e-9)


FIXED = bs.ErrorModel(0.001, 0.006)  # with which no modes are close
INFERRED = bs.ErrorModel(*(
    bs.Parameter(name, bs.LogNormal(size, 0.5)) for name, size in (("sf", 0.001), ("ss", 0.006))
))  # fmt: skip
PAIRING = {"a": 1, "c": 4, "b": 2}


def identified(augmented, missing=True):
    """Modes 1, 2, 4 of four, a little off: one without a sensor, one without a shape."""
    frequencies, shapes = augmented.modes(augmented.prior_medians())
    rng = np.random.default_rng(3)
    modes = []
    for label, i in (("a", 0), ("b", 1), ("c", 3)):
        shape = shapes[0, :3, i] / np.linalg.norm(shapes[0, :3, i])
        shape = shape + 0.01 * rng.standard_normal(3)
        if missing and label == "b":
            shape[1] = np.nan
        hz = frequencies[0, i] * (1.0 + 0.005 * rng.standard_normal())
        modes.append(bs.IdentifiedMode(label, hz, None if missing and label == "c" else shape))
    factor = 0.004 * np.random.default_rng(0).standard_normal((12, 12))
    return bs.ModalData(tuple(modes), (0.0, 6.0), FLOORS, covariance=factor @ factor.T)


def drawn(model_class, n=6):
    z = 0.03 * np.random.default_rng(1).standard_normal((n, len(model_class.parameters)))
    return model_class.values(z)


def test_misfit_is_chi_square_of_all_errors_together_and_of_each_mode(augmented):
    joint = bs.ModelClass("joint", augmented, identified(augmented), INFERRED, pairing=PAIRING)
    values = drawn(joint)
    (modes,) = at_draws(joint, values).modes
    result = misfit(joint.likelihoods[0], values, modes, np.random.default_rng(0))
    _, numbers = joint.correlated_errors.independent_residuals(values, [modes])
    squares = (numbers[0] ** 2).sum(axis=1)
    joint_log_p = log_chi_square(squares, numbers[0].shape[1])
    for b, row in enumerate(values):
        dense = Dense(joint, row[None])
        everything = range(len(dense.kinds))
        of_a, of_b = ([i for i in everything if dense.kinds[i][1::2] == (each, "shape")]
                      for each in "ab")  # fmt: skip
        for found, rows in zip((joint_log_p[b], *result.shape_log_p[b, :2]),
                               (everything, of_a, of_b), strict=True):  # fmt: skip
            residual, covariance = dense.residuals[rows], dense.covariance[np.ix_(rows, rows)]
            squares = residual @ np.linalg.solve(covariance, residual)
            assert found == pytest.approx(chi2.logsf(squares, len(rows)), rel=1e-8)


def test_expected_macs_are_those_of_the_directions_in_which_a_shape_errs(augmented):
    data = identified(augmented, missing=False)
    across = np.cross(data.mode("b").unit_shape, [1.0, 0.0, 0.0])
    covariance = 1e-6 * np.eye(12)
    # Mode b errs in one direction, the others in two equally.
    covariance[6:9, 6:9] = 1e-4 * np.outer(across, across) / (across @ across)
    data = replace(data, covariance=None, modes=tuple(
        replace(mode, frequency_cov=None, shape_sd=None) for mode in data.modes
    ))  # fmt: skip
    data = replace(data, covariance=covariance)
    joint = bs.ModelClass("joint", augmented, data, bs.ErrorModel(1e-6, 1e-6), pairing=PAIRING)
    values = drawn(joint)
    likelihood = joint.likelihoods[0]
    result = misfit(likelihood, values, likelihood.compared_modes(values), np.random.default_rng(0))
    exact = 0.5 * np.array([1e-6 * chi2.ppf(0.95, 2), 1e-4 * chi2.ppf(0.95, 1)])
    np.testing.assert_allclose(result.expected_macs[:, 0], (1.0 - exact[0]) ** 2, atol=1e-9)
    np.testing.assert_allclose(result.expected_macs[:, 1], (1.0 - exact[1]) ** 2, atol=1e-9)


def test_paired_modes_are_one_datum_and_predicted_together(augmented):
    data = identified(augmented)
    pairing = {"a": 1, "c": 4}
    joint = bs.ModelClass("joint", augmented, data, FIXED, pairing=pairing)
    n = 20_000
    values = np.ones((n, len(joint.parameters)))
    result = at_draws(joint, values)
    np.testing.assert_allclose(result.log_likelihoods.sum(axis=1), joint.log_likelihood(values))
    terms = datum_terms(joint, values, result, [pairing], (2, n // 2), np.random.default_rng(1))
    assert terms.data == ("a and c", "b", "no other mode")
    predicted = terms.predicted_hz.reshape(n, -1)
    covariance = data.covariance[np.ix_([0, 2], [0, 2])] + 0.001**2 * np.eye(2)
    correlation = covariance[0, 1] / np.sqrt(covariance.diagonal().prod())
    drawn_together = np.corrcoef(predicted[:, 0], predicted[:, 2])[0, 1]
    assert drawn_together == pytest.approx(correlation, abs=5.0 / math.sqrt(n))


def test_a_stored_result_keeps_the_joint_errors(augmented, tmp_path, make_posterior):
    data = identified(augmented)
    joint = bs.ModelClass("joint", augmented, data, FIXED, pairing=PAIRING)
    names, digest = joint.parameter_names, joint.data_digest
    posteriors = [make_posterior("joint", names=names, data_digest=digest)]
    study, settings = bs.Study("joint", [joint]), bs.SamplingSettings()
    bs.save_result(ranked(study, posteriors, 0, settings, bs.Run()), tmp_path / "result")
    stored = bs.load_result(tmp_path / "result")
    np.testing.assert_array_equal(stored.data.covariance, data.covariance)
    record = stored.record.model_class("joint").configurations[0]
    assert record.covariance_digest == data.covariance_digest


@pytest.mark.parametrize("rounding", [0.0, 1e-40, 1e-20])
def test_a_direction_without_error_says_nothing_of_frequencies_but_by_rounding(rounding):
    zero = np.zeros((1, 1))
    errors = joint_errors.JointErrors(
        frequencies=joint_errors.ErrorGroup([0], zero + 4.0, joint_errors.Separation(zero, zero)),
        shapes=[0],
        variances=np.array([2.0, rounding]),
        axes=np.eye(2)[None],
        between=np.array([[1.0], [1e-17]]),
        identified=np.array([[0.0, 0.0]]),
        single_var=np.array([1.0]),
        dimensions=np.array([2.0]),
    )
    # 4 - 1²/2, of a frequency given the shape along the first axis.
    np.testing.assert_allclose(errors.least_variances[0], [3.5])
