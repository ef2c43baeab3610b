"""One test of many: its posterior in standard-normal coordinates, from a ranking or its files.

What tests that the model class does not explain say of a population means nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np
from scipy.special import betaincc

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.text_files import read_table
from bayes_ssi.inference.criticism.adequacy import Adequacy
from bayes_ssi.inference.criticism.misfit import CRITICISM
from bayes_ssi.inference.criticism.misfit_in_words import (
    inadequacy_in_words,
    misfit_text,
    misfits_in_words,
)
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.inference.sampling.estimates import Estimate
from bayes_ssi.inference.sampling.resampling import evenly_spaced_indices
from bayes_ssi.results.hierarchy.likelihood_fit import SETTINGS
from bayes_ssi.results.stored_result import AnyResult, StoredResult, as_stored


@dataclass(frozen=True, eq=False)
class SingleTest:
    """The posterior of one model class in one test."""

    name: str
    parameters: tuple[ParameterRecord, ...]  # of the model class, the columns of ``z``
    z: FloatArray  # (n, d), nearly independent posterior draws in standard-normal coordinates
    log_likelihoods: FloatArray  # (n,)
    evidence: Estimate  # log evidence of the class
    data_digest: str
    definitions: tuple[str, ...]
    failed_checks: tuple[str, ...]
    adequacy: Adequacy | None = None

    def columns(self, names: Sequence[str]) -> list[int]:
        """The columns of the named parameters."""
        own = [parameter.name for parameter in self.parameters]
        return [own.index(name) for name in names]


def single_tests(
    results: Mapping[str, AnyResult], class_name: str | None = None
) -> tuple[str, tuple[SingleTest, ...]]:
    """The name of the model class, and its posterior in every test."""
    if len(results) < SETTINGS.fewest_tests:
        raise ValueError(
            f"hierarchy: at least {SETTINGS.fewest_tests} tests are needed, got {len(results)}"
        )
    tests: list[SingleTest] = []
    for name, result in results.items():
        stored = as_stored(result)
        known = [each.name for each in stored.record.model_classes]
        class_name = known[0] if class_name is None and len(known) == 1 else class_name
        if class_name not in known:
            listed = ", ".join(map(repr, known))
            problem = (
                "which model class?" if class_name is None else f"no model class {class_name!r};"
            )
            raise ValueError(f"hierarchy: test {name!r}: {problem} Choose from {listed}")
        tests.append(_single_test(name, stored, class_name))
    assert class_name is not None
    _check_alike(tests, class_name)
    return class_name, tuple(tests)


def _single_test(name: str, stored: StoredResult, class_name: str) -> SingleTest:
    posterior, record = stored.posterior(class_name), stored.record.model_class(class_name)
    failed, values = stored.comparison.failed_data_checks, posterior.values
    independent = int(posterior.effective_sample_sizes.min())
    # Draws of successive steps, walker by walker: evenly spaced ones are far apart in a chain.
    some = evenly_spaced_indices(len(values), max(1, min(SETTINGS.most_draws, independent)))
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
        same = by_digest.setdefault(test.data_digest, test.name)
        if same != test.name:
            raise ValueError(f"hierarchy: tests {same!r} and {test.name!r} have the same data")
        for ours, theirs in zip_longest(first.parameters, test.parameters):
            if ours != theirs:
                raise ValueError(
                    f"hierarchy: model class {class_name!r} has the parameter {ours} in test "
                    f"{first.name!r} and {theirs} in test {test.name!r}; rank all tests with the "
                    "same parameters and priors"
                )


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
        columns, rows = read_table(path)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from None
    if len(columns) != 2 or not columns[1]:
        got = columns or "nothing"
        raise ValueError(f"{path}: the first line must be 'test, NAME OF THE COVARIATE', got {got}")
    name, values = columns[1], {}
    for where, row in rows:
        if len(row) != 2 or not row[0]:
            raise ValueError(f"{where}: expected a test and its {name}, got {','.join(row)!r}")
        if row[0] in values:
            raise ValueError(f"{where}: a second value for test {row[0]!r}")
        try:
            values[row[0]] = float(row[1])
        except ValueError:
            raise ValueError(f"{where}: {name} must be a number, got {row[1]!r}") from None
    return name, values


def judged_tests(class_name: str, tests: Sequence[SingleTest]) -> tuple[list[str], list[str]]:
    """Tests that the class does not explain, and those that only among so many it does.

    A sentence each.
    """
    failed: list[str] = []
    unusual: list[str] = []
    for test in tests:
        what, fit = f"test {test.name!r}, {class_name!r}", test.adequacy
        # Of many tests that a right class explains, the most unusual one is far out (Bonferroni).
        if fit and (len(tests) * fit.overall.p_value < CRITICISM.limit or fit.hints):
            failed.append(f"{what}: {inadequacy_in_words(fit)}")
        elif fit and fit.overall.is_small:
            unusual.append(
                f"{what}: the data are as unusual as in one right test of "
                f"{1.0 / CRITICISM.limit:.0f}, {misfit_text(fit.overall.sds)}: "
                f"{'; '.join(misfits_in_words(fit))}"
            )
    return failed, unusual


def repeated_errors(class_name: str, tests: Sequence[SingleTest]) -> Iterator[str]:
    """A sentence if the frequency errors of the modes repeat themselves from test to test.

    Of n tests, m modes and independent standardised errors, the share of the modes' mean errors in
    the sum of squares is Beta(m/2, m(n - 1)/2).
    """
    seen = [{m.label: m for m in t.adequacy.modes if m.frequency_sd} for t in tests if t.adequacy]
    labels = [label for label in seen[0] if all(label in modes for modes in seen)] if seen else []
    if len(seen) < len(tests) or not labels:
        return
    n, m = len(seen), len(labels)
    errors = np.array([[modes[label].frequency_error for label in labels] for modes in seen])
    standardised = errors / [[modes[label].frequency_sd for label in labels] for modes in seen]
    of_means = float((standardised.mean(axis=0) ** 2).mean())
    share = of_means / float((standardised**2).mean())
    by_chance = betaincc(0.5 * m, 0.5 * m * (n - 1), share)
    is_large = of_means > SETTINGS.smallest_repeated_error**2
    if is_large and by_chance < SETTINGS.repeated_by_chance:
        means = zip(labels, errors.mean(axis=0), strict=True)
        listed = ", ".join(f"mode {label} {100 * mean:+.1f} %" for label, mean in means)
        yield (
            f"{class_name!r} errs alike in all tests ({listed} on average): these errors are "
            "counted anew in each test and hide how the parameters vary; rank classes with all "
            "tests as configurations and ErrorModel(between_tests=...)"
        )
