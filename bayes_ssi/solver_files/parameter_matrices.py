"""Parameters by difference: K(θ) and M(θ) from exports of one model with altered properties.

Stiffness and mass are polynomials in most properties of sections and materials: proportional to a
modulus, a density or an area, with a part proportional to t and one to t³ in the thickness t of a
shell. With factors θ_j of properties, 1 being nominal,

    K(θ) = K_c + Σ_j Σ_e θ_j^e K_je,  K_c = K(1) - Σ_je K_je,

and K_je follow from exports in which one property has other factors, by least squares in f^e - 1.
The fewest exponents are taken with which all exports of the property are predicted; further
exports, with several properties altered at once, must be predicted as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import scipy.sparse as sp

from bayes_ssi.arrays import FloatArray
from bayes_ssi.solver_files.exported_model import ExportedModel

# Largest error of a prediction, relative to √(K_ii K_jj): what nine printed digits allow.
TOLERANCE = 1e-8
# Parts of a matrix below this share of the tolerance are rounding of printed digits.
NEGLIGIBLE = 1e-3 * TOLERANCE
# Exponents of properties: modulus, area and density enter by 1, bending of plates and the depth of
# sections by 3, their second moments by 4 in the diameter, flexibilities by -1.
EXPONENTS = (1, 3, 2, 4, -1)


@dataclass(frozen=True, eq=False)
class Export:
    """An export of the model with altered properties.

    Attributes:
        file: for messages.
        factors: property → factor of its nominal value; others are nominal.
        model: as read.
    """

    file: str
    factors: Mapping[str, float]
    model: ExportedModel


@dataclass(frozen=True, eq=False)
class Term:
    """A matrix times a power of a property's factor; the constant term has no property."""

    matrix: sp.csc_array
    name: str | None = None
    exponent: int = 0


@dataclass(frozen=True, eq=False)
class ParameterMatrices:
    """Stiffness and mass as sums of matrices times powers of factors.

    Attributes:
        nominal: the model as exported with nominal properties.
        stiffness, mass: their terms, the constant one first.
        errors: file of a check → the larger relative error of its predicted stiffness and mass.
    """

    nominal: ExportedModel
    stiffness: tuple[Term, ...]
    mass: tuple[Term, ...]
    errors: Mapping[str, float]


def parameter_matrices(
    nominal: ExportedModel, changed: Sequence[Export], checks: Sequence[Export] = ()
) -> ParameterMatrices:
    """Terms of stiffness and mass by differences of exports.

    Args:
        nominal: the model with nominal properties.
        changed: exports with one altered property each; several of a property with other factors
            find powers and polynomials.
        checks: exports with any properties altered, which must be predicted.

    Raises:
        ValueError: an export is of another model, alters no or several properties, or changes
            nothing; or the exports are not predicted to 1e-8, and the message gives the error.
    """
    by_name: dict[str, list[Export]] = {}
    for export in changed:
        if len(export.factors) != 1:
            raise ValueError(f"{export.file}: must alter one property, got {dict(export.factors)}")
        by_name.setdefault(next(iter(export.factors)), []).append(export)
    for name, exports in by_name.items():
        _require_other_factors(name, exports)
    for check in checks:
        unknown = [name for name in check.factors if name not in by_name]
        if unknown:
            raise ValueError(
                f"{check.file}: {unknown[0]!r} is not altered by any other export; altered are "
                f"{', '.join(map(repr, by_name))}"
            )
    errors = {check.file: 0.0 for check in checks}
    terms = []
    for which in ("stiffness", "mass"):
        base = getattr(nominal, which)
        differences = {
            name: [_difference(nominal, export, which) for export in exports]
            for name, exports in by_name.items()
        }
        wanted = [_difference(nominal, check, which) for check in checks]
        fits = {
            name: list(_fits(f"{name}: {which}", exports, differences[name], _scale(base), checks))
            for name, exports in by_name.items()
        }
        chosen, of_checks = _chosen(fits, checks, wanted, _scale(base), which)
        errors = {file: max(error, of_checks[file]) for file, error in errors.items()}
        terms.append(_terms(base, chosen))
    affected = {term.name for part in terms for term in part}
    idle = [name for name in by_name if name not in affected]
    if idle:
        raise ValueError(
            f"{by_name[idle[0]][0].file}: {idle[0]!r} changes neither stiffness nor mass; is it "
            "the nominal export?"
        )
    return ParameterMatrices(nominal, terms[0], terms[1], errors)


def _require_other_factors(name: str, exports: Sequence[Export]) -> None:
    factors = [export.factors[name] for export in exports]
    for export, factor in zip(exports, factors, strict=True):
        if not (np.isfinite(factor) and factor > 0.0 and factor != 1.0):
            raise ValueError(
                f"{export.file}: the factor of {name!r} must be positive and not 1, got {factor:g}"
            )
    if len(set(factors)) < len(factors):
        raise ValueError(f"{exports[-1].file}: another export has the same factor of {name!r}")


def _difference(nominal: ExportedModel, export: Export, which: str) -> sp.csc_array:
    """Altered minus nominal matrix, rows in the nominal order."""
    matrix = getattr(export.model, which)
    if export.model.size != nominal.size:
        raise ValueError(
            f"{export.file}: {export.model.size} degrees of freedom, the nominal export has "
            f"{nominal.size}"
        )
    if nominal.labels != export.model.labels:
        if set(nominal.labels or ()) != set(export.model.labels or ()):
            raise ValueError(f"{export.file}: its labels are not those of the nominal export")
        row_of = {name: row for row, name in enumerate(export.model.labels or ())}
        order = [row_of[name] for name in nominal.labels or ()]
        matrix = matrix[order][:, order]
    return sp.csc_array(matrix - getattr(nominal, which))


