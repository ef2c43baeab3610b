"""Parameters by difference: K(θ) and M(θ) from exports of one model with altered properties.

Stiffness and mass are polynomials in most properties of sections and materials: proportional to a
modulus, a density or an area, with a part proportional to t and one to t³ in the thickness t of a
shell. With factors θ_j of properties, 1 being nominal,

    K(θ) = K_c + Σ_j Σ_e θ_j^e K_je,  K_c = K(1) - Σ_je K_je,

and K_je follow from exports in which one property has other factors, by least squares in f^e - 1.
The fewest exponents are taken with which all exports of the property are predicted, fewer than
these, or a single one linearly; further exports, with several properties altered at once, must be
predicted as well.

Where the product of two properties matters, as of the modulus and the thickness of a shell,
exports with both altered give terms θ_j^e θ_k^f in the same way, from what they change beyond each
alone, by least squares in (f_j^e - 1)(f_k^f - 1), which is zero where either is nominal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.structures.solver_files.exported_model import ExportedModel


@dataclass(frozen=True)
class DifferenceSettings:
    """When exports count as predicted, and by which powers."""

    # Largest error of a prediction, relative to √(K_ii K_jj): what nine printed digits allow.
    tolerance: float = 1e-8
    # Of properties: modulus, area and density enter by 1, bending of plates and the depth of
    # sections by 3, their second moments by 4 in the diameter, flexibilities by -1.
    exponents: tuple[int, ...] = (1, 3, 2, 4, -1)

    @property
    def rounding(self) -> float:
        """Parts of a matrix below it are rounding of printed digits."""
        return 1e-3 * self.tolerance


SETTINGS = DifferenceSettings()


@dataclass(frozen=True, eq=False)
class AlteredModel:
    """An export of a model with altered properties.

    Attributes:
        file: what messages call it.
        factors: property → its factor, 1 being nominal.
        model: as :func:`read_model` reads it.
    """

    file: str
    factors: Mapping[str, float]
    model: ExportedModel


# Properties with the exponents of their factors, whose powers are multiplied; () is 1.
Powers = tuple[tuple[str, int], ...]


@dataclass(frozen=True, eq=False)
class Term:
    """A matrix times powers of properties' factors; the constant term has none."""

    matrix: sp.csc_array
    powers: Powers = ()


@dataclass(frozen=True, eq=False)
class ParameterMatrices:
    """Stiffness and mass as sums of matrices times powers of factors and their products.

    Attributes:
        nominal: the model with all factors 1.
        stiffness: the terms of K(θ), and ``mass`` those of M(θ).
        errors: file of a check → the largest error of its entries, relative to √(K_ii K_jj).
    """

    nominal: ExportedModel
    stiffness: tuple[Term, ...]
    mass: tuple[Term, ...]
    errors: Mapping[str, float]

    def with_parameters(
        self, parameters: Mapping[str, Value]
    ) -> tuple[list[tuple[Value, sp.csc_array]], list[tuple[Value, sp.csc_array]]]:
        """Stiffness and mass as :class:`MatrixStructure` takes them, pairs (coefficient, matrix).

        Args:
            parameters: property → the parameter, or number, that its factor is.

        Raises:
            ValueError: a property has no parameter.
        """
        names = {name for term in (*self.stiffness, *self.mass) for name, _ in term.powers}
        require_known("parameters: none is given for property", names, parameters)

        def pairs(terms: Sequence[Term]) -> list[tuple[Value, sp.csc_array]]:
            return [
                (math.prod((parameters[name] ** e for name, e in term.powers), start=1.0),
                 term.matrix)
                for term in terms
            ]  # fmt: skip

        return pairs(self.stiffness), pairs(self.mass)


