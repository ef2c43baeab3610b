"""Calibration against the paper's tables and closed forms: minima, what data leave open."""

import math

import numpy as np
import pytest
from conftest import assert_refused
from scipy.optimize import minimize_scalar

import bayes_ssi as bs

# The paper's Table 1: normalised parameters, and d in per cent.
TABLE_1 = {
    "1-a": ([0.948, 1.159, 0.850], 13.0),
    "1-b": ([1.350, 0.6855, 1.343], 33.6),  # k2 is printed as 0.685; unrounded it is 0.6855
    "2": ([0.985, 1.045, 1.004], 2.7),
    "3": ([1.0, 1.0, 1.0, 1.0], 0.0),
}
# The other exact fits of the frequencies, to four decimals.
OTHERS = {
    "1-a": [[2.5769, 0.6164, 0.5877]],
    "1-b": [[2.6372, 0.5563, 0.8471]],
    "3": [
        [1.0634, 0.8877, 1.1313, 0.9364],
        [2.4403, 0.5965, 0.6767, 1.0152],
        [2.4582, 0.5827, 0.7334, 0.9519],
    ],
}

# Tables 2 to 5: the best model of each approach, by the ten parameters that all four share.
BEST_MODELS = {
    "1-a": [0.952, 0.857, 1.0, 1.0, 0.984, 1.137, 1.035, 0.789, 0.928, 0.804],
    "1-b": [0.820, 2.873, 1.0, 1.0, 1.155, 0.395, 0.960, 0.837, 1.221, 0.812],
    "2": [0.629, 0.755, 1.0, 1.0, 1.254, 1.192, 0.816, 0.777, 0.790, 0.740],
    "3": [0.607, 0.769, 1.0, 1.0, 1.305, 1.163, 0.803, 0.785, 0.785, 0.742],
}


@pytest.mark.parametrize("name", TABLE_1)
def test_table_1(model_classes, name):
    values, d_percent = TABLE_1[name]
    # Two frequencies do not determine three stiffnesses: approach 2 needs the shapes.
    best = bs.calibrate(model_classes[name], shape_weight=1.0 if name == "2" else 0.0).best
    np.testing.assert_allclose(best.values, values, atol=1.05e-3)
    assert 100.0 * best.distance == pytest.approx(d_percent, abs=0.06)
    off = np.array(best.values) - 1.0
    assert best.distance == pytest.approx(math.sqrt(np.mean(off**2)), rel=1e-12)
    if name == "2":
        assert best.objective == pytest.approx(0.00589, abs=5e-6)


@pytest.mark.parametrize("name", OTHERS)
def test_every_exact_minimum_of_the_frequencies_is_listed(model_classes, name):
    computed = bs.calibrate(model_classes[name], shape_weight=0.0)
    exact = [fit for fit in computed.minima if fit.objective < 1e-6]
    assert len(exact) == 1 + len(OTHERS[name])
    for expected in OTHERS[name]:
        assert min(np.abs(np.array(fit.values) - expected).max() for fit in exact) < 6e-5
    distances = [np.linalg.norm(np.log(fit.values)) for fit in exact]  # from the prior
    assert distances == sorted(distances)
    assert computed.undetermined_directions == 0


def test_the_weight_of_shapes_is_that_of_the_likelihood(model_classes):
    by_default = bs.calibrate(model_classes["2"], n_starts=16)
    assert by_default.shape_weight == pytest.approx(0.01 / 0.05)
    given = bs.calibrate(model_classes["2"], shape_weight=0.2, n_starts=16)
    assert by_default.best.values == pytest.approx(given.best.values, rel=1e-6)
    assert by_default.best.values != pytest.approx(TABLE_1["2"][0], abs=1e-3)


def test_only_the_true_model_fits_the_shapes_too(model_classes):
    calibration = bs.calibrate(model_classes["3"])
    np.testing.assert_allclose(calibration.best.values, 1.0, atol=1e-5)
    assert calibration.best.objective < 1e-6
    assert all(fit.objective > 1e-3 for fit in calibration.minima[1:])


