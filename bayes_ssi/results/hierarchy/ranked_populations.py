"""Many tests of one structure, from the stored posteriors of each: no test is sampled again.

What tests that the model class does not explain say of a population means nothing.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np
from scipy.special import betaincc

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices
from bayes_ssi.foundations.text_files import read_table
from bayes_ssi.inference.criticism.adequacy import (
    inadequacy_in_words,
    misfit_text,
    misfits_in_words,
)
from bayes_ssi.inference.criticism.misfit import INADEQUATE
from bayes_ssi.inference.sampling.diagnostics import Estimate
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.results.hierarchy import populations
from bayes_ssi.results.hierarchy.hierarchy_record import (
    CovariateScale,
    Hierarchy,
    RankedPopulation,
    SingleTestSummary,
)
from bayes_ssi.results.hierarchy.populations import PopulationPriors, SingleTest
from bayes_ssi.results.stored_result import AnyResult, StoredResult, as_stored
from bayes_ssi.studies.ranking import comparison

FEWEST_TESTS = 2  # fewer say nothing of how parameters vary
# Of each test that are used: their likelihoods are known, so that more say little more.
MOST_DRAWS = 1000
# From the draws of the tests, in nats; with a larger one, two standard errors are more than a
# bare mention on the scale of Bayes factors.
LARGEST_ERROR = 0.5
# Of frequencies, in their standard deviations; smaller ones are those that the prior leaves.
SMALLEST_REPEATED_ERROR = 0.3
# Probability with which errors that agree between tests by chance are taken for repeated ones.
REPEATED_BY_CHANCE = 0.001

SAME, VARIES = "the same in all tests", "varies from test to test"


@checked
def hierarchy(
    results: Mapping[str, AnyResult],
    covariate: Mapping[str, float] | None = None,
    *,
    covariate_name: str = "covariate",
    class_name: str | None = None,
    parameters: Sequence[str] | None = None,
    priors: PopulationPriors | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
) -> Hierarchy:
    """Rank how the parameters of one model class vary over many tests of one structure.

    They are the same in all tests, vary from test to test, follow a covariate such as the
    temperature, or both. No test is sampled again: the likelihood of each is known at the draws of
    its posterior.

    Args:
        results: name of a test → its ranking, or the directory where that was saved.
        covariate: name of a test → the value of the covariate.
        covariate_name: of the covariate, for names of populations.
        class_name: the model class; not needed where the results are of one class.
        parameters: names of those that the populations describe; all of the structure if None.
            The others are independent from test to test, with their own priors.
        priors: of spreads and slopes.
        seed: determines the result.
        settings: how precisely to sample the parameters of the populations.
        run: its progress is reported to; nothing else of it is used.

    Raises:
        ValueError: there are too few tests, they are not of the same class, a parameter is
            unknown, or the covariate is missing, not finite or constant.
    """
    class_name, tests = single_tests(results, class_name)
    of_structure = [parameter.name for parameter in tests[0].parameters if not parameter.is_error]
    wanted = of_structure if parameters is None else parameters
    require_known("hierarchy: the structure has no parameter", wanted, of_structure)
    if not wanted:
        raise ValueError("hierarchy: no parameter is named; name one or more")
    names = tuple(name for name in of_structure if name in wanted)
    scale, x = _standardised(tests, covariate, covariate_name)
    report = (run or Run()).report
    fits = populations.fit_tests(tests, seed, partial(report, "single tests", "likelihoods"))
    columns = tests[0].columns(names)
    sampler = populations.PopulationSampler(
        tests, fits, columns, x, seed, settings or SamplingSettings()
    )
    kinds = [(SAME, False, False), (VARIES, True, False)]
    if scale is not None:
        follows = f"varies with {scale.name}"
        kinds += [(follows, False, True), (f"{follows} and from test to test", True, True)]
    sampled = [
        sampler.sample(
            populations.Population(kind, names, varies, follows, priors or PopulationPriors()),
            partial(report, kind),
        )
        for kind, varies, follows in kinds
    ]
    sampled.sort(key=lambda population: -population.log_evidence)
    failed, unusual = judged_tests(class_name, tests)
    first, *others = tests
    remarks = [
        f"the structure of test {test.name!r} is not defined as that of {first.name!r}: "
        "parameters of one name must mean the same in all tests"
        for test in others
        if test.definitions != first.definitions
    ]
    return Hierarchy(
        model_class=class_name,
        parameters=tests[0].parameters,
        names=names,
        tests=tuple(_rows(sampler, sampled[0].coverage, covariate)),
        covariate=scale,
        populations=tuple(_ranked(sampled)),
        seed=seed,
        failed_checks=(
            *(c for test in tests for c in test.failed_checks),
            *failed,
            *repeated_errors(class_name, tests),
            *populations.failed_fits(tests, fits),
        ),
        remarks=(*remarks[:1], *unusual),
    )


def _standardised(
    tests: Sequence[SingleTest], covariate: Mapping[str, float] | None, name: str
) -> tuple[CovariateScale | None, FloatArray]:
    """The covariate's scale, and its standardised values (n_tests,); zeros without covariate."""
    if covariate is None:
        return None, np.zeros(len(tests))
    for test in tests:
        require_known(f"hierarchy: no value of {name!r} for test", [test.name], covariate)
        if not math.isfinite(covariate[test.name]):
            raise ValueError(
                f"hierarchy: {name!r} of test {test.name!r} must be a finite number, got "
                f"{covariate[test.name]!r}"
            )
    values = np.array([covariate[test.name] for test in tests], dtype=float)
    if np.ptp(values) == 0.0:
        raise ValueError(f"hierarchy: {name!r} is {values[0]:g} in all tests: nothing follows it")
    scale = CovariateScale(name, float(values.mean()), float(values.std()))
    return scale, (values - scale.mean) / scale.sd


