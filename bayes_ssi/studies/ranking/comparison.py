"""Ranking of model classes by their evidence on the same data."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from scipy.special import logsumexp

from bayes_ssi.foundations.argument_types import checked, repeated, require_known
from bayes_ssi.foundations.displayed import Displayed, columns, counted
from bayes_ssi.inference.criticism.adequacy import inadequacy_in_words
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior

# Kass and Raftery (1995), Bayes Factors, section 3.2, in 2 ln B.
SCALE_NAME = "Kass and Raftery (1995)"
SCALE = (
    (2.0, "not worth more than a bare mention"),
    (6.0, "positive"),
    (10.0, "strong"),
    (math.inf, "very strong"),
)


# A smaller difference in ln B is not worth more than a bare mention on the scale; from the other
# on, evidence is very strong.
BARE_MENTION, VERY_STRONG = 0.5 * SCALE[0][0], 0.5 * SCALE[-2][0]
# How much too low an evidence may be whose check failed, which does not say by how much: an
# improbable class that not even that would bring back changes no answer.
WRONG_BY = 2.0 * VERY_STRONG
# Of a difference from the best class beyond which it is distinguishable: about 95 % of a normal
# distribution lie within two.
STANDARD_ERRORS = 2.0
# A class less probable than this is not flagged for lying at the edge of its priors: having to do
# so is what makes it improbable.
PROBABLE = 0.01


def bayes_factor_scale(log_bayes_factor: float) -> str:
    """What a Bayes factor means on the scale of Kass and Raftery (1995); the sign is ignored."""
    if math.isnan(log_bayes_factor):
        raise ValueError("bayes_factor_scale: the log Bayes factor is not a number")
    twice = 2.0 * abs(log_bayes_factor)
    return next((words for limit, words in SCALE if twice < limit), SCALE[-1][1])


def is_distinguishable(log_bayes_factor: float, error: float) -> bool:
    """Whether it is more than a bare mention on the scale and than two of its standard errors."""
    size = abs(log_bayes_factor)
    return size >= BARE_MENTION and size > STANDARD_ERRORS * error


def evidence_against(log_bayes_factor: float, error: float) -> str:
    """The evidence against a hypothesis, by its Bayes factor over the most probable one."""
    if not is_distinguishable(log_bayes_factor, error):
        return "not distinguishable"
    if log_bayes_factor > 0.0:
        return "prior probability only"
    return bayes_factor_scale(log_bayes_factor)


@dataclass(frozen=True)
class Check:
    """A failed check of an answer, or a remark on it."""

    # What was checked: the "data", a missing "appendage", what a "hidden" one would change, the
    # "misfit" of the best class, the "sampling" of a class, an "edge" at which its posterior lies,
    # or a "setting".
    kind: str
    words: str  # a sentence
    fails: bool = True  # whether the answer is not to be trusted until this is understood
    model_class: str = ""  # name of the class that it concerns; empty where that is all of them


def words_of(checks: Iterable[Check], *kinds: str) -> tuple[str, ...]:
    """The words of the failed checks of some kinds; of all if none is named."""
    return tuple(each.words for each in checks if each.fails and (each.kind in kinds or not kinds))


@dataclass(frozen=True)
class RankedClass:
    """One row of a ranking."""

    name: str
    log_evidence: float  # in nats, with its standard ``error``
    error: float
    prior_probability: float  # among the classes compared, and ``probability`` likewise
    probability: float
    # Log evidence less that of the most probable class; positive where prior weights outweigh it.
    log_bayes_factor: float
    log_bayes_factor_error: float  # standard error of the difference
    # The evidence against this class in the words of the named scale, or "not distinguishable".
    against: str
    distinguishable: bool  # see :func:`is_distinguishable`
    mean_log_likelihood: float  # how well the class fits, in nats
    information_gained: float  # the penalty on the fit, in nats
    n_parameters: int
    # Probability that data from this class are farther from it than these are, and the same as a
    # distance from the mean of a normal variable; None where that is not known.
    misfit_p_value: float | None
    misfit_sds: float | None
    is_rough: bool  # it infers so large an error of frequencies that it explains nothing
    # The misfit of the best class, failed checks of the sampling, and what its edges and settings
    # do to the ranking. Those of a class too improbable to change the answer, and settings on which
    # hardly the ranking depends, are remarks.
    checks: tuple[Check, ...] = ()

    @property
    def misfit(self) -> str:
        """What of the data the best class does not explain, and likely causes; else empty."""
        return next(iter(words_of(self.checks, "misfit")), "")

    @property
    def failed_checks(self) -> tuple[str, ...]:
        return words_of(self.checks)

    @property
    def remarks(self) -> tuple[str, ...]:
        return tuple(check.words for check in self.checks if not check.fails)

    @property
    def probability_text(self) -> str:
        return probability_text(self.probability)


def probability_text(probability: float) -> str:
    """A probability to four decimals, never rounded to 0 or 1."""
    if probability < 1e-4:
        return "< 0.0001"
    return "> 0.9999" if probability > 0.9999 else f"{probability:.4f}"


@dataclass(frozen=True, repr=False)
class Comparison(Displayed):
    """Model classes ranked by probability, the best first; on equal prior weights, by evidence."""

    classes: tuple[RankedClass, ...]
    data_digest: str  # identifies the data that all of them explain
    # Failed checks that concern all classes: of the data, such as of how the modes were identified,
    # and why an appendage may be missing from all of them.
    common_checks: tuple[Check, ...] = ()
    # Which regions the searches for maxima can have missed; a sentence.
    unseen: str = ""

    @property
    def has_equal_priors(self) -> bool:
        priors = [row.prior_probability for row in self.classes]
        return max(priors) - min(priors) < 1e-9  # sums of weights, up to rounding

    @property
    def best(self) -> RankedClass:
        return self.classes[0]

    @property
    def not_distinguishable(self) -> tuple[str, ...]:
        return tuple(row.name for row in self.classes[1:] if not row.distinguishable)

    @property
    def failed_data_checks(self) -> tuple[str, ...]:
        return words_of(self.common_checks, "data")

    @property
    def unmodelled_appendage(self) -> str:
        """Why the answer may be that of an analyst who misses an appendage; empty if it is not."""
        return next(iter(words_of(self.common_checks, "appendage")), "")

    @property
    def hidden_appendage(self) -> str:
        """What one whose other mode was not identified would change; empty if nothing."""
        return next((each.words for each in self.common_checks if each.kind == "hidden"), "")

    @property
    def misfit(self) -> str:
        """What of the data the best class does not explain, with its name; empty if nothing."""
        return f"{self.best.name!r}: {self.best.misfit}" if self.best.misfit else ""

    @property
    def failed_checks(self) -> tuple[str, ...]:
        """Those of the data, a missing appendage, then of every class, the best's misfit first."""
        return self.failed_checks_besides()

    def failed_checks_besides(self, *kinds: str) -> tuple[str, ...]:
        """The failed checks of all but some kinds, those of every class with its name."""
        common = [check for check in self.common_checks if check.kind not in kinds]
        rows = ((row.name, [c for c in row.checks if c.kind not in kinds]) for row in self.classes)
        of_classes = (f"{name!r}: {words}" for name, own in rows for words in words_of(own))
        return (*words_of(common), *of_classes)

    def with_checks(self, checks: Iterable[Check]) -> "Comparison":
        """This comparison with these failed checks and remarks in place of those that it has."""
        of: dict[str, list[Check]] = {}
        for check in checks:
            of.setdefault(check.model_class, []).append(check)
        rows = tuple(replace(row, checks=tuple(of.get(row.name, ()))) for row in self.classes)
        return replace(self, classes=rows, common_checks=tuple(of.get("", ())))

    def with_further(self, checks: Iterable[Check]) -> "Comparison":
        """This comparison with further checks, of all classes together."""
        return replace(self, common_checks=(*self.common_checks, *checks))

    @property
    def remarks(self) -> tuple[str, ...]:
        return tuple(f"{row.name!r}: {remark}" for row in self.classes for remark in row.remarks)

    def _line(self) -> str:
        failed = counted(len(self.failed_checks), "failed check")
        best = f"best {self.best.name!r}, probability {self.best.probability_text}"
        return f"{counted(len(self.classes), 'model class')}, {best}, {failed}"

    def _rows(self) -> list[dict[str, Any]]:
        names = ("name", "log_evidence", "error", "log_bayes_factor", "probability", "misfit_sds",
                 "against")  # fmt: skip
        return [columns(row, names) for row in self.classes]


