"""Populations from which the parameters of the tests come, and the likelihood of what they share.

The coordinates z of a test's parameters, in which their priors are N(0, I), are normally
distributed about a mean, which may follow a covariate: z_i ~ N(mean + slope·x_i, diag(spread²)).
With spread zero and without slope they are the same in all tests.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import require_regular_file
from bayes_ssi.parameters.families import HalfNormal, Normal
from bayes_ssi.parameters.parameters import Parameter, values_at
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.results.hierarchy.hierarchy_settings import SETTINGS
from bayes_ssi.results.hierarchy.likelihood_fit import Bumps


def read_covariate(path: str | Path) -> tuple[str, dict[str, float]]:
    """Name and values of a covariate: name of a test → value.

    The file has two columns, the tests and the covariate, and a heading for each; the second one
    names the covariate::

        test, temperature in °C
        2026-01-14, -3.5
        2026-04-02, 11
    """
    path = Path(path)
    try:
        require_regular_file(path)
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file in UTF-8") from None
    rows = csv.reader(text.splitlines(), skipinitialspace=True)
    numbered = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    lines = [(n, row) for n, row in numbered if any(row) and not row[0].startswith("#")]
    if not lines or len(lines[0][1]) != 2 or not lines[0][1][1]:
        got = lines[0][1] if lines else "nothing"
        raise ValueError(f"{path}: the first line must be 'test, NAME OF THE COVARIATE', got {got}")
    name, values = lines[0][1][1], {}
    for line, row in lines[1:]:
        where = f"{path}, line {line}"
        if len(row) != 2 or not row[0]:
            raise ValueError(f"{where}: expected a test and its {name}, got {','.join(row)!r}")
        if row[0] in values:
            raise ValueError(f"{where}: a second value for test {row[0]!r}")
        try:
            values[row[0]] = float(row[1])
        except ValueError:
            raise ValueError(f"{where}: {name} must be a number, got {row[1]!r}") from None
    return name, values


@dataclass(frozen=True)
class PopulationPriors:
    """Priors of what describes a population, in standard-normal coordinates of the parameters.

    The mean is N(0, 1), so that the population's centre has the model class's own prior.

    Attributes:
        spread: standard deviation from test to test, in standard deviations of the class's prior.
        slope: change of the mean by one standard deviation of the covariate.
    """

    spread: Prior = field(default_factory=partial(HalfNormal, 0.5))
    slope: Prior = field(default_factory=partial(Normal, 0.0, 0.5))


@dataclass(frozen=True)
class Population:
    """One hypothesis about how the parameters of the tests are related.

    Attributes:
        name: in words.
        names: the k parameters of the model class that it describes.
        varies: whether they vary from test to test.
        follows: whether their mean follows the covariate.
        priors: priors of spreads and slopes.
    """

    name: str
    names: tuple[str, ...]
    varies: bool
    follows: bool
    priors: PopulationPriors

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Means, then slopes and spreads where there are any, of all k parameters."""
        kinds: list[tuple[str, Prior]] = [("mean", Normal(0.0, 1.0))]
        kinds += [("slope", self.priors.slope)] if self.follows else []
        kinds += [("spread", self.priors.spread)] if self.varies else []
        return tuple(
            Parameter(f"{kind} of {n}", prior) for kind, prior in kinds for n in self.names
        )

    def values(self, u: FloatArray) -> FloatArray:
        """Values (B, n_parameters) of the parameters at standard-normal coordinates ``u``."""
        return values_at(self.parameters, u)

    def split(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Means, slopes and spreads, each (B, k), from ``values`` (B, n_parameters)."""
        k = len(self.names)
        zeros = np.zeros((len(values), k))
        slopes = values[:, k : 2 * k] if self.follows else zeros
        return values[:, :k], slopes, values[:, -k:] if self.varies else zeros


@dataclass(frozen=True, eq=False)
class PopulationLikelihood:
    """The likelihood of all tests, each given by bumps, at parameters of a population.

    Attributes:
        covariates: (n_tests,), standardised; zero where there are none.
    """

    population: Population
    bumps: Sequence[Bumps]
    covariates: FloatArray

    def log_likelihood_at(self, u: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at standard-normal coordinates of the population's parameters."""
        return self.of_tests(self.population.values(u)).sum(axis=1)

    def of_tests(self, values: FloatArray) -> FloatArray:
        """The log-likelihood of every test (B, n_tests) at ``values`` (B, n_parameters)."""
        rows = max(1, SETTINGS.array_size // self._joined.roots.size)
        parts = [self._of_tests(values[i : i + rows]) for i in range(0, len(values), rows)]
        return np.concatenate(parts)

    def _of_tests(self, values: FloatArray) -> FloatArray:
        """As :meth:`of_tests`.

        With z = mean + spread·e and e ~ N(0, I), the exponent of a bump is quadratic in e, and its
        expectation is a normal integral.
        """
        joined = self._joined
        means, slopes, spreads = self.population.split(values)
        covariates = np.repeat(self.covariates, self._counts)
        means = means[:, None] + slopes[:, None] * covariates[:, None]
        rooted = np.einsum("tij,btj->bti", joined.roots, means)
        log_parts = joined.constants + np.einsum("tj,btj->bt", joined.slopes, means)
        log_parts -= 0.5 * np.einsum("bti,bti->bt", rooted, rooted)
        if self.population.varies:
            linear = joined.slopes - np.einsum("tij,bti->btj", joined.roots, rooted)
            linear *= spreads[:, None]
            scales = spreads[:, :, None] * spreads[:, None]
            matrices = joined.precisions * scales[:, None] + np.eye(spreads.shape[1])
            choleskys: FloatArray = np.linalg.cholesky(matrices).astype(float, copy=False)
            solved = _forward_substituted(choleskys, linear)
            log_parts += 0.5 * np.einsum("bti,bti->bt", solved, solved)
            log_parts -= np.log(np.diagonal(choleskys, axis1=2, axis2=3)).sum(axis=-1)
        first = np.cumsum(self._counts) - self._counts
        return np.logaddexp.reduceat(log_parts, first, axis=1)

    @cached_property
    def _joined(self) -> Bumps:
        """The bumps of all tests in turn, and :attr:`_counts`, how many each test has."""
        return Bumps.joined(self.bumps)

    @cached_property
    def _counts(self) -> NDArray[np.intp]:
        return np.array([len(bumps.constants) for bumps in self.bumps])


def _forward_substituted(lower: FloatArray, right: FloatArray) -> FloatArray:
    """x (..., k) with lower·x = right, for lower triangular matrices (..., k, k)."""
    solved = np.empty_like(right)
    for i in range(right.shape[-1]):
        known = (lower[..., i, :i] * solved[..., :i]).sum(axis=-1)
        solved[..., i] = (right[..., i] - known) / lower[..., i, i]
    return solved
