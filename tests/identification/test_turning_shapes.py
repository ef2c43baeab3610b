"""Means over turns of two close modes, against quadrature."""

import math

import numpy as np
import pytest
from scipy.special import ive

from bayes_ssi.inference.likelihood.turning_shapes import Turned, TurningShapes


def random_case(rng, kind):
    """κ', two model shapes, two identified shapes about a turn of them, and their errors.

    Of the second kind model shapes are nearly parallel at the sensors, of the third orthogonal; one
    in four has one identified shape, one in five shapes that have nothing to do with the model's.
    """
    model = rng.standard_normal((2, rng.integers(2, 9)))
    if kind == 1:
        apart = 10.0 ** rng.uniform(-3.0, -0.5) * rng.standard_normal(model.shape[1])
        model[1] = 10.0 ** rng.uniform(-1.0, 1.0) * model[0] + apart
    elif kind == 2:
        model = np.linalg.qr(model.T)[0].T * 10.0 ** rng.uniform(-0.5, 0.5, (2, 1))
    sds, turn = 10.0 ** rng.uniform(math.log10(0.005), math.log10(0.2), 2), rng.uniform(-1.57, 1.57)
    c, s = math.cos(turn), math.sin(turn)
    shapes = np.array([[c, s], [-s, c]]) @ model
    if rng.random() < 0.2:
        shapes = rng.standard_normal(shapes.shape)
    shapes /= np.linalg.norm(shapes, axis=1)[:, None]
    shapes += sds[:, None] * rng.standard_normal(shapes.shape) * rng.choice([0, 1, 1, 3])
    shapes /= np.linalg.norm(shapes, axis=1)[:, None]
    if rng.random() < 0.25:
        sds[1] = np.inf
    return (0.0 if rng.random() < 0.15 else 10.0 ** rng.uniform(-3.0, 5.0)), model, shapes, sds


def by_trapezoids(kappa, model, shapes, sds):
    """On a grid that is finest at the turns where anything happens, halved where it is uneven."""

    def exponents(t):
        total = kappa * (np.cos(2.0 * t) - 1.0)
        for shape, sd, turn in zip(shapes, sds, (t, t + 0.5 * math.pi), strict=True):
            turned = np.cos(turn)[:, None] * model[0] + np.sin(turn)[:, None] * model[1]
            total -= (1.0 - abs(turned @ shape) / np.linalg.norm(turned, axis=1)) / sd**2
        return total

    fine = np.geomspace(1e-9, 1.6, 1500)
    nearest = [np.linalg.lstsq(model.T, shape, rcond=None)[0] for shape in shapes]
    at = [0.0, math.atan2(*nearest[0][::-1]), math.atan2(-nearest[1][0], nearest[1][1])]
    grid = np.concatenate(
        [np.linspace(-1.57, 1.57, 4001), *(c + side * fine for c in at for side in (1, -1))]
    )
    grid = np.unique((grid + 0.5 * math.pi) % math.pi) - 0.5 * math.pi
    grid = np.append(grid, grid[0] + math.pi)
    values = exponents(grid)
    for _ in range(12):
        density, steps = np.exp(values - values.max()), np.diff(grid)
        areas = np.maximum(density[1:], density[:-1]) * steps
        halved = (np.abs(np.diff(values)) > 0.05) & (areas > 1e-7 * areas.sum())
        middles = 0.5 * (grid[1:] + grid[:-1])[halved]
        places = np.flatnonzero(halved) + 1
        grid = np.insert(grid, places, middles)
        values = np.insert(values, places, exponents(middles))
    mean = np.trapezoid(np.exp(values - values.max()), grid) / (math.pi * ive(0, kappa))
    return math.log(mean) + values.max()


def turning_shapes(models, units, sds):
    """Of the lower and the upper mode (2, s, E), identified shapes (2, s, E) and errors (2, E)."""
    low, high = models
    modes = (np.stack(each, axis=1) for each in ((low, high), (high, -low)))
    units = units.swapaxes(0, 1)
    return TurningShapes.of(*modes, units, np.ones_like(units), sds**2)


