"""One test of many: its posterior in standard-normal coordinates, from a ranking or its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.criticism.adequacy import Adequacy
from bayes_ssi.inference.model_class.class_record import ClassRecord, ParameterRecord, class_record
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.results.load import StoredResult, load_result
from bayes_ssi.studies.ranking.study import Ranking

# Most draws of each test that are used: their likelihoods are known, so that more say little more.
MOST_DRAWS = 1000
# Fewer tests say nothing of how parameters vary.
FEWEST_TESTS = 2

# A ranking of one test, as it was made or read, or the directory that holds it.
TestResult = Ranking | StoredResult | str | PathLike[str]


@dataclass(frozen=True, eq=False)
class SingleTest:
    """The posterior of one model class in one test.

    Attributes:
        parameters: of the model class, the columns of ``z``.
        z: (n, d), nearly independent posterior draws in standard-normal coordinates.
        log_likelihoods: (n,).
        evidence: log evidence of the class.
    """

    name: str
    parameters: tuple[ParameterRecord, ...]
    z: FloatArray
    log_likelihoods: FloatArray
    evidence: Estimate
    data_digest: str
    definitions: tuple[str, ...]
    failed_checks: tuple[str, ...]
    adequacy: Adequacy | None = None

    def columns(self, names: Sequence[str]) -> list[int]:
        """The columns of the named parameters."""
        own = [parameter.name for parameter in self.parameters]
        return [own.index(name) for name in names]


def single_tests(
    results: Mapping[str, TestResult], class_name: str | None = None
) -> tuple[str, tuple[SingleTest, ...]]:
    """The name of the model class, and its posterior in every test."""
    if len(results) < FEWEST_TESTS:
        raise ValueError(f"hierarchy: at least {FEWEST_TESTS} tests are needed, got {len(results)}")
    tests: list[SingleTest] = []
    for name, result in results.items():
        found, posterior, record, failed = _chosen(name, result, class_name)
        class_name = found
        tests.append(_single_test(name, posterior, record, failed))
    assert class_name is not None
    _check_alike(tests, class_name)
    return class_name, tuple(tests)


def _chosen(
    test: str, result: TestResult, class_name: str | None
) -> tuple[str, Posterior, ClassRecord, tuple[str, ...]]:
    """Name, posterior and record of the model class in one result, and its data's failed checks."""
    if isinstance(result, (str, PathLike)):
        result = load_result(Path(result))
    if isinstance(result, Ranking):
        records = tuple(map(class_record, result.study.model_classes))
    elif isinstance(result, StoredResult):
        records = result.record.model_classes
    else:
        raise TypeError(
            f"hierarchy: test {test!r} must be a ranking or a result directory, got {result!r}"
        )
    names = [each.name for each in records]
    chosen = names[0] if class_name is None and len(names) == 1 else class_name
    if chosen not in names:
        listed = ", ".join(map(repr, names))
        problem = "which model class?" if chosen is None else f"no model class {chosen!r};"
        raise ValueError(f"hierarchy: test {test!r}: {problem} Choose from {listed}")
    posterior = next(each for each in result.posteriors if each.name == chosen)
    failed = result.comparison.failed_data_checks
    return chosen, posterior, records[names.index(chosen)], failed


def _single_test(
    name: str, posterior: Posterior, record: ClassRecord, failed: Sequence[str]
) -> SingleTest:
    values = posterior.values
    independent = int(posterior.effective_sample_sizes.min())
    # Draws of successive steps, walker by walker: evenly spaced ones are far apart in a chain.
    some = evenly_spaced_indices(len(values), max(1, min(MOST_DRAWS, independent)))
    columns = zip(record.parameters, values[some].T, strict=True)
    z = np.column_stack([parameter.prior.to_normal(column) for parameter, column in columns])
    if not np.isfinite(z).all():
        raise ValueError(f"hierarchy: test {name!r}: a draw lies outside of its prior")
    return SingleTest(
        name=name,
        parameters=record.parameters,
        z=z,
        log_likelihoods=posterior.log_likelihoods.reshape(-1)[some],
        evidence=Estimate(posterior.evidence.log_evidence, posterior.evidence.error),
        data_digest=posterior.data_digest,
        definitions=tuple(each.definition for each in record.configurations),
        failed_checks=tuple(
            f"test {name!r}: {check}" for check in (*failed, *posterior.failed_checks)
        ),
        adequacy=posterior.adequacy,
    )


def _check_alike(tests: Sequence[SingleTest], class_name: str) -> None:
    """Raise ValueError unless the tests are different tests of the same class."""
    first = tests[0]
    by_digest: dict[str, str] = {}
    for test in tests:
        where = f"hierarchy: model class {class_name!r} in tests {first.name!r} and {test.name!r}"
        same = by_digest.setdefault(test.data_digest, test.name)
        if same != test.name:
            raise ValueError(f"hierarchy: tests {same!r} and {test.name!r} have the same data")
        for ours, theirs in zip(first.parameters, test.parameters, strict=False):
            if ours.name != theirs.name:
                raise ValueError(
                    f"{where}: the parameters differ, {ours.name!r} and {theirs.name!r}"
                )
            if ours != theirs:
                raise ValueError(
                    f"{where}: the priors of {ours.name!r} differ, {ours.prior!r} and "
                    f"{theirs.prior!r}; rank all tests with the same prior"
                )
        if len(first.parameters) != len(test.parameters):
            raise ValueError(
                f"{where}: {len(first.parameters)} and {len(test.parameters)} parameters"
            )
