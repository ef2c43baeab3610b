"""What every search finds, and stores: its hypotheses, places, and what it averaged over them.

Appendages and changes are two vocabularies for the same record: where, how much of it, with what
probability, over which hypotheses. Sentences, tables, reports and JSON take what they say from it.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from scipy.special import expit, logsumexp

from bayes_ssi.foundations.displayed import Displayed, InWords, columns, counted
from bayes_ssi.foundations.summaries import Quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.studies.ranking.study import AveragedParameter, Ranking, Study
from bayes_ssi.studies.search.family import Family, Feature, FeaturePlace
from bayes_ssi.studies.search.family_search import Draws, FamilySearch
from bayes_ssi.studies.search.ladder import most_probability_unsampled

T = TypeVar("T")
CREDIBLE = 0.95  # share of the probability of all places that the named ones hold


def credible(places: Sequence[T], probabilities: Sequence[float]) -> tuple[T, ...]:
    """The fewest first places that hold 95 % of the probabilities, which fall."""
    sums = list(accumulate(probabilities))
    least = CREDIBLE * sums[-1]
    n = next((i for i, one in enumerate(sums, 1) if one >= least), len(sums))
    return tuple(places[:n])


@dataclass(frozen=True)
class Finding:
    """A feature at a place: how probable it is there, and how much of it there is, if it is."""

    place: FeaturePlace
    probability: float  # summed over all hypotheses with it, or that of one hypothesis
    amounts: Mapping[str, Quantiles]  # quantity → 5, 50 and 95 % quantiles, averaged likewise
    is_observed: bool = True  # whether the tests say anything about the place
    # The same probability of one of several appendages if the prior of the mass were uniform in its
    # logarithm, and so in that of the effective mass, which prefers no place to any other.
    by_data: float | None = None
    # Places that may have changed instead: the data do not tell them apart.
    alike: tuple[str, ...] = ()
    # The smallest loss of all its parameters that the tests would have shown with probability 0.9;
    # None where no loss would be, or it was not computed.
    smallest_visible: float | None = None


@dataclass(frozen=True)
class HypothesisRecord:
    name: str
    baseline: str
    prior_probability: float  # among all hypotheses, and ``probability`` likewise
    probability: float
    log_evidence: float  # in nats, with its standard ``error``; approximate where it is not sampled
    error: float
    is_sampled: bool
    screened: float  # the approximate log evidence, and ``laplace``, Laplace's alone
    laplace: float
    features: tuple[Finding, ...]  # what it adds to its baseline

    @property
    def claimed(self) -> tuple[Finding, ...]:
        """Its features besides common ones."""
        return tuple(each for each in self.features if not each.place.is_common)


@dataclass(frozen=True, repr=False, kw_only=True)
class FamilyRecord(Displayed):
    """The findings of a search, stored in addition to its ranking."""

    # Where a stored record names the kind of search.
    record_tag = "search"
    feature: ClassVar[str]  # what hypotheses add to a baseline, and with its article
    a_feature: ClassVar[str]
    nothing: ClassVar[str]  # what a hypothesis without any feature claims
    why_unseen: ClassVar[str]  # why a test says nothing about a place
    at_least_one: ClassVar[str] = "at least one"  # what has the probability of any
    plural: ClassVar[str] = ""  # of "test", by which the answer was found
    amount: ClassVar[tuple[str, str]] = ("", "amount")  # headings of amounts' names and values

    # An upper bound on the probability of all hypotheses together whose evidences are approximate.
    most_probability_unsampled: float
    probability_of_any: float  # that there is a feature, besides what all places have in common
    places: tuple[Finding, ...]  # all that were considered
    geometry: Geometry | None  # where the structure's nodes are, as far as it is known
    hypotheses: tuple[HypothesisRecord, ...]  # the most probable first
    averaged_parameters: tuple[AveragedParameter, ...]  # of the baselines
    # The number of hypotheses with several features that were not tried though others with as many
    # were, and the probability that these would have if every feature added what it adds alone.
    n_not_tried: int = 0
    expected_not_tried: float = 0.0
    has_visible: bool = False  # whether the smallest visible losses were computed

    def claim(self, holds: bool) -> str:
        """That there is any, or none."""
        return f"there is {self.a_feature if holds else f'no {self.feature}'} is"

    def place(self, name: str) -> Finding:
        """The place of that name; KeyError if there is none."""
        return {each.place.name: each for each in self.places}[name]

    @property
    def scale(self) -> float:
        """Of amounts, to what the heading of their values says."""
        return 100.0 if self.amount[1].endswith("(%)") else 1.0

    @property
    def places_by_probability(self) -> tuple[Finding, ...]:
        return tuple(sorted(self.places, key=lambda each: -each.probability))

    @property
    def shown(self) -> tuple[tuple[Finding, ...], ...]:
        """Places as they are shown, the most probable first, of one feature after the other."""
        return (self.places_by_probability,)

    @property
    def best_with_features(self) -> HypothesisRecord | None:
        """The most probable hypothesis that claims any; None if none was tried."""
        return next((each for each in self.hypotheses if each.claimed), None)

    @property
    def n_unsampled(self) -> int:
        return sum(not each.is_sampled for each in self.hypotheses)

    def hypothesis(self, name: str) -> HypothesisRecord:
        return {each.name: each for each in self.hypotheses}[name]

    @property
    def is_more_likely(self) -> bool:
        """Whether a feature is at least as probable as none."""
        return self.probability_of_any >= 0.5

    @abstractmethod
    def model_class(self, study: Study, name: str) -> ModelClass:
        """The class of a hypothesis, built again on the study that was searched.

        Raises:
            ValueError: it is not that study.
        """

    def _line(self) -> str:
        places = counted(len(self.places), "place")
        return f"of {places}: {self.a_feature} with probability {self.probability_of_any:.4f}"

    def _rows(self) -> list[dict[str, Any]]:
        names = ("name", "probability", "log_evidence", "is_sampled")
        return [columns(row, names) for row in self.hypotheses]


Record = TypeVar("Record", bound=FamilyRecord)


@dataclass(frozen=True, eq=False, repr=False)
class SearchResult(InWords, Generic[Record]):
    """The result of a search."""

    ranking: Ranking  # of the hypotheses that were sampled; probabilities are among these
    record: Record  # what was found, averaged over all hypotheses

    def _line(self) -> str:
        return self.record._line()

    def _rows(self) -> list[dict[str, Any]]:
        return self.record._rows()


# Name of a hypothesis → draws of how much there is of each of its features.
FeatureDraws = Mapping[str, Mapping[Feature, Draws]]


def feature_draws(family: Family[Feature], search: FamilySearch[Feature]) -> FeatureDraws[Feature]:
    draws: dict[str, dict[Feature, Draws]] = {}
    for hypothesis in search.hypotheses:
        of_all = search.draws[hypothesis.model_class.name]
        own = draws[hypothesis.model_class.name] = {}
        for feature in hypothesis.key.features:
            amounts = family.quantities(hypothesis.key.baseline, feature, of_all.column)
            values = np.column_stack(list(amounts.values()))
            own[feature] = Draws(tuple(amounts), values, of_all.weights)
    return draws


def findings(search: FamilySearch[Feature], draws: FeatureDraws[Feature]) -> dict[str, Any]:
    """Fields of a :class:`FamilyRecord`, whatever was searched for."""
    rows = hypotheses_by_probability(search, draws)
    approximate = {each.model_class.name: each.approximate_log_mass for each in search.hypotheses}
    sampled = {name: search.log_masses[name] for name in approximate if name in search.posteriors}
    log_total = float(logsumexp(list(search.log_masses.values())))
    not_tried = float(logsumexp([log_mass for *_, log_mass in search.levels]))
    return {
        "hypotheses": rows,
        "probability_of_any": min(1.0, sum(row.probability for row in rows if row.claimed)),
        "places": tuple(averaged_features(draws, search.probabilities)),
        "most_probability_unsampled": most_probability_unsampled(approximate, sampled),
        "averaged_parameters": tuple(search.averaged_parameters()),
        "n_not_tried": sum(n for _, n, _ in search.levels),
        "expected_not_tried": float(expit(not_tried - log_total)),
    }


def hypotheses_by_probability(
    search: FamilySearch[Feature], draws: FeatureDraws[Feature]
) -> tuple[HypothesisRecord, ...]:
    """All hypotheses, the most probable first."""
    total_weight = sum(each.prior_weight for each in search.hypotheses)
    rows = []
    # By the logarithm, which also ranks hypotheses whose probabilities are rounded to zero.
    for each in sorted(search.hypotheses, key=lambda h: -search.log_masses[h.model_class.name]):
        name, screened = each.model_class.name, each.screened
        posterior = search.posteriors.get(name)
        evidence = screened if posterior is None else posterior.evidence
        probability, own = search.probabilities[name], draws[name].items()
        row = HypothesisRecord(
            name,
            each.key.baseline,
            each.prior_weight / total_weight,
            probability,
            evidence.log_evidence,
            evidence.error,
            posterior is not None,
            screened.log_evidence,
            screened.laplace,
            tuple(Finding(feature, probability, of_one.quantiles) for feature, of_one in own),
        )
        rows.append(row)
    return tuple(rows)


def averaged_features(
    draws: FeatureDraws[Feature], probabilities: Mapping[str, float]
) -> Iterator[Finding]:
    """Every feature, its probability, and its draws averaged over all hypotheses that have it."""
    of_feature: dict[Feature, list[tuple[float, Draws]]] = {}
    for name, features in draws.items():
        for feature, of_one in features.items():
            of_feature.setdefault(feature, []).append((probabilities[name], of_one))
    for feature, with_one in of_feature.items():
        probability = sum(share for share, _ in with_one)
        if probability == 0.0:  # too small for a floating-point number
            with_one = [(1.0, each) for _, each in with_one]
        total = sum(share for share, _ in with_one)
        values = np.concatenate([each.values for _, each in with_one])
        weights = np.concatenate([share / total * each.weights for share, each in with_one])
        yield Finding(feature, probability, Draws(with_one[0][1].names, values, weights).quantiles)