def _scale(matrix: sp.csc_array) -> sp.dia_array:
    """Diagonal that makes entries (i, j) relative to √(K_ii K_jj)."""
    diagonal = np.sqrt(abs(matrix.diagonal()))
    diagonal[diagonal == 0.0] = diagonal.max()
    return sp.diags_array(1.0 / diagonal)


def _error(difference: sp.csc_array, scale: sp.dia_array) -> float:
    return float(abs(scale @ difference @ scale).max())


Fit = tuple[tuple[int, sp.csc_array], ...]


def _fits(
    what: str,
    exports: Sequence[Export],
    differences: Sequence[sp.csc_array],
    scale: sp.dia_array,
    checks: Sequence[Export],
) -> Iterator[Fit]:
    """Exponents and matrices that predict all exports of a property, the fewest first.

    With as many exponents as exports, each set of them does: more than one is then offered, and
    other exports must tell.
    """
    name = next(iter(exports[0].factors))
    factors = np.array([export.factors[name] for export in exports])
    if max(_error(each, scale) for each in differences) <= NEGLIGIBLE:
        yield ()
        return
    smallest = np.inf
    for count in range(1, len(factors) + 1):
        fits = []
        for exponents in combinations(EXPONENTS, count):
            fit, error = _fit(factors, exponents, differences, scale)
            smallest = min(smallest, error if count < len(factors) else np.inf)
            if error <= TOLERANCE:
                fits.append(fit)
        if fits and count < len(factors):
            yield fits[0]
            return
        if fits and len(factors) == 1:
            yield fits[0]  # affine, the exponent 1
            return
        if fits and any(name in check.factors for check in checks):
            yield from fits
            return
    raise ValueError(
        f"{what}: no power of its factor predicts these exports, the best misses them by "
        f"{smallest:.1e} of √(K_ii K_jj); export it with one more factor, for a sum of powers"
    )


def _fit(
    factors: FloatArray,
    exponents: tuple[int, ...],
    differences: Sequence[sp.csc_array],
    scale: sp.dia_array,
) -> tuple[Fit, float]:
    """Matrices of the exponents by least squares, and the largest error of a prediction."""
    design = factors[:, None] ** np.array(exponents, dtype=float) - 1.0
    weights = np.linalg.pinv(design)
    matrices = [_sum(row, differences) for row in weights]
    errors = [
        _error(_sum([-1.0, *row], [difference, *matrices]), scale)
        for row, difference in zip(design, differences, strict=True)
    ]
    return tuple(zip(exponents, matrices, strict=True)), max(errors)


def _sum(weights: Sequence[float] | FloatArray, matrices: Sequence[sp.csc_array]) -> sp.csc_array:
    total = float(weights[0]) * matrices[0]
    for weight, matrix in zip(weights[1:], matrices[1:], strict=True):
        total = total + float(weight) * matrix
    return sp.csc_array(total)


def _chosen(
    fits: Mapping[str, list[Fit]],
    checks: Sequence[Export],
    wanted: Sequence[sp.csc_array],
    scale: sp.dia_array,
    which: str,
) -> tuple[dict[str, Fit], dict[str, float]]:
    """One fit of each property, with which all checks are predicted, and their errors."""
    best: tuple[float, str] = (np.inf, "")
    for combination in product(*fits.values()):
        chosen = dict(zip(fits, combination, strict=True))
        errors = {
            check.file: _error(difference - _predicted(chosen, check.factors, difference), scale)
            for check, difference in zip(checks, wanted, strict=True)
        }
        largest = max(errors.items(), key=lambda item: item[1], default=("", 0.0))
        if largest[1] <= TOLERANCE:
            return chosen, errors
        best = min(best, (largest[1], largest[0]))
    raise ValueError(
        f"{best[1]}: its {which} is missed by {best[0]:.1e} of √(K_ii K_jj), {TOLERANCE:g} is "
        "allowed: it is not a sum of these properties' powers; export each with one more factor, "
        "and with more digits if they are few"
    )


def _predicted(
    chosen: Mapping[str, Fit], factors: Mapping[str, float], like: sp.csc_array
) -> sp.csc_array:
    total = sp.csc_array(like.shape)
    for name, factor in factors.items():
        for exponent, matrix in chosen[name]:
            total = total + (factor**exponent - 1.0) * matrix
    return total


def _terms(base: sp.csc_array, chosen: Mapping[str, Fit]) -> tuple[Term, ...]:
    terms = [
        Term(cleaned, name, exponent)
        for name, fit in chosen.items()
        for exponent, matrix in fit
        if (cleaned := _without_rounding(matrix, base)).nnz
    ]
    constant = _without_rounding(
        _sum([1.0, *[-1.0] * len(terms)], [base, *(t.matrix for t in terms)]), base
    )
    return (Term(constant), *terms) if constant.nnz else tuple(terms)


def _without_rounding(matrix: sp.csc_array, base: sp.csc_array) -> sp.csc_array:
    scale = _scale(base)
    relative = abs(scale @ matrix @ scale)
    kept = sp.csc_array(matrix.multiply(relative > NEGLIGIBLE))
    kept.eliminate_zeros()
    return kept