@pytest.mark.parametrize("shape_weight", [0.0, 0.5, 1.0])
def test_the_objective_is_that_of_the_paper(model_classes, shape_weight):
    """f_ob from the frequencies and MACs that the calibration itself lists."""
    before = bs.calibrate(model_classes["1-a"], shape_weight, n_starts=4).before
    r_f = np.array([mode.model_hz / mode.identified_hz - 1.0 for mode in before.modes])
    r_shape = np.array([2.0 * (1.0 - math.sqrt(mode.mac)) for mode in before.modes])
    total = (r_f**2).sum() + shape_weight**2 * r_shape.sum()
    count = len(r_f) * (1.0 + shape_weight**2)
    assert before.objective == pytest.approx(math.sqrt(total / count), rel=1e-9)
    assert before.values == (1.0, 1.0, 1.0)
    assert before.distance == 0.0
    computed = [mode.model_hz for mode in before.modes]
    np.testing.assert_allclose(computed, [0.9832, 2.7372, 3.9213], atol=5e-5)
    pairs = [(mode.label, mode.model_mode) for mode in before.modes]
    assert pairs == [("1", 1), ("2a", 2), ("3", 3)]


def test_modes_without_shape_have_no_mac(model_classes):
    shapes = model_classes["3"]
    bare = bs.ModelClass("3", shapes.structure, shapes.data.without_shapes(), shapes.error,
                         pairing=shapes.pairing)  # fmt: skip
    calibration = bs.calibrate(bare)  # any weight: there is no shape to weigh
    assert all(math.isnan(mode.mac) for mode in calibration.best.modes)
    assert len([fit for fit in calibration.minima if fit.objective < 1e-6]) == 4


@pytest.mark.parametrize(("pairing", "undetermined"), [({"1": 1}, 2), ({"1": 1, "3": 3}, 1)])
def test_what_the_frequencies_leave_undetermined(model_classes, pairing, undetermined):
    three = model_classes["2"]
    few = bs.ModelClass("few", three.structure, three.data, three.error, pairing=pairing)
    calibration = bs.calibrate(few, shape_weight=0.0, n_starts=16)
    assert calibration.undetermined_directions == undetermined
    assert calibration.best.objective < 1e-6
    assert [fit for fit in calibration.minima if fit.objective < 1e-6] == [calibration.best]
    # The prior median misses frequencies by 0.3 % at most: a point that fits lies close by.
    assert np.abs(np.log(calibration.best.values)).max() < 0.05


@pytest.mark.parametrize(("name", "d_percent"), [("1-a", 17.6), ("1-b", 72.9), ("2", 2.1)])
def test_distances_between_the_papers_best_models(name, d_percent):
    values, reference = (
        dict(zip("abcdefghij", BEST_MODELS[each], strict=True)) for each in (name, "3")
    )
    assert 100.0 * bs.rms_distance(values, reference) == pytest.approx(d_percent, abs=0.06)


def test_distances_are_those_of_normalised_parameters():
    """A stiffness of nominal value 40 that comes out at 30 is 25 % off."""
    k = bs.Parameter("k", bs.LogNormal(40.0, 0.3))
    data = bs.ModalData((bs.IdentifiedMode("1", math.sqrt(30.0) / (2.0 * math.pi)),), (0.0, 3.0))
    building = bs.ShearBuilding((1.0,), (k,))
    calibration = bs.calibrate(bs.ModelClass("x", building, data, pairing={"1": 1}))
    assert calibration.best.values == pytest.approx((30.0,))
    assert calibration.best.distance == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("values", "reference", "message"),
    [
        ({"a": 1.0}, {"a": 1.0, "b": 1.0}, "no value of parameter 'b'"),
        ({"a": 1.0}, {}, "the reference has no parameter"),
    ],
)
def test_distances_that_mean_nothing(values, reference, message):
    assert_refused(f"rms_distance: {message}", bs.rms_distance, values, reference)


def test_the_seed_decides_and_more_starts_find_no_less(model_classes):
    a, b = (bs.calibrate(model_classes["3"], 0.0, seed=1, n_starts=16) for _ in range(2))
    assert a == b
    assert a.n_starts == 16


def test_searches_that_run_out_of_steps_end_at_no_minimum(model_classes, monkeypatch):
    monkeypatch.setattr("bayes_ssi.inference.calibration.least_squares.MOST_STEPS", 2)
    with pytest.raises(ValueError, match="'1-a': no local search for a minimum converged"):
        bs.calibrate(model_classes["1-a"], n_starts=4)


