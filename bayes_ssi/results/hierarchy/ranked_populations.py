"""Many tests of one structure, from the stored posteriors of each: no test is sampled again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.choices import require_known
from bayes_ssi.inference.model_class.class_record import ParameterRecord
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.results.hierarchy.hierarchy_record import (
    CovariateScale,
    Hierarchy,
    RankedPopulation,
    SingleTestSummary,
)
from bayes_ssi.results.hierarchy.likelihood_fit import SETTINGS
from bayes_ssi.results.hierarchy.populations import (
    Coverage,
    Population,
    PopulationPriors,
    PopulationSampler,
    SampledPopulation,
    failed_fits,
    fit_tests,
)
from bayes_ssi.results.hierarchy.single_tests import (
    SingleTest,
    judged_tests,
    repeated_errors,
    single_tests,
)
from bayes_ssi.results.stored_result import AnyResult
from bayes_ssi.studies.ranking.comparison import (
    RANKING,
    bayes_factor_scale,
    class_probabilities,
    is_distinguishable,
)

SAME, VARIES = "the same in all tests", "varies from test to test"

# Called with a population's name, a step and its completed share.
Report = Callable[[str, str, float], None]


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
    progress: Report = lambda _name, _step, _done: None,
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
        progress: called with the name of a population, a step and its completed share.

    Raises:
        ValueError: there are too few tests, they are not of the same class, a parameter is
            unknown, or the covariate is missing, not finite or constant.
    """
    class_name, tests = single_tests(results, class_name)
    names = _population_names(tests[0].parameters, parameters)
    scale, x = _standardised(tests, covariate, covariate_name)
    fits = fit_tests(tests, seed, partial(progress, "single tests", "likelihoods"))
    columns = tests[0].columns(names)
    sampler = PopulationSampler(tests, fits, columns, x, seed, settings or SamplingSettings())
    priors = priors or PopulationPriors()
    populations = [Population(SAME, names, False, False, priors)]
    populations += [Population(VARIES, names, True, False, priors)]
    if scale is not None:
        follows = f"varies with {scale.name}"
        populations += [Population(follows, names, False, True, priors)]
        both = f"{follows} and from test to test"
        populations += [Population(both, names, True, True, priors)]
    sampled = [sampler.sample(each, partial(progress, each.name)) for each in populations]
    sampled.sort(key=lambda each: -each.log_evidence)
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
            *failed_fits(tests, fits),
        ),
        remarks=(*remarks[:1], *unusual),
    )


def _population_names(
    own: Sequence[ParameterRecord], wanted: Sequence[str] | None
) -> tuple[str, ...]:
    of_structure = tuple(parameter.name for parameter in own if not parameter.is_error)
    if wanted is None:
        return of_structure
    require_known("hierarchy: the structure has no parameter", wanted, of_structure)
    if not wanted:
        raise ValueError("hierarchy: no parameter is named; name one or more")
    return tuple(name for name in of_structure if name in wanted)


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
    sampler: PopulationSampler, covered: Coverage, covariate: Mapping[str, float] | None
) -> list[SingleTestSummary]:
    """A row for each test, with what the most probable population's coverage says of it."""
    sizes = np.median(covered.effective_sample_sizes, axis=0)
    rows = []
    for i, (test, fit) in enumerate(zip(sampler.tests, sampler.fits, strict=True)):
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
                n_bumps=len(fit.bumps.constants),
                fit_error=fit.error,
                effective_sample_size=float(sizes[i]),
            )
        )
    return rows


def _ranked(sampled: Sequence[SampledPopulation]) -> list[RankedPopulation]:
    """Rows of the ranking, for populations in the order of their evidence."""
    best = sampled[0]
    probabilities = class_probabilities({s.population.name: s.log_evidence for s in sampled}, None)
    rows = []
    for each in sampled:
        difference = each.log_evidence - best.log_evidence
        error = 0.0 if each is best else math.hypot(each.error, best.error)
        failed = each.failed_checks
        # Where a population has no chance, it does not matter how little.
        has_chance = difference + RANKING.standard_errors * error > math.log(RANKING.probable)
        if has_chance and each.coverage.error > SETTINGS.largest_error:
            failed = (
                *failed,
                f"the draws of the tests leave an error of {each.coverage.error:.2f} nats, more "
                f"than {SETTINGS.largest_error}: they hardly reach where the population has the "
                "tests' parameters",
            )
        against = "best" if each is best else "not distinguishable"
        if each is not best and is_distinguishable(difference, error):
            against = bayes_factor_scale(difference)
        rows.append(
            RankedPopulation(
                population=each.population,
                log_evidence=each.log_evidence,
                error=each.error,
                error_from_draws=each.coverage.error,
                probability=probabilities[each.population.name],
                log_bayes_factor=difference,
                log_bayes_factor_error=error,
                against=against,
                draws=each.draws,
                failed_checks=failed,
            )
        )
    return rows
