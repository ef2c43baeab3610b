"""Joint identification errors against multivariate normal densities, quadrature, closed forms."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import chi2, multivariate_normal

import bayes_ssi as bs
from bayes_ssi.inference.criticism.misfit import log_chi_square, misfit
from bayes_ssi.inference.likelihood.joint_errors import ErrorGroup, JointErrors, Separation
from bayes_ssi.inference.posterior.model_at_draws import at_draws, datum_terms

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


def plane_of(mode):
    """Two directions, or one, at right angles to the shape, as columns of (3, d - 1)."""
    measured = np.isfinite(mode.unit_shape)
    plane = np.zeros((3, measured.sum() - 1))
    plane[measured] = np.linalg.svd(mode.unit_shape[measured][None])[2][1:].T
    return plane


def residuals(model_class, values, labels):
    """Residuals of frequencies, then of shapes in their planes, row by row as defined."""
    data, rows = model_class.data, []
    likelihood = model_class.likelihoods[0]
    modes = likelihood.modes(values)
    seen = likelihood.shapes_at_sensors(modes)
    for b in range(len(values)):
        of_shapes, of_frequencies = [], []
        for label in labels:
            mode, number = data.mode(label), model_class.pairing[label] - 1
            of_frequencies.append(modes.frequencies_hz[b, number] / mode.frequency_hz - 1.0)
            if mode.scored_shape is None:
                continue
            own = np.nan_to_num(mode.unit_shape)
            model = np.where(np.isfinite(mode.unit_shape), seen[b, :, number], 0.0)
            model /= np.linalg.norm(model) * np.sign(model @ own)
            tangent = model - (model @ own) * own
            chord = math.sqrt(2.0 - 2.0 * model @ own)
            of_shapes += list(plane_of(mode).T @ tangent * chord / np.linalg.norm(tangent))
        rows.append([*of_frequencies, *of_shapes])
    return np.array(rows)


def covariance_in_planes(data, labels):
    """The covariance of such residuals, and for each of them the identified mode and its kind."""
    m, n = len(data.modes), len(data.sensors)
    columns, kinds = [], []
    for label in labels:
        column = np.zeros(m + m * n)
        column[data.labels.index(label)] = 1.0
        columns.append(column)
        kinds.append((label, "frequency"))
    for label in labels:
        j = data.labels.index(label)
        if data.modes[j].scored_shape is None:
            continue
        for direction in plane_of(data.modes[j]).T:
            column = np.zeros(m + m * n)
            column[m + n * j : m + n * (j + 1)] = direction
            columns.append(column)
            kinds.append((label, "shape"))
    basis = np.array(columns)
    return basis @ data.covariance @ basis.T, kinds


def drawn(model_class, n=6):
    z = 0.03 * np.random.default_rng(1).standard_normal((n, len(model_class.parameters)))
    return model_class.values(z)


@pytest.mark.parametrize("error", [FIXED, INFERRED], ids=["fixed", "inferred"])
@pytest.mark.parametrize("missing", [True, False], ids=["partial", "whole"])
def test_residuals_have_their_joint_normal_density(building, error, missing):
    data = identified(building, missing)
    joint = bs.ModelClass("joint", building, data, error, pairing=PAIRING)
    alone = bs.ModelClass(
        "alone", building, data.without_covariance(), error, pairing=joint.pairing
    )
    values = drawn(joint)
    labels = ("a", "b", "c")
    covariance, kinds = covariance_in_planes(data, labels)
    expected = alone.log_likelihood(values)
    for b, residual in enumerate(residuals(joint, values, labels)):
        sf, ss = values[b, -2:] if error is INFERRED else (0.001, 0.006)
        added = np.array([sf if kind == "frequency" else ss for _, kind in kinds])
        single = [
            data.mode(label).frequency_cov if kind == "frequency" else data.mode(label).shape_sd
            for label, kind in kinds
        ]
        expected[b] += multivariate_normal.logpdf(residual, cov=covariance + np.diag(added**2))
        expected[b] -= multivariate_normal.logpdf(
            residual, cov=np.diag(np.square(single) + added**2)
        )
    np.testing.assert_allclose(joint.log_likelihood(values), expected, rtol=1e-10)


def test_any_pairing_takes_each_modes_own_part(building):
    data = identified(building)
    m, n = 3, 3
    mode_of = np.r_[np.arange(m), np.repeat(np.arange(m), n)]
    blocks = replace(data, covariance=data.covariance * np.equal.outer(mode_of, mode_of))
    model_class = bs.ModelClass("any", building, data, INFERRED, pairing="any")
    values = drawn(model_class)
    terms = []
    for numbers in itertools.product(range(5), repeat=3):
        pairing = {label: i for label, i in zip("abc", numbers, strict=True) if i}
        if len(set(pairing.values())) < len(pairing):
            continue
        one = bs.ModelClass("one", building, blocks, INFERRED, pairing=pairing)
        columns = [model_class.parameter_names.index(name) for name in one.parameter_names]
        terms.append(one.log_likelihood(values[:, columns]))
    np.testing.assert_allclose(
        model_class.log_likelihood(values), logsumexp(terms, axis=0), rtol=1e-11
    )


class Turning(bs.Structure):
    """Two modes whose frequencies and shapes are linear in two parameters, or nearly."""

    parameters = tuple(bs.Parameter(name, bs.Normal(0.0, 1.0)) for name in "pq")
    degrees_of_freedom = ("x", "y")
    n_modes = 2
    effects = 0.004 * np.array([[1.0, 0.3], [0.4, -0.8], [-0.7, 0.5], [0.2, 1.1]])

    def modes(self, values):
        x = (self.effects[:, None] * values).sum(axis=2)  # (4, B)
        angles = np.array([0.5, 1.9])[:, None] + 2.0 * np.arcsin(0.5 * x[2:])
        frequencies = np.array([2.0, 3.0]) * (1.0 + x[:2].T)
        return bs.Modes(frequencies, np.stack([np.cos(angles).T, np.sin(angles).T], axis=1))


def test_evidence_and_posterior_of_a_linear_model():
    """Residuals linear in parameters and normal: the evidence is that of a normal distribution."""
    structure = Turning()
    factor = 0.003 * np.random.default_rng(5).standard_normal((4, 4))
    in_planes = factor @ factor.T + 1e-6 * np.eye(4)
    at = np.array([0.003, -0.004, 0.005, 0.002])  # of the data, about the prior's mean
    angles = np.array([0.5, 1.9]) + 2.0 * np.arcsin(0.5 * at[2:])
    modes = tuple(
        bs.IdentifiedMode(label, f, np.array([math.cos(angle), math.sin(angle)]))
        for label, f, angle in zip("ab", np.array([2.0, 3.0]) * (1.0 + at[:2]), angles, strict=True)
    )
    basis = np.zeros((6, 4))
    basis[:2, :2] = np.eye(2)
    for j, angle in enumerate(angles):
        basis[2 + 2 * j : 4 + 2 * j, 2 + j] = -math.sin(angle), math.cos(angle)
    data = bs.ModalData(modes, (0.0, 5.0), ("x", "y"), covariance=basis @ in_planes @ basis.T)
    error = bs.ErrorModel(0.0004, 0.001)  # with which modes at 2 and 3 Hz are not close
    candidate = bs.ModelClass("linear", structure, data, error, pairing={"a": 1, "b": 2})
    posterior = bs.sample(candidate, seed=1)
    covariance = in_planes + np.diag([0.0004, 0.0004, 0.001, 0.001]) ** 2
    # r_f = f/f_e - 1 is linear in the parameters with f_e in the denominator.
    residual = np.concatenate([1.0 / (1.0 + at[:2]) - 1.0, -at[2:]])
    effects = structure.effects.copy()
    effects[:2] /= (1.0 + at[:2])[:, None]
    exact = multivariate_normal.logpdf(residual, cov=covariance + effects @ effects.T)
    # Detected, density in Hz, and half the density at either sign of a shape.
    exact += 2.0 * math.log(0.95) - 0.1 - np.log(data.frequencies_hz).sum() - 2.0 * math.log(2.0)
    evidence = posterior.evidence
    # The circle's curvature changes normalisers by σ²/8 and angles by x³/24: both below 10⁻⁴.
    assert evidence.log_evidence == pytest.approx(exact, abs=1e-3 + 4.0 * evidence.error)
    precision = effects.T @ np.linalg.solve(covariance, effects) + np.eye(2)
    sds = np.sqrt(np.linalg.inv(precision).diagonal())
    mean = np.linalg.solve(precision, -effects.T @ np.linalg.solve(covariance, residual))
    for row, m, sd in zip(posterior.summary, mean, sds, strict=True):
        assert row.mean == pytest.approx(m, abs=5.0 * row.mean_error)
        assert row.sd == pytest.approx(sd, rel=0.05)
    assert posterior.failed_checks == ()


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
        for labels in (("a", "b", "c"), ("a",), ("b",)):
            covariance, kinds = covariance_in_planes(data, labels)
            added = np.array([row[-2] if kind == "frequency" else row[-1] for _, kind in kinds])
            covariance += np.diag(added**2)
            (residual,) = residuals(joint, row[None], labels)
            if len(labels) == 3:
                squares = residual @ np.linalg.solve(covariance, residual)
                expected = chi2.logsf(squares, len(kinds))
                assert joint_log_p[b] == pytest.approx(expected, rel=1e-8)
                continue
            squares = residual[1:] @ np.linalg.solve(covariance[1:, 1:], residual[1:])
            j = data.labels.index(labels[0])
            expected = chi2.logsf(squares, len(kinds) - 1)
            assert result.shape_log_p[b, j] == pytest.approx(expected, rel=1e-8)


def test_expected_macs_are_those_of_the_directions_in_which_a_shape_errs(building):
    data = identified(building, missing=False)
    plane = plane_of(data.mode("b"))
    covariance = 1e-6 * np.eye(12)
    # Mode b errs in one direction, the others in two equally.
    covariance[6:9, 6:9] = 1e-4 * np.outer(plane[:, 0], plane[:, 0])
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


def test_a_stored_result_keeps_the_joint_errors(building, tmp_path):
    data = identified(building)
    joint = bs.ModelClass("joint", building, data, FIXED, pairing=PAIRING)
    coarse = bs.SamplingSettings(log_evidence_error=0.1)
    ranking = bs.rank(bs.Study("joint", [joint]), settings=coarse)
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
