"""The answer of a result in sentences: which structure, which parameters, how sure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.results.claims import (
    MOST_LISTED,
    best_determined,
    differing,
    explained,
    parameters_in_words,
    quantities,
    why_it_loses,
)
from bayes_ssi.results.load import StoredResult
from bayes_ssi.results.search_answer import (
    beaten_baselines,
    hypothesis_in_words,
    search_sentences,
    search_verdict,
)
from bayes_ssi.results.wording import (
    data_warnings,
    likelihood_in_words,
    listed,
    probability_in_words,
    with_error,
)
from bayes_ssi.studies.ranking.averages import averaged_parameters
from bayes_ssi.studies.ranking.comparison import RankedClass


@dataclass(frozen=True)
class Answer:
    """The answer of a result, the most important first.

    Attributes:
        warnings: what has to be understood before the answer is trusted: a sentence, and the items
            of the list below it.
        figures: Bayes factors and nats.
    """

    warnings: tuple[tuple[str, tuple[str, ...]], ...]
    verdict: str
    reasons: tuple[str, ...]
    figures: tuple[str, ...]

    @property
    def paragraphs(self) -> tuple[str, ...]:
        """The verdict and what follows it."""
        return (self.verdict, *self.reasons, *self.figures)


def answer(result: StoredResult) -> Answer:
    """The answer of a ranking, or of a search for appendages."""
    verdict = _verdict(result) if result.search is None else search_verdict(result.search)
    return Answer(
        tuple(_warnings(result)), verdict, tuple(_reasons(result)), tuple(_figures(result))
    )


def _warnings(result: StoredResult) -> Iterator[tuple[str, tuple[str, ...]]]:
    misfit = result.comparison.misfit
    accepted = result.record.failed_checks_accepted
    yield from data_warnings(result.comparison.failed_data_checks, accepted)
    missing = result.comparison.unmodelled_appendage
    if missing:
        yield (
            "The data look as if an appendage split a mode, and no model class has one. The answer "
            "is among wrong structures.",
            (missing,),
        )
    if misfit:
        yield "The most probable class does not explain the data.", (misfit,)
    beaten = beaten_baselines(result.search) if result.search else ()
    if beaten:
        yield (
            "The answer rests on a baseline that another class beats by far. An appendage on it "
            "may stand for what the baseline itself lacks.",
            beaten,
        )
    failed = result.comparison.failed_checks_of("sampling", "edge", "setting")
    if failed:
        several = len(failed) > 1
        yield (
            f"{len(failed)} check{'s' if several else ''} failed"
            f"{' and were accepted when the result was saved' if accepted else ''}. Do not trust "
            f"the ranking until {'they are' if several else 'it is'} understood.",
            failed,
        )


def _verdict(result: StoredResult) -> str:
    rows, best = result.comparison.classes, result.comparison.best
    if len(rows) == 1:
        return (
            f"Only one model class was sampled: {_title(result, best)}. How probable it is cannot "
            "be said without another."
        )
    alike = _alike(result)
    if alike:
        tied = [best, *alike]
        shown = [_title_and_probability(result, row) for row in tied[:MOST_LISTED]]
        shown += [f"{len(tied) - MOST_LISTED} others"] if len(tied) > MOST_LISTED else []
        together = probability_in_words(min(1.0, sum(row.probability for row in tied)))
        return (
            f"Among {len(rows)} model classes the data do not distinguish between "
            f"{listed(shown)}. Their probability together is {together}: keep them all, and "
            "predict with their average."
        )
    sure = likelihood_in_words(best.probability)
    before = probability_in_words(best.prior_probability)
    return (
        f"The most probable of the {len(rows)} model classes is: {_title(result, best)}. Among "
        f"them it is {sure}, with probability {probability_in_words(best.probability)}"
        f"{'' if result.comparison.has_equal_priors else f' ({before} before the test)'}."
    )


def _reasons(result: StoredResult) -> Iterator[str]:
    rows, best = result.comparison.classes, result.comparison.best
    alike = _alike(result)
    posterior = result.posterior(best.name)
    if result.search is not None:
        yield from search_sentences(result.search, result.comparison)
    elif alike:
        yield from _common_claims(result, [best, *alike])
    else:
        parameters = parameters_in_words(posterior, result.record.model_class(best.name))
        yield " ".join([f"It {explained(posterior, result.tests)}.", *parameters])
    others = [row for row in rows[1:] if row.distinguishable]
    if others:
        yield _runner_up(result, others[0], posterior)


def _common_claims(result: StoredResult, alike: Sequence[RankedClass]) -> Iterator[str]:
    """On which parameters classes agree that are not distinguishable, and on which they do not."""
    posteriors = [result.posterior(row.name) for row in alike]
    record = result.record.model_class(alike[0].name)
    disputed = {name for other in posteriors[1:] for name in differing(posteriors[0], other)[0]}
    of_all = set.intersection(*(set(each.parameter_names) for each in posteriors))
    agreed = [row for row in posteriors[0].summary if row.name in of_all - disputed]
    averages = {row.name: row for row in averaged_parameters(posteriors, result.comparison)}
    if agreed:
        shown = [averages[row.name] for row in best_determined(agreed)]
        more = len(agreed) - len(shown)
        yield (
            f"They agree on {quantities(shown, record)}{f' and {more} others' if more else ''} "
            "(medians and 90 % intervals of their average)."
        )
    for row, posterior in zip(alike[:MOST_LISTED], posteriors, strict=False):
        record = result.record.model_class(row.name)
        errors = {each.name for each in record.parameters if each.is_error}
        claimed = [each for each in posterior.summary if each.name in disputed - errors]
        sizes = [each for each in posterior.summary if each.name in disputed & errors]
        own = [each for each in posterior.summary if each.name not in of_all | disputed]
        parts = [explained(posterior, result.tests)]
        verbs = ("claims", "needs sizes of errors", "also infers")
        for verb, parameters in zip(verbs, (claimed, sizes, own), strict=True):
            if parameters:
                parts.append(f"{verb} {quantities(best_determined(parameters), record)}")
        yield f"{row.name!r} {'; it '.join(parts)}."


def _runner_up(result: StoredResult, row: RankedClass, best: Posterior) -> str:
    posterior = result.posterior(row.name)
    record = result.record.model_class(row.name)
    different, same = differing(posterior, best)
    errors = {each.name for each in record.parameters if each.is_error}
    own = set(posterior.parameter_names) - set(best.parameter_names) - errors
    claims = [each for each in posterior.summary if each.name in own.union(different) - errors]
    sizes = [each for each in posterior.summary if each.name in errors.intersection(different)]
    n_sampled = len(result.comparison.classes)
    among = f" among the {n_sampled} hypotheses that were sampled" if result.search else ""
    sentences = [
        f"Runner-up{among}: {_title_and_probability(result, row)}.",
        f"It {explained(posterior, result.tests)}.",
    ]
    if claims:
        sentences.append(f"It claims {quantities(best_determined(claims), record)}.")
    if sizes:
        sentences.append(f"It needs other sizes of errors: {quantities(sizes, record)}.")
    if same:
        other = "other " if claims or sizes else ""
        sentences.append(f"On the {other}parameters that both infer it agrees.")
    return " ".join([*sentences, why_it_loses(row, result.comparison.best)])


def _figures(result: StoredResult) -> Iterator[str]:
    comparison = result.comparison
    for row in comparison.classes[1:]:
        if row.distinguishable:
            fit = row.mean_log_likelihood - comparison.best.mean_log_likelihood
            information = row.information_gained - comparison.best.information_gained
            yield (
                f"In figures: ln B of {row.name!r} against {comparison.best.name!r} is "
                f"{with_error(row.log_bayes_factor, row.log_bayes_factor_error)} nats "
                f"({_strength(row)}): {fit:+.2f} from its fit and {-information:+.2f} from the "
                "information that its parameters gain."
            )
            return


def _strength(row: RankedClass) -> str:
    return row.against if row.log_bayes_factor > 0.0 else f"evidence against it: {row.against}"


def _alike(result: StoredResult) -> list[RankedClass]:
    """The other classes that are not distinguishable from the best."""
    rows = result.comparison.classes
    return [row for row in rows[1:] if not row.distinguishable]


def _title_and_probability(result: StoredResult, row: RankedClass) -> str:
    # Of a search, those that were not sampled have a share, too.
    of_all = row if result.search is None else result.search.hypothesis(row.name)
    return _title(result, row, f"probability {probability_in_words(of_all.probability)}")


def _title(result: StoredResult, row: RankedClass, *further: str) -> str:
    """What a class is; its name, by which tables call it, comes after, with ``further``."""
    if result.search is None:
        name, description = f"class {row.name!r}", result.record.model_class(row.name).description
    else:
        name, description = repr(row.name), hypothesis_in_words(result.search, row.name)
    first, *others = (description, name, *further) if description else (name, *further)
    return f"{first} ({', '.join(others)})" if others else first
