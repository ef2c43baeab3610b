"""Parameters, and products of them in the fields of structures and errors.

A number in a field is fixed, a :class:`Parameter` in the same field is inferred, and the same
Parameter in two fields ties them. ``nominal * k1`` and ``thickness**3`` are allowed: every
such field is a :class:`Product`, a number times powers of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_name
from bayes_ssi.parameters.priors import Prior

# Largest prior probability of a value at or below zero in a field that must be positive: about one
# of the likelihood evaluations of a run.
NEGLIGIBLE_PROBABILITY = 1e-6


class _Multiplies:
    """Multiplication, division and powers of a Parameter or Product."""

    def __mul__(self, other: Value) -> Product:
        return as_product(self) * as_product(other)  # type: ignore[arg-type]

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> Product:
        return as_product(self) * as_product(other) ** -1.0  # type: ignore[arg-type]

    def __rtruediv__(self, other: Value) -> Product:
        return as_product(other) * as_product(self) ** -1.0  # type: ignore[arg-type]

    def __pow__(self, exponent: float) -> Product:
        product = as_product(self)  # type: ignore[arg-type]
        powers = tuple((p, power * exponent) for p, power in product.powers)
        return Product(product.scale**exponent, powers)


@dataclass(frozen=True)
class Parameter(_Multiplies):
    """An uncertain quantity: a name, a proper prior, and a unit for reports.

    Two objects of the same name, prior and unit are the same parameter.

    Raises:
        TypeError: the prior is no prior distribution.
        ValueError: the name is no text, is empty, or cannot be printed.

    >>> stiffness = 30e9 * bs.Parameter("E / nominal", bs.LogNormal(median=1.0, cov=0.1))
    >>> stiffness.median
    30000000000.0
    """

    name: str
    prior: Prior
    unit: str = ""

    def __post_init__(self) -> None:
        require_name(self.name, "Parameter: name")
        if not isinstance(self.prior, Prior):
            known = ", ".join(kind.__name__ for kind in Prior.__subclasses__())
            raise TypeError(
                f"Parameter {self.name!r}: prior must be a prior distribution, got {self.prior!r}; "
                f"choose from {known}"
            )


@dataclass(frozen=True)
class Product(_Multiplies):
    """``scale`` times powers of parameters; with no parameters, a fixed number."""

    scale: float
    powers: tuple[tuple[Parameter, float], ...] = ()

    def __repr__(self) -> str:
        """The product in the notation of a study: ``199.3 * k1 * t**3``."""
        factors = [p.name if power == 1 else f"{p.name}**{power:g}" for p, power in self.powers]
        return " * ".join([f"{self.scale:.6g}", *factors])

    def __mul__(self, other: Value) -> Product:
        other = as_product(other)
        powers = dict(self.powers)
        for parameter, power in other.powers:
            powers[parameter] = powers.get(parameter, 0.0) + power
        remaining = tuple((p, power) for p, power in powers.items() if power != 0.0)
        return Product(self.scale * other.scale, remaining)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(parameter for parameter, _ in self.powers)

    @property
    def median(self) -> float:
        """The product at every parameter's prior median."""
        return self.scale * math.prod(p.prior.quantile(0.5) ** power for p, power in self.powers)


Value = float | Parameter | Product


def as_product(value: Value, field: str = "value") -> Product:
    """The :class:`Product` that a number, Parameter or Product stands for."""
    if isinstance(value, Product):
        return value
    if isinstance(value, Parameter):
        return Product(1.0, ((value, 1.0),))
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        return Product(float(value))
    raise TypeError(f"{field} must be a number, a Parameter or a number times it, got {value!r}")


