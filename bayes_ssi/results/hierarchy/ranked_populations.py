"""Many tests of one structure, from the stored posteriors of each: no test is sampled again.

What tests that the model class does not explain say of a population means nothing.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest

import numpy as np
from scipy.special import betaincc

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.criticism.adequacy import inadequacy_in_words
from bayes_ssi.inference.criticism.misfit import INADEQUATE
from bayes_ssi.inference.model_class.class_record import ClassRecord, ParameterRecord
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.results.hierarchy.hierarchy_record import (
    CovariateScale,
    Hierarchy,
    SingleTestSummary,
    in_units,
)
from bayes_ssi.results.hierarchy.likelihood_fit import fit_likelihood
from bayes_ssi.results.hierarchy.populations import (
    Population,
    PopulationPriors,
    RankedPopulation,
    sample_population,
)
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
    posteriors = {name: test.posterior(class_name) for name, test in tests.items()}
    records = {name: test.record.model_class(class_name) for name, test in tests.items()}
    everything = next(iter(records.values())).parameters
    of_structure = [parameter.name for parameter in everything if not parameter.is_error]
    wanted = of_structure if parameters is None else parameters
    require_known("hierarchy: the structure has no parameter", wanted, of_structure)
    if not wanted:
        raise ValueError("hierarchy: no parameter is named; name one or more")
    names = tuple(name for name in of_structure if name in wanted)
    scale, x = _standardised(list(tests), covariate, covariate_name)
    report = (run or Run()).report
    columns = [i for i, parameter in enumerate(everything) if parameter.name in names]
    fits, rows = [], []
    for i, (test, posterior) in enumerate(posteriors.items()):
        z, log_likelihoods = _draws(test, posterior, everything)
        evidence, rng = posterior.evidence.log_evidence, np.random.default_rng([seed, i])
        fits.append(fit_likelihood(z, log_likelihoods, evidence, rng).within(columns))
        quantiles = np.quantile(z[:, columns], LEVELS, axis=0)
        intervals = in_units([everything[column] for column in columns], quantiles).T
        at = None if covariate is None else float(covariate[test])
        rows.append(SingleTestSummary(test, at, evidence, tuple(map(tuple, intervals.tolist()))))
        report("single tests", "likelihoods", (i + 1) / len(tests))
    kinds = [(SAME, False, False), (VARIES, True, False)]
    if scale is not None:
        follows = f"varies with {scale.name}"
        kinds += [(follows, False, True), (f"{follows} and from test to test", True, True)]
    priors, settings, sampled = priors or PopulationPriors(), settings or SamplingSettings(), []
    for kind, varies, of_covariate in kinds:
        population = Population(kind, names, varies, of_covariate, priors)
        progress = partial(report, kind)
        sampled.append(sample_population(population, fits, x, seed, settings, progress))
    failed = [
        f"test {name!r}: {check}"
        for name, test in tests.items()
        for check in (*test.comparison.failed_data_checks, *posteriors[name].failed_checks)
    ]
    failed += [*unexplained_tests(class_name, posteriors)]
    failed += [*repeated_errors(class_name, posteriors)]
    return Hierarchy(
        model_class=class_name,
        parameters=everything,
        names=names,
        tests=tuple(rows),
        covariate=scale,
        populations=ranked(sampled),
        seed=seed,
        failed_checks=tuple(failed),
        remarks=tuple(different_structures(records)),
    )


def different_structures(records: Mapping[str, ClassRecord]) -> Iterator[str]:
    """A sentence if a test's structure is not defined as that of the first, of the first such."""
    defined = {name: [c.definition for c in own.configurations] for name, own in records.items()}
    first, *others = defined
    for name in [name for name in others if defined[name] != defined[first]][:1]:
        yield (
            f"the structure of test {name!r} is not defined as that of {first!r}: parameters of "
            "one name must mean the same in all tests"
        )


def _standardised(
    tests: Sequence[str], covariate: Mapping[str, float] | None, name: str
) -> tuple[CovariateScale | None, FloatArray]:
    """The covariate's scale, and its standardised values (n_tests,); zeros without covariate."""
    if covariate is None:
        return None, np.zeros(len(tests))
    require_known(f"hierarchy: no value of {name!r} for test", tests, covariate)
    values = np.array([covariate[test] for test in tests], dtype=float)
    for test, value in zip(tests, values.tolist(), strict=True):
        if not math.isfinite(value):
            raise ValueError(
                f"hierarchy: {name!r} of test {test!r} must be a finite number, got {value!r}"
            )
    if np.ptp(values) == 0.0:
        raise ValueError(f"hierarchy: {name!r} is {values[0]:g} in all tests: nothing follows it")
    scale = CovariateScale(name, float(values.mean()), float(values.std()))
    return scale, (values - scale.mean) / scale.sd


