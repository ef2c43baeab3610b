"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

On each of several baseline classes it builds hypotheses: no appendage; one appendage of each kind
at each of its places; then one more, as long as the evidence grows. No pairing of modes is assumed:
every hypothesis is scored over all pairings. All are screened, which gives approximate evidences;
those on which the answer rests are sampled.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.required_accuracy import RefinementSettings
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.appendages.baselines import Baselines, choose_baselines, compact, prior_draws
from bayes_ssi.studies.appendages.findings import search_record
from bayes_ssi.studies.appendages.hypotheses import SearchSettings, name_of
from bayes_ssi.studies.appendages.next_level import NextLevel, next_level
from bayes_ssi.studies.appendages.places import AppendagePlace
from bayes_ssi.studies.appendages.sampling_choice import to_sample
from bayes_ssi.studies.appendages.screening import (
    Key,
    Screened,
    ScreenedHypothesis,
    ToScreen,
    screen_all,
)
from bayes_ssi.studies.appendages.screening_in_steps import screen_best
from bayes_ssi.studies.appendages.search_result import AppendageSearch
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.study import Study, compare_and_diagnose

Hypotheses = Mapping[Key, ScreenedHypothesis]
# Screening has found where posteriors lie, so that no search precedes sampling. The basis that all
# share is accurate there: mostly its error is less than half of the data's own, and 16 full
# solutions at draws correct the evidence. Otherwise it is enlarged once, for that hypothesis.
KNOWN_REGIONS = RefinementSettings(error_share=0.5, most_searches=0, most_rounds=2)


@checked
def search(
    baseline: ModelClass | Study,
    search_settings: SearchSettings | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    run: Run | None = None,
    *,
    baselines: Sequence[str] | None = None,
    candidates: Sequence[Candidate] | None = None,
    present_in: Sequence[str] | None = None,
) -> AppendageSearch:
    """Search for hidden appendages on a baseline structure, or on each of several.

    Args:
        baseline: a class; its pairing is not used. Of a study, all classes are baselines on which
            appendages can be hung, with its prior weights, but for those that carry an appendage
            of their own where others do not.
        search_settings: what an appendage may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        run: workers, a checkpoint to resume from, and progress; the result does not depend on
            them.
        baselines: names of the study's classes that appendages are hung on; the others are
            compared without any.
        candidates: where appendages may hang; floors and storeys where a structure has them, else
            all sensors, if None.
        present_in: names of the configurations that have the appendages; if None, all whose
            structures have the candidates' places.

    Raises:
        ValueError: appendages cannot be hung on any structure, a candidate is not on it or is
            given twice, there is no class or configuration of such a name, or a hypothesis cannot
            be sampled.
    """
    options = search_settings or SearchSettings()
    settings = settings or SamplingSettings()
    if isinstance(baseline, ModelClass):
        baseline = Study(baseline.name, [baseline])
    chosen = choose_baselines(baseline, baselines, candidates, present_in)
    hidden_in = chosen.classes[0].name if len(chosen.classes) == 1 else baseline.name
    run = run or Run()
    with run.working():
        hypotheses, levels = screened_hypotheses(chosen, options, seed, run)
        wanted = [ToScreen(rival, None) for rival in chosen.rivals]
        rivals = screen_all(wanted, seed, run) if wanted else []
        sampled = _sampled(chosen, hypotheses, options, seed, settings, run)
        classes, posteriors = zip(*sampled.values(), strict=True)
        study = Study(
            f"Appendages hidden in {hidden_in!r}",
            classes,
            prior_weights={
                made.name: hypotheses[key].prior_weight for key, (made, _) in sampled.items()
            },
        )
        ranking = compare_and_diagnose(study, posteriors, seed, settings, run)
    record = search_record(chosen, rivals, options, ranking, tuple(hypotheses.values()), levels)
    return AppendageSearch(ranking, record)


