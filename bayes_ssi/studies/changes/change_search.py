"""What changed between two tests of a structure: probability, place and size.

Hypotheses are built on the classes of a study: nothing changed; one place lost a share of its
stiffness; then one more, as long as the evidence grows. Tests of one structure share the errors of
its model, since it is wrong in the same way before and after.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import counted
from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.changes.changes_family import (
    SHARED,
    ChangePlace,
    Changes,
    ChangeSettings,
    choose_changes,
)
from bayes_ssi.studies.changes.visible_loss import VISIBILITY, visibilities
from bayes_ssi.studies.ranking.comparison import RANKING
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.family_search import FamilySearch, search_family
from bayes_ssi.studies.search.search_record import (
    FamilyRecord,
    HypothesisRecord,
    SearchResult,
    averaged_features,
    records_by_probability,
)

# A probability to a twentieth of its odds is as much as anyone asks.
SAMPLING = SamplingSettings(log_evidence_error=0.05)


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
    """A place that may have changed."""

    change: ChangeSummary  # averaged over all hypotheses in which it changed
    probability: float
    is_observed: bool  # whether its parameters move any mode that is compared
    # Places that may have changed instead: the data do not tell them apart.
    alike: tuple[str, ...]
    # The smallest loss of all its parameters that the tests would have shown with probability 0.9;
    # None where no loss would be, or it was not computed.
    smallest_visible: float | None = None

    @property
    def place(self) -> ChangePlace:
        return self.change.place


@dataclass(frozen=True, repr=False, kw_only=True)
class ChangeRecord(FamilyRecord):
    """The findings of a comparison of two tests, and those of every search."""

    feature, a_feature = "change", "a change"
    nothing = "nothing changed"
    why_unseen = "whose parameters move no mode that is compared"

    before: tuple[str, ...]  # names of the tests
    after: tuple[str, ...]
    settings: ChangeSettings
    probability_of_change: float  # that anything changed but for a common factor
    # Share of the prediction errors that the tests have in common, averaged over all hypotheses;
    # None where it is not inferred.
    shared: Quantiles | None
    places: tuple[PlaceOfChange, ...]
    hypotheses: tuple[ChangesRecord, ...]
    has_visible: bool = False  # whether smallest visible losses were computed

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


@checked
def changes(
    study: ModelClass | Study,
    before: Sequence[str],
    after: Sequence[str],
    settings: ChangeSettings | None = None,
    seed: int = 0,
    sampling: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    joined: Mapping[str, Sequence[str]] | None = None,
    places: Mapping[str, Sequence[str]] | None = None,
    left_out: Sequence[str] = (),
    visible: bool = True,
) -> SearchResult[ChangeRecord]:
    """What changed between two tests of a structure, or between two groups of tests.

    Args:
        study: a class with these tests, or several, over which answers are averaged.
        before: names of configurations, and ``after``.
        settings: what a change may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        sampling: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; the result does not depend on
            them.
        joined: name of a place → parameters that lose one share. Every parameter of the structure
            that is neither here nor in ``places`` is a place of its own.
        places: name of a place → parameters of which each loses a share of its own.
        left_out: parameters that do not change.
        visible: whether to compute the smallest losses that the tests would have shown; not where
            they show a change.

    Raises:
        ValueError: a configuration or parameter is unknown or named twice, no mode is paired both
            before and after, or a hypothesis cannot be sampled.
    """
    if isinstance(study, ModelClass):
        study = Study(study.name, [study])
    family = choose_changes(
        study, before, after, settings, joined=joined, places=places, left_out=left_out
    )
    return compare(family, seed, sampling or SAMPLING, run or Run(), visible=visible)


def compare(
    family: Changes, seed: int, sampling: SamplingSettings, run: Run, visible: bool = True
) -> SearchResult[ChangeRecord]:
    with run.working():
        found = search_family(family, seed, sampling, run)
        record = change_record(family, found)
        if visible and record.probability_of_change < VISIBILITY.shown:
            unchanged = [each for each in found.hypotheses if not each.key.features]
            likeliest = max(unchanged, key=lambda each: found.log_masses[each.model_class.name])
            seen = visibilities(family, likeliest, seed, run)
            with_visible = tuple(
                replace(each, smallest_visible=seen[each.place].smallest)
                if each.is_observed and each.place in seen
                else each
                for each in record.places
            )
            record = replace(record, places=with_visible, has_visible=True)
    return SearchResult(found.ranking, record)


class LossDraws(NamedTuple):
    """Posterior draws of the losses of one place (n, n_losses), and their weights (n,)."""

    losses: FloatArray
    weights: FloatArray

    def summary(self, place: ChangePlace) -> ChangeSummary:
        columns = zip(place.losses, self.losses.T, strict=True)
        losses = {name: weighted_quantiles(each, self.weights) for name, each in columns}
        return ChangeSummary(place, losses)


def change_record(family: Changes, found: FamilySearch[ChangePlace]) -> ChangeRecord:
    """What was found, for a search in which none, some or all hypotheses were sampled."""
    draws: dict[str, dict[ChangePlace, LossDraws]] = {}
    shared = []
    for each in found.hypotheses:
        name = each.model_class.name
        own = found.draws[name]
        draws[name] = {
            place: LossDraws(np.column_stack([own.column(n) for n in place.losses]), own.weights)
            for place in each.key.features
        }
        if SHARED in own.names:
            shared.append((own.column(SHARED), found.probabilities[name] * own.weights))
    rows = records_by_probability(found, draws, ChangesRecord)
    alike, unseen = _alike(rows), without_influence(family)
    of_shared = [np.concatenate(each) for each in zip(*shared, strict=True)]
    return ChangeRecord(
        before=family.before,
        after=family.after,
        settings=family.options,
        probability_of_change=min(1.0, sum(r.probability for r in rows if r.claims_change)),
        shared=weighted_quantiles(*of_shared) if shared else None,
        places=tuple(
            PlaceOfChange(
                change,
                probability,
                is_observed=place not in unseen,
                alike=alike.get(place, ()),
            )
            for place, probability, change in averaged_features(draws, found.probabilities)
        ),
        geometry=None,
        hypotheses=rows,
        **found.findings,
    )


def _alike(rows: Sequence[ChangesRecord]) -> dict[ChangePlace, tuple[str, ...]]:
    """Place of the most probable change → places with which another explains the data as well."""
    best = next((each for each in rows if each.claims_change), None)
    if best is None or best.probability == 0.0:
        return {}
    least = math.exp(-RANKING.bare_mention) * best.probability
    ours = {change.place for change in best.changes}
    alike: dict[ChangePlace, tuple[str, ...]] = {}
    for row in rows:
        theirs = {change.place for change in row.changes}
        if row.probability >= least and len(ours - theirs) == len(theirs - ours) == 1:
            ((lost,), (gained,)) = ours - theirs, theirs - ours
            alike[lost] = (*alike.get(lost, ()), gained.name)
    return alike


def without_influence(family: Changes) -> set[ChangePlace]:
    """Places whose losses change nothing that is compared with the data, in any class."""
    seen: set[ChangePlace] = set()
    every = {place for of_class in family.features.values() for place in of_class}
    for each in family.classes:
        (unchanged,) = each.log_likelihood_at(np.zeros((1, len(each.parameters))))
        for place in family.features[each.name]:
            changed = family.hypothesis(each, (place,), each.name)
            # The losses are away from their medians, which may be zero.
            z = [[float(name not in each.parameter_names) for name in changed.parameter_names]]
            (log_likelihood,) = changed.log_likelihood_at(np.array(z))
            if not abs(log_likelihood - unchanged) < 1e-6:
                seen.add(place)
    return every - seen
