"""The likelihood against plain loops over its definition, quadrature, and invariances."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.linalg import eigh

import bayes_ssi as bs
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import check_pairing

SENSORS = ("floor 3", "floor 1", "infill 1-2")
MASSES = (3.0, 2.0, 1.5)
STIFFNESSES = (900.0, 700.0, 400.0)
NAN = math.nan


class Prescribed(bs.Structure):
    """Modes written down, not computed: a shape on the sphere given by its two angles."""

    angles = tuple(bs.Parameter(name, bs.Uniform(0.0, 2.0 * math.pi)) for name in ("t", "p"))
    parameters = angles
    degrees_of_freedom = ("x", "y", "z")
    n_modes = 1

    def modes(self, values):
        t, p = values.T
        shapes = np.array([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]).T
        shapes[np.isnan(t)] = 0.0
        return bs.Modes(np.ones((len(values), 1)), 4.0 * shapes[:, :, None])


def likelihood(structure, data, pairing, frequency_cov=0.01, shape_sd=0.05, p_d=0.9, nu=0.3):
    error = bs.ErrorModel(frequency_cov, shape_sd)
    return ModalLikelihood(structure, data, error, bs.IdentificationModel(p_d, nu), pairing)


@pytest.fixture
def building():
    k = [bs.Parameter(f"k{i}", bs.LogNormal(1.0, 0.3)) for i in (1, 2, 3)]
    frame = bs.ShearBuilding(MASSES, [s * x for s, x in zip(STIFFNESSES, k, strict=True)])
    return frame.with_element(bs.OutOfPlaneInfill((1, 2), 0.6, 2.0))


@pytest.fixture
def identified():
    """Pairs with and without shape and errors of their own, and three kinds of spurious modes."""
    modes = (
        bs.IdentifiedMode("first", 1.31, [1.2, 0.5, 0.8], frequency_cov=0.004, shape_sd=0.03),
        bs.IdentifiedMode("ghost", 1.7, [1.0, NAN, 3.0]),
        bs.IdentifiedMode("second", 2.05, [-0.3, 0.4, NAN], frequency_cov=0.007),
        bs.IdentifiedMode("blip", 3.9),
        bs.IdentifiedMode("dot", 4.0, [NAN, NAN, 1.0], shape_sd=0.2),
        bs.IdentifiedMode("third", 3.2, [NAN, 0.4, NAN]),
    )
    return bs.ModalData(modes, (0.2, 4.7), SENSORS)


PAIRING = {"third": 3, "first": 1, "second": 2}


def dense_modes(k1, k2, k3):
    """Frequencies, and shapes at the sensors, from matrices written out by hand."""
    k1, k2, k3 = np.array(STIFFNESSES) * (k1, k2, k3)
    stiffness = np.zeros((4, 4))
    stiffness[:3, :3] = [[k1 + k2, -k2, 0.0], [-k2, k2 + k3, -k3], [0.0, -k3, k3]]
    v = np.array([-0.5, -0.5, 0.0, 1.0])
    stiffness += 0.3 * (2.0 * math.pi * 2.0) ** 2 * np.outer(v, v)
    squares, shapes = eigh(stiffness, np.diag([3.15, 2.15, 1.5, 0.3]))
    return np.sqrt(squares) / (2.0 * math.pi), shapes[[2, 0, 3]]


def log_z(sd, d):
    def integrand(t):
        return math.exp(-(1.0 - math.cos(t)) / sd**2) * math.sin(t) ** (d - 2)

    sphere = 2.0 * math.pi ** ((d - 1) / 2) / math.gamma((d - 1) / 2)
    near, _ = quad(integrand, 0.0, 8.0 * sd, epsabs=0.0)
    return math.log(2.0 * sphere * near)


def by_hand(data, ks, frequency_cov, shape_sd, p_d, nu):
    """The log-likelihood of ``data`` with PAIRING, term by term."""
    frequencies, shapes = dense_modes(*ks)
    low, high = data.band_hz
    total = -nu
    for mode in data.modes:
        shape = np.full(3, NAN) if mode.shape is None else np.array(mode.shape)
        seen = np.isfinite(shape)
        unit = shape[seen] / np.linalg.norm(shape[seen])
        d = int(seen.sum())
        if mode.label not in PAIRING:
            total += math.log(nu / (high - low))
            if d >= 2:
                total -= math.log(2.0 * math.pi ** (d / 2) / math.gamma(d / 2))
            continue
        i = PAIRING[mode.label] - 1
        sd = math.hypot(frequency_cov, mode.frequency_cov or 0.0) * mode.frequency_hz
        total += math.log(p_d) + stats.norm.logpdf(mode.frequency_hz, frequencies[i], sd)
        if d >= 2:
            model = shapes[seen, i] / np.linalg.norm(shapes[seen, i])
            sd = math.hypot(shape_sd, mode.shape_sd or 0.0)
            total += -(1.0 - abs(unit @ model)) / sd**2 - log_z(sd, d)
    for i in set(range(4)) - {number - 1 for number in PAIRING.values()}:
        own = np.mean([(mode.frequency_cov or 0.0) ** 2 for mode in data.modes])
        sd = math.sqrt(frequency_cov**2 + own) * frequencies[i]
        inside = stats.norm.cdf(high, frequencies[i], sd) - stats.norm.cdf(low, frequencies[i], sd)
        total += math.log(1.0 - p_d * inside)
    return total


# At all of these the undetected mode lies on the end of the band, 4.7 Hz, to 3 %.
KS = [(1.0, 1.0, 1.0), (0.93, 1.1, 1.04), (1.3, 1.05, 0.9)]
ERRORS = [bs.Parameter(name, bs.LogNormal(1.0, 0.5)) for name in "ab"]


@pytest.mark.parametrize("with_shapes", [True, False])
@pytest.mark.parametrize("errors", [(), (1.0, 1.0), (0.4, 2.5)], ids=["fixed", "same", "others"])
@pytest.mark.parametrize(("p_d", "nu"), [(0.9, 0.3), (0.5, 0.01), (0.999, 3.0)])
def test_the_log_density_against_loops(building, identified, with_shapes, errors, p_d, nu):
    """With fixed or inferred sizes of errors."""
    data = identified if with_shapes else identified.without_shapes()
    (first, second), (a, b) = (ERRORS, errors) if errors else ([1.0, 1.0], [1.0, 1.0])
    model = likelihood(building, data, PAIRING, 0.02 * first, 0.06 * second, p_d, nu)
    names = ["k1", "k2", "k3", *(("ab" if with_shapes else "a") if errors else "")]
    assert [p.name for p in model.parameters] == names
    total = model.log_density(np.array([[*ks, a, b][: len(names)] for ks in KS]))
    expected = [by_hand(data, ks, 0.02 * a, 0.06 * b, p_d, nu) for ks in KS]
    np.testing.assert_allclose(total, expected, rtol=1e-10)


@pytest.mark.parametrize("frequency_cov", [0.002, 0.01, 0.05])
def test_the_density_of_the_frequency_integrates_to_one(frequency_cov):
    # Its standard deviation follows the datum, not the model: one within the variance.
    oscillator = bs.ShearBuilding((1.0,), ((2.0 * math.pi) ** 2,))

    def density(frequency_hz):
        data = bs.ModalData((bs.IdentifiedMode("1", frequency_hz),), (0.0, 3.0))
        terms = likelihood(oscillator, data, {"1": 1}, frequency_cov).terms(np.empty((1, 0)))
        return math.exp(terms.frequency[0, 0]) / 0.9

    ends = 1.0 + 10.0 * frequency_cov * np.array([-1.0, 0.0, 1.0])
    integral = sum(quad(density, a, b)[0] for a, b in pairwise(ends))
    assert abs(integral - 1.0) < 1.2 * frequency_cov**2


@pytest.mark.parametrize("shape", [[0.3, -0.5, 0.8], [0.7, NAN, -0.2]], ids=["three", "two"])
def test_the_density_of_the_shape_integrates_to_one(shape):
    # It is symmetric in the two shapes, so it may be integrated over the model's.
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0, shape),), (0.0, 2.0), ("x", "y", "z"))
    if np.isnan(shape[1]):  # a circle
        t, weight = np.linspace(0.0, 2.0 * math.pi, 4000, endpoint=False), 2.0 * math.pi / 4000
        p = np.zeros(4000)
    else:  # a sphere
        nodes, weights = np.polynomial.legendre.leggauss(160)
        t, p = (x.ravel() for x in np.meshgrid(np.arccos(nodes), np.arange(320) * math.pi / 160))
        weight = np.tile(weights, 320) * math.pi / 160
    terms = likelihood(Prescribed(), data, {"1": 1}, shape_sd=0.15).terms(np.array([t, p]).T)
    assert (np.exp(terms.shape[:, 0]) * weight).sum() == pytest.approx(1.0, abs=1e-8)


def test_a_model_shape_that_vanishes_at_the_sensors_points_nowhere():
    data = bs.ModalData((bs.IdentifiedMode("1", 1.0, [1, 2, 2]),), (0.0, 2.0), ("x", "y", "z"))
    terms = likelihood(Prescribed(), data, {"1": 1}, shape_sd=0.5).terms(np.array([[NAN, 0.0]]))
    normaliser = math.log(4.0 * math.pi * 0.25 * -math.expm1(-4.0))
    assert terms.shape[0, 0] == pytest.approx(-4.0 - normaliser, rel=1e-12)


class Rounded(bs.ShearBuilding3D):
    """Motions that are zero by symmetry are rounded: by a processor, or by a parameter here."""

    def modes(self, values):
        modes = super().modes(values)
        noise = np.random.default_rng(0).choice([-1e-15, 0.0, 1e-15], (200, 6, 6))[: len(values)]
        return bs.Modes(
            modes.frequencies_hz, np.where(abs(modes.shapes) < 1e-9, noise, modes.shapes)
        )


@pytest.mark.parametrize("measured", [("x",), ("x", "y")])
@pytest.mark.parametrize("pairing", ["any", {"1": 1, "2": 2}])
def test_a_mode_that_moves_the_sensors_by_rounding_alone_resembles_no_shape(measured, pairing):
    """Modes in y, nearly as frequent as those in x, of which shapes are identified."""
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    building = Rounded((2.0, 1.0), (1.0,) * 2, *[(s * k, 60.0) for s in (90.0, 90.9, 500.0)])
    sensors = tuple(f"floor {floor} {axis}" for axis in measured for floor in (1, 2))
    in_x = [0.5, 0.8, *[NAN] * (len(sensors) - 2)]
    modes = (bs.IdentifiedMode("1", 0.65, in_x), bs.IdentifiedMode("2", 0.66, in_x))
    data = bs.ModalData(modes, (0.0, 1.0), sensors)
    candidate = bs.ModelClass("c", building, data, bs.ErrorModel(0.01, 0.3), pairing=pairing)
    log_likelihoods = candidate.log_likelihood(np.ones((200, 1)))
    np.testing.assert_allclose(log_likelihoods, log_likelihoods[0], rtol=1e-12)
    distances = candidate.likelihoods[0].compared_modes(np.ones((1, 1))).shape_distances
    if pairing == "any":
        np.testing.assert_array_equal(distances.reshape(2, -1)[:, 1], 1.0)
    else:  # the two turn together, and whatever the turn, sensors see the mode in x
        np.testing.assert_allclose(distances[:, 1], distances[:, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("band", "pairing", "undetected"),
    [
        ((0.0, 0.15), {"1": 1}, 0.0),
        ((0.2, 1.0), {"1": 2}, 0.0),
        ((0.0, 1.0), {"1": 1}, math.log(0.1)),
        ((0.0, 1.0), {"1": 2}, math.log(0.1)),
        ((0.0, 1.0), {}, 2.0 * math.log(0.1)),
    ],
)
def test_only_a_mode_inside_the_band_can_be_missed(band, pairing, undetected):
    two = bs.ShearBuilding((1.0, 1.0), (1.0, 1.0))  # 0.098 and 0.258 Hz
    data = bs.ModalData((bs.IdentifiedMode("1", sum(band) / 2.0),), band)
    terms = likelihood(two, data, pairing).terms(np.empty((1, 0)))
    assert terms.missed[0].sum() == pytest.approx(undetected, abs=1e-12)


# Frequencies of two unit masses on two unit springs.
LOWER_HZ, UPPER_HZ = ((math.sqrt(5.0) + sign) / (4.0 * math.pi) for sign in (-1.0, 1.0))


def at_band_edge(band, pairing, frequency_cov=0.01, own=(None,)):
    """Two unit masses on two springs of 1, 4 and -1 times unit stiffness."""
    k = bs.Parameter("k", bs.LogNormal(1.0, 0.3))
    two = bs.ShearBuilding((1.0, 1.0), (k, k))
    middle = sum(band) / 2.0
    modes = [bs.IdentifiedMode(str(i), middle, frequency_cov=e) for i, e in enumerate(own, 1)]
    model = likelihood(two, bs.ModalData(tuple(modes), band), pairing, frequency_cov)
    with np.errstate(all="ignore"):
        values = np.array([[1.0], [4.0], [-1.0]])
        return model.at_band_edge(values, model.modes(values).frequencies_hz).tolist()


@pytest.mark.parametrize(
    ("end", "near"), [(0.978, False), (0.982, True), (1.0, True), (1.018, True), (1.022, False)]
)
def test_a_mode_within_two_standard_errors_of_a_limit_is_at_the_edge(end, near):
    """The standard error is 1 % of the mode's frequency; at 4 k it is twice as high."""
    nothing = [False, False]
    assert at_band_edge((0.0, end * UPPER_HZ), {"1": 1}) == [[False, near], nothing, nothing]
    assert at_band_edge((end * LOWER_HZ, 9.0), {"1": 2}) == [[near, False], nothing, nothing]
    assert at_band_edge((0.0, 2.0 * end * UPPER_HZ), {"1": 1}) == [nothing, [False, near], nothing]


