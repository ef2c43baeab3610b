"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

From a baseline model class it builds hypotheses: no appendage; one appendage of each kind at each
of its places; then one more added to the best of these, as long as the evidence grows. No pairing
of modes is assumed: every hypothesis is scored over all pairings. All are screened, which gives
approximate evidences; those on which the answer rests are sampled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from bayes_ssi.appendages.hypotheses import (
    SearchSettings,
    hypothesis,
    places_of,
    structure_with_floors,
)
from bayes_ssi.appendages.places import AppendagePlace
from bayes_ssi.appendages.sampling_choice import to_sample
from bayes_ssi.appendages.screening import Screened, ToScreen, screen_all
from bayes_ssi.appendages.search_result import AppendageSearch, Hypothesis, search_record
from bayes_ssi.argument_types import checked
from bayes_ssi.execution.run import Run
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.posterior import Posterior
from bayes_ssi.ranking.class_sampling import sample_all
from bayes_ssi.ranking.study import Study, compare_and_diagnose
from bayes_ssi.sampling.settings import SamplingSettings

Places = tuple[AppendagePlace, ...]


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
    run = run or Run()
    with run.working():
        hypotheses = _screened(baseline, candidates, options, seed, run)
        posteriors = _sampled(hypotheses, options, seed, settings, run)
        sampled = [hypotheses[places] for places in posteriors]
        study = Study(
            f"Appendages hidden in {baseline.name!r}",
            [each.model_class for each in sampled],
            prior_weights={each.model_class.name: each.prior_weight for each in sampled},
        )
        ranking = compare_and_diagnose(study, tuple(posteriors.values()), seed, settings, run)
    record = search_record(baseline, options, ranking, tuple(hypotheses.values()), candidates)
    return AppendageSearch(ranking, record)


def _screened(
    baseline: ModelClass,
    candidates: Sequence[AppendagePlace],
    options: SearchSettings,
    seed: int,
    run: Run,
) -> dict[Places, Hypothesis]:
    """All hypotheses with their approximate evidences."""
    hypotheses: dict[Places, Hypothesis] = {}
    level: list[Places] = [()]
    while level:
        classes = [hypothesis(baseline, places, options) for places in level]
        wanted = [
            ToScreen(model_class, _simpler(places, hypotheses))
            for places, model_class in zip(level, classes, strict=True)
        ]
        weight = _prior_weight(len(level[0]), len(candidates), options)
        for places, model_class, screened in zip(
            level, classes, screen_all(wanted, seed, run), strict=True
        ):
            hypotheses[places] = Hypothesis(places, model_class, weight, screened)
        level = _next_level(hypotheses, candidates, options)
    return hypotheses


def _simpler(places: Places, hypotheses: Mapping[Places, Hypothesis]) -> Screened | None:
    """The best hypothesis with one of these appendages less; None where there is none to leave."""
    fewer = [tuple(other for other in places if other != place) for place in places]
    known = [hypotheses[each].screened for each in fewer if each in hypotheses]
    return max(known, key=lambda each: each.log_evidence) if known else None


def _sampled(
    hypotheses: Mapping[Places, Hypothesis],
    options: SearchSettings,
    seed: int,
    settings: SamplingSettings,
    run: Run,
) -> dict[Places, Posterior]:
    """Posteriors of the baseline, and of the hypotheses on which the answer rests."""
    approximate = {places: each.approximate_log_mass for places, each in hypotheses.items()}
    posteriors: dict[Places, Posterior] = {}
    chosen = to_sample(approximate, {}, options.most_unsampled)
    while chosen:
        # Parameters without any appendage are part of the answer.
        now = [p for p in hypotheses if p in chosen or (p == () and not posteriors)]
        posteriors.update(
            zip(
                now,
                sample_all([hypotheses[p].model_class for p in now], seed, settings, run),
                strict=True,
            )
        )
        log_masses = {p: hypotheses[p].log_mass(each) for p, each in posteriors.items()}
        chosen = to_sample(approximate, log_masses, options.most_unsampled)
    return {places: posteriors[places] for places in hypotheses if places in posteriors}


def _next_level(
    hypotheses: Mapping[Places, Hypothesis],
    candidates: Sequence[AppendagePlace],
    options: SearchSettings,
) -> list[Places]:
    """Hypotheses with one more appendage than the best so far; none if more do not help."""

    def log_evidence(places: Places) -> float:
        return hypotheses[places].screened.log_evidence

    most = max(len(places) for places in hypotheses)
    if most + 1 == len(options.number_weights):
        return []
    top = [places for places in hypotheses if len(places) == most]
    fewer = [places for places in hypotheses if len(places) == most - 1]
    if fewer and max(map(log_evidence, top)) <= max(map(log_evidence, fewer)):
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
