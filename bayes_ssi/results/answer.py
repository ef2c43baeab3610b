"""The answer of a result in sentences: which structure, which parameters, how sure.

What a model class claims, the modes it explains, and why it loses; medians and 90 % intervals
throughout.
"""

import math
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bayes_ssi.foundations.displayed import in_words
from bayes_ssi.foundations.summaries import Summary
from bayes_ssi.inference.model_class.class_record import ClassRecord
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.posterior.posterior import ParameterSummary, Posterior
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.results import search_answer
from bayes_ssi.results.stored_result import StoredResult, as_stored
from bayes_ssi.results.wording import (
    MOST_LISTED,
    UNDETERMINED_SPREAD,
    data_warnings,
    likelihood_in_words,
    listed,
    probability_in_words,
    quantity,
    shortened,
)
from bayes_ssi.studies.appendages.appendage_search import SearchRecord
from bayes_ssi.studies.ranking.comparison import BARE_MENTION, RankedClass
from bayes_ssi.studies.ranking.study import Ranking, averaged_parameters
from bayes_ssi.studies.search.findings import SearchResult

SURE_PAIRING = 0.95  # least probability of a pairing that is said without it


@dataclass(frozen=True)
class Answer:
    """The answer of a result, the most important first."""

    # What has to be understood before the answer is trusted: sentences, and the items below each.
    warnings: tuple[tuple[str, tuple[str, ...]], ...]
    verdict: str
    reasons: tuple[str, ...]
    further: tuple[str, ...]  # that reports and all tables say besides
    commands: tuple[str, ...]  # to ask next, each whole, on a line of its own

    @property
    def paragraphs(self) -> tuple[str, ...]:
        return (self.verdict, *self.reasons)


def answer(result: StoredResult) -> Answer:
    search = result.search
    return Answer(
        tuple(_warnings(result)),
        _verdict(result),
        tuple(_reasons(result)),
        (*search_answer.further_sentences(search), *_runner_up(result)) if search else (),
        tuple(_commands(result)),
    )


def first_screen(result: StoredResult | Ranking | SearchResult[Any]) -> str:
    """Warnings, then the answer, a paragraph each."""
    if isinstance(result, SearchResult):
        result = replace(as_stored(result.ranking), search=result.record)
    words = answer(as_stored(result))
    warnings = ["\n".join([f"(!) {text}", *items]) for text, items in words.warnings]
    return "\n\n".join([*warnings, *words.paragraphs, *words.commands])


for _kind in (StoredResult, Ranking, SearchResult):
    in_words.register(_kind, first_screen)


def _warnings(result: StoredResult) -> Iterator[tuple[str, tuple[str, ...]]]:
    comparison, search = result.comparison, result.search
    accepted = result.record.failed_checks_accepted
    yield from data_warnings(comparison.failed_data_checks, accepted)
    if missing := comparison.unmodelled_appendage:
        yield (
            "The data look as if an appendage split a mode that the most probable class has whole: "
            "the answer may be among wrong structures. A mode identified twice, torsion and a "
            "machine look alike.",
            (missing,),
        )
    if misfit := comparison.misfit:
        yield "The most probable class does not explain the data.", (misfit,)
    if isinstance(search, SearchRecord) and (beaten := search_answer.beaten_baselines(search)):
        yield (
            "The answer rests on a baseline that another class beats by far. An appendage on it "
            "may stand for what the baseline itself lacks.",
            beaten,
        )
    if failed := comparison.failed_checks_besides("misfit", "data", "appendage"):
        several = len(failed) > 1
        among = ""  # a search compares what it sampled, and says probabilities of all hypotheses
        if search is not None and search.n_unsampled:
            n = len(comparison.classes)
            among = f" Their probabilities are among the {n} hypotheses that were sampled."
        yield (
            f"{len(failed)} check{'s' if several else ''} failed"
            f"{' and were accepted when the result was saved' if accepted else ''}. Do not trust "
            f"the ranking until {'they are' if several else 'it is'} understood.{among}",
            failed,
        )


def _commands(result: StoredResult) -> Iterator[str]:
    """The search for the appendage that is missing, or may be hidden."""
    comparison, file = result.comparison, result.record.study_file
    if file and (comparison.unmodelled_appendage or comparison.hidden_appendage):
        name = comparison.best.name
        several = f" --class {shlex.quote(name)}" if len(comparison.classes) > 1 else ""
        yield f"To search for appendages:\nbayes-ssi search {shlex.quote(file)}{several}"