def ranked(sampled: Sequence[RankedPopulation]) -> tuple[RankedPopulation, ...]:
    """Populations that were sampled one by one, by their evidence."""
    ordered = sorted(sampled, key=lambda population: -population.log_evidence)
    best, rows = ordered[0], []
    log_evidences = {each.name: each.log_evidence for each in sampled}
    probabilities = comparison.class_probabilities(log_evidences, None)
    for each in ordered:
        difference = each.log_evidence - best.log_evidence
        error = 0.0 if each is best else math.hypot(each.error, best.error)
        against = "best" if each is best else comparison.evidence_against(difference, error)
        row = replace(each, log_bayes_factor=difference, log_bayes_factor_error=error)
        row = replace(row, probability=probabilities[each.name], against=against)
        # Where a population has no chance, it does not matter how little.
        has_chance = difference + comparison.STANDARD_ERRORS * error > math.log(comparison.PROBABLE)
        if has_chance and each.draws_error > LARGEST_ERROR:
            check = (
                f"the draws of the tests leave an error of {each.draws_error:.2f} nats, more "
                f"than {LARGEST_ERROR}: they hardly reach where the population has the "
                "tests' parameters"
            )
            row = replace(row, failed_checks=(*each.failed_checks, check))
        rows.append(row)
    return tuple(rows)


def single_tests(
    results: Mapping[str, AnyResult], class_name: str | None = None
) -> tuple[str, dict[str, StoredResult]]:
    """The name of the model class, and the results, which are of different data and one class."""
    if len(results) < FEWEST_TESTS:
        raise ValueError(f"hierarchy: at least {FEWEST_TESTS} tests are needed, got {len(results)}")
    tests = {name: as_stored(result) for name, result in results.items()}
    first = next(iter(tests))
    by_digest: dict[str, str] = {}
    for name, test in tests.items():
        known = [model_class.name for model_class in test.record.model_classes]
        class_name = known[0] if class_name is None and len(known) == 1 else class_name
        if class_name not in known:
            what = "which model class?" if class_name is None else f"no model class {class_name!r};"
            listed = ", ".join(map(repr, known))
            raise ValueError(f"hierarchy: test {name!r}: {what} Choose from {listed}")
        same = by_digest.setdefault(test.posterior(class_name).data_digest, name)
        if same != name:
            raise ValueError(f"hierarchy: tests {same!r} and {name!r} have the same data")
        parameters = (tests[n].record.model_class(class_name).parameters for n in (first, name))
        for ours, theirs in zip_longest(*parameters):
            if ours != theirs:
                raise ValueError(
                    f"hierarchy: model class {class_name!r} has the parameter {ours} in test "
                    f"{first!r} and {theirs} in test {name!r}; rank all tests with the same "
                    "parameters and priors"
                )
    assert class_name is not None
    return class_name, tests


def _draws(
    test: str, posterior: Posterior, parameters: Sequence[ParameterRecord]
) -> tuple[FloatArray, FloatArray]:
    """Nearly independent draws (n, d) in standard-normal coordinates, and log-likelihoods (n,)."""
    values = posterior.values
    independent = int(posterior.effective_sample_sizes.min())
    # Draws of successive steps, walker by walker: evenly spaced ones are far apart in a chain.
    some = evenly_spaced_indices(len(values), max(1, min(MOST_DRAWS, independent)))
    columns = zip(parameters, values[some].T, strict=True)
    z = np.column_stack([parameter.prior.to_normal(column) for parameter, column in columns])
    if not np.isfinite(z).all():
        raise ValueError(f"hierarchy: test {test!r}: a draw lies outside of its prior")
    return z, posterior.log_likelihoods.reshape(-1)[some]


def unexplained_tests(class_name: str, posteriors: Mapping[str, Posterior]) -> Iterator[str]:
    """Tests that the class does not explain, a sentence each."""
    for test, posterior in posteriors.items():
        fit = posterior.adequacy
        # Of many tests that a right class explains, the most unusual one is far out (Bonferroni).
        if fit and (len(posteriors) * fit.overall.p_value < INADEQUATE or fit.hints):
            words = inadequacy_in_words(fit, posterior.pairing_is_given)
            yield f"test {test!r}, {class_name!r}: {words}"


def repeated_errors(class_name: str, posteriors: Mapping[str, Posterior]) -> Iterator[str]:
    """A sentence if the frequency errors of the modes repeat themselves from test to test.

    Of n tests, m modes and independent standardised errors, the share of the modes' mean errors in
    the sum of squares is Beta(m/2, m(n - 1)/2).
    """
    known = [posterior.adequacy for posterior in posteriors.values()]
    seen = [{m.label: m for m in fit.modes if m.frequency_sd} for fit in known if fit]
    labels = [label for label in seen[0] if all(label in modes for modes in seen)] if seen else []
    if len(seen) < len(known) or not labels:
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