@checked
def compare(
    posteriors: Sequence[Posterior], prior_weights: Mapping[str, float] | None = None
) -> Comparison:
    """Rank model classes by evidence.

    A probable class whose posterior lies at the edge of a setting fails a check: what the setting
    does to the ranking is not known here, but in :func:`~bayes_ssi.studies.questions.rank`.
    Failed checks of sampling a class that would remain improbable with an evidence 10 nats higher
    are remarks.

    Args:
        posteriors: posteriors of the classes, all sampled on the same data.
        prior_weights: name → prior weight of a class, equal if not given.

    Raises:
        ValueError: there is nothing to compare, two classes have one name, the data differ, or a
            prior weight is missing, unknown or not positive.
    """
    comparison = by_evidence(posteriors, prior_weights)
    checkers = (misfit_of_best, failed_sampling, at_edges)
    return comparison.with_checks(
        check for checker in checkers for check in checker(comparison, posteriors)
    )


def by_evidence(
    posteriors: Sequence[Posterior], prior_weights: Mapping[str, float] | None
) -> Comparison:
    """The comparison before any check; arguments and errors are those of :func:`compare`."""
    if not posteriors:
        raise ValueError("compare: no posterior to compare")
    names = [posterior.name for posterior in posteriors]
    if twice := repeated(names):
        raise ValueError(f"compare: two model classes are named {twice[0]!r}")
    require_same_data("compare", posteriors)
    weights = checked_weights(names, prior_weights)
    log_evidences = {each.name: each.evidence.log_evidence for each in posteriors}
    probabilities = class_probabilities(log_evidences, weights)
    total = sum(weights.values())
    priors = {name: weight / total for name, weight in weights.items()}
    # By the logarithm, which also ranks classes whose probabilities are rounded to zero.
    ranked = sorted(posteriors, key=lambda p: -log_evidences[p.name] - math.log(weights[p.name]))
    best = ranked[0]
    rows = [_row(each, best, priors[each.name], probabilities[each.name]) for each in ranked]
    share = 100.0 * max(each.largest_unseen_mass for each in posteriors)
    unseen = (
        "Not excluded: another solution that fills less than "
        f"{share:.2g} % of the prior of a class's parameters, if no search was led to it."
    )
    return Comparison(tuple(rows), best.data_digest, unseen=unseen)


