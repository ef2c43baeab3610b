"""Parameters by difference of exports, against matrices whose dependence is known."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import bayes_ssi as bs
from bayes_ssi.structures.solver_files.exported_model import Matrices, exported_model
from bayes_ssi.structures.solver_files.parameter_matrices import AlteredModel, parameter_matrices

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
    matrices = Matrices(
        [matrix[order][:, order] for matrix in (stiffness, thickness * DENSITY)],
        ("K", "M"),
        labels=labels,
    )
    factors = {
        name: value for name, value in (("columns", columns), ("slab", thickness)) if value != 1.0
    }
    return AlteredModel(f"{columns}-{thickness}.sti", factors, exported_model("test", matrices))


NOMINAL = export().model


def formula(terms):
    return [term.powers for term in terms]


def assert_predicts(matrices, columns, thickness):
    factors = {"columns": columns, "slab": thickness}
    expected = export(columns, thickness).model
    for terms, matrix in ((matrices.stiffness, expected.stiffness), (matrices.mass, expected.mass)):
        total = sum(
            np.prod([factors[name] ** e for name, e in term.powers]) * term.matrix for term in terms
        )
        np.testing.assert_allclose(total.toarray(), matrix.toarray(), rtol=1e-9, atol=1e-9)


def test_a_property_that_enters_linearly():
    matrices = parameter_matrices(NOMINAL, [export(1.1)], [export(0.7)])
    assert formula(matrices.stiffness) == [(), (("columns", 1),)]
    assert formula(matrices.mass) == [()]
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
    altered = replace(check, model=model)
    matrices = parameter_matrices(NOMINAL, [export(1.1)], [altered])
    assert matrices.errors[check.file] == pytest.approx(4e-9, rel=1e-4)


@pytest.mark.parametrize(
    "exports",
    [
        ([1.2, 1.4, 0.8], [export(0.9, 1.1)]),
        ([1.2, 1.4, 0.8], []),
    ],
)
def test_a_thickness_enters_by_its_first_and_third_power(exports):
    factors, checks = exports
    changed = [export(1.1), *(export(1.0, factor) for factor in factors)]
    matrices = parameter_matrices(NOMINAL, changed, checks)
    assert formula(matrices.stiffness) == [
        (), (("columns", 1),), (("slab", 1),), (("slab", 3),)
    ]  # fmt: skip
    # All of the mass is proportional to the thickness: nothing is constant.
    assert formula(matrices.mass) == [(("slab", 1),)]
    assert_predicts(matrices, 0.6, 1.7)


def test_a_single_power():
    def powered(factor):
        stiffness = GROUND + factor**3 * BENDING
        model = exported_model("test", Matrices((stiffness, DENSITY), ("K", "M"), labels=LABELS))
        return AlteredModel(f"{factor}", {"depth": factor}, model)

    matrices = parameter_matrices(powered(1.0).model, [powered(1.1), powered(0.8)])
    assert formula(matrices.stiffness) == [(), (("depth", 3),)]
    with pytest.raises(ValueError, match=r"0.8: its stiffness is missed by [\d.e-]+ of"):
        parameter_matrices(powered(1.0).model, [powered(1.1)], [powered(0.8)])


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
        return AlteredModel(f"{factor}", {"t": factor}, model)

    changed = [expanded(factor) for factor in factors]
    matrices = parameter_matrices(expanded(1.0).model, changed, [expanded(1.6)])
    assert sorted(term.powers for term in matrices.stiffness) == [
        (), *((("t", exponent),) for exponent in exponents)
    ]  # fmt: skip
    assert matrices.errors["1.6"] < 1e-10


def shell(modulus=1.0, thickness=1.0, area=1.0):
    """K = E (t K_m + t³ K_b) of shells, and E A K_c of columns, whose modulus is the same."""
    stiffness = modulus * (thickness * MEMBRANE + thickness**3 * BENDING + area * COLUMNS) + GROUND
    named = {"E": modulus, "t": thickness, "A": area}
    factors = {name: value for name, value in named.items() if value != 1.0}
    matrices = Matrices((stiffness, DENSITY), ("K", "M"), labels=LABELS)
    return AlteredModel(f"{factors}", factors, exported_model("test", matrices))


ALONE = [shell(1.1), shell(1.0, 1.2), shell(1.0, 0.8), shell(1.0, 1.4), shell(area=1.3)]
CHECK = shell(0.7, 1.3, 0.6)
TOGETHER = [shell(1.1, 1.2), shell(0.8, 0.7), shell(1.2, area=0.9)]


def test_products_of_two_properties():
    """Every shell is a product of the modulus and powers of the thickness; alone, neither acts."""
    matrices = parameter_matrices(shell().model, [*ALONE, *TOGETHER], [CHECK])
    expected = {
        (): GROUND,
        (("E", 1), ("t", 1)): MEMBRANE,
        (("E", 1), ("t", 3)): BENDING,
        (("A", 1), ("E", 1)): COLUMNS,
    }
    assert {term.powers for term in matrices.stiffness} == set(expected)
    for term in matrices.stiffness:
        np.testing.assert_allclose(term.matrix.toarray(), expected[term.powers], atol=1e-9)
    assert formula(matrices.mass) == [()]
    assert matrices.errors[CHECK.file] < 1e-12


@pytest.mark.parametrize(
    ("together", "checks", "message"),
    [
        ([], [CHECK], r"missed by [\d.e-]+ of .* two whose product matters also together"),
        # One export with both altered cannot tell t from t³, nor one product of them from two.
        (
            TOGETHER[:1],
            [CHECK],
            r"E and t: stiffness: no product of their powers .* export both with",
        ),
        ([shell(1.1, 1.2), shell(1.1, 1.2)], [], r"the same factor of 'E' and 't'"),
        ([shell(1.1, 1.2, 0.9)], [], r"must alter one property, or two whose product matters"),
    ],
)
def test_products_that_are_not_known_are_refused(together, checks, message):
    with pytest.raises(ValueError, match=message) as refused:
        parameter_matrices(shell().model, [*ALONE, *together], checks)
    assert "\n" not in str(refused.value)


def test_the_error_of_a_product_that_is_left_out():
    """K = E A C is missed by (0.7 - 1)(0.6 - 1) of an entry on the diagonal."""

    def bar(modulus, area):
        factors = {n: f for n, f in (("E", modulus), ("A", area)) if f != 1.0}
        model = exported_model("test", Matrices((modulus * area * GROUND, DENSITY), ("K", "M")))
        return AlteredModel(f"{modulus}-{area}", factors, model)

    changed = [bar(1.1, 1.0), bar(1.0, 1.3)]
    with pytest.raises(ValueError, match=r"0.7-0.6: its stiffness is missed by 1\.2e-01 of"):
        parameter_matrices(bar(1.0, 1.0).model, changed, [bar(0.7, 0.6)])
    matrices = parameter_matrices(bar(1.0, 1.0).model, [*changed, bar(1.2, 1.2)], [bar(0.7, 0.6)])
    assert formula(matrices.stiffness) == [(("A", 1), ("E", 1))]


def test_a_pair_without_a_product_adds_nothing():
    """Columns and slab are apart: their changes add up."""
    changed = [export(1.1), export(1.0, 1.2), export(1.0, 0.8), export(1.0, 1.4), export(0.9, 1.1)]
    matrices = parameter_matrices(NOMINAL, changed)
    assert all(len(powers) <= 1 for powers in formula(matrices.stiffness))


def test_rows_may_stand_in_another_order():
    matrices = parameter_matrices(
        NOMINAL, [export(1.1, labels=LABELS[::-1])], [export(0.7, labels=LABELS[4:] + LABELS[:4])]
    )
    np.testing.assert_allclose(matrices.stiffness[1].matrix.toarray(), COLUMNS, atol=1e-12)


@pytest.mark.parametrize(
    ("changed", "checks", "message"),
    [
        ([export(1.0, 1.2), export(1.0, 0.8)], [], r"slab: stiffness: no power .* misses them by"),
        ([export(1.0, 1.2)], [export(1.0, 0.8)], r"0.8.sti: its stiffness is missed by 0\.\d|e-"),
        (
            [export(1.2, coupled=0.1), export(1.0, 1.2), export(1.0, 0.8), export(1.0, 1.4)],
            [export(0.9, 1.1, coupled=0.1)],
            r"0.9-1.1.sti: its stiffness is missed by",
        ),
        (
            [export(1.1, digits=6)],
            [export(0.7, digits=6)],
            r"missed by \d\.\de-0[56] .* more digits",
        ),
        (
            [export(1.1, 1.2)],
            [],
            r"1.1-1.2.sti: no other export alters alone 'columns'; choose from nothing",
        ),
        ([export()], [], r"1.0-1.0.sti: must alter one property"),
        ([export(1.1), export(1.1)], [], r"another export has the same factor of 'columns'"),
        (
            [export(1.1)],
            [export(1.0, 1.1)],
            r"no other export alters alone 'slab'; choose from 'columns'",
        ),
        (
            [AlteredModel("f", {"columns": 1.1}, NOMINAL)],
            [],
            r"f: 'columns' changes neither stiffness",
        ),
        (
            [AlteredModel("f", {"columns": -1.0}, NOMINAL)],
            [],
            r"factor of 'columns' must be positive",
        ),
        (
            [export(1.1, labels=["a x", *LABELS[1:]])],
            [],
            r"1.1-1.0.sti: its labels are not those of the nominal export",
        ),
    ],
)
def test_what_is_refused(changed, checks, message):
    with pytest.raises(ValueError, match=message) as refused:
        parameter_matrices(NOMINAL, changed, checks)
    assert "\n" not in str(refused.value)


def test_terms_become_a_structure_with_parameters():
    """Frequencies of the altered model by its own export."""
    found = parameter_matrices(NOMINAL, [export(1.1)])
    columns = bs.Parameter("columns", bs.LogNormal(1.0, 0.2))
    stiffness, mass = found.with_parameters({"columns": columns})
    structure = bs.MatrixStructure(stiffness, mass, labels=NOMINAL.labels, n_modes=2)
    other = export(1.3).model
    expected = bs.MatrixStructure(other.stiffness, other.mass, labels=other.labels, n_modes=2)
    np.testing.assert_allclose(
        structure.modes(np.array([[1.3]])).frequencies_hz,
        expected.modes(np.empty((1, 0))).frequencies_hz,
        rtol=1e-9,
    )
    with pytest.raises(ValueError, match="none is given for property 'columns'; choose from 'E'"):
        found.with_parameters({"E": columns})