@checked
def parameter_matrices(
    nominal: ExportedModel, changed: Sequence[AlteredModel], checks: Sequence[AlteredModel] = ()
) -> ParameterMatrices:
    """Terms of stiffness and mass by differences of exports.

    Args:
        nominal: the model with nominal properties.
        changed: exports with one altered property each, or with two whose product matters; several
            with other factors find powers and polynomials.
        checks: exports with several properties altered, which must be predicted.

    Raises:
        ValueError: an export is of another model, a factor is 1 or not positive, a property changes
            nothing, or an export is not predicted to 1e-8.
    """
    by_properties: dict[tuple[str, ...], list[AlteredModel]] = {}
    for export in changed:
        if len(export.factors) not in (1, 2):
            raise ValueError(
                f"{export.file}: must alter one property, or two whose product matters, got "
                f"{dict(export.factors)}"
            )
        by_properties.setdefault(tuple(sorted(export.factors)), []).append(export)
    for names, exports in by_properties.items():
        _require_other_factors(names, exports)
    by_name = {names[0]: exports for names, exports in by_properties.items() if len(names) == 1}
    by_pair = {names: exports for names, exports in by_properties.items() if len(names) == 2}
    for other in (*checks, *changed):
        require_known(f"{other.file}: no other export alters alone", other.factors, by_name)
    errors = {check.file: 0.0 for check in checks}
    terms = []
    for which in ("stiffness", "mass"):
        base = getattr(nominal, which)
        differences = {
            export: _difference(nominal, export, which) for export in (*changed, *checks)
        }
        changes = _Changes(which, _scale(base), differences)
        alone = {
            name: _fitted(changes, [((name, e),) for e in SETTINGS.exponents], exports, ())
            for name, exports in by_name.items()
        }
        chosen = _joined(alone.values())
        together = [
            _fitted(changes, _products(*(alone[name] for name in names)), exports, chosen)
            for names, exports in by_pair.items()
        ]
        chosen = (*chosen, *_joined(together))
        for check in checks:
            errors[check.file] = max(errors[check.file], changes.missed(chosen, check))
        terms.append(_terms(base, chosen))
    affected = {name for part in terms for term in part for name, _ in term.powers}
    idle = [name for name in by_name if name not in affected]
    if idle:
        raise ValueError(
            f"{by_name[idle[0]][0].file}: {idle[0]!r} changes neither stiffness nor mass; is it "
            "the nominal export?"
        )
    return ParameterMatrices(nominal, terms[0], terms[1], errors)


def _require_other_factors(names: Sequence[str], exports: Sequence[AlteredModel]) -> None:
    for export in exports:
        for name in names:
            factor = export.factors[name]
            if not (np.isfinite(factor) and factor > 0.0 and factor != 1.0):
                raise ValueError(
                    f"{export.file}: the factor of {name!r} must be positive and not 1, got "
                    f"{factor:g}"
                )
    if len({tuple(export.factors[name] for name in names) for export in exports}) < len(exports):
        what = " and ".join(map(repr, names))
        raise ValueError(f"{exports[-1].file}: another export has the same factor of {what}")


def _difference(nominal: ExportedModel, export: AlteredModel, which: str) -> sp.csc_array:
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


# Matrices with powers; the change is the sum of the matrices times products of f^e - 1.
Fit = tuple[tuple[Powers, sp.csc_array], ...]


@dataclass(frozen=True, eq=False)
class _Changes:
    """What exports change of the stiffness or mass."""

    which: str
    scale: sp.dia_array
    differences: Mapping[AlteredModel, sp.csc_array]

    def missed(self, fit: Fit, check: AlteredModel) -> float:
        """The largest error of the prediction of a check, refused where it is too large."""
        predicted = _predicted(fit, check.factors, self.scale)
        error = _error(self.differences[check] - predicted, self.scale)
        if error > SETTINGS.tolerance:
            raise ValueError(
                f"{check.file}: its {self.which} is missed by {error:.1e} of √(K_ii K_jj), "
                f"{SETTINGS.tolerance:g} is allowed: if files and factors are right, it is not a "
                "sum of these properties' powers; export each with one more factor, two whose "
                "product matters also together, and with more digits if they are few"
            )
        return error


