"""What changed between two tests of a structure: probability, place and size.

Hypotheses are built on the classes of a study: nothing changed; one place lost a share of its
stiffness; a mass or an appendage came or went; something else changed every frequency; then one
more, as long as the evidence grows. Tests of one structure share the errors of
its model, since it is wrong in the same way before and after.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bayes_ssi.foundations.displayed import listed
from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.changes.changes_family import (
    SHARED,
    Changes,
    ChangeSettings,
    choose_changes,
    risen,
)
from bayes_ssi.studies.changes.kinds_of_change import ElementPlace, KindOfChange
from bayes_ssi.studies.changes.visible_loss import SHOWN, smallest_losses
from bayes_ssi.studies.ranking.comparison import BARE_MENTION
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.family import FeaturePlace
from bayes_ssi.studies.search.family_search import FamilySearch
from bayes_ssi.studies.search.findings import (
    FamilyRecord,
    Finding,
    HypothesisRecord,
    feature_draws,
    findings,
)


@dataclass(frozen=True, repr=False, kw_only=True)
class ChangeRecord(FamilyRecord):
    """The findings of a comparison of two tests, and those of every search."""

    feature, a_feature = "change", "a change"
    nothing = "nothing changed"
    why_unseen = "whose parameters move no mode that is compared"
    at_least_one, plural, amount = "a change", "s", ("quantity", "lost or added (%)")

    before: tuple[str, ...]  # names of the tests
    after: tuple[str, ...]
    settings: ChangeSettings
    # Share of the prediction errors that the tests have in common, averaged over all hypotheses;
    # None where it is not inferred.
    shared: Quantiles | None
    mass_scale: str  # what masses are a share of; empty where none was considered
    # Label of a mode of both sides → the share by which its frequency rose.
    risen: Mapping[str, float]

    @property
    def kinds(self) -> dict[str, float]:
        """Kind of change → the probability that there is one of it; common losses are none."""
        rows = [(row.probability, _kinds_of(row.features)) for row in self.hypotheses]
        return {
            kind: sum(probability for probability, kinds in rows if kind in kinds)
            for kind in _kinds_of(self.places)
        }

    def claim(self, holds: bool) -> str:
        tests = f"between {listed(map(repr, self.before))} and {listed(map(repr, self.after))}"
        return f"{'something' if holds else 'nothing'} changed {tests} is"

    def model_class(self, study: Study, name: str) -> ModelClass:
        row = self.hypothesis(name)
        family = choose_changes(study.only([row.baseline]), self.before, self.after, self.settings)
        places: list[Any] = [each.place for each in row.features]
        return family.hypothesis(family.classes[0], places, name)


def change_findings(
    family: Changes, search: FamilySearch[KindOfChange], seed: int, run: Run, visible: bool = True
) -> ChangeRecord:
    """What was found; ``visible`` whether to compute the smallest losses that would have shown."""
    record = change_record(family, search)
    if not visible or record.probability_of_any >= SHOWN:
        return record
    unchanged = [each for each in search.hypotheses if not each.key.features]
    likeliest = max(unchanged, key=lambda each: search.log_masses[each.model_class.name])
    seen = smallest_losses(family, likeliest, seed, run)
    places = tuple(
        replace(each, smallest_visible=seen[each.place])
        if each.is_observed and each.place in seen
        else each
        for each in record.places
    )
    return replace(record, places=places, has_visible=True)


def change_record(family: Changes, search: FamilySearch[KindOfChange]) -> ChangeRecord:
    """What was found, for a search in which none, some or all hypotheses were sampled."""
    inferring = [(name, own) for name, own in search.draws.items() if SHARED in own.names]
    columns = [own.column(SHARED) for _, own in inferring]
    weights = [search.probabilities[name] * own.weights for name, own in inferring]
    common = findings(search, feature_draws(family, search))
    alike, unseen = _alike(common["hypotheses"]), without_influence(family)
    common["places"] = tuple(
        replace(each, is_observed=each.place not in unseen, alike=alike.get(each.place, ()))
        for each in common["places"]
    )
    places = [place for of_class in family.features.values() for place in of_class]
    has_masses = any(isinstance(place, ElementPlace) for place in places)
    return ChangeRecord(
        mass_scale=family.scales[family.classes[0].name].name if has_masses else "",
        risen=risen(family.classes[0], family.before, family.after),
        before=family.before,
        after=family.after,
        settings=family.options,
        shared=weighted_quantiles(*map(np.concatenate, (columns, weights))) if columns else None,
        geometry=None,
        **common,
    )


def _kinds_of(changes: Iterable[Finding]) -> list[str]:
    places = (each.place for each in changes if not each.place.is_common)
    return list(dict.fromkeys(place.kind for place in places if isinstance(place, KindOfChange)))


def _alike(rows: Sequence[HypothesisRecord]) -> dict[FeaturePlace, tuple[str, ...]]:
    """Place of the most probable change → places with which another explains the data as well."""
    best = next((each for each in rows if each.claimed), None)
    if best is None or best.probability == 0.0:
        return {}
    least = math.exp(-BARE_MENTION) * best.probability
    ours = {change.place for change in best.features}
    alike: dict[FeaturePlace, tuple[str, ...]] = {}
    for row in rows:
        theirs = {change.place for change in row.features}
        if row.probability >= least and len(ours - theirs) == len(theirs - ours) == 1:
            ((lost,), (gained,)) = ours - theirs, theirs - ours
            alike[lost] = (*alike.get(lost, ()), gained.name)
    return alike


def without_influence(family: Changes) -> set[KindOfChange]:
    """Places whose losses change nothing that is compared with the data, in any class."""
    seen: set[KindOfChange] = set()
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