def screened_hypotheses(
    baselines: Baselines, options: SearchSettings, seed: int, run: Run
) -> tuple[dict[Key, ScreenedHypothesis], list[NextLevel]]:
    """All hypotheses with their approximate evidences, and the levels in which they were tried."""
    names = [each.name for each in baselines.classes]
    carriers = {name: baselines.projected(name, prior_draws) for name in names}
    hypotheses: dict[Key, ScreenedHypothesis] = {}

    def prior_weight(name: str, number: int) -> float:
        """That of a number of appendages, shared by all ways to place them."""
        share = options.number_weights[number] / math.comb(len(baselines.places[name]), number)
        return baselines.prior_probability(name) * share

    levels = [NextLevel([Key(name, ()) for name in names])]
    while keys := levels[-1].keys:
        wanted = [
            ToScreen(
                baselines.hypothesis(
                    carriers[name], places, options, _full_name(name, places, names)
                ),
                _simpler(Key(name, places), hypotheses),
            )
            for name, places in keys
        ]
        weights = [prior_weight(name, len(places)) for name, places in keys]
        masses = [each.approximate_log_mass.log_evidence for each in hypotheses.values()]
        fewer = float(np.logaddexp.reduce(masses, initial=-math.inf))
        results = screen_best(wanted, weights, len(keys[0].places), seed, run, fewer)
        for key, (made, _), weight, screened in zip(keys, wanted, weights, results, strict=True):
            hypotheses[key] = ScreenedHypothesis(key, made, weight, screened)
        if len(hypotheses) == len(names):
            # Where the posterior is, a smaller basis is more accurate.
            for name in names:
                draws = hypotheses[Key(name, ())].screened.wide_draws
                carriers[name] = baselines.projected(name, draws)
        most = len(options.number_weights) - 1
        levels.append(
            next_level(hypotheses, baselines.places, prior_weight, most, options.branches)
        )
    return hypotheses, levels


def _full_name(baseline: str, places: Sequence[AppendagePlace], names: Sequence[str]) -> str:
    of_one = name_of(places)
    return of_one if len(names) == 1 else f"{baseline}: {of_one}"


def _simpler(key: Key, hypotheses: Hypotheses) -> Screened | None:
    """The best hypothesis with one of these appendages less; None where there is none to leave."""
    fewer = [
        Key(key.baseline, tuple(other for other in key.places if other != place))
        for place in key.places
    ]
    known = [hypotheses[each].screened for each in fewer if each in hypotheses]
    return max(known, key=lambda each: each.log_evidence) if known else None


def _sampled(
    baselines: Baselines,
    hypotheses: Hypotheses,
    options: SearchSettings,
    seed: int,
    settings: SamplingSettings,
    run: Run,
) -> dict[Key, tuple[ModelClass, Posterior]]:
    """Classes and posteriors of the hypotheses on which the answer rests, and their baselines."""
    # Screening has searched, too.
    settings = replace(settings, searches=math.ceil(settings.searches / 2))
    approximate = {key: each.approximate_log_mass for key, each in hypotheses.items()}
    sampled: dict[Key, tuple[ModelClass, Posterior]] = {}
    log_masses: dict[Key, float] = {}
    accurate: dict[str, ModelClass] = {}
    most = baselines.most_sampled(options)
    while chosen := set(to_sample(approximate, log_masses, options.most_unsampled, most)):
        # Parameters without any appendage are part of the answer.
        chosen |= {Key(key.baseline, ()) for key in chosen}
        now = [key for key in hypotheses if key in chosen and key not in sampled]
        for name in {key.baseline for key in now} - accurate.keys():
            own = [each for key, each in hypotheses.items() if key.baseline == name]
            best = max(own, key=lambda each: each.approximate_log_mass.log_evidence)
            accurate[name] = baselines.accurate(name, best.screened.posterior_draws)
        classes = [
            _to_sample(baselines, accurate[key.baseline], hypotheses[key], options) for key in now
        ]
        starts = [hypotheses[key].screened.maxima for key in now]
        posteriors = sample_all(classes, seed, settings, run, KNOWN_REGIONS, starts)
        for key, made, posterior in zip(now, classes, posteriors, strict=True):
            sampled[key] = made, posterior
            log_masses[key] = hypotheses[key].log_mass(posterior)
    return {key: sampled[key] for key in hypotheses if key in sampled}


def _to_sample(
    baselines: Baselines,
    accurate: ModelClass,
    hypothesis: ScreenedHypothesis,
    options: SearchSettings,
) -> ModelClass:
    """The class of a hypothesis, its reduced structures compact where its posterior lies."""
    carrier = compact(accurate, hypothesis.screened.draws)
    return baselines.hypothesis(
        carrier, hypothesis.key.places, options, hypothesis.model_class.name
    )
