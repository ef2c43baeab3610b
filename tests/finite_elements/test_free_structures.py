"""Structures that nothing holds: rigid-body modes are left out, elastic ones in closed form."""

import numpy as np
import pytest
import scipy.sparse as sp
from searches import COARSE, exact_modes

import bayes_ssi as bs

# cosh(βL) cos(βL) = 1.
BETA = np.array([4.730040745, 7.853204624, 10.995607838])


def beam(n, rigidity=1.0):
    """A beam of length 1, mass 1 a length: n elements with consistent masses, and labels."""
    h = 1.0 / n
    k = np.array([
        [12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
        [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2],
    ])  # fmt: skip
    m = np.array([
        [156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
        [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
    ])  # fmt: skip
    at = 2 * np.arange(n)[:, None, None] + np.zeros((1, 4, 4), dtype=int)
    rows, columns = at + np.arange(4)[:, None], at + np.arange(4)
    stiffness, mass = (
        sp.csc_array((np.tile(each, (n, 1, 1)).ravel(), (rows.ravel(), columns.ravel())))
        for each in (rigidity * k / h**3, m * h / 420.0)
    )
    labels = [f"{node} {direction}" for node in range(n + 1) for direction in ("y", "rz")]
    return stiffness, mass, labels


EI = bs.Parameter("EI", bs.LogNormal(1.0, 0.2))


def structure(n, **options):
    stiffness, mass, labels = beam(n)
    sensors = {"left": 0, "middle": n, "right": 2 * n}
    options = {"n_modes": 3, **options}
    return bs.MatrixStructure([(EI, stiffness)], mass, labels=labels, sensors=sensors, **options)


@pytest.mark.parametrize("n", [12, 60, 300])
def test_a_free_beam_in_closed_form(n):
    """Small, dense and sparse solvers; the error of such elements goes with (βh)⁴/1440."""
    free = structure(n)
    modes = free.modes(np.array([[1.0], [1.44]]))
    expected = BETA**2 / (2.0 * np.pi)
    assert free.n_rigid_modes == 2
    np.testing.assert_allclose(modes.frequencies_hz[0], expected, rtol=(11.0 / n) ** 4 / 1e3 + 2e-6)
    np.testing.assert_allclose(modes.frequencies_hz[1], 1.2 * modes.frequencies_hz[0], rtol=1e-6)
    ends = np.abs(modes.shapes[0][[0, 2]])
    np.testing.assert_allclose(ends, 2.0, rtol=1e-3)  # of unit modal mass
    assert "without 2 rigid-body modes" in free.description()["modes"]
    shifted, mass = free.system.shifted_matrices(np.array([1.0]))
    k = shifted - free.system.free_body.shift * mass
    strains = np.sort(np.linalg.eigvalsh(k.toarray()))[:2]
    assert np.abs(strains).max() < 1e-9 * abs(k).max()


def test_up_to_a_frequency_counts_elastic_modes_only():
    assert structure(60, n_modes=None, up_to_hz=1.1 * BETA[1] ** 2 / (2.0 * np.pi)).n_modes == 2


@pytest.mark.parametrize("n", [60, 300])
def test_a_free_beam_in_a_reduced_basis(n):
    free = structure(n)
    reduced = free.reduced()
    values = np.array([[0.7], [1.0], [1.5]])
    np.testing.assert_allclose(
        reduced.modes(values).frequencies_hz, free.modes(values).frequencies_hz, rtol=1e-3
    )
    bounds = reduced.bounds(values)
    assert bounds.frequency.shape == (3, 3)
    assert bounds.frequency.max() < 1e-3


@pytest.mark.parametrize("n", [12, 60])
def test_elements_on_a_free_beam(n):
    """A pendulum in its middle against the same as matrices, whole and in a reduced basis."""
    stiffness, mass, labels = beam(n)
    tuned = BETA[0] ** 2 / (2.0 * np.pi)
    pendulum = bs.Pendulum(on="middle", mass=0.03, frequency=tuned, label="tank")
    size = len(labels)
    spring = np.zeros(size + 1)
    spring[n], spring[size] = -1.0, 1.0
    whole_k = sp.block_diag([stiffness, sp.csc_array((1, 1))]).toarray()
    whole_k += 0.03 * (2.0 * np.pi * tuned) ** 2 * np.outer(spring, spring)
    whole_m = sp.block_diag([mass, sp.csc_array([[0.03]])]).toarray()
    expected = bs.MatrixStructure(
        whole_k, whole_m, n_modes=4, sensors={"left": 0, "middle": n, "right": 2 * n}
    ).modes(np.empty((1, 0)))
    free = structure(n)
    for carrying in (free.with_element(pendulum), free.reduced().with_element(pendulum)):
        found = carrying.modes(np.array([[1.0]]))
        np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-3)
    shapes = free.place_shapes(["middle"], np.array([[1.0]]))
    assert abs(shapes[0, 0]) == pytest.approx(1.2156, abs=2e-3)  # Blevins: of ends that are 2
    values = np.array([[0.9], [1.0], [1.1]])
    projected = free.reduced().projected(values, ["middle"]).with_element(pendulum)
    np.testing.assert_allclose(
        projected.modes(np.array([[1.0]])).frequencies_hz, expected.frequencies_hz, rtol=3e-3
    )


def test_rounded_to_nine_digits_it_is_free_still():
    stiffness, mass, labels = beam(60)
    rounded = stiffness.copy()
    rounded.data = np.array([float(f"{value:.8e}") for value in stiffness.data * 1.2345])
    free = bs.MatrixStructure(rounded, mass, n_modes=3, labels=labels, sensors=["0 y", "60 y"])
    assert free.n_rigid_modes == 2
    expected = np.sqrt(1.2345) * BETA**2 / (2.0 * np.pi)
    np.testing.assert_allclose(free.modes(np.empty((1, 0))).frequencies_hz[0], expected, rtol=1e-2)


def test_soft_supports_are_no_rigid_body_modes():
    """An isolated body moves at a hundredth of its first elastic frequency, and it counts."""
    stiffness, mass, labels = beam(40)
    soft = stiffness.tolil()
    for row in (0, 80):
        soft[row, row] += 0.5 * (2.0 * np.pi * 0.03) ** 2
    held = bs.MatrixStructure(sp.csc_array(soft), mass, n_modes=3, labels=labels, sensors=["0 y"])
    assert held.n_rigid_modes == 0
    assert held.modes(np.empty((1, 0))).frequencies_hz[0, 0] == pytest.approx(0.03, rel=1e-3)


@pytest.mark.usefixtures("quick_screening")
def test_a_free_beam_is_ranked_and_searched():
    free = structure(4)
    truth = free.with_element(bs.Pendulum(on="middle", mass=0.02, frequency=3.5))
    data = exact_modes(truth, ("left", "middle", "right"), (0.5, 25.0), 4, (1.1,))
    error = bs.ErrorModel(frequency_cov=0.005, shape_sd=0.02)
    baseline = bs.ModelClass("beam", free, data, error, pairing="any")
    one = bs.SearchSettings(number_weights=(1.0, 1.0), most_sampled=1)
    places = [bs.Candidate(place, place) for place in ("left", "middle", "right")]
    result = bs.search(baseline, one, settings=COARSE, candidates=places)
    assert result.record.probability_of_any > 0.99
    (pendulum,) = result.record.matched
    assert "middle" in [each.place.candidate.name for each in pendulum.places_by_data]
    assert pendulum.frequency_hz[0] < 3.5 < pendulum.frequency_hz[2]
    stiffness = next(p for p in result.record.averaged_parameters if p.name == "EI")
    assert stiffness.quantile_05 < 1.1 < stiffness.quantile_95


def test_a_free_body_in_a_plane():
    """It bends as a beam, and stretches as a bar: j/2 √(EA/m). Three rigid modes are left out."""
    bending, mass, _ = beam(40)
    links = np.diff(np.eye(41), axis=0)
    stretching = 100.0 * 40.0 * links.T @ links
    along = np.diag(np.r_[0.5, np.ones(39), 0.5]) / 40.0
    stiffness = sp.csc_array(sp.block_diag([bending, stretching]))
    mass = sp.csc_array(sp.block_diag([mass, along]))
    free = bs.MatrixStructure([(EI, stiffness)], mass, n_modes=3, sensors={"end": 0, "tip": 122})
    assert free.n_rigid_modes == 3
    expected = np.array([BETA[0] ** 2 / (2.0 * np.pi), 5.0, BETA[1] ** 2 / (2.0 * np.pi)])
    for each in (free, free.reduced()):
        found = each.modes(np.array([[1.0]])).frequencies_hz[0]
        np.testing.assert_allclose(found, expected, rtol=1e-3)