def _rows(
    sampler: populations.PopulationSampler,
    covered: populations.Coverage,
    covariate: Mapping[str, float] | None,
) -> list[SingleTestSummary]:
    """A row for each test, with what the most probable population's coverage says of it."""
    sizes = np.median(covered.effective_sample_sizes, axis=0)
    rows = []
    for i, test in enumerate(sampler.tests):
        quantiles = np.quantile(test.z[:, sampler.columns], [0.05, 0.5, 0.95], axis=0)
        own = [test.parameters[column].prior for column in sampler.columns]
        intervals = [p.from_normal(of_p) for p, of_p in zip(own, quantiles.T, strict=True)]
        rows.append(
            SingleTestSummary(
                name=test.name,
                data_digest=test.data_digest,
                covariate=None if covariate is None else float(covariate[test.name]),
                log_evidence=test.evidence.log_evidence,
                intervals=tuple((float(a), float(b), float(c)) for a, b, c in intervals),
                n_draws=len(test.z),
                effective_sample_size=float(sizes[i]),
            )
        )
    return rows


def _ranked(sampled: Sequence[populations.SampledPopulation]) -> list[RankedPopulation]:
    best = sampled[0]
    probabilities = comparison.class_probabilities(
        {s.population.name: s.log_evidence for s in sampled}, None
    )
    rows = []
    for each in sampled:
        difference = each.log_evidence - best.log_evidence
        error = 0.0 if each is best else math.hypot(each.error, best.error)
        failed = each.failed_checks
        # Where a population has no chance, it does not matter how little.
        has_chance = difference + comparison.STANDARD_ERRORS * error > math.log(comparison.PROBABLE)
        if has_chance and each.coverage.error > LARGEST_ERROR:
            failed = (
                *failed,
                f"the draws of the tests leave an error of {each.coverage.error:.2f} nats, more "
                f"than {LARGEST_ERROR}: they hardly reach where the population has the "
                "tests' parameters",
            )
        rows.append(
            RankedPopulation(
                population=each.population,
                log_evidence=each.log_evidence,
                error=each.error,
                probability=probabilities[each.population.name],
                log_bayes_factor=difference,
                log_bayes_factor_error=error,
                against="best" if each is best else comparison.evidence_against(difference, error),
                draws=each.draws,
                failed_checks=failed,
            )
        )
    return rows


def single_tests(
    results: Mapping[str, AnyResult], class_name: str | None = None
) -> tuple[str, tuple[SingleTest, ...]]:
    """The name of the model class, and its posterior in every test."""
    if len(results) < FEWEST_TESTS:
        raise ValueError(f"hierarchy: at least {FEWEST_TESTS} tests are needed, got {len(results)}")
    tests: list[SingleTest] = []
    for name, result in results.items():
        stored = as_stored(result)
        known = [model_class.name for model_class in stored.record.model_classes]
        class_name = known[0] if class_name is None and len(known) == 1 else class_name
        if class_name not in known:
            what = "which model class?" if class_name is None else f"no model class {class_name!r};"
            listed = ", ".join(map(repr, known))
            raise ValueError(f"hierarchy: test {name!r}: {what} Choose from {listed}")
        tests.append(_single_test(name, stored, class_name))
    assert class_name is not None
    _check_alike(tests, class_name)
    return class_name, tuple(tests)


def _single_test(name: str, stored: StoredResult, class_name: str) -> SingleTest:
    posterior, record = stored.posterior(class_name), stored.record.model_class(class_name)
    failed, values = stored.comparison.failed_data_checks, posterior.values
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
        definitions=tuple(configuration.definition for configuration in record.configurations),
        failed_checks=tuple(
            f"test {name!r}: {check}" for check in (*failed, *posterior.failed_checks)
        ),
        adequacy=posterior.adequacy,
    )


def _check_alike(tests: Sequence[SingleTest], class_name: str) -> None:
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
        if fit and (len(tests) * fit.overall.p_value < INADEQUATE or fit.hints):
            failed.append(f"{what}: {inadequacy_in_words(fit)}")
        elif fit and fit.overall.is_small:
            unusual.append(
                f"{what}: the data are as unusual as in one right test of "
                f"{1.0 / INADEQUATE:.0f}, {misfit_text(fit.overall.sds)}: "
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
    is_large = of_means > SMALLEST_REPEATED_ERROR**2
    if is_large and by_chance < REPEATED_BY_CHANCE:
        means = zip(labels, errors.mean(axis=0), strict=True)
        listed = ", ".join(f"mode {label} {100 * mean:+.1f} %" for label, mean in means)
        yield (
            f"{class_name!r} errs alike in all tests ({listed} on average): these errors are "
            "counted anew in each test and hide how the parameters vary; rank classes with all "
            "tests as configurations and ErrorModel(between_tests=...)"
        )