def positive_product(value: Value, field: str) -> Product:
    """Like :func:`as_product`, for a field that must be positive."""
    product = as_product(value, field)
    if not (math.isfinite(product.scale) and product.scale > 0):
        raise ValueError(f"{field} must be positive and finite, got {product.scale!r}")
    for parameter in product.parameters:
        share = parameter.prior.probability_below(0.0)
        if share > NEGLIGIBLE_PROBABILITY:
            raise ValueError(
                f"{field} must be positive, but parameter {parameter.name!r} with prior "
                f"{parameter.prior} is zero or negative with probability {share:.2g}; "
                "choose a LogNormal or a TruncatedNormal prior"
            )
    return product


def fraction_product(value: Value, field: str) -> Product:
    """Like :func:`as_product`, for a field that must be at least 0 and below 1."""
    product = as_product(value, field)
    if not product.parameters:
        if not 0.0 <= product.scale < 1.0:
            raise ValueError(f"{field} must be at least 0 and below 1, got {product.scale!r}")
        return product
    highest, positive = product.scale, True
    for parameter, power in product.powers:
        ends = np.array(parameter.prior.support)
        with np.errstate(divide="ignore", invalid="ignore"):
            highest *= float((ends**power).max())
        positive &= float(ends.min()) >= 0.0
    if not (positive and 0.0 < highest <= 1.0):
        priors = ", ".join(f"{p.name!r} with prior {p.prior}" for p in product.parameters)
        raise ValueError(
            f"{field} must be at least 0 and below 1, which {priors} can leave; choose "
            "Uniform(0, 1) or another prior within these bounds"
        )
    return product


def collect_parameters(parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """Each parameter once, in the order of first appearance."""
    by_name: dict[str, Parameter] = {}
    for parameter in parameters:
        known = by_name.setdefault(parameter.name, parameter)
        if known != parameter:
            raise ValueError(
                f"two different parameters are named {parameter.name!r}: {known} and {parameter}; "
                "use one Parameter object in both places to tie them, or two names"
            )
    return tuple(by_name.values())


def parameters_of(products: Iterable[Product]) -> tuple[Parameter, ...]:
    """Those of all products, each once, in the order of first appearance."""
    return collect_parameters(p for product in products for p in product.parameters)


def checked_values(values: ArrayLike, parameters: Sequence[Parameter], name: str) -> FloatArray:
    """``values`` as an array (B, n_parameters); ``name`` is what messages call it.

    Numbers that are not finite are left to the model: a batch is not refused for one of its rows.
    """
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be an array of numbers, got {values!r:.80}") from None
    if array.ndim != 2 or array.shape[1] != len(parameters):
        columns = ", ".join(parameter.name for parameter in parameters) or "none"
        raise ValueError(
            f"{name} must have one row for each set of values and one column for each parameter "
            f"({columns}), (B, {len(parameters)}), got shape {array.shape}"
        )
    return array


def values_at(parameters: Sequence[Parameter], z: FloatArray) -> FloatArray:
    """Values (B, n_parameters) of parameters at standard-normal coordinates ``z``."""
    values = np.empty(z.shape)
    for column, parameter in enumerate(parameters):
        values[:, column] = parameter.prior.from_normal(z[:, column])
    return values


@dataclass(frozen=True)
class ProductTable:
    """Evaluates many products for a batch of parameter values at once."""

    products: tuple[Product, ...]
    # The columns of the values that :meth:`evaluate` takes, all of ``products`` among them.
    parameters: tuple[Parameter, ...]

    @cached_property
    def _factors(self) -> list[tuple[float, list[tuple[int, float]]]]:
        """Of each product its scale, and the column and power of every factor."""
        column = {parameter: i for i, parameter in enumerate(self.parameters)}
        return [(each.scale, [(column[p], e) for p, e in each.powers]) for each in self.products]

    def evaluate(self, values: FloatArray) -> FloatArray:
        """The products at ``values`` (B, n_parameters), as an array (B, T)."""
        table = np.empty((len(self.products), len(values)))
        for row, (scale, factors) in zip(table, self._factors, strict=True):
            row[:] = scale
            for column, power in factors:
                row *= values[:, column] if power == 1.0 else values[:, column] ** power
        return table.T