# Of 4,000 cases those in which nodes about one turn are far from where the shapes are nearest, few
# even nodes miss where they are, or step over a gap.
SHAPES_THAT_DISAGREE = (
    118, 409, 1033, 2074, 2182, 2539, 2548, 2890, 2947, 3382, 3586, 3607, 3682,
)  # fmt: skip


def test_means_over_turns_are_integrals():
    rng = np.random.default_rng(11)
    errors = []
    for i in range(max(SHAPES_THAT_DISAGREE) + 1):
        case = kappa, model, shapes, sds = random_case(rng, i % 3)
        if i < 150 or i in SHAPES_THAT_DISAGREE:
            turning = turning_shapes(model[:, :, None], shapes[:, :, None], sds[:, None])
            (mean,) = Turned.of(np.array([kappa]), turning).log_means
            exact = by_trapezoids(*case)
            errors.append(abs(mean - exact) / (1.0 - 0.01 * exact))  # down to exp(-28,000)
    assert max(errors) < 0.005
    assert np.median(errors) < 1e-4


def test_no_exponent_is_above_the_highest_ones_and_one_shape_reaches_it():
    rng = np.random.default_rng(3)
    turns = np.linspace(0.0, math.pi, 20_001)[:, None]
    for i in range(60):
        _, model, shapes, sds = random_case(rng, i % 3)
        turning = turning_shapes(model[:, :, None], shapes[:, :, None], sds[:, None])
        distances = turning.distances(np.cos(2.0 * turns), np.sin(2.0 * turns))[:, :, 0]
        highest = (-distances / turning.variances).max(axis=1)
        # Neighbours of the grid are so near that exponents differ by less than this.
        found = turning.highest_exponents[:, 0]
        assert (found >= highest - 1e-9).all()
        assert found == pytest.approx(highest, rel=1e-3, abs=0.02)


def test_a_shape_is_unseen_at_the_one_turn_at_which_both_cancel():
    """Of two alike, that is at -45 degrees: (cos t + sin t)² = 1 + sin 2t."""
    one = np.ones((3, 1, 1))
    shapes = TurningShapes.of(one, one, one / math.sqrt(3.0), one, np.array([[1e-4]]))
    doubled = np.array([[-0.5 * math.pi], [0.5 * math.pi], [0.0]])
    unseen = shapes.are_unseen(np.cos(doubled), np.sin(doubled))
    assert unseen[:, 0].tolist() == [True, False, False]


def test_the_turn_is_not_one_at_which_no_sensor_sees_the_mode():
    """The two modes are nearly opposite at the sensors: at atan(1/8.6) they cancel one another.

    On both sides the shape fits, so that the mean turn is just there; misfits and joint errors are
    to be those of a turn at which it fits.
    """
    low = np.array([0.00292296, 0.00456056, 0.00484652])
    high = np.array([-0.02297953, -0.03900381, -0.04182941])
    unit = np.array([0.37168192, 0.62663492, 0.68496805])
    unit /= np.linalg.norm(unit)
    shapes = TurningShapes.of(
        low[:, None, None], high[:, None, None], unit[:, None, None], np.ones((3, 1, 1)),
        np.array([[3.899575e-6]]),
    )  # fmt: skip
    kappa = np.array([33.79204718848855])
    turns = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 400_001)[:, None]
    exponents = shapes.exponents(kappa, np.cos(2.0 * turns), np.sin(2.0 * turns))[:, 0]
    highest = exponents.max()
    weights = np.exp(exponents - highest)
    turned = Turned.of(kappa, shapes)
    assert turned.log_means[0] == pytest.approx(
        math.log(weights.mean() / ive(0, kappa[0])) + highest, abs=3e-4
    )
    # At the mean turn the exponent would be hundreds below.
    mean = 0.5 * math.atan2((weights * np.sin(2.0 * turns[:, 0])).sum(),
                            (weights * np.cos(2.0 * turns[:, 0])).sum())  # fmt: skip
    assert np.interp(mean, turns[:, 0], exponents) < highest - 100.0
    assert np.interp(turned.angles[0], turns[:, 0], exponents) > highest - 1.0