def class_probabilities(
    log_evidences: Mapping[str, float], prior_weights: Mapping[str, float] | None
) -> dict[str, float]:
    """Name → posterior probability of every model class; equal prior weights if None."""
    weights = prior_weights or dict.fromkeys(log_evidences, 1.0)
    log_masses = {name: each + math.log(weights[name]) for name, each in log_evidences.items()}
    log_total = float(logsumexp(list(log_masses.values())))
    return {name: math.exp(log_mass - log_total) for name, log_mass in log_masses.items()}


def _row(posterior: Posterior, best: Posterior, prior: float, probability: float) -> RankedClass:
    evidence, top, fit = posterior.evidence, best.evidence, posterior.adequacy
    difference = evidence.log_evidence - top.log_evidence
    error = 0.0 if posterior is best else math.hypot(evidence.error, top.error)
    return RankedClass(
        name=posterior.name,
        log_evidence=evidence.log_evidence,
        error=evidence.error,
        prior_probability=prior,
        probability=probability,
        log_bayes_factor=difference,
        log_bayes_factor_error=error,
        against="best" if posterior is best else evidence_against(difference, error),
        distinguishable=posterior is not best and is_distinguishable(difference, error),
        mean_log_likelihood=evidence.mean_log_likelihood,
        information_gained=evidence.information_gained,
        n_parameters=len(posterior.parameter_names),
        misfit_p_value=fit.overall.p_value if fit else None,
        misfit_sds=fit.overall.sds if fit else None,
        is_rough=fit is not None and fit.is_rough,
    )


