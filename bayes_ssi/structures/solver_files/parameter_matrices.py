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

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations, product

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


# Properties with the exponents of their factors, whose powers are multiplied; () is 1.
Powers = tuple[tuple[str, int], ...]


@dataclass(frozen=True, eq=False)
class MatrixTerm:
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
        names = {name for term in (*self.stiffness, *self.mass) for name, _ in term.powers}
        require_known("parameters: none is given for property", names, parameters)

        def pairs(terms: Sequence[MatrixTerm]) -> list[tuple[Value, sp.csc_array]]:
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
    alone = {names[0]: exports for names, exports in by_properties.items() if len(names) == 1}
    for other in (*checks, *changed):
        require_known(f"{other.file}: no other export alters alone", other.factors, alone)
    errors = {check.file: 0.0 for check in checks}
    terms = []
    for which in ("stiffness", "mass"):
        changes = _Changes.of(which, nominal, [*changed, *checks])
        fits: dict[tuple[str, ...], Terms] = {}
        for names in sorted(by_properties, key=len):  # what each changes alone comes first
            possible: list[Powers] = [((names[0], e),) for e in EXPONENTS]
            if len(names) == 2:
                first, second = (fits[(name,)] for name in names)
                possible = [(*a.powers, *b.powers) for a, b in product(first, second)]
            known = tuple(chain.from_iterable(fits.values())) if len(names) == 2 else ()
            fits[names] = changes.fitted(by_properties[names], possible, known)
        chosen = tuple(chain.from_iterable(fits.values()))
        for check in checks:
            errors[check.file] = max(errors[check.file], changes.missed(chosen, check))
        terms.append(changes.multiplied_out(chosen))
    affected = {name for part in terms for term in part for name, _ in term.powers}
    idle = [name for name in alone if name not in affected]
    if idle:
        raise ValueError(
            f"{alone[idle[0]][0].file}: {idle[0]!r} changes neither stiffness nor mass; is it "
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


# Each term is a matrix times the product of f^e - 1, which is zero where a property is nominal.
Terms = tuple[MatrixTerm, ...]


def _change(powers: Powers, factors: Mapping[str, float]) -> float:
    return math.prod(factors.get(name, 1.0) ** exponent - 1.0 for name, exponent in powers)


def _sum(weights: Sequence[float] | FloatArray, matrices: Sequence[sp.csc_array]) -> sp.csc_array:
    first, *others = (float(w) * matrix for w, matrix in zip(weights, matrices, strict=True))
    return sp.csc_array(sum(others, start=first))


@dataclass(frozen=True, eq=False)
class _Changes:
    which: str
    nominal: sp.csc_array
    scale: sp.dia_array  # the diagonal that makes entries (i, j) relative to √(K_ii K_jj)
    differences: Mapping[AlteredModel, sp.csc_array]
    # Relative parts of a matrix of all entries below which it is rounding of printed digits: those
    # of a difference of two exports, over that of the factors.
    rounding: float

    @classmethod
    def of(cls, which: str, model: ExportedModel, exports: Sequence[AlteredModel]) -> "_Changes":
        nominal = getattr(model, which)
        diagonal = np.sqrt(abs(nominal.diagonal()))
        diagonal[diagonal == 0.0] = diagonal.max()
        differences = {export: _difference(model, export, which) for export in exports}
        smallest = min(abs(f - 1.0) for export in exports for f in export.factors.values())
        # Numbers of fewer digits are round ones, rather than rounded.
        last_digit = 10.0 ** (1 - model.digits) if model.digits >= FEWEST_DIGITS else 0.0
        rounding = max(ROUNDING, 2.0 * last_digit / smallest)
        return cls(which, nominal, sp.diags_array(1.0 / diagonal), differences, rounding)

    def error(self, difference: sp.csc_array) -> float:
        return float(abs(self.scale @ difference @ self.scale).max())

    def left(self, export: AlteredModel, known: Terms) -> sp.csc_array:
        """What an export changes beyond what is known."""
        predicted = sp.csc_array(self.scale.shape)
        for term in known:
            change = _change(term.powers, export.factors)
            if change != 0.0:
                predicted = predicted + change * term.matrix
        return sp.csc_array(self.differences[export] - predicted)

    def missed(self, fit: Terms, check: AlteredModel) -> float:
        """The largest error of the prediction of a check, refused where it is too large."""
        error = self.error(self.left(check, fit))
        if error > TOLERANCE:
            raise ValueError(
                f"{check.file}: its {self.which} is missed by {error:.1e} of √(K_ii K_jj), "
                f"{TOLERANCE:g} is allowed: if files and factors are right, it is not a "
                "sum of these properties' powers; export each with one more factor, two whose "
                "product matters also together, and with more digits if they are few"
            )
        return error

    def fitted(
        self, exports: Sequence[AlteredModel], possible: Sequence[Powers], known: Terms
    ) -> Terms:
        """The fewest powers that, with those ``known``, predict exports of the same properties.

        As many powers as there are exports always do: then all that are possible must be wanted,
        or of a single property and export the first, which is linear.
        """
        differences = [self.left(export, known) for export in exports]
        # What is known may predict them, as well as printed digits allow.
        allowed = TOLERANCE if known else ROUNDING
        if max(map(self.error, differences)) <= allowed:
            return ()
        names = sorted(exports[0].factors)
        smallest = np.inf
        for count in range(1, min(len(exports), len(possible)) + 1):
            if count < len(exports) or count == len(possible):
                sets = list(combinations(possible, count))
            else:
                sets = [tuple(possible[:1])] if len(exports) == len(names) == 1 else []
            for powers in sets:
                # Matrices by least squares, and the largest error of a prediction.
                design = np.array([[_change(p, e.factors) for p in powers] for e in exports])
                matrices = [_sum(row, differences) for row in np.linalg.pinv(design)]
                error = max(
                    self.error(_sum([-1.0, *row], [difference, *matrices]))
                    for row, difference in zip(design, differences, strict=True)
                )
                if error <= TOLERANCE:
                    return tuple(map(MatrixTerm, matrices, powers))
                smallest = min(smallest, error)
        is_single = len(names) == 1
        what = "power of its factor predicts" if is_single else "product of their powers predicts"
        missed = (
            f", the best misses them by {smallest:.1e} of √(K_ii K_jj)" if smallest < np.inf else ""
        )
        raise ValueError(
            f"{' and '.join(names)}: {self.which}: no {what} these exports{missed}; export "
            f"{'it' if is_single else 'both'} with one more factor, for a sum of powers"
        )

    def multiplied_out(self, chosen: Terms) -> tuple[MatrixTerm, ...]:
        """Products of f^e - 1 multiplied out, without what is rounding."""
        of_powers: dict[Powers, sp.csc_array] = {(): self.nominal}
        for term in chosen:
            powers = term.powers
            for count in range(len(powers), -1, -1):
                for kept in combinations(powers, count):
                    part = (-1.0) ** (len(powers) - count) * term.matrix
                    of_powers[kept] = of_powers[kept] + part if kept in of_powers else part
        terms = []
        for powers, matrix in of_powers.items():
            relative = abs(self.scale @ matrix @ self.scale)
            kept_entries = sp.csc_array(matrix.multiply(relative > ROUNDING))
            kept_entries.eliminate_zeros()
            if kept_entries.nnz and self.error(matrix) > self.rounding:
                terms.append(MatrixTerm(kept_entries, powers))
        return tuple(terms)