def _verdict(result: StoredResult) -> str:
    if result.search is not None:
        return search_answer.search_verdict(result.search)
    rows, best = result.comparison.classes, result.comparison.best
    if len(rows) == 1:
        return (
            f"Only one model class was sampled: {_title(result, best)}. How probable it is cannot "
            "be said without another."
        )
    if alike := _alike(result):
        tied = [best, *alike]
        titles = [_title_and_probability(result, row) for row in tied]
        together = probability_in_words(min(1.0, sum(row.probability for row in tied)))
        return (
            f"Among {len(rows)} model classes the data do not distinguish between "
            f"{shortened(titles)}. Their probability together is {together}: keep them all, and "
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
    best, alike = result.comparison.best, _alike(result)
    posterior = result.posterior(best.name)
    if result.search is not None:
        yield from search_answer.search_sentences(result.search, result.comparison)
    elif alike:
        yield from _common_claims(result, [best, *alike])
    else:
        parameters = parameters_in_words(posterior, result.record.model_class(best.name))
        yield " ".join([f"It {explained(posterior, result.tests)}.", *parameters])
    if result.comparison.hidden_appendage:
        yield result.comparison.hidden_appendage
    if result.search is None:
        yield from _runner_up(result)


def _runner_up(result: StoredResult) -> Iterator[str]:
    """The most probable class that the data tell from the best one, and why it loses."""
    best, *others = result.comparison.classes
    for row in [row for row in others if row.distinguishable][:1]:
        yield _in_words(result, row, result.posterior(best.name))


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
        errors = {parameter.name for parameter in record.parameters if parameter.is_error}
        parts = _claims(posterior, record, {
            "claims": disputed - errors,
            "needs sizes of errors": disputed & errors,
            "also infers": {*posterior.parameter_names} - of_all - disputed,
        })  # fmt: skip
        yield f"{row.name!r} {'; it '.join([explained(posterior, result.tests), *parts])}."


def _claims(
    posterior: Posterior, record: ClassRecord, names: Mapping[str, Collection[str]]
) -> list[str]:
    """What a class does, in words → the parameters that it does so with, those that it has."""
    rows = {
        verb: [row for row in posterior.summary if row.name in own] for verb, own in names.items()
    }
    return [
        f"{verb} {quantities(best_determined(own), record)}" for verb, own in rows.items() if own
    ]


def _in_words(result: StoredResult, row: RankedClass, best: Posterior) -> str:
    posterior = result.posterior(row.name)
    record = result.record.model_class(row.name)
    different, same = differing(posterior, best)
    errors = {parameter.name for parameter in record.parameters if parameter.is_error}
    own = set(posterior.parameter_names) - set(best.parameter_names) - errors
    claims = _claims(posterior, record, {
        "claims": own.union(different) - errors,
        "needs other sizes of errors:": errors.intersection(different),
    })  # fmt: skip
    n_sampled = len(result.comparison.classes)
    among = f" among the {n_sampled} hypotheses that were sampled" if result.search else ""
    sentences = [
        f"Runner-up{among}: {_title_and_probability(result, row)}.",
        *(f"It {what}." for what in (explained(posterior, result.tests), *claims)),
    ]
    if same:
        other = "other " if claims else ""
        sentences.append(f"On the {other}parameters that both infer it agrees.")
    return " ".join([*sentences, why_it_loses(row, result.comparison.best)])


def _alike(result: StoredResult) -> list[RankedClass]:
    """The other classes that are not distinguishable from the best."""
    return [row for row in result.comparison.classes[1:] if not row.distinguishable]


def _title_and_probability(result: StoredResult, row: RankedClass) -> str:
    # Of a search, those that were not sampled have a share, too.
    of_all = row if result.search is None else result.search.hypothesis(row.name)
    return _title(result, row, f"probability {probability_in_words(of_all.probability)}")


def _title(result: StoredResult, row: RankedClass, *further: str) -> str:
    """What a class is; its name, by which tables call it, comes after, with ``further``."""
    if result.search is None:
        name, description = f"class {row.name!r}", result.record.model_class(row.name).description
    else:
        description = search_answer.hypothesis_in_words(result.search, row.name)
        name = repr(row.name)
    first, *others = (description, name, *further) if description else (name, *further)
    return f"{first} ({', '.join(others)})" if others else first


def parameters_in_words(posterior: Posterior, record: ClassRecord) -> list[str]:
    """The parameters of a class: structural ones, errors, and what the data say nothing about."""
    errors = {parameter.name for parameter in record.parameters if parameter.is_error}
    structural = [row for row in posterior.summary if row.name not in errors]
    sentences = []
    if structural:
        shown = best_determined(structural)
        what = "Its parameters"
        if len(shown) < len(structural):
            what = f"The {len(shown)} best determined of its {len(structural)} parameters"
        sentences.append(f"{what}, medians and 90 % intervals: {quantities(shown, record)}.")
    if errors:
        rows = [row for row in posterior.summary if row.name in errors]
        inferred = [p for product in record.error.correlations for p in product.parameters]
        what = "sizes and correlations" if inferred else "sizes"
        sentences.append(f"Inferred {what} of prediction errors: {quantities(rows, record)}.")
    priors = {parameter.name: parameter.prior for parameter in record.parameters}
    moved = {row.name: abs(priors[row.name].to_normal(row.median)) for row in posterior.summary}
    wide = [row.name for row in posterior.summary if row.relative_spread >= UNDETERMINED_SPREAD]
    if vague := [name for name in wide if moved[name] < 1.0]:
        sentences.append(f"The data say next to nothing about {shortened(vague)}.")
    return sentences


def best_determined(rows: Sequence[ParameterSummary]) -> list[ParameterSummary]:
    """The parameters that the data determine best, as many as a sentence lists, in their order."""
    best = sorted(rows, key=lambda row: row.relative_spread)[:MOST_LISTED]
    return [row for row in rows if row in best]


def quantities(rows: Sequence[Summary], record: ClassRecord) -> str:
    """Names, medians and 90 % intervals."""
    units = {parameter.name: parameter.unit for parameter in record.parameters}
    return "; ".join(
        f"{row.name} = {quantity(row.quantile_05, row.median, row.quantile_95, units[row.name])}"
        for row in rows
    )


def differing(one: Posterior, other: Posterior) -> tuple[list[str], list[str]]:
    """Names of the parameters of both classes: those on which they disagree, and the others.

    They disagree where each median lies outside the other's 90 % interval.
    """
    theirs = {row.name: row for row in other.summary}
    agree = {
        ours.name: ours.quantile_05 <= row.median <= ours.quantile_95
        or row.quantile_05 <= ours.median <= row.quantile_95
        for ours in one.summary
        if (row := theirs.get(ours.name)) is not None
    }
    return [name for name in agree if not agree[name]], [name for name in agree if agree[name]]


def explained(posterior: Posterior, tests: Mapping[str, ModalData]) -> str:
    """Which identified modes are modes of a class, and how closely: "pairs …"."""
    labels: list[str] = []
    missed: list[str] = []
    errors: list[float] = []
    macs: list[float] = []
    for modes in posterior.configurations:
        data = tests[modes.name]
        for label in data.labels:
            (labels if label in modes.pairing else missed).append(label_in(modes.name, label))
        for mode in modes.updated.modes:
            errors.append(abs(mode.after_hz[1] / data.mode(mode.label).frequency_hz - 1.0))
            macs += [mode.mac_after[1]] if mode.mac_after is not None else []
    if not labels:
        return "pairs none of the identified modes and takes all for spurious"
    closeness = [f"frequencies within {100.0 * max(errors):.2g} %"] if errors else []
    # Rounded down, and below the 1 that no MAC exceeds.
    closeness += [f"MAC above {min(math.floor(1e3 * min(macs)), 999) / 1e3:.3f}"] if macs else []
    how = f" ({', '.join(closeness)})" if closeness else ""
    inferred = (modes.inferred_pairing for modes in posterior.configurations)
    least = min((each.pairings[0].probability for each in inferred if each), default=1.0)
    if least < SURE_PAIRING:
        how += f", in the most probable pairing (probability {probability_in_words(least)}),"
    if not missed:
        return f"pairs all {len(labels)} identified modes{how}".rstrip(",")
    n = len(labels) + len(missed)
    spurious = f"takes {listed(map(repr, missed))} for spurious"
    return f"pairs {len(labels)} of {n} identified modes{how} and {spurious}"


def why_it_loses(row: RankedClass, best: RankedClass) -> str:
    """Fit against complexity, in plain words."""
    if row.log_bayes_factor > 0.0:
        return "The data favour it, but its prior probability is too low."
    fit = best.mean_log_likelihood - row.mean_log_likelihood
    tuning = row.information_gained - best.information_gained
    if fit > BARE_MENTION:
        if tuning < -BARE_MENTION:
            return "It loses because it fits the data worse, though its parameters are tuned less."
        also = ", even with its parameters tuned more" if tuning > BARE_MENTION else ""
        return f"It loses because it fits the data worse{also}."
    if tuning > BARE_MENTION:
        if fit < -BARE_MENTION:
            return (
                "It loses because its better fit takes more tuning of its parameters than it "
                "justifies."
            )
        return "It loses because its parameters must be tuned more to fit equally well."
    return "It loses by a little in fit and by a little in the tuning that its parameters need."
