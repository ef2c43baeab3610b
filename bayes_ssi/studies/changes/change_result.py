"""The result of a comparison of two tests: whether anything changed, where, and by how much."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bayes_ssi.foundations.displayed import counted
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.studies.changes.change_places import ChangePlace
from bayes_ssi.studies.changes.change_settings import ChangeSettings
from bayes_ssi.studies.changes.changes_family import choose_changes
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.search_record import FamilyRecord, HypothesisRecord, SearchResult

Quantiles = tuple[float, float, float]  # 5, 50 and 95 %


@dataclass(frozen=True)
class ChangeSummary:
    """What one place lost under one hypothesis, or averaged over several."""

    place: ChangePlace
    losses: Mapping[str, Quantiles]  # name of a loss → the share that is lost


@dataclass(frozen=True)
class ChangesRecord(HypothesisRecord):
    """One hypothesis of change."""

    changes: tuple[ChangeSummary, ...]

    @property
    def features(self) -> tuple[ChangeSummary, ...]:
        return self.changes

    @property
    def claims_change(self) -> bool:
        """Whether anything changed but for a factor that all places have in common."""
        return any(not each.place.is_common for each in self.changes)


@dataclass(frozen=True)
class PlaceOfChange:
    """A place that may have changed.

    Attributes:
        change: what it lost, if anything, averaged over all hypotheses in which it did.
        probability: that it changed.
        is_observed: whether its parameters move any mode that is compared.
        alike: names of the places that may have changed instead: the data do not tell them apart.
        smallest_visible: the smallest loss of all its parameters that the tests would have shown
            with probability 0.9; None where no loss would be, or it was not computed.
    """

    change: ChangeSummary
    probability: float
    is_observed: bool
    alike: tuple[str, ...]
    smallest_visible: float | None = None

    @property
    def place(self) -> ChangePlace:
        return self.change.place


@dataclass(frozen=True, repr=False, kw_only=True)
class ChangeRecord(FamilyRecord):
    """The findings of a comparison of two tests, and those of every search.

    Attributes:
        before, after: names of the tests.
        settings: what a change may be.
        probability_of_change: that anything changed but for a common factor.
        shared: share of the prediction errors that the tests have in common, averaged over all
            hypotheses; None where it is not inferred.
        has_visible: whether smallest visible losses were computed.
    """

    feature, a_feature = "change", "a change"
    nothing = "nothing changed"
    why_unseen = "whose parameters move no mode that is compared"

    before: tuple[str, ...]
    after: tuple[str, ...]
    settings: ChangeSettings
    probability_of_change: float
    shared: Quantiles | None
    places: tuple[PlaceOfChange, ...]
    hypotheses: tuple[ChangesRecord, ...]
    has_visible: bool = False

    @property
    def best(self) -> ChangesRecord:
        """The most probable hypothesis."""
        return self.hypotheses[0]

    @property
    def best_change(self) -> ChangesRecord | None:
        """The most probable hypothesis that anything changed; None if none was tried."""
        return next((each for each in self.hypotheses if each.claims_change), None)

    def parameters_of_features(self, name: str) -> list[str]:
        return [loss for change in self.hypothesis(name).changes for loss in change.losses]

    def model_class(self, study: Study, name: str) -> ModelClass:
        row = self.hypothesis(name)
        family = choose_changes(study.only([row.baseline]), self.before, self.after, self.settings)
        return family.hypothesis(family.classes[0], [each.place for each in row.changes], name)

    def place(self, name: str) -> PlaceOfChange:
        """The place of that name; KeyError if there is none."""
        return {each.place.name: each for each in self.places}[name]

    def _line(self) -> str:
        places = counted(len(self.places), "place")
        return f"of {places}: a change with probability {self.probability_of_change:.4f}"


@dataclass(frozen=True, eq=False, repr=False)
class ChangeSearch(SearchResult):
    """The result of a comparison of two tests."""

    record: ChangeRecord
