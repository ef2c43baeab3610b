"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

From a baseline model class it builds hypotheses: no appendage; one appendage of each kind at each
of its places; then one more added to the best of these, as long as the evidence grows. No pairing
of modes is assumed: every hypothesis is scored over all pairings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

from bayes_ssi.appendages.hypotheses import (
    SearchSettings,
    hypothesis,
    places_of,
    structure_with_floors,
)
from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.appendages.search_result import AppendageSearch, search_record
from bayes_ssi.argument_types import checked
from bayes_ssi.execution.run import Run
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.class_sampling import sample_all
from bayes_ssi.ranking.study import Study, compare_and_diagnose
from bayes_ssi.sampling.settings import SamplingSettings


@checked
def search(
    baseline: ModelClass,
    search_settings: SearchSettings | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
) -> AppendageSearch:
    """Search for hidden appendages on a baseline structure.

    Args:
        baseline: a class whose structure has floors; its pairing is not used.
        search_settings: what an appendage may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; the result does not depend on
            them.

    Raises:
        ValueError: the structure has no floors to hang an appendage on, there are several
            configurations, or a hypothesis cannot be sampled.
    """
    options = search_settings or SearchSettings()
    settings = settings or SamplingSettings()
    candidates = places_of(structure_with_floors(baseline))
    build = partial(hypothesis, baseline, search_settings=options)
    posteriors: dict[tuple[AppendagePlace, ...], Posterior] = {}
    classes: dict[tuple[AppendagePlace, ...], ModelClass] = {}
    run = run or Run()
    with run.working():
        level: list[tuple[AppendagePlace, ...]] = [(), *((place,) for place in candidates)]
        while level:
            classes.update({places: build(places) for places in level})
            sampled = sample_all([classes[places] for places in level], seed, settings, run)
            posteriors.update(zip(level, sampled, strict=True))
            level = _next_level(posteriors, candidates, options)
        weights = {
            classes[places].name: _prior_weight(len(places), len(candidates), options)
            for places in posteriors
        }
        study = Study(
            f"Appendages hidden in {baseline.name!r}", list(classes.values()), prior_weights=weights
        )
        sampled_all = tuple(posteriors.values())
        ranking = compare_and_diagnose(study, sampled_all, seed, settings, run)
    places_by_name = {classes[places].name: places for places in posteriors}
    record = search_record(baseline, options, ranking, places_by_name, candidates)
    return AppendageSearch(ranking, record)


def _next_level(
    posteriors: Mapping[tuple[AppendagePlace, ...], Posterior],
    candidates: Sequence[AppendagePlace],
    options: SearchSettings,
) -> list[tuple[AppendagePlace, ...]]:
    """Hypotheses with one more appendage than the best so far; none if more do not help."""

    def log_evidence(places: tuple[AppendagePlace, ...]) -> float:
        return posteriors[places].evidence.log_evidence

    most = max(len(places) for places in posteriors)
    if most + 1 == len(options.number_weights):
        return []
    top = [places for places in posteriors if len(places) == most]
    fewer = [places for places in posteriors if len(places) == most - 1]
    if max(map(log_evidence, top)) <= max(map(log_evidence, fewer)):
        return []
    best = sorted(top, key=log_evidence, reverse=True)[: options.branches]
    extended = [
        tuple(place for place in candidates if place in (*places, new))
        for places in best
        for new in candidates
        if new not in places
    ]
    return list(dict.fromkeys(extended))


def _prior_weight(number: int, n_candidates: int, options: SearchSettings) -> float:
    """Prior weight of a number of appendages, shared by all ways to place them."""
    return options.number_weights[number] / math.comb(n_candidates, number)