@pytest.mark.parametrize(
    ("band", "pairing", "error", "at_edge"),
    [
        ((0.0, UPPER_HZ), {"1": 2}, 0.01, [[False, False]] * 3),  # it is paired
        ((LOWER_HZ, UPPER_HZ), {}, 0.01, [[True, True], [False, False], [False, False]]),
        # Errors of 60 % reach from any frequency to zero, which is no edge.
        ((0.0, 9.0), {"1": 1}, 0.6, [[False, False]] * 3),
        ((0.01, 9.0), {"1": 1}, 0.6, [[False, True], [False, True], [False, False]]),
    ],
)
def test_unpaired_modes_are_at_edges_other_than_zero(band, pairing, error, at_edge):
    assert at_band_edge(band, pairing, error) == at_edge


@pytest.mark.parametrize(("end", "near"), [(1.045, True), (1.047, False)])
def test_identification_errors_widen_the_edge(end, near):
    # A mode that was not identified would have had the mean square error of those that were:
    # 2 √(0.01² + (0.03² + 0.02²)/3) = 0.0462.
    assert at_band_edge((0.0, end * UPPER_HZ), {"1": 1}, own=(0.03, None, 0.02))[0] == [False, near]


def test_the_edge_follows_an_inferred_error():
    size = bs.Parameter("e", bs.LogNormal(0.01, 1.0))
    two = bs.ShearBuilding((1.0, 1.0), (1.0, 1.0))
    data = bs.ModalData((bs.IdentifiedMode("1", 0.1),), (0.0, 1.03 * UPPER_HZ))
    model = likelihood(two, data, {"1": 1}, size)
    values = np.array([[0.014], [0.016]])
    at_edge = model.at_band_edge(values, model.modes(values).frequencies_hz)
    assert at_edge.tolist() == [[False, False], [False, True]]