def test_a_mode_that_sensors_hardly_see_has_the_shape_that_they_see():
    """A local mode: another turn adds the neighbour's motion, thousands of times its own."""
    model, sds = np.array([[1.0, 0.0], [2e-5, 5e-5]]), np.array([0.01, 0.01])
    shapes = model / np.linalg.norm(model, axis=1)[:, None]
    turning = turning_shapes(model[:, :, None], shapes[:, :, None], sds[:, None])
    turned = Turned.of(np.array([400.0]), turning)
    assert turned.log_means[0] == pytest.approx(by_trapezoids(400.0, model, shapes, sds), abs=1e-3)
    assert turned.distances.max() < 1e-4


def test_nodes_do_not_step_over_the_turn_at_which_no_sensor_sees_the_mode():
    """Its density has a narrow gap there, and is the same on both sides of it."""
    model, sds = np.array([[1.0, 0.0], [0.0, 0.003]]), np.array([0.1, np.inf])
    shapes = np.array([[1.0, 0.0]] * 2)
    turning = turning_shapes(model[:, :, None], shapes[:, :, None], sds[:, None])
    (mean,) = Turned.of(np.zeros(1), turning).log_means
    assert mean == pytest.approx(by_trapezoids(0.0, model, shapes, sds), abs=1e-3)


def test_shapes_parallel_at_the_sensors_look_alike_at_every_turn():
    """As those of an appendage's two modes: no turn is nearer to an identified shape."""
    rng = np.random.default_rng(11)
    n = 200
    lower, *units = rng.standard_normal((3, 4, n))
    upper = rng.uniform(-2.0, 2.0, n) * lower * (1.0 + 1e-15 * rng.standard_normal((4, n)))
    units = np.array([unit / np.sqrt((unit**2).sum(axis=0)) for unit in units])
    turning = turning_shapes(np.array([lower, upper]), units, np.full((2, n), 0.01))
    turned = Turned.of(rng.uniform(0.1, 20.0, n), turning)
    cosines = abs((units * lower).sum(axis=1)) / np.sqrt((lower**2).sum(axis=0))
    assert turned.log_means == pytest.approx(-((1.0 - cosines) / 1e-4).sum(axis=0), rel=1e-6)


@pytest.mark.parametrize("sd", [1e-2, 1e-4, 1e-5])
def test_a_small_error_of_the_shape(sd):
    """Of one shape at a turn of 0.3: ∫ exp(-(t - 0.3)²/(2σ²)) over a range of π, over π."""
    model, sds = np.eye(2, 3), np.array([sd, np.inf])
    shapes = np.array([[math.cos(0.3), math.sin(0.3), 0.0]] * 2)
    turning = turning_shapes(model[:, :, None], shapes[:, :, None], sds[:, None])
    turned = Turned.of(np.zeros(1), turning)
    assert turned.log_means[0] == pytest.approx(math.log(sd * math.sqrt(2.0 / math.pi)), abs=1e-3)
    assert turned.angles[0] == pytest.approx(0.3, abs=1e-6)


def test_errors_below_rounding_leave_the_best_turn():
    """The logarithm of a mean of exp(-distance/σ²) tends to the least distance, over -σ²."""
    model, shapes = np.random.default_rng(2).standard_normal((2, 2, 3, 50))
    shapes /= np.sqrt((shapes**2).sum(axis=1, keepdims=True))
    turning = turning_shapes(model, shapes, np.full((2, 50), 1e-13))
    turned = Turned.of(np.full(50, 1e-9), turning)
    turns = np.linspace(0.0, math.tau, 20_001)[:, None]
    least = turning.distances(np.cos(turns), np.sin(turns)).sum(axis=0).min(axis=0)
    assert -1e-26 * turned.log_means == pytest.approx(least, rel=1e-3)
