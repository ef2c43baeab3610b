"""Starts in narrow regions, against quadrature and exact fits computed elsewhere."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.special import logsumexp

import bayes_ssi as bs
from bayes_ssi.inference.calibration.narrow_regions import starts_in_narrow_regions
from bayes_ssi.inference.sampling.multistart import search_maxima
from bayes_ssi.inference.sampling.target import Target, log_standard_normal

# The four-storey benchmark building of 12 degrees of freedom (Johnson, Lam, Katafygiotis and Beck
# 2004): masses in kg, moments of inertia in kg m², stiffnesses of every storey in N/m and N m.
MASSES = np.array([3452.4, 2652.4, 2652.4, 1809.9])
INERTIAS = np.array([3819.4, 2986.1, 2986.1, 2056.9])
STIFFNESSES = {"x": 106.60e6, "y": 67.90e6, "t": 232.02e6}
FACTORS = {"x": 1.1, "y": 0.9, "t": 1.05}
SENSORS = tuple(f"floor {i} {direction}" for i in (2, 4) for direction in ("x", "y", "torsion"))


def building(factors):
    x, y, t = ((STIFFNESSES[name] * factors[name],) * 4 for name in "xyt")
    return bs.ShearBuilding3D(tuple(MASSES), tuple(np.sqrt(INERTIAS / MASSES)), x, y, t)


def benchmark_class(error):
    """Any pairing of six modes that one factor a direction explains but for ``error``."""
    rng = np.random.default_rng(3)
    truth = building(FACTORS)
    frequencies, shapes = truth.modes(np.zeros((1, 0)))
    rows = [truth.degrees_of_freedom.index(sensor) for sensor in SENSORS]
    modes = []
    for j, shape in enumerate(shapes[0, rows, :6].T):
        noise = error * rng.standard_normal(1 + len(rows))
        measured = shape / np.linalg.norm(shape) + noise[1:]
        modes.append(bs.IdentifiedMode(str(j + 1), frequencies[0, j] * (1.0 + noise[0]), measured))
    data = bs.ModalData(tuple(modes), (0.0, 42.0), SENSORS)
    unknown = {name: bs.Parameter(name, bs.LogNormal(1.0, 0.3)) for name in FACTORS}
    errors = bs.ErrorModel(error, error)
    return bs.ModelClass("benchmark", building(unknown), data, errors, pairing="any")


def log_evidence_near_truth(candidate, error):
    """By the trapezoidal rule, ten standard deviations to either side of the true factors."""
    truth = [p.prior.to_normal(FACTORS[p.name]) for p in candidate.parameters]
    # A factor's standard error from one frequency: 2 σ as a fraction, over the prior's.
    reach = 10.0 * 2.0 * error / np.sqrt(np.log1p(0.3**2))
    line, step = np.linspace(-reach, reach, 25, retstep=True)
    z = truth + np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    return logsumexp(candidate.log_likelihood_at(z) + log_standard_normal(z)) + 3.0 * np.log(step)


def searched(candidate, starts):
    target = Target(candidate.log_likelihood_at, len(candidate.parameters), suggest_starts=starts)
    return search_maxima(target, 2, np.random.SeedSequence(0))


def test_the_building_has_the_published_frequencies():
    frequencies = building(dict.fromkeys("xyt", 1.0)).modes(np.zeros((1, 0))).frequencies_hz[0]
    np.testing.assert_allclose(frequencies[:3], [9.41, 11.79, 16.38], atol=5e-3)


def test_precise_modes_of_any_pairing_are_found():
    """Without suggested starts no two of twelve searches find them, at ten times these errors."""
    error = 1e-5
    candidate = benchmark_class(error)
    exact = log_evidence_near_truth(candidate, error)
    result = searched(candidate, partial(starts_in_narrow_regions, candidate, None))
    assert result.reached_by[:, 0].all()
    # Laplace's approximation is accurate where the posterior is this narrow.
    assert result.maxima.laplace_estimate.log_evidence == pytest.approx(exact, abs=0.005)


def test_all_exact_fits_of_a_given_pairing_are_reached(model_classes):
    """Four stiffness factors fit the frequencies exactly at four points, as calibration lists."""
    given = model_classes["3"]
    error = bs.ErrorModel(frequency_cov=1e-4, shape_sd=0.05)
    candidate = replace(given, name="3 on frequencies", error=error)
    test = candidate.configuration()
    test = replace(test, data=test.data.without_shapes())
    candidate = replace(candidate, configurations=(test,))
    rngs = map(np.random.default_rng, range(12))
    starts = [starts_in_narrow_regions(candidate, None, rng).z for rng in rngs]
    values = candidate.values(np.concatenate(starts))
    for exact in ([1.0, 1.0, 1.0, 1.0], [1.0634, 0.8877, 1.1313, 0.9364]):
        nearest = np.abs(values - exact).max(axis=1).min()
        assert nearest < 5e-4  # at errors of a tenth of a thousandth


def test_inferred_errors_are_drawn_down_to_an_exact_fit(model_classes):
    """Exact data: the density rises as errors fall, until their prior holds against it."""
    exact = replace(model_classes["3"], error=bs.ErrorModel()).with_any_pairing("inferred")
    starts = partial(starts_in_narrow_regions, exact, None)
    z = starts(np.random.default_rng(0)).z
    heights = exact.log_likelihood_at(z) + log_standard_normal(z)
    result = searched(exact, starts)
    assert heights.max() == pytest.approx(result.maxima.log_posteriors.max(), abs=1.0)
    assert (z[heights.argmax(), 4:] < -2.0).all()


def half_failing(k, m):
    if k < 100.0 or m < 0.0:
        raise RuntimeError("no convergence")
    return np.sqrt(np.array([1.0, 4.0]) * k / m) / (2.0 * np.pi), None


def failing_class(m):
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.5))
    structure = bs.FunctionStructure(half_failing, {"k": 100.0 * k, "m": m}, n_modes=2)
    frequencies = np.sqrt(np.array([1.0, 4.0]) * 1.3) / (2.0 * np.pi)
    modes = tuple(bs.IdentifiedMode(str(j), f) for j, f in enumerate(frequencies, 1))
    data, error = bs.ModalData(modes, (0.0, 1.0), ()), bs.ErrorModel(1e-5, 1e-5)
    return bs.ModelClass("failing", structure, data, error, pairing="any")


def test_models_that_fail():
    candidate = failing_class(100.0)
    suggested = starts_in_narrow_regions(candidate, None, np.random.default_rng(0))
    assert np.abs(candidate.values(suggested.z) - 1.3).min() < 1e-4
    nothing = starts_in_narrow_regions(failing_class(-1.0), None, np.random.default_rng(0))
    assert nothing.z.shape == (0, 1)
    assert nothing.n_evaluations > 0