def _fitted(
    changes: _Changes, possible: Sequence[Powers], exports: Sequence[AlteredModel], known: Fit
) -> Fit:
    """The fewest powers that, with those ``known``, predict exports of the same properties.

    As many powers as there are exports always do: then all that are possible must be wanted, or of
    a single property and export the first, which is linear.
    """
    differences = [
        sp.csc_array(changes.differences[export] - _predicted(known, export.factors, changes.scale))
        for export in exports
    ]
    # What is known may predict them, as well as printed digits allow.
    allowed = SETTINGS.tolerance if known else SETTINGS.rounding
    if max(_error(each, changes.scale) for each in differences) <= allowed:
        return ()
    names = sorted(exports[0].factors)
    smallest = np.inf
    for count in range(1, min(len(exports), len(possible)) + 1):
        if count < len(exports) or count == len(possible):
            sets = list(combinations(possible, count))
        else:
            sets = [tuple(possible[:1])] if len(exports) == len(names) == 1 else []
        for powers in sets:
            fit, error = _fit(powers, exports, differences, changes.scale)
            if error <= SETTINGS.tolerance:
                return fit
            smallest = min(smallest, error)
    what = "power of its factor predicts" if len(names) == 1 else "product of their powers predicts"
    missed = (
        f", the best misses them by {smallest:.1e} of √(K_ii K_jj)" if smallest < np.inf else ""
    )
    raise ValueError(
        f"{' and '.join(names)}: {changes.which}: no {what} these exports{missed}; export "
        f"{'it' if len(names) == 1 else 'both'} with one more factor, for a sum of powers"
    )


def _products(first: Fit, second: Fit) -> list[Powers]:
    """Every power of one property times every one of the other."""
    return [(*a, *b) for a, b in product((p for p, _ in first), (p for p, _ in second))]


def _fit(
    powers: Sequence[Powers],
    exports: Sequence[AlteredModel],
    differences: Sequence[sp.csc_array],
    scale: sp.dia_array,
) -> tuple[Fit, float]:
    """Matrices of the powers by least squares, and the largest error of a prediction."""
    design = np.array([[_change(each, export.factors) for each in powers] for export in exports])
    weights = np.linalg.pinv(design)
    matrices = [_sum(row, differences) for row in weights]
    errors = [
        _error(_sum([-1.0, *row], [difference, *matrices]), scale)
        for row, difference in zip(design, differences, strict=True)
    ]
    return tuple(zip(powers, matrices, strict=True)), max(errors)


def _change(powers: Powers, factors: Mapping[str, float]) -> float:
    """The product of f^e - 1, which is zero where a property is nominal."""
    return math.prod(factors.get(name, 1.0) ** exponent - 1.0 for name, exponent in powers)


def _sum(weights: Sequence[float] | FloatArray, matrices: Sequence[sp.csc_array]) -> sp.csc_array:
    total = float(weights[0]) * matrices[0]
    for weight, matrix in zip(weights[1:], matrices[1:], strict=True):
        total = total + float(weight) * matrix
    return sp.csc_array(total)


def _joined(fits: Iterable[Fit]) -> Fit:
    return tuple(part for fit in fits for part in fit)


def _predicted(fit: Fit, factors: Mapping[str, float], like: sp.dia_array) -> sp.csc_array:
    total = sp.csc_array(like.shape)
    for powers, matrix in fit:
        change = _change(powers, factors)
        if change != 0.0:
            total = total + change * matrix
    return total


def _terms(base: sp.csc_array, chosen: Fit) -> tuple[Term, ...]:
    """Products of f^e - 1 multiplied out, without what is rounding."""
    of_powers: dict[Powers, sp.csc_array] = {(): base}
    for powers, matrix in chosen:
        for count in range(len(powers), -1, -1):
            for kept in combinations(powers, count):
                part = (-1.0) ** (len(powers) - count) * matrix
                of_powers[kept] = of_powers[kept] + part if kept in of_powers else part
    cleaned = {powers: _without_rounding(each, base) for powers, each in of_powers.items()}
    return tuple(Term(matrix, powers) for powers, matrix in cleaned.items() if matrix.nnz)


def _without_rounding(matrix: sp.csc_array, base: sp.csc_array) -> sp.csc_array:
    scale = _scale(base)
    relative = abs(scale @ matrix @ scale)
    kept = sp.csc_array(matrix.multiply(relative > SETTINGS.rounding))
    kept.eliminate_zeros()
    return kept