def test_errors_are_not_calibrated(model_classes):
    whole = model_classes["3"]
    free = bs.ModelClass("3", whole.structure, whole.data, pairing=whole.pairing)
    assert bs.calibrate(free, n_starts=8).parameter_names == ("k1", "k2", "k3", "ks")


@pytest.mark.parametrize(
    ("name", "wanted", "values"),
    [
        ("shape_weight", "zero or positive", (-1.0, math.nan)),
        ("n_starts", "from 1 to 10,000", (0, 100_000_000)),
    ],
)
def test_bad_options_are_refused(model_classes, name, wanted, values):
    for value in values:
        with pytest.raises(ValueError, match=f"{name} must be {wanted}, got {value}"):
            bs.calibrate(model_classes["2"], **{name: value})


def test_nothing_to_calibrate(model_classes):
    two = model_classes["2"]
    none = bs.ModelClass("none", two.structure, two.data, two.error, pairing={})
    assert_refused("'none': no mode is paired, nothing to fit", bs.calibrate, none)
    fixed = bs.ShearBuilding((1.0, 1.0, 1.0), (50.0, 50.0, 50.0))
    only_errors = bs.ModelClass("fixed", fixed, two.data, pairing={"1": 1})
    with pytest.raises(ValueError, match="'fixed': its structure has no parameter to calibrate"):
        bs.calibrate(only_errors)


SIGMA_F = 0.01
COV_A, COV_B = 0.2, 0.4
SD_A, SD_B = (math.sqrt(math.log1p(cov**2)) for cov in (COV_A, COV_B))
A, B = bs.Parameter("ka", bs.LogNormal(2.0, COV_A)), bs.Parameter("kb", bs.LogNormal(1.0, COV_B))


# A storey and an infill; two storeys, the mass between them negligible. The total mass is 1.
IN_PARALLEL = bs.ShearBuilding((1.0,), (A,)).with_element(bs.InPlaneInfill((0, 1), 1e-9, B))
IN_SERIES = bs.ShearBuilding((1e-9, 1.0), (A, B))


@pytest.mark.parametrize(("springs", "power"), [(IN_PARALLEL, 1.0), (IN_SERIES, -1.0)])
def test_one_frequency_determines_neither_of_two_springs(springs, power):
    """d ln f = ½ Σ w d ln k, with w the share of each spring in the stiffness k(ka, kb)."""

    def stiffness(ka, kb):
        powers = np.array([ka**power, kb**power])
        return powers.sum() ** (1.0 / power), powers / powers.sum()

    measured = 1.2 * stiffness(2.0, 1.0)[0]
    data = bs.ModalData((bs.IdentifiedMode("1", math.sqrt(measured) / (2 * math.pi)),), (0.0, 1.0))
    candidate = bs.ModelClass("c", springs, data, bs.ErrorModel(SIGMA_F), pairing={"1": 1})
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


def one_two_and_none(a_prior=None):
    """Frequencies √a and 2 √(b c): a by itself, b and c together, and d not at all."""
    priors = {name: bs.LogNormal(1.0, 0.3) for name in "abc"} | {"d": bs.Normal(0.0, 1.0)}
    priors["a"] = a_prior or priors["a"]
    arguments = {name: bs.Parameter(name, prior) for name, prior in priors.items()}
    frequencies = lambda a, b, c, d: (np.sqrt([a, 4.0 * b * c]), None)  # noqa: ARG005, E731
    structure = bs.FunctionStructure(frequencies, arguments, n_modes=2)
    data = bs.ModalData((bs.IdentifiedMode("1", 1.1), bs.IdentifiedMode("2", 2.1)), (0.0, 5.0))
    return bs.ModelClass("c", structure, data, bs.ErrorModel(SIGMA_F), pairing={"1": 1, "2": 2})


def test_what_is_determined_alone_and_what_is_not():
    calibration = bs.calibrate(one_two_and_none(), n_starts=8)
    a, b, c, d = calibration.best.values
    # The nearest exact fit shares the change between b and c, and leaves d.
    assert (a, b, c, d) == pytest.approx((1.1**2, 2.1 / 2.0, 2.1 / 2.0, 0.0), rel=1e-6, abs=1e-6)
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
