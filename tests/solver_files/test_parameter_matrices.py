"""Parameters by difference of exports, against matrices whose dependence is known."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from conftest import assert_refused

import bayes_ssi as bs
from bayes_ssi.structures.solver_files.exported_model import Matrices, exported_model

LABELS = [f"{node} x" for node in range(1, 9)]


def part(rows, seed):
    """A random stiffness of some degrees of freedom."""
    factor = np.random.default_rng(seed).standard_normal((len(rows), len(rows)))
    matrix = np.zeros((8, 8))
    matrix[np.ix_(rows, rows)] = factor @ factor.T
    return matrix


GROUND = np.diag([5.0] * 8)
COLUMNS, MEMBRANE, BENDING = part([0, 1, 2, 3], 1), part([3, 4, 5], 2), part([4, 5, 6, 7], 3)
DENSITY = np.diag(np.arange(1.0, 9.0))


def export(columns=1.0, thickness=1.0, labels=LABELS, digits=None, coupled=0.0):
    """K = K_0 + c K_c + t K_m + t³ K_b, and M = t M_t: an elastic frame with a slab."""
    stiffness = GROUND + columns * COLUMNS + thickness * MEMBRANE + thickness**3 * BENDING
    stiffness = stiffness + coupled * columns * thickness * BENDING
    if digits is not None:
        stiffness = np.vectorize(lambda value: float(f"{value:.{digits - 1}e}"))(stiffness)
    order = [LABELS.index(name) for name in labels] if set(labels) == set(LABELS) else slice(None)
    ordered = [matrix[order][:, order] for matrix in (stiffness, thickness * DENSITY)]
    matrices = Matrices(ordered, ("K", "M"), labels=labels)
    factors = {
        name: value for name, value in (("columns", columns), ("slab", thickness)) if value != 1.0
    }
    return bs.AlteredModel(f"{columns}-{thickness}.sti", factors, exported_model("test", matrices))


NOMINAL = export().model


def formula(terms):
    return [(term.name, term.exponent) for term in terms]


def test_a_property_that_enters_linearly():
    matrices = bs.parameter_matrices(NOMINAL, [export(1.1)], [export(0.7)])
    assert formula(matrices.stiffness) == [("", 0), ("columns", 1)]
    assert formula(matrices.mass) == [("", 0)]
    np.testing.assert_allclose(matrices.stiffness[1].matrix.toarray(), COLUMNS, atol=1e-12)
    # Compact: no entry where the property has no effect.
    assert matrices.stiffness[1].matrix.nnz == np.count_nonzero(COLUMNS)
    assert matrices.errors["0.7-1.0.sti"] < 1e-13


@pytest.mark.parametrize("which", ["stiffness", "mass"])
def test_the_error_of_a_check_is_its_worst_entry_in_either_matrix(which):
    """By hand: 4e-9 of √(K_ii K_jj) in one entry, and 1e-9 in another."""
    check = export(0.7)
    scales = np.sqrt(getattr(NOMINAL, which).diagonal())
    wrong = np.zeros((8, 8))
    wrong[2, 5] = wrong[5, 2] = 4e-9 * scales[2] * scales[5]
    wrong[1, 1] = -1e-9 * scales[1] ** 2
    model = replace(check.model, **{which: getattr(check.model, which) + sp.csc_array(wrong)})
    matrices = bs.parameter_matrices(NOMINAL, [export(1.1)], [replace(check, model=model)])
    assert matrices.errors[check.file] == pytest.approx(4e-9, rel=1e-4)


@pytest.mark.parametrize("exports", [([1.2, 1.4, 0.8], [export(0.9, 1.1)]), ([1.2, 1.4, 0.8], [])])
def test_a_thickness_enters_by_its_first_and_third_power(exports):
    factors, checks = exports
    changed = [export(1.1), *(export(1.0, factor) for factor in factors)]
    matrices = bs.parameter_matrices(NOMINAL, changed, checks)
    assert formula(matrices.stiffness) == [("", 0), ("columns", 1), ("slab", 1), ("slab", 3)]
    # All of the mass is proportional to the thickness: nothing is constant.
    assert formula(matrices.mass) == [("slab", 1)]
    factors, expected = {"columns": 0.6, "slab": 1.7}, export(0.6, 1.7).model
    for terms, matrix in ((matrices.stiffness, expected.stiffness), (matrices.mass, expected.mass)):
        total = sum(factors.get(term.name, 1.0) ** term.exponent * term.matrix for term in terms)
        np.testing.assert_allclose(total.toarray(), matrix.toarray(), rtol=1e-9, atol=1e-9)


def test_a_single_power():
    def powered(factor):
        stiffness = GROUND + factor**3 * BENDING
        model = exported_model("test", Matrices((stiffness, DENSITY), ("K", "M"), labels=LABELS))
        return bs.AlteredModel(f"{factor}", {"depth": factor}, model)

    matrices = bs.parameter_matrices(powered(1.0).model, [powered(1.1), powered(0.8)])
    assert formula(matrices.stiffness) == [("", 0), ("depth", 3)]
    with pytest.raises(ValueError, match=r"0.8: its stiffness is missed by [\d.e-]+ of"):
        bs.parameter_matrices(powered(1.0).model, [powered(1.1)], [powered(0.8)])


@pytest.mark.parametrize(
    ("exponents", "factors"),
    [((-1, 1), (1.2, 0.8, 1.4)), ((-1, 1, 2, 3), (1.2, 0.8, 1.4, 0.7, 0.6))],
)
def test_shells_that_a_program_expands_into_solids(exponents, factors):
    """In a plane, and as CalculiX ties them where they meet at an angle."""
    parts = {exponent: part([3, 4, 5, 6], exponent + 5) for exponent in exponents}

    def expanded(factor):
        stiffness = GROUND + sum(factor**e * parts[e] for e in exponents)
        model = exported_model("test", Matrices((stiffness, DENSITY), ("K", "M"), labels=LABELS))
        return bs.AlteredModel(f"{factor}", {"t": factor}, model)

    changed = [expanded(factor) for factor in factors]
    matrices = bs.parameter_matrices(expanded(1.0).model, changed, [expanded(1.6)])
    expected = [("", 0), *(("t", exponent) for exponent in exponents)]
    assert sorted(formula(matrices.stiffness)) == expected
    assert matrices.errors["1.6"] < 1e-10


def test_rows_may_stand_in_another_order():
    matrices = bs.parameter_matrices(
        NOMINAL, [export(1.1, labels=LABELS[::-1])], [export(0.7, labels=LABELS[4:] + LABELS[:4])]
    )
    np.testing.assert_allclose(matrices.stiffness[1].matrix.toarray(), COLUMNS, atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "checks", "message"),
    [
        ([export(1.0, 1.2), export(1.0, 0.8)], [], r"slab: stiffness: no power .* misses them by"),
        ([export(1.0, 1.2)], [export(1.0, 0.8)], r"0.8.sti: its stiffness is missed by 0\.\d|e-"),
        ([export(1.2, coupled=0.1), export(1.0, 1.2), export(1.0, 0.8), export(1.0, 1.4)],
         [export(0.9, 1.1, coupled=0.1)], r"0.9-1.1.sti: its stiffness is missed by"),
        ([export(1.1, digits=6)], [export(0.7, digits=6)],
         r"missed by \d\.\de-0[56] .* more digits"),
        ([export(1.1, 1.2)], [],
         r"1.1-1.2.sti: must alter one property, got {'columns': 1.1, 'slab': 1.2}; exp"),
        ([export()], [], r"1.0-1.0.sti: must alter one property"),
        ([export(1.1), export(1.1)], [], r"another export has the same factor of 'columns'"),
        ([export(1.1)], [export(1.0, 1.1)],
         r"no other export alters alone 'slab'; choose from 'columns'"),
        ([bs.AlteredModel("f", {"columns": 1.1}, NOMINAL)], [],
         r"f: 'columns' changes neither stiffness"),
        ([bs.AlteredModel("f", {"columns": -1.0}, NOMINAL)], [],
         r"factor of 'columns' must be positive"),
        ([export(1.1, labels=["a x", *LABELS[1:]])], [],
         r"1.1-1.0.sti: its labels are not those of the nominal export"),
    ],
)  # fmt: skip
def test_what_is_refused(changed, checks, message):
    assert_refused(message, bs.parameter_matrices, NOMINAL, changed, checks)


def test_terms_become_a_structure_with_parameters():
    """Frequencies of the altered model by its own export."""
    found = bs.parameter_matrices(NOMINAL, [export(1.1)])
    columns = bs.Parameter("columns", bs.LogNormal(1.0, 0.2))
    stiffness, mass = found.with_parameters({"columns": columns})
    structure = bs.MatrixStructure(stiffness, mass, labels=NOMINAL.labels, n_modes=2)
    other = export(1.3).model
    expected = bs.MatrixStructure(other.stiffness, other.mass, labels=other.labels, n_modes=2)
    hz = structure.modes(np.array([[1.3]])).frequencies_hz
    np.testing.assert_allclose(hz, expected.modes(np.empty((1, 0))).frequencies_hz, rtol=1e-9)
    with pytest.raises(ValueError, match="none is given for property 'columns'; choose from 'E'"):
        found.with_parameters({"E": columns})
