"""Parameters by difference: K(θ) and M(θ) from exports of one model with altered properties.

Stiffness and mass are polynomials in most properties of sections and materials: proportional to a
modulus, a density or an area, with a part proportional to t and one to t³ in the thickness t of a
shell. With factors θ_j of properties, 1 being nominal,

    K(θ) = K_c + Σ_j Σ_e θ_j^e K_je,  K_c = K(1) - Σ_je K_je,

and K_je follow from exports in which one property has other factors, by least squares in f^e - 1.
The fewest exponents are taken with which all exports of the property are predicted, fewer than
these, or a single one linearly; further exports, with several properties altered at once, must be
predicted as well. Where the product of two properties matters, as of the modulus and the thickness
of the same shells, they are not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy.sparse as sp

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.parameters.parameters import Value
from bayes_ssi.structures.solver_files.exported_model import ExportedModel

# Largest error of a prediction, relative to √(K_ii K_jj): what nine printed digits allow.
TOLERANCE = 1e-8
ROUNDING = 1e-3 * TOLERANCE  # parts of a matrix below it are rounding of printed digits
FEWEST_DIGITS = 8  # to which programs print matrices that are differenced
# Of properties: modulus, area and density enter by 1, bending of plates and the depth of
# sections by 3, their second moments by 4 in the diameter, flexibilities by -1.
EXPONENTS = (1, 3, 2, 4, -1)


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


@dataclass(frozen=True, eq=False)
class MatrixTerm:
    """A matrix times a power of a property's factor; the constant term has no property."""

    matrix: sp.csc_array
    name: str = ""
    exponent: int = 0


@dataclass(frozen=True, eq=False)
class ParameterMatrices:
    """Stiffness and mass as sums of matrices times powers of factors.

    Attributes:
        nominal: the model with all factors 1.
        stiffness: the terms of K(θ), and ``mass`` those of M(θ).
        errors: file of a check → the largest error of its entries, relative to √(K_ii K_jj).
    """

    nominal: ExportedModel
    stiffness: tuple[MatrixTerm, ...]
    mass: tuple[MatrixTerm, ...]
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
        names = {term.name for term in (*self.stiffness, *self.mass) if term.name}
        require_known("parameters: none is given for property", names, parameters)

        def pairs(terms: Sequence[MatrixTerm]) -> list[tuple[Value, sp.csc_array]]:
            return [(parameters[t.name] ** t.exponent if t.name else 1.0, t.matrix) for t in terms]

        return pairs(self.stiffness), pairs(self.mass)


@checked
def parameter_matrices(
    nominal: ExportedModel, changed: Sequence[AlteredModel], checks: Sequence[AlteredModel] = ()
) -> ParameterMatrices:
    """Terms of stiffness and mass by differences of exports.

    Args:
        nominal: the model with nominal properties.
        changed: exports with one altered property each; several with other factors find powers and
            polynomials.
        checks: exports with several properties altered, which must be predicted.

    Raises:
        ValueError: an export is of another model, a factor is 1 or not positive, a property changes
            nothing, or an export is not predicted to 1e-8.
    """
    by_property: dict[str, list[AlteredModel]] = {}
    for export in changed:
        if len(export.factors) != 1:
            raise ValueError(
                f"{export.file}: must alter one property, got {dict(export.factors)}; exports with "
                "several are checks"
            )
        by_property.setdefault(next(iter(export.factors)), []).append(export)
    for name, exports in by_property.items():
        for export in exports:
            if not 0.0 < (factor := export.factors[name]) < np.inf or factor == 1.0:
                raise ValueError(
                    f"{export.file}: the factor of {name!r} must be positive and not 1, got "
                    f"{factor:g}"
                )
        if len({export.factors[name] for export in exports}) < len(exports):
            raise ValueError(f"{exports[-1].file}: another export has the same factor of {name!r}")
    for check in checks:
        require_known(f"{check.file}: no other export alters alone", check.factors, by_property)
    errors = {check.file: 0.0 for check in checks}
    terms = []
    for which in ("stiffness", "mass"):
        changes = _Changes(which, nominal, [*changed, *checks])
        chosen = [one for each in by_property.items() for one in changes.fitted(*each)]
        for check in checks:
            errors[check.file] = max(errors[check.file], changes.missed(chosen, check))
        terms.append(changes.with_constant(chosen))
    affected = {term.name for part in terms for term in part}
    idle = [name for name in by_property if name not in affected]
    if idle:
        raise ValueError(
            f"{by_property[idle[0]][0].file}: {idle[0]!r} changes neither stiffness nor mass; is "
            "it the nominal export?"
        )
    return ParameterMatrices(nominal, terms[0], terms[1], errors)


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