def with_shapes(data, change):
    """The same modes, with changed shapes."""
    modes = (replace(m, shape=None if m.shape is None else change(m.shape)) for m in data.modes)
    return replace(data, modes=tuple(modes))


@pytest.mark.parametrize("factor", [-1.0, 50.0, -1e-4, np.exp(1j), 1j])
def test_sign_scale_and_phase_of_a_shape_do_not_matter(building, identified, factor):
    turned = with_shapes(identified, lambda shape: factor * shape)
    values = np.array(KS)
    expected = likelihood(building, identified, PAIRING).log_density(values)
    other = likelihood(building, turned, PAIRING).log_density(values)
    np.testing.assert_allclose(other, expected, rtol=1e-9)


def test_a_fixed_structure_with_an_inferred_error():
    size = bs.Parameter("e", bs.LogNormal(0.01, 1.0))
    oscillator = bs.ShearBuilding((1.0,), ((2.0 * math.pi) ** 2,))
    data = bs.ModalData((bs.IdentifiedMode("1", 1.02),), (0.0, 2.0))
    model = likelihood(oscillator, data, {"1": 1}, size)
    assert model.parameters == (size,)
    sizes = np.array([0.005, 0.02, 0.1])
    expected = math.log(0.9) - 0.3 + stats.norm.logpdf(1.02, 1.0, 1.02 * sizes)
    np.testing.assert_allclose(model.log_density(sizes[:, None]), expected, rtol=1e-12)


