"""Joint identification errors: misfits, predictions and storage against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from dense_errors import Dense
from scipy.stats import chi2

import bayes_ssi as bs
from bayes_ssi.inference.criticism.misfit import log_chi_square, misfit
from bayes_ssi.inference.likelihood.joint_errors import ErrorGroup, JointErrors, Separation
from bayes_ssi.inference.posterior.model_at_draws import at_draws, datum_terms
from bayes_ssi.studies.ranking.checks import ranked

SENSORS = ("floor 1", "floor 2", "floor 3")
FIXED = bs.ErrorModel(0.001, 0.006)  # with which no modes are close
INFERRED = bs.ErrorModel(*(
    bs.Parameter(name, bs.LogNormal(size, 0.5)) for name, size in (("sf", 0.001), ("ss", 0.006))
))  # fmt: skip
PAIRING = {"a": 1, "c": 4, "b": 2}


@pytest.fixture
def building(augmented):
    """Three floors and an infill: four modes, four parameters."""
    return augmented


def random_covariance(m, n, seed=0, size=0.004):
    factor = size * np.random.default_rng(seed).standard_normal((m + m * n, m + m * n))
    return factor @ factor.T


def identified(building, missing=True):
    """Modes 1, 2, 4 of the building, a little off: one without a sensor, one without a shape."""
    frequencies, shapes = building.modes(building.prior_medians())
    rng = np.random.default_rng(3)
    modes = []
    for label, i in (("a", 0), ("b", 1), ("c", 3)):
        shape = shapes[0, :3, i] / np.linalg.norm(shapes[0, :3, i])
        shape = shape + 0.01 * rng.standard_normal(3)
        if missing and label == "b":
            shape[1] = np.nan
        modes.append(
            bs.IdentifiedMode(
                label,
                frequencies[0, i] * (1.0 + 0.005 * rng.standard_normal()),
                None if missing and label == "c" else shape,
            )
        )
    return bs.ModalData(tuple(modes), (0.0, 6.0), SENSORS, covariance=random_covariance(3, 3))


def drawn(model_class, n=6):
    z = 0.03 * np.random.default_rng(1).standard_normal((n, len(model_class.parameters)))
    return model_class.values(z)


def test_misfit_is_chi_square_of_all_errors_together_and_of_each_mode(building):
    data = identified(building)
    joint = bs.ModelClass("joint", building, data, INFERRED, pairing=PAIRING)
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


def test_expected_macs_are_those_of_the_directions_in_which_a_shape_errs(building):
    data = identified(building, missing=False)
    across = np.cross(data.mode("b").unit_shape, [1.0, 0.0, 0.0])
    covariance = 1e-6 * np.eye(12)
    # Mode b errs in one direction, the others in two equally.
    covariance[6:9, 6:9] = 1e-4 * np.outer(across, across) / (across @ across)
    data = replace(data, covariance=None, modes=tuple(
        replace(mode, frequency_cov=None, shape_sd=None) for mode in data.modes
    ))  # fmt: skip
    data = replace(data, covariance=covariance)
    error = bs.ErrorModel(1e-6, 1e-6)
    joint = bs.ModelClass("joint", building, data, error, pairing=PAIRING)
    values = drawn(joint)
    likelihood = joint.likelihoods[0]
    modes = likelihood.compared_modes(values)
    result = misfit(likelihood, values, modes, np.random.default_rng(0))
    exact = 0.5 * np.array([1e-6 * chi2.ppf(0.95, 2), 1e-4 * chi2.ppf(0.95, 1)])
    np.testing.assert_allclose(result.expected_macs[:, 0], (1.0 - exact[0]) ** 2, atol=1e-9)
    np.testing.assert_allclose(result.expected_macs[:, 1], (1.0 - exact[1]) ** 2, atol=1e-9)


def test_paired_modes_are_one_datum_and_predicted_together(building):
    data = identified(building)
    pairing = {"a": 1, "c": 4}
    joint = bs.ModelClass("joint", building, data, FIXED, pairing=pairing)
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


def test_a_stored_result_keeps_the_joint_errors(building, tmp_path, make_posterior):
    data = identified(building)
    joint = bs.ModelClass("joint", building, data, FIXED, pairing=PAIRING)
    names, digest = joint.parameter_names, joint.data_digest
    posteriors = [make_posterior("joint", names=names, data_digest=digest)]
    study, settings = bs.Study("joint", [joint]), bs.SamplingSettings()
    ranking = ranked(study, posteriors, 0, settings, bs.Run())
    bs.save_result(ranking, tmp_path / "result")
    stored = bs.load_result(tmp_path / "result")
    np.testing.assert_array_equal(stored.data.covariance, data.covariance)
    record = stored.record.model_class("joint").configurations[0]
    assert record.covariance_digest == data.covariance_digest


@pytest.mark.parametrize("rounding", [0.0, 1e-40, 1e-20])
def test_a_direction_without_error_says_nothing_of_frequencies_but_by_rounding(rounding):
    zero = np.zeros((1, 1))
    errors = JointErrors(
        frequencies=ErrorGroup([0], zero + 4.0, Separation(zero, zero)),
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