def can_matter(probability: float) -> bool:
    """Whether a class would be probable if its log evidence were as much too low as it may be."""
    return probability > 0.0 and math.log(probability) + WRONG_BY >= math.log(PROBABLE)


def misfit_of_best(comparison: Comparison, posteriors: Sequence[Posterior]) -> Iterator[Check]:
    """What of the data the best class does not explain, and likely causes."""
    fits = {posterior.name: posterior.adequacy for posterior in posteriors}
    ranked = [row.name for row in comparison.classes]
    best = fits[ranked[0]]
    if best is None or best.is_adequate:
        return
    adequate = [name for name in ranked if (fit := fits[name]) is not None and fit.is_adequate]
    others = "No other class explains them" if len(ranked) > 1 else ""
    if adequate:
        others = f"Only less probable classes explain them ({', '.join(map(repr, adequate))})"
    (is_given,) = (each.pairing_is_given for each in posteriors if each.name == ranked[0])
    yield Check("misfit", inadequacy_in_words(best, is_given, others), model_class=ranked[0])


def failed_sampling(comparison: Comparison, posteriors: Sequence[Posterior]) -> Iterator[Check]:
    """Failed checks of the sampling of classes; remarks where they can change no answer."""
    probabilities = {row.name: row.probability for row in comparison.classes}
    for posterior in posteriors:
        matters = can_matter(probabilities[posterior.name])
        harmless = "" if matters else "; the class is too improbable for this to change the answer"
        for words in posterior.failed_checks:
            yield Check("sampling", words + harmless, matters, posterior.name)


def at_edges(comparison: Comparison, posteriors: Sequence[Posterior]) -> Iterator[Check]:
    """Edges of settings at which posteriors of probable classes lie."""
    probabilities = {row.name: row.probability for row in comparison.classes}
    for each in posteriors:
        if probabilities[each.name] >= PROBABLE:
            yield from (Check("edge", edge.statement, True, each.name) for edge in each.edges)


Explained = TypeVar("Explained", ModelClass, Posterior)


def require_same_data(
    where: str,
    classes: Sequence[Explained],
    differing: Callable[[Explained, Explained], str] = lambda first, other: (
        f" (digests {first.data_digest} and {other.data_digest})"
    ),
) -> None:
    """Refuse classes whose data differ, of which ``differing`` says more."""
    first = classes[0]
    for other in classes[1:]:
        if other.data_digest != first.data_digest:
            raise ValueError(
                f"{where}: model classes {first.name!r} and {other.name!r} explain different data"
                f"{differing(first, other)}, so their evidences cannot be compared; give every "
                "class the same ModalData and leave out of a pairing what a class does not explain"
            )


def checked_weights(
    names: Sequence[str], prior_weights: Mapping[str, float] | None
) -> dict[str, float]:
    """Name → prior weight of every model class, 1 for each where none are given."""
    if prior_weights is None:
        return dict.fromkeys(names, 1.0)
    require_known("prior weight for unknown model class", prior_weights, names)
    for name in names:
        weight = prior_weights.get(name)
        if not 0 < (weight or 0.0) < math.inf:
            raise ValueError(
                f"prior weight of {name!r} must be positive and finite, got {weight!r}"
            )
    return dict(prior_weights)