def _sum(weights: Sequence[float] | FloatArray, matrices: Sequence[sp.csc_array]) -> sp.csc_array:
    first, *others = (float(w) * matrix for w, matrix in zip(weights, matrices, strict=True))
    return sp.csc_array(sum(others, start=first))


class _Changes:
    def __init__(self, which: str, model: ExportedModel, exports: Sequence[AlteredModel]) -> None:
        self.which, self.nominal = which, getattr(model, which)
        diagonal = np.sqrt(abs(self.nominal.diagonal()))
        diagonal[diagonal == 0.0] = diagonal.max()
        self.scale = sp.diags_array(1.0 / diagonal)  # makes entries relative to √(K_ii K_jj)
        self.differences = {export: _difference(model, export, which) for export in exports}
        smallest = min(abs(f - 1.0) for export in exports for f in export.factors.values())
        # Numbers of fewer digits are round ones, rather than rounded.
        last_digit = 10.0 ** (1 - model.digits) if model.digits >= FEWEST_DIGITS else 0.0
        # Relative parts of a matrix of all entries below which it is rounding of printed digits:
        # those of a difference of two exports, over that of the factors.
        self.rounding = max(ROUNDING, 2.0 * last_digit / smallest)

    def error(self, difference: sp.csc_array) -> float:
        return float(abs(self.scale @ difference @ self.scale).max())

    def missed(self, terms: Sequence[MatrixTerm], check: AlteredModel) -> float:
        """The largest error of the prediction of a check, refused where it is too large."""
        changes = [check.factors.get(term.name, 1.0) ** term.exponent - 1.0 for term in terms]
        matrices = [self.differences[check], *(term.matrix for term in terms)]
        error = self.error(_sum([-1.0, *changes], matrices))
        if error > TOLERANCE:
            raise ValueError(
                f"{check.file}: its {self.which} is missed by {error:.1e} of √(K_ii K_jj), "
                f"{TOLERANCE:g} is allowed: if files and factors are right, it is not a "
                "sum of these properties' powers; export each with one more factor, and with more "
                "digits if they are few, or do without one of two whose product matters"
            )
        return error

    def fitted(self, name: str, exports: Sequence[AlteredModel]) -> list[MatrixTerm]:
        """The fewest powers that predict exports of one property.

        As many powers as there are exports always do: then all that are possible must be wanted,
        or of a single export the first, which is linear.
        """
        differences = [self.differences[export] for export in exports]
        if max(map(self.error, differences)) <= ROUNDING:
            return []
        factors, smallest = np.array([export.factors[name] for export in exports]), np.inf
        for count in range(1, min(len(exports), len(EXPONENTS)) + 1):
            if count < len(exports) or count == len(EXPONENTS):
                sets = list(combinations(EXPONENTS, count))
            else:
                sets = [EXPONENTS[:1]] if len(exports) == 1 else []
            for exponents in sets:
                # Matrices by least squares, and the largest error of a prediction.
                design = factors[:, None] ** np.array(exponents, dtype=float) - 1.0
                matrices = [_sum(row, differences) for row in np.linalg.pinv(design)]
                error = max(
                    self.error(_sum([-1.0, *row], [difference, *matrices]))
                    for row, difference in zip(design, differences, strict=True)
                )
                if error <= TOLERANCE:
                    each = zip(matrices, exponents, strict=True)
                    return [MatrixTerm(matrix, name, exponent) for matrix, exponent in each]
                smallest = min(smallest, error)
        raise ValueError(
            f"{name}: {self.which}: no power of its factor predicts these exports, the best misses "
            f"them by {smallest:.1e} of √(K_ii K_jj); export it with one more factor, for a sum of "
            "powers"
        )

    def with_constant(self, chosen: Sequence[MatrixTerm]) -> tuple[MatrixTerm, ...]:
        """The terms without what is rounding, from the constant one on."""
        constant = _sum([1.0, *(-1.0 for _ in chosen)], [self.nominal, *(t.matrix for t in chosen)])
        terms = []
        for term in (MatrixTerm(constant), *chosen):
            relative = abs(self.scale @ term.matrix @ self.scale)
            kept_entries = sp.csc_array(term.matrix.multiply(relative > ROUNDING))
            kept_entries.eliminate_zeros()
            if kept_entries.nnz and self.error(term.matrix) > self.rounding:
                terms.append(replace(term, matrix=kept_entries))
        return tuple(terms)
