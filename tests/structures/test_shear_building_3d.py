"""The shear building in space, against closed forms and the planar building."""

import math

import numpy as np
import pytest
from conftest import assert_refused, multiplier

import bayes_ssi as bs

NONE = np.empty((1, 0))


def uniform(n, k_x, k_y, k_torsion, radius, mass=2.0):
    return bs.ShearBuilding3D([mass] * n, [radius] * n, [k_x] * n, [k_y] * n, [k_torsion] * n)


def one_storey(centre=(0.0, 0.0)):
    """Mass 2, radius of gyration 1.5, stiffnesses 800, 1800 and 5000."""
    return bs.ShearBuilding3D([2.0], [1.5], [800.0], [1800.0], [5000.0], [centre])


def frequencies(structure, values=NONE):
    return structure.modes(values).frequencies_hz


def test_a_uniform_building_has_the_frequencies_of_three_chains():
    # f_j = (1/π) √(k/m) sin((2j - 1)π / (2(2n + 1))), with k_θ/(m r²) for torsion.
    computed = frequencies(uniform(3, 900.0, 1100.0, 4000.0, 1.5))[0]
    sines = np.sin((2 * np.arange(1, 4) - 1) * math.pi / 14) / math.pi
    squared = np.array([900.0 / 2.0, 1100.0 / 2.0, 4000.0 / (2.0 * 1.5**2)])
    expected = np.sort(np.outer(np.sqrt(squared), sines).ravel())
    np.testing.assert_allclose(computed, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("centre", "own", "coupled"), [((0.4, 0.0), 800.0, 1800.0), ((0.0, -0.4), 1800.0, 800.0)]
)
def test_a_storey_with_an_eccentric_centre_of_stiffness(centre, own, coupled):
    # One direction is uncoupled; the other and torsion are [[a, c], [c, b]].
    a, b = coupled / 2.0, (5000.0 + coupled * 0.4**2) / (2.0 * 1.5**2)
    half, root = (a + b) / 2.0, math.hypot((a - b) / 2.0, coupled * 0.4 / (2.0 * 1.5))
    expected = np.sqrt(np.sort([own / 2.0, half - root, half + root])) / (2.0 * math.pi)
    np.testing.assert_allclose(frequencies(one_storey(centre))[0], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("centre", "force", "turn"), [((0.4, 0.0), (0.0, 1.0), -0.4), ((0.0, 0.4), (1.0, 0.0), 0.4)]
)
def test_a_force_at_the_mass_turns_the_floor_about_the_centre_of_stiffness(centre, force, turn):
    # The moment of the force about the centre of stiffness is (-x, -y) × F.
    stiffness, _ = one_storey(centre).matrices(NONE)
    x, y, rotation = np.linalg.solve(stiffness[0], [*force, 0.0])
    assert rotation == pytest.approx(turn / 5000.0)
    at_centre = np.array([x - centre[1] * rotation, y + centre[0] * rotation])
    np.testing.assert_allclose(at_centre, np.array(force) / [800.0, 1800.0], rtol=1e-12)


def test_a_mass_on_a_floor_counts_in_all_three_directions():
    added = bs.FloorBlock(on=1, mass=0.5, radius=0.8)
    squared = [800.0 / 2.5, 1800.0 / 2.5, 5000.0 / (2.0 * 1.5**2 + 0.5 * 0.8**2)]
    expected = np.sqrt(np.sort(squared)) / (2.0 * math.pi)
    computed = frequencies(one_storey().with_element(added))[0]
    np.testing.assert_allclose(computed, expected, rtol=1e-12)
    assert added.as_mass() is added


def test_an_appendage_in_one_direction_is_that_of_the_planar_building():
    k, m, f = multiplier("k"), multiplier("m", 0.1), multiplier("f", 3.0)
    values = np.exp(0.2 * np.random.default_rng(1).standard_normal((5, 3))) * [1.0, 0.1, 3.0]
    planar = bs.ShearBuilding((2.0,) * 3, (900.0 * k,) * 3).with_element(bs.Pendulum(3, m, f))
    spatial = uniform(3, 900.0 * k, 1e6, 1e7, 1.5).with_element(
        bs.Pendulum("floor 3 x", m, f, label="blade")
    )
    assert [p.name for p in spatial.parameters] == [p.name for p in planar.parameters]
    # The other directions are so stiff that theirs are the highest six frequencies.
    np.testing.assert_allclose(
        frequencies(spatial, values)[:, :4], frequencies(planar, values), rtol=1e-9
    )
    assert spatial.n_modes == 10


def test_parameters_stand_in_any_field():
    names = ("m", "r", "kx", "ky", "kt", "dm", "a")
    m, r, kx, ky, kt, dm, a = (multiplier(name) for name in names)
    added = bs.FloorBlock(1, dm, radius=a)
    structure = bs.ShearBuilding3D([m], [r], [kx], [ky], [kt]).with_element(added)
    assert {p.name for p in structure.parameters} == set(names)
    values = np.array([[0.5 + 0.1 * names.index(p.name) for p in structure.parameters]])
    of = dict(zip((p.name for p in structure.parameters), values[0], strict=True))
    mass = of["m"] + of["dm"]
    inertia = of["m"] * of["r"] ** 2 + of["dm"] * of["a"] ** 2
    squared = [of["kx"] / mass, of["ky"] / mass, of["kt"] / inertia]
    expected = np.sqrt(np.sort(squared)) / (2.0 * math.pi)
    np.testing.assert_allclose(frequencies(structure, values)[0], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bs.ShearBuilding3D([1.0, 1.0], [1.0], [1.0], [1.0], [1.0]),
         "needs one of each per storey, at least one, got 2 masses, 1 radii_of_gyration"),
        (lambda: bs.ShearBuilding3D([], [], [], [], []), "at least one, got 0 masses"),
        (lambda: bs.ShearBuilding3D([1.0], [1.0], [1.0], [-2.0], [1.0]),
         "stiffnesses_y, number 1 from below, must be positive and finite, got -2.0"),
        (lambda: bs.ShearBuilding3D([1.0], [1.0], [1.0], [1.0], [1.0], [(0, 0), (0, 0)]),
         "1 torsional_stiffnesses, 2 eccentricities"),
        (lambda: bs.ShearBuilding3D([1.0], [1.0], [1.0], [1.0], [1.0], ground_motion="torsion"),
         "ShearBuilding3D: ground_motion must be 'x' or 'y', got 'torsion'"),
        (lambda: bs.FloorBlock(0, 1.0), "on must be a floor from 1 upwards, or three labels"),
        (lambda: bs.FloorBlock(1, 0.0), "block on floor 1: mass must be positive"),
        (lambda: bs.FloorBlock(1, 1.0, 3), "at must be two coordinates, "),
        (lambda: bs.FloorBlock(1, 1.0, radius=0.0), "block on floor 1: radius must be positive"),
        (lambda: one_storey().with_element(bs.FloorBlock(2, 1.0, radius=1.0)),
         "block on floor 2: the structure has no degree of freedom 'floor 2 x'; choose from "
         "'floor 1 x', 'floor 1 y', 'floor 1 torsion'"),
        (lambda: one_storey().with_element(bs.Pendulum(1, 1.0, 1.0)),
         "pendulum 1: the structure has no degree of freedom 1; choose from"),
    ],
)  # fmt: skip
def test_bad_input_is_named(make, message):
    assert_refused(message.replace("(", r"\("), make)
