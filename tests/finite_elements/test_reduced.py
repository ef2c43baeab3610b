"""Reduced bases against full solutions: their accuracy and its certificate."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
from chains import spring_chain

import bayes_ssi as bs
from bayes_ssi.structures.finite_elements import sparse_modes
from bayes_ssi.structures.modal import BATCHED_UP_TO, mac
from bayes_ssi.structures.structure import Requirement

N, PARTS = 240, 3
MODULE = "bayes_ssi.structures.finite_elements.matrix_structure"
# Of full solutions themselves: eigenvalues are exact to a part of the highest, 4 N² in this chain,
# whose lowest is (π/2)².
ROUNDING = np.finfo(float).eps * 4 * N**2 / (np.pi / 2) ** 2


def beam(n=N, parts=PARTS):
    """A chain of springs in groups, each with a stiffness of its own: K of every group."""
    return [sp.csc_array(float(n) ** 2 * part) for part in spring_chain(n, parts)]


def factors(n=PARTS, cov=0.3):
    return [bs.Parameter(f"k{i}", bs.LogNormal(1.0, cov)) for i in range(1, n + 1)]


def full(**options):
    sensors = {f"s{i}": i for i in range(19, N, 20)}
    terms = list(zip(factors(), beam(), strict=True))
    return bs.MatrixStructure(terms, sp.eye_array(N), sensors=sensors, n_modes=5, **options)


def draws(n, seed=0, spread=0.3):
    return np.random.default_rng(seed).lognormal(0.0, spread, (n, PARTS))


@pytest.fixture(scope="module")
def reduced():
    made = full().reduced()
    assert made.basis.size
    return made


def test_is_small_and_right_over_the_prior(reduced):
    assert reduced.n_full_solutions < 20
    assert reduced.basis.size < 60
    values = draws(100)
    exact, fast = reduced.full.modes(values), reduced.modes(values)
    off = np.abs(fast.frequencies_hz / exact.frequencies_hz - 1.0)
    alike = [np.diag(mac(a, b)) for a, b in zip(exact.shapes, fast.shapes, strict=True)]
    assert off.max() < 1e-4
    assert np.min(alike) > 0.9999
    # Bounds hold, and are not trivially wide.
    bounds = reduced.bounds(values)
    assert np.all(bounds.frequency >= off - ROUNDING)
    assert np.median(bounds.frequency / np.maximum(off, ROUNDING)) < 1000.0
    angle = np.sqrt(np.maximum(1.0 - np.array(alike), 0.0))
    assert np.mean(bounds.shape >= angle - 1e-7) > 0.99
    # At a full solution they are zero but for rounding.
    assert reduced.bounds(reduced.prior_medians()).frequency.max() < 1e-6


def test_goes_on_where_it_is_not_accurate_enough(reduced, monkeypatch):
    values = draws(30, seed=1, spread=0.6)
    better = reduced.accurate_at(Requirement(values, 1e-7, 1e-4))
    assert better is not reduced
    assert better.n_full_solutions > reduced.n_full_solutions
    bounds = better.bounds(values)
    assert bounds.frequency.max() <= 1e-7
    assert bounds.shape.max() <= 1e-4
    assert better.accurate_at(Requirement(values, 1e-7, 1e-4)) is better
    exact = reduced.full.modes(values).frequencies_hz
    np.testing.assert_allclose(better.modes(values).frequencies_hz, exact, rtol=1e-7)
    with_at_most(2, monkeypatch)
    assert full().reduced().accurate_at(Requirement(values, 1e-7, 1e-4)).n_full_solutions == 2


def with_at_most(n_full_solutions, monkeypatch):
    monkeypatch.setattr(f"{MODULE}.MOST_FULL_SOLUTIONS", n_full_solutions)


def test_a_coarse_basis_knows_that_it_is_coarse(monkeypatch):
    with_at_most(1, monkeypatch)
    coarse = full().reduced()
    values = draws(40)
    off = coarse.modes(values).frequencies_hz / coarse.full.modes(values).frequencies_hz - 1.0
    assert off.max() > 0.01
    assert np.all(coarse.bounds(values).frequency >= off - ROUNDING)


def counted_factors(monkeypatch):
    """Sizes of the matrices that are factorised from now on."""
    sizes, module = [], "bayes_ssi.structures.finite_elements.sparse_modes._superlu"
    factorise = sparse_modes._superlu

    def counting(matrix, *others):
        sizes.append(matrix.shape[0])
        return factorise(matrix, *others)

    monkeypatch.setattr(module, counting)
    return sizes


def test_large_models_are_reduced_by_one_full_solution_as_accurately(monkeypatch):
    """The bounds hold for another basis, too: frequencies are within them of exact ones."""
    monkeypatch.setattr(f"{MODULE}.ONE_FACTOR_FROM", 100)
    made, values = full().reduced(), draws(40, seed=1)
    required = Requirement(values, 1e-7, 1e-4)
    assert made.basis.size
    sizes = counted_factors(monkeypatch)
    better = made.accurate_at(required)
    assert sizes == [N] * len(sizes)
    assert len(sizes) <= 1  # the reference's own, where it was not needed before
    assert (better.n_full_solutions, better.confirming(values).n_full_solutions) == (1, 1)
    exact = made.full.modes(values)
    for structure, wanted in ((made, 1e-4), (better, 1e-7), (made.confirming(values), 1e-5)):
        off = np.abs(structure.modes(values).frequencies_hz / exact.frequencies_hz - 1.0)
        assert off.max() <= wanted
        assert np.all(structure.bounds(values).frequency >= off - ROUNDING)


def test_so_are_elements_on_them(monkeypatch):
    monkeypatch.setattr(f"{MODULE}.ONE_FACTOR_FROM", 100)
    values = draws(10, seed=2)
    pendulum = bs.Pendulum("s119", 2.0, float(full().modes(values).frequencies_hz[:, 1].mean()))
    bare, exact = full().reduced(), full().with_element(pendulum)
    assert bare.basis.size
    better = bare.with_element(pendulum).accurate_at(Requirement(values, 1e-7, 1e-4))
    assert better.n_full_solutions == 1
    assert "full solution and" in better.accuracy(values).statement
    expected = exact.modes(values)
    found = better.modes(values)
    np.testing.assert_allclose(found.frequencies_hz, expected.frequencies_hz, rtol=1e-7)
    alike = [np.diag(mac(a, b)) for a, b in zip(expected.shapes, found.shapes, strict=True)]
    assert np.min(alike) > 1.0 - 1e-6


def test_where_a_correction_adds_nothing_other_values_are_tried(monkeypatch):
    monkeypatch.setattr(f"{MODULE}.ONE_FACTOR_FROM", 100)
    made, tried = full().reduced(), []
    assert made.basis.size

    def nothing(*arguments):
        tried.append(arguments[1])
        return np.zeros((N, 0))

    monkeypatch.setattr(f"{MODULE}.ReducedBasis.corrections", nothing)
    assert made.accurate_at(Requirement(draws(40, seed=1), 1e-9, 1e-5)) is made
    assert len({id(each) for each in tried}) == len(tried) == 3


def test_small_models_are_confirmed_by_full_solutions(reduced):
    assert reduced.confirming(draws(3)) is reduced.full


@pytest.mark.parametrize("small", [True, False])
def test_rows_and_copies_agree(reduced, small, monkeypatch):
    assert reduced.basis.size <= BATCHED_UP_TO
    values = draws(130)
    if not small:  # one by one, as in a larger basis
        expected = reduced.modes(values).frequencies_hz
        monkeypatch.setattr("bayes_ssi.structures.modal.BATCHED_UP_TO", 0)
        np.testing.assert_allclose(reduced.modes(values).frequencies_hz, expected, rtol=1e-10)
    together = reduced.modes(values)
    copied = pickle.loads(pickle.dumps(reduced))
    for rows in (slice(0, 1), slice(70, 130)):
        part = copied.modes(values[rows])
        np.testing.assert_array_equal(part.frequencies_hz, together.frequencies_hz[rows])
        np.testing.assert_array_equal(part.shapes, together.shapes[rows])


def test_copies_of_a_model_share_what_takes_long(reduced):
    assert pickle.loads(pickle.dumps(reduced))._reference is reduced._reference
    stiffer = [bs.Parameter(f"k{i}", bs.LogNormal(2.0, 0.3)) for i in range(1, PARTS + 1)]
    kinds = [(factors(), 2.0, range(19, N, 20)), (stiffer, 1.0, range(19, N, 20))]
    for parameters, scale, places in [*kinds, (factors(), 1.0, [N - 1])]:
        terms = [(k, scale * part) for k, part in zip(parameters, beam(), strict=True)]
        sensors = {f"s{i}": i for i in places}
        other = bs.MatrixStructure(terms, sp.eye_array(N), sensors=sensors, n_modes=5)
        assert other.reduced()._reference is not reduced._reference


def test_response_is_that_of_the_full_model():
    frame = full(influence=np.ones(N))
    values = draws(3)
    exact, fast = frame.modal_model(values), frame.reduced().modal_model(values)
    np.testing.assert_allclose(np.abs(fast.participation), np.abs(exact.participation), rtol=1e-3)
    products = [np.einsum("dm,m->dm", one.shapes[0], one.participation[0]) for one in (exact, fast)]
    np.testing.assert_allclose(products[1], products[0], atol=1e-3)


def test_masses_may_depend_on_parameters_and_be_missing():
    m = bs.Parameter("m", bs.LogNormal(1.0, 0.3))
    extra = np.zeros(N)
    extra[-1] = 100.0
    mass = [sp.diags_array(np.arange(N) % 2 * 1.0), (m, sp.diags_array(extra))]
    k1, k2, k3 = beam()
    (k,) = factors(1)
    frame = bs.MatrixStructure([(k, k1), k2, k3], mass, sensors={"a": N - 1, "b": N // 2},
                               n_modes=4)  # fmt: skip
    values = np.random.default_rng(0).lognormal(0.0, 0.3, (30, 2))
    exact, fast = frame.modes(values), frame.reduced().modes(values)
    np.testing.assert_allclose(fast.frequencies_hz, exact.frequencies_hz, rtol=1e-4)


def test_a_structure_that_fits_in_its_basis_is_exact():
    (k,) = factors(1)
    small = bs.MatrixStructure([(k, np.diag([1.0, 2.0])), np.eye(2)], np.eye(2), n_modes=2)
    reduced = small.reduced()
    values = np.array([[0.5], [2.0]])
    np.testing.assert_allclose(reduced.modes(values)[0], small.modes(values)[0], rtol=1e-10)
    assert reduced.n_full_solutions < 5


def test_rows_without_modes_are_nan_alone_and_in_a_batch():
    q = bs.Parameter("q", bs.Normal(1.0, 0.2))
    structure = bs.MatrixStructure((q, beam(N, 1)[0]), sp.eye_array(N), n_modes=3).reduced()
    frequencies = structure.modes(np.array([[1.0], [-1.0]])).frequencies_hz
    assert np.isfinite(frequencies[0]).all()
    assert np.isnan(frequencies[1]).all()
    assert np.isnan(structure.modes(np.array([[-1.0]])).frequencies_hz).all()


def test_no_solution_at_the_medians_is_an_error():
    (k,) = factors(1)
    frame = bs.MatrixStructure((k, -beam(N, 1)[0]), sp.eye_array(N), n_modes=2)
    with pytest.raises(ValueError, match="the stiffness matrix is not positive definite"):
        frame.reduced().modes(np.ones((1, 1)))
