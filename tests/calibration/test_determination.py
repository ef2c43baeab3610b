"""What data determine of parameters and what they leave open, against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import bayes_ssi as bs

SIGMA_F = 0.01
COV_A, COV_B = 0.2, 0.4
SD_A, SD_B = (math.sqrt(math.log1p(cov**2)) for cov in (COV_A, COV_B))
A, B = bs.Parameter("ka", bs.LogNormal(2.0, COV_A)), bs.Parameter("kb", bs.LogNormal(1.0, COV_B))


def in_parallel():
    """A storey and an infill of stiffnesses ka and kb; a total mass of 1."""
    infill = bs.InPlaneInfill((0, 1), mass=1e-9, stiffness=B)
    return bs.ShearBuilding((1.0,), (A,)).with_element(infill)


def in_series():
    """Two storeys, the mass between them negligible."""
    return bs.ShearBuilding((1e-9, 1.0), (A, B))


def sum_of(ka, kb):
    return ka + kb, np.array([ka, kb]) / (ka + kb)


def series_of(ka, kb):
    k = 1.0 / (1.0 / ka + 1.0 / kb)
    return k, np.array([k / ka, k / kb])


@pytest.mark.parametrize(("build", "stiffness"), [(in_parallel, sum_of), (in_series, series_of)])
def test_one_frequency_determines_neither_of_two_springs(build, stiffness):
    """d ln f = ½ Σ w d ln k, with w the share of each spring in the stiffness k(ka, kb)."""
    measured = 1.2 * stiffness(2.0, 1.0)[0]
    data = bs.ModalData((bs.IdentifiedMode("1", math.sqrt(measured) / (2 * math.pi)),), (0.0, 1.0))
    candidate = bs.ModelClass("c", build(), data, bs.ErrorModel(SIGMA_F), pairing={"1": 1})
    calibration = bs.calibrate(candidate, n_starts=8)
    ka, kb = calibration.best.values
    k, share = stiffness(ka, kb)
    assert k == pytest.approx(measured, rel=1e-6)
    # The nearest such point: z is along the gradient of ln k, which is w σ for log-normal priors.
    z = np.log([ka / 2.0, kb / 1.0]) / [SD_A, SD_B]
    gradient = share * [SD_A, SD_B]
    assert z[0] / z[1] == pytest.approx(gradient[0] / gradient[1], rel=1e-3)
    assert calibration.standard_errors == (math.inf, math.inf)
    assert calibration.undetermined_directions == 1
    assert not calibration.determines_all


def product_frequencies(a, b, c, d):  # noqa: ARG001 - no frequency depends on d
    return np.sqrt([a, 4.0 * b * c]), None


def one_two_and_none(a_prior=None):
    """Frequencies √a and 2 √(b c): a by itself, b and c together, and d not at all."""
    priors = {name: bs.LogNormal(1.0, 0.3) for name in "abc"} | {"d": bs.Normal(0.0, 1.0)}
    priors["a"] = a_prior or priors["a"]
    arguments = {name: bs.Parameter(name, prior) for name, prior in priors.items()}
    structure = bs.FunctionStructure(product_frequencies, arguments, n_modes=2)
    data = bs.ModalData((bs.IdentifiedMode("1", 1.1), bs.IdentifiedMode("2", 2.1)), (0.0, 5.0))
    error = bs.ErrorModel(SIGMA_F)
    return bs.ModelClass("c", structure, data, error, pairing={"1": 1, "2": 2})


def test_what_is_determined_alone_and_what_is_not():
    calibration = bs.calibrate(one_two_and_none(), n_starts=8)
    a, b, c, d = calibration.best.values
    # The nearest exact fit shares the change between b and c, and leaves d.
    expected = (1.1**2, 2.1 / 2.0, 2.1 / 2.0, 0.0)
    assert (a, b, c, d) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert calibration.undetermined_directions == 2
    assert calibration.standard_errors[0] == pytest.approx(2.0 * SIGMA_F * a, rel=1e-5)
    assert calibration.standard_errors[1:] == (math.inf,) * 3


def test_the_priors_pull():
    """One equation for each: the frequency's residual over its error against z."""
    calibration = bs.calibrate(one_two_and_none(), n_starts=4, with_prior=True)
    sd = math.sqrt(math.log1p(0.3**2))

    def exponent(z, n, measured):
        """n parameters at the same z give the frequency e^(n sd z / 2)."""
        return ((math.exp(0.5 * n * sd * z) / measured - 1.0) / SIGMA_F) ** 2 + n * z * z

    def expected(n, measured):
        return math.exp(sd * minimize_scalar(exponent, args=(n, measured)).x)

    a, b, c, d = calibration.best.values
    assert a == pytest.approx(expected(1, 1.1), rel=1e-6)
    assert (b, c) == pytest.approx([expected(2, 1.05)] * 2, rel=1e-6)
    assert d == pytest.approx(0.0, abs=1e-9)
    assert calibration.with_prior
    assert calibration.undetermined_directions == 0
    assert calibration.determines_all
    errors = calibration.standard_errors
    assert errors[3] == pytest.approx(1.0, rel=1e-6)  # that of its prior
    # To first order, precision of ln a: (1/2 f/f_e / σ_f)² + 1/sd².
    precision = (0.5 * math.sqrt(a) / 1.1 / SIGMA_F) ** 2 + sd**-2
    assert errors[0] == pytest.approx(a / math.sqrt(precision), rel=1e-5)


@pytest.mark.parametrize("seed", [2, 11])
def test_with_the_prior_errors_do_not_drive_what_the_data_leave_open(seed):
    """18 storeys and the shapes of three modes, with errors, at three floors."""
    n = 18
    factors = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in range(1, n + 1)]
    building = bs.ShearBuilding((1000.0,) * n, [2e6 * k for k in factors])
    rng = np.random.default_rng(seed)
    true = rng.normal(0.0, 0.2, n)
    frequencies, shapes = building.modes(np.exp(true[None]))
    modes = [
        bs.IdentifiedMode(
            str(i + 1),
            frequencies[0, i] * (1.0 + 0.003 * rng.normal()),
            shapes[0, [5, 11, 17], i] * (1.0 + 0.01 * rng.normal(size=3)),
        )
        for i in range(3)
    ]
    data = bs.ModalData(modes, (0.0, 4.0), sensors=("floor 6", "floor 12", "floor 18"))
    candidate = bs.ModelClass(
        "tall", building, data, bs.ErrorModel(0.01, 0.05), pairing={"1": 1, "2": 2, "3": 3}
    )
    calibration = bs.calibrate(candidate, n_starts=2, with_prior=True)
    assert calibration.n_converged == 2
    assert len(calibration.minima) == 1
    for mode in calibration.best.modes:  # within the errors of the data
        assert mode.model_hz == pytest.approx(mode.identified_hz, rel=3.0 * SIGMA_F)
        assert mode.mac > 1.0 - 3.0 * 0.05**2
    errors = np.log(calibration.best.values) - true
    sds = np.divide(calibration.standard_errors, calibration.best.values)
    assert (np.abs(errors) < 3.0 * sds).all()