@pytest.mark.parametrize("pairing", [PAIRING, {"first": 1}, {}], ids=len)
@pytest.mark.parametrize("bad", [[-1.0, 1.0, 1.0], [1.0, NAN, 1.0], [math.inf, 1.0, 1.0]])
def test_rows_without_modes_are_nan_and_leave_the_others_alone(building, identified, pairing, bad):
    model = likelihood(building, identified, pairing)
    total = model.log_density(np.array([KS[0], bad, KS[1]]))
    assert np.isnan(total[1])
    alone = [model.log_density(np.array([ks]))[0] for ks in KS[:2]]
    np.testing.assert_allclose(total[[0, 2]], alone, rtol=1e-12)
    assert np.isfinite(total[[0, 2]]).all()


def test_the_order_of_sensors_and_pairs_does_not_matter(building, identified):
    order = [2, 0, 1]
    shuffled = with_shapes(identified, lambda shape: shape[order])
    sensors = tuple(SENSORS[i] for i in order)
    shuffled = replace(shuffled, modes=shuffled.modes[::-1], sensors=sensors)
    pairing = dict(sorted(PAIRING.items()))
    np.testing.assert_allclose(
        likelihood(building, shuffled, pairing).log_density(np.array(KS)),
        likelihood(building, identified, PAIRING).log_density(np.array(KS)),
        rtol=1e-11,
    )


