"""The findings of a search: places, appendages, baselines and averaged parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.studies.appendages.baselines import MassScale, hypothesis, parameters_of
from bayes_ssi.studies.appendages.candidates import SearchSettings
from bayes_ssi.studies.ranking.comparison import VERY_STRONG
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.findings import FamilyRecord, Finding, credible


@dataclass(frozen=True)
class MatchedAppendage:
    """One appendage over all hypotheses with equally many: 5, 50 and 95 % quantiles."""

    # Natural frequency on a fixed structure. Where it may be one of several that are apart, the
    # most probable, to which all else refers.
    frequency_hz: tuple[float, float, float]
    probability: float  # of that frequency, if there are as many appendages as are matched
    # The others with their probabilities, the most probable first.
    other_frequencies_hz: tuple[tuple[float, tuple[float, float, float]], ...]
    # Vibrating mass times the square of the motion of its place in the mode of the main structure
    # next to its frequency, over the largest motion of a sensor, in the structure's unit; None
    # where motions are known at sensors alone.
    effective_mass: tuple[float, float, float] | None
    effective_ratio: tuple[float, float, float] | None  # the same over the mode's modal mass
    mode: int  # number of that mode, from 1
    places: tuple[Finding, ...]  # where it may be, the most probable first

    @property
    def places_by_data(self) -> tuple[Finding, ...]:
        """The fewest places that the data leave with 95 %, whatever the prior of the mass."""
        by_data = {each.place: each.by_data or 0.0 for each in self.places}
        ordered = sorted(self.places, key=lambda each: -by_data[each.place])
        return credible(ordered, [by_data[each.place] for each in ordered])

    @property
    def against_by_prior(self) -> tuple[Finding, ...]:
        """Places that the data leave, and only the prior of the mass makes improbable."""
        left = credible(self.places, [place.probability for place in self.places])
        return tuple(place for place in self.places_by_data if place not in left)


@dataclass(frozen=True)
class BaselineRecord:
    """A class that appendages were hung on, or that was compared with such without appendages."""

    name: str
    classes: tuple[str, ...]
    log_evidence: float  # without any appendage, in nats; approximate where that was not sampled
    prior_probability: float
    probability: float
    # The mass, in the structure's unit, to which mass ratios refer; None where no appendage was
    # tried.
    mass_scale: MassScale | None


@dataclass(frozen=True, repr=False, kw_only=True)
class SearchRecord(FamilyRecord):
    """The findings of a search for appendages."""

    feature, a_feature = "appendage", "an appendage"
    nothing = "without any appendage"
    why_unseen = "which move in no mode that a sensor sees"

    # The classes that appendages were hung on, the most probable first; and those compared with
    # them without appendages.
    baselines: tuple[BaselineRecord, ...]
    left_out: Mapping[str, str]  # class of the study on which no appendage was hung → why
    present_in: tuple[str, ...] | None  # configurations that have the appendages; None if all have
    search_settings: SearchSettings
    # Those of the most probable number of them, matched by frequency over all hypotheses with that
    # number; none where all of these have probability zero.
    matched: tuple[MatchedAppendage, ...] = ()
    # Motions that the model does not have, which compete with appendages.
    motions: tuple[Finding, ...] = ()
    mass_unit: str = ""  # the structure's; empty where the study states none

    @property
    def mass_heading(self) -> str:
        return "vibrating mass" + (f" ({self.mass_unit})" if self.mass_unit else "")

    @property
    def beaten(self) -> tuple[BaselineRecord, ...]:
        """Baselines that another class beats without any appendage, by very strong evidence.

        An appendage on such a baseline may stand for what the baseline lacks.
        """
        return tuple(
            each
            for each in self.baselines
            if each.prior_probability > 0.0
            and self.best_without_appendages.log_evidence - each.log_evidence > VERY_STRONG
        )

    @property
    def best_without_appendages(self) -> BaselineRecord:
        return max(self.baselines, key=lambda each: each.log_evidence)

    @property
    def shown(self) -> tuple[tuple[Finding, ...], ...]:
        """Those of the most probable number of appendages, one after the other."""
        return tuple(each.places for each in self.matched) or super().shown

    @property
    def probability_of_number(self) -> float:
        """Of the hypotheses with as many appendages as are matched, which these are of."""
        number = len(self.matched)
        of_number = (row for row in self.hypotheses if len(row.claimed) == number)
        return min(1.0, sum(row.probability for row in of_number))

    def parameters_of_features(self, name: str) -> list[str]:
        places: list[Any] = [each.place for each in self.hypothesis(name).features]
        return [name for place in places for name in parameters_of(place)]

    def model_class(self, study: Study, name: str) -> ModelClass:
        row = self.hypothesis(name)
        places: list[Any] = [each.place for each in row.features]
        baseline = {each.name: each for each in self.baselines}[row.baseline]
        (original,) = study.only(baseline.classes[:1]).model_classes
        return hypothesis(
            original.with_any_pairing(row.baseline),
            places,
            self.search_settings,
            name,
            present_in=self.present_in,
            scale=baseline.mass_scale,
        )
