"""The result of a hierarchical model: ranked populations, what follows from them, and its files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray, systematic_indices
from bayes_ssi.foundations.displayed import Displayed, columns, counted
from bayes_ssi.foundations.packages import versions
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.results.hierarchy.populations import RankedPopulation
from bayes_ssi.results.result_files import new_directory, read_current, write_csv, write_json

# The file that every directory of this kind holds.
MARKER = "hierarchy.json"
NEXT_TESTS = 1000  # draws of the parameters in the next test that are written to a file


@dataclass(frozen=True)
class SingleTestSummary:
    """What one of the tests says by itself."""

    name: str
    covariate: float | None  # None where there is no covariate
    log_evidence: float  # of the model class in this test alone
    # 5, 50 and 95 % quantiles of the population's parameters in this test alone.
    intervals: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class CovariateScale:
    """A covariate, and how it is standardised."""

    name: str  # for tables and figures, with its unit
    mean: float
    sd: float


@dataclass(frozen=True, eq=False, repr=False)
class Hierarchy(Displayed):
    """Many tests of one structure: how its parameters vary from test to test.

    Attributes:
        model_class: name of the class that was sampled in every test.
        parameters: all parameters of the class.
        names: those that the populations describe; the others are independent from test to test.
        tests: the tests.
        covariate: the covariate; None where there is none.
        populations: ranked, the most probable first.
        seed: seed of the sampling.
        failed_checks: of the single tests, a sentence each.
        remarks: a sentence each.
    """

    model_class: str
    parameters: tuple[ParameterRecord, ...]
    names: tuple[str, ...]
    tests: tuple[SingleTestSummary, ...]
    covariate: CovariateScale | None
    populations: tuple[RankedPopulation, ...]
    seed: int
    failed_checks: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def best(self) -> RankedPopulation:
        """The most probable population."""
        return self.populations[0]

    @property
    def all_failed_checks(self) -> tuple[str, ...]:
        """Failed checks of the tests, and of the populations with their names."""
        of_populations = (
            f"{each.name!r}: {check}" for each in self.populations for check in each.failed_checks
        )
        return (*self.failed_checks, *of_populations)

    def centres(self, ranked: RankedPopulation, covariate: float | None = None) -> FloatArray:
        """Draws (n_draws, k) of the population's median in the units of the parameters.

        Args:
            ranked: the population.
            covariate: where; at the mean of the tests if None.

        Raises:
            ValueError: there is no covariate.
        """
        means, slopes, _ = ranked.population.split(ranked.draws)
        return in_units(self.of_population, means + slopes * self._standardised(covariate))

    def spreads(self, ranked: RankedPopulation) -> FloatArray:
        """Draws (n_draws, k) of the standard deviation from test to test, in the parameters' units.

        Half the distance between the values one standard deviation on either side of the centre,
        both in standard-normal coordinates.
        """
        means, _, spreads = ranked.population.split(ranked.draws)
        return 0.5 * self._apart(means, spreads)

    def slopes(self, ranked: RankedPopulation) -> FloatArray:
        """Draws (n_draws, k) of the change of the centre by one unit of the covariate.

        At the covariate's mean, in the units of the parameters.

        Raises:
            ValueError: there is no covariate.
        """
        if self.covariate is None:
            raise ValueError("hierarchy: there is no covariate")
        means, slopes, _ = ranked.population.split(ranked.draws)
        return self._apart(means, 0.5 * slopes / self.covariate.sd)

    def _apart(self, middle: FloatArray, step: FloatArray) -> FloatArray:
        """The distance (n_draws, k) of values a step to either side, in the parameters' units."""
        above, below = (in_units(self.of_population, middle + one) for one in (step, -step))
        return above - below

    def next_test(self, n_draws: int = 1000, covariate: float | None = None) -> FloatArray:
        """Draws of the parameters in the next test, (n_draws, n_parameters), in their units.

        All parameters of the model class, as its structure and errors take them: those of the
        populations are drawn from these, in proportion to their probabilities, the others from
        their priors.

        Args:
            n_draws: number of draws.
            covariate: its value in the next test; the mean of the tests if None.

        Raises:
            ValueError: there is no covariate, or ``n_draws`` is not positive.
        """
        if n_draws < 1:
            raise ValueError(f"hierarchy: the number of draws must be positive, got {n_draws!r}")
        rng = np.random.default_rng(0)
        probabilities = np.array([each.probability for each in self.populations])
        chosen = systematic_indices(probabilities, n_draws, rng)
        counts = np.bincount(chosen, minlength=len(probabilities))
        drawn = []
        for ranked, count in zip(self.populations, counts, strict=True):
            values = ranked.draws[rng.integers(len(ranked.draws), size=count)]
            means, slopes, spreads = ranked.population.split(values)
            steps = spreads * rng.standard_normal(means.shape)
            drawn.append(means + slopes * self._standardised(covariate) + steps)
        z = rng.standard_normal((n_draws, len(self.parameters)))
        z[:, self.population_columns] = np.concatenate(drawn)
        return in_units(self.parameters, z)

    @property
    def of_population(self) -> tuple[ParameterRecord, ...]:
        """The parameters that the populations describe."""
        return tuple(self.parameters[column] for column in self.population_columns)

    @property
    def population_columns(self) -> list[int]:
        """Their columns among those of all parameters, as in :meth:`next_test`."""
        own = [parameter.name for parameter in self.parameters]
        return [own.index(name) for name in self.names]

    def _standardised(self, covariate: float | None) -> float:
        if covariate is None:
            return 0.0
        if self.covariate is None:
            raise ValueError(f"hierarchy: there is no covariate, got {covariate!r}")
        return (covariate - self.covariate.mean) / self.covariate.sd

    def _line(self) -> str:
        return f"of {counted(len(self.tests), 'test')} of {self.model_class!r}: {self.best.name}"

    def _rows(self) -> list[dict[str, Any]]:
        names = ("name", "log_evidence", "error", "log_bayes_factor", "probability", "against")
        return [columns(row, names) for row in self.populations]