def test_an_error_that_no_paired_datum_calls_for_is_not_inferred(building, identified):
    size = bs.Parameter("s", bs.LogNormal(0.05, 1.0))
    with_shape = likelihood(building, identified, {"first": 1}, shape_sd=size)
    without = likelihood(building, identified, {"third": 3}, shape_sd=size)
    assert [p.name for p in with_shape.parameters] == ["k1", "k2", "k3", "s"]
    assert [p.name for p in without.parameters] == ["k1", "k2", "k3"]


@pytest.mark.parametrize(
    ("pairing", "error", "message"),
    [
        ({"fourth": 1}, ValueError, "pairing: no identified mode 'fourth'; choose from 'first', "),
        ({"first": 0}, ValueError, "'first' is paired with model mode 0; .* modes 1 to 4"),
        ({"first": 5}, ValueError, "'first' is paired with model mode 5; .* modes 1 to 4"),
        ({"first": 1.0}, ValueError, "'first' is paired with model mode 1.0;"),
        ({"first": True}, ValueError, "'first' is paired with model mode True;"),
        ({"first": "1"}, ValueError, "'first' is paired with model mode '1';"),
        (
            {"first": 1, "second": 1},
            ValueError,
            "model mode 1 is paired with two identified modes, 'first' and 'second'",
        ),
        ([("first", 1)], TypeError, r"pairing must map labels .* got \[\('first', 1\)\]"),
        (None, TypeError, "pairing must map labels .* got None"),
    ],
)
def test_impossible_pairings_are_refused(building, identified, pairing, error, message):
    with pytest.raises(error, match=message):
        check_pairing(pairing, identified, building.n_modes)
