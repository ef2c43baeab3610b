"""What every search stores: its hypotheses, and what it averaged over them."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from bayes_ssi.foundations.displayed import Displayed, InWords, columns
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.structures.geometry import Geometry
from bayes_ssi.studies.ranking.study import AveragedAndNaive, Ranking, Study
from bayes_ssi.studies.search.approximate_evidence import EFFORTS
from bayes_ssi.studies.search.family import Feature
from bayes_ssi.studies.search.family_search import FamilySearch

T = TypeVar("T")


def credible(places: Sequence[T], probabilities: Sequence[float]) -> tuple[T, ...]:
    """The fewest first places that hold 95 % of the probabilities, which fall."""
    sums = list(accumulate(probabilities))
    least = EFFORTS.credible * sums[-1]
    n = next((i for i, one in enumerate(sums, 1) if one >= least), len(sums))
    return tuple(places[:n])


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

    @property
    @abstractmethod
    def features(self) -> Sequence[Any]:
        """What it adds to its baseline."""


@dataclass(frozen=True, repr=False, kw_only=True)
class FamilyRecord(Displayed):
    """The findings of a search, stored in addition to its ranking."""

    # Where a stored record names the kind of search.
    record_tag = "search"
    feature: ClassVar[str]  # what hypotheses add to a baseline, and with its article
    a_feature: ClassVar[str]
    nothing: ClassVar[str]  # what a hypothesis without any feature claims
    why_unseen: ClassVar[str]  # why a test says nothing about a place

    # An upper bound on the probability of all hypotheses together whose evidences are approximate.
    most_probability_unsampled: float
    places: tuple[Any, ...]  # all that were considered, each with its ``probability``
    geometry: Geometry | None  # where the structure's nodes are, as far as it is known
    hypotheses: tuple[HypothesisRecord, ...]  # the most probable first
    averaged_parameters: tuple[AveragedAndNaive, ...]  # of the baselines
    # The number of hypotheses with several features that were not tried though others with as many
    # were, and the probability that these would have if every feature added what it adds alone.
    n_not_tried: int = 0
    expected_not_tried: float = 0.0

    @property
    def place_probabilities(self) -> dict[Any, float]:
        return {each.place: each.probability for each in self.places}

    @property
    def places_by_probability(self) -> tuple[Any, ...]:
        return tuple(sorted(self.places, key=lambda each: -each.probability))

    @property
    def credible_places(self) -> tuple[Any, ...]:
        """The fewest places with 95 % of the probability, summed over all; the first first."""
        ordered = self.places_by_probability
        return credible(ordered, [each.probability for each in ordered])

    @property
    def n_unsampled(self) -> int:
        return sum(not each.is_sampled for each in self.hypotheses)

    @property
    def errors_of_screening(self) -> tuple[float, float]:
        """How much approximate log evidences exceed those sampled, least and most, in nats."""
        errors = [each.screened - each.log_evidence for each in self.hypotheses if each.is_sampled]
        return min(errors), max(errors)

    def hypothesis(self, name: str) -> Any:
        return {each.name: each for each in self.hypotheses}[name]

    @abstractmethod
    def parameters_of_features(self, name: str) -> list[str]:
        """Those that a hypothesis adds to its baseline."""

    @abstractmethod
    def model_class(self, study: Study, name: str) -> ModelClass:
        """The class of a hypothesis, built again on the study that was searched.

        Raises:
            ValueError: it is not that study.
        """

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


def records_by_probability(
    found: FamilySearch[Feature],
    draws: Mapping[str, Mapping[Feature, Any]],
    record: Callable[..., T],
) -> tuple[T, ...]:
    """All hypotheses, the most probable first: fields by name, then summaries of its features."""
    total_weight = sum(each.prior_weight for each in found.hypotheses)
    probabilities = found.probabilities
    rows = []
    # By the logarithm, which also ranks hypotheses whose probabilities are rounded to zero.
    for each in sorted(found.hypotheses, key=lambda h: -found.log_masses[h.model_class.name]):
        name, screened = each.model_class.name, each.screened
        posterior = found.posteriors.get(name)
        evidence = screened if posterior is None else posterior.evidence
        rows.append(
            record(
                name,
                each.key.baseline,
                each.prior_weight / total_weight,
                probabilities[name],
                evidence.log_evidence,
                evidence.error,
                posterior is not None,
                screened.log_evidence,
                screened.laplace,
                tuple(own.summary(feature) for feature, own in draws[name].items()),
            )
        )
    return tuple(rows)


def averaged_features(
    draws: Mapping[str, Mapping[Feature, Any]], probabilities: Mapping[str, float]
) -> Iterator[tuple[Feature, float, Any]]:
    """Every feature, its probability, and the summary of its draws over all that have it.

    Draws of a hypothesis, by name, are for each feature a named tuple of arrays (n, ...), of which
    the ``weights`` add up to one; its method ``summary`` takes the feature.
    """
    of_feature: dict[Feature, list[tuple[float, Any]]] = {}
    for name, features in draws.items():
        for feature, of_one in features.items():
            of_feature.setdefault(feature, []).append((probabilities[name], of_one))
    for feature, with_one in of_feature.items():
        probability = sum(share for share, _ in with_one)
        if probability == 0.0:  # too small for a floating-point number
            with_one = [(1.0, each) for _, each in with_one]
        total = sum(share for share, _ in with_one)
        weighted = [each._replace(weights=share / total * each.weights) for share, each in with_one]
        mixed = type(weighted[0])(*map(np.concatenate, zip(*weighted, strict=True)))
        yield feature, probability, mixed.summary(feature)