def in_units(parameters: Sequence[ParameterRecord], z: FloatArray) -> FloatArray:
    """Values (n, k) of parameters at standard-normal coordinates ``z`` (n, k)."""
    values = [each.prior.from_normal(z[:, i]) for i, each in enumerate(parameters)]
    return np.stack(values, axis=1)


@dataclass(frozen=True)
class HierarchyRecord:
    hierarchy: Hierarchy
    command: str  # the command that reproduces it; empty where it was made from Python
    created: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))
    versions: Mapping[str, str] = field(default_factory=versions)
    format: int = 2  # increased whenever the format of the files changes


@checked
def save_hierarchy(
    hierarchy: Hierarchy,
    directory: str | Path,
    *,
    covariate: float | None = None,
    overwrite: bool = False,
    command: str = "",
) -> None:
    """Write a hierarchy, and draws of the parameters in the next test, to a new directory.

    Args:
        hierarchy: the result.
        directory: where it goes.
        covariate: its value in the next test; the mean of the tests if None.
        overwrite: replace a hierarchy that exists.
        command: the command that reproduces the result, for the record.

    Raises:
        FileExistsError: the directory exists and ``overwrite`` is false, or holds something else.
        ValueError: there is no covariate.
    """
    draws = hierarchy.next_test(NEXT_TESTS, covariate)
    with new_directory(directory, marker=MARKER, overwrite=overwrite) as partial:
        write_json(partial / MARKER, HierarchyRecord(hierarchy, command))
        names = [parameter.name for parameter in hierarchy.parameters]
        rows = [[f"{value:.7g}" for value in row] for row in draws]
        write_csv(partial / "next_test.csv", [names, *rows])


@checked
def load_hierarchy(directory: str | Path) -> Hierarchy:
    """Read a directory that :func:`save_hierarchy` wrote.

    Raises:
        ValueError: it does not exist, is damaged, or was written by another version.
    """
    path = Path(directory) / MARKER
    stored = read_current(HierarchyRecord, path, what="a hierarchy", again="compute it again")
    return stored.hierarchy
