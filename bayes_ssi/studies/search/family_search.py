"""The search through a family of hypotheses: screened, extended by one more feature, sampled.

One feature is tried everywhere. More are tried as long as the evidence grows: on the best
hypotheses, everywhere; and wherever the evidence that is to be expected gives the hypothesis a
noticeable probability. A feature is expected to add what it adds alone, as it does where two act on
different modes. Where both explain the same modes this is too much, which costs work alone; a
feature that shows only next to another one is tried with the best, not with all.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, NamedTuple

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import RefinementSettings
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.studies.ranking.checks import ranked
from bayes_ssi.studies.ranking.class_sampling import sample_all
from bayes_ssi.studies.ranking.comparison import class_probabilities
from bayes_ssi.studies.ranking.study import AveragedParameter, Ranking, Study, averaged_parameter
from bayes_ssi.studies.search.approximate_evidence import MOST_FULL, QUICK, Effort, Screened
from bayes_ssi.studies.search.family import Family, Feature, Hypothesis, Key, prior_draws
from bayes_ssi.studies.search.ladder import screen_best, to_sample

LEAST_EXPECTED = 1e-3  # probability of a hypothesis with several features that is tried
MOST_EXPECTED = 300  # number of these

# Hypotheses with one number of features to try; how many with as many are not; and the log of the
# expected evidences times prior weights of these, summed.
Level = tuple[list[Key[Feature]], int, float]


class Draws(NamedTuple):
    """Draws of quantities, such as a hypothesis's parameters."""

    names: tuple[str, ...]  # of the quantities
    values: FloatArray  # (n, d)
    weights: FloatArray  # (n,), which add up to one

    def column(self, name: str) -> FloatArray:
        return self.values[:, self.names.index(name)]

    @property
    def quantiles(self) -> dict[str, Quantiles]:
        return {name: weighted_quantiles(self.column(name), self.weights) for name in self.names}


@dataclass(frozen=True, eq=False)
class FamilySearch(Generic[Feature]):
    """What a search found: the ranking of what was sampled, and all hypotheses."""

    ranking: Ranking
    hypotheses: tuple[Hypothesis[Feature], ...]
    levels: tuple[Level[Feature], ...]

    @cached_property
    def posteriors(self) -> dict[str, Posterior]:
        return {posterior.name: posterior for posterior in self.ranking.posteriors}

    @cached_property
    def draws(self) -> dict[str, Draws]:
        """Name of a hypothesis → draws of its posterior; of screening where it was not sampled."""
        draws = {}
        for hypothesis in self.hypotheses:
            made, screened = hypothesis.model_class, hypothesis.screened
            if (posterior := self.posteriors.get(made.name)) is None:
                own = Draws(made.parameter_names, made.values(screened.z), screened.weights)
            else:
                n = len(posterior.values)
                own = Draws(posterior.parameter_names, posterior.values, np.full(n, 1.0 / n))
            draws[made.name] = own
        return draws

    @cached_property
    def log_masses(self) -> dict[str, float]:
        by_name = {each.model_class.name: each for each in self.hypotheses}
        return {name: each.log_mass(self.posteriors.get(name)) for name, each in by_name.items()}

    @cached_property
    def probabilities(self) -> dict[str, float]:
        return class_probabilities(self.log_masses, None)

    def averaged_parameters(self) -> Iterator[AveragedParameter]:
        """The baselines' parameters averaged over hypotheses that were sampled."""
        without = {each.model_class.name for each in self.hypotheses if not each.key.features}
        shares = [(self.posteriors[row.name], row.probability)
                  for row in self.ranking.comparison.classes]  # fmt: skip
        naive = [posterior for posterior, _ in shares if posterior.name in without]
        for name in dict.fromkeys(name for each in naive for name in each.parameter_names):
            inferring = [each for each in shares if name in each[0].parameter_names]
            if not any(probability > 0.0 for _, probability in inferring):
                continue
            first = next(each for each in naive if name in each.parameter_names)
            values = first.values[:, first.parameter_names.index(name)]
            simplest = {"naive_mean": float(values.mean()), "naive_sd": float(values.std())}
            posteriors, probabilities = zip(*inferring, strict=True)
            yield averaged_parameter(name, posteriors, probabilities, **simplest)


def search_family(
    family: Family[Feature], seed: int, settings: SamplingSettings, run: Run
) -> FamilySearch[Feature]:
    """Screen the hypotheses of a family, sample those on which the answer rests, and rank them."""
    hypotheses, levels = screened_hypotheses(family, seed, run)
    sampled = _sampled(family, hypotheses, seed, settings, run)
    classes, posteriors = zip(*sampled.values(), strict=True)
    weights = {made.name: hypotheses[key].prior_weight for key, (made, _) in sampled.items()}
    study = Study(family.title, classes, prior_weights=weights, mass_unit=family.study.mass_unit)
    searched = {n for each in classes for n in each.parameter_names} - {
        n for each in family.classes for n in each.parameter_names
    }
    ranking = ranked(study, posteriors, seed, settings, run, searched=searched)
    return FamilySearch(ranking, tuple(hypotheses.values()), tuple(levels))


def screened_hypotheses(
    family: Family[Feature], seed: int, run: Run, quick: Effort = QUICK, most_full: int = MOST_FULL
) -> tuple[dict[Key[Feature], Hypothesis[Feature]], list[Level[Feature]]]:
    """All hypotheses with their approximate evidences, and the levels in which they were tried.

    Args:
        quick, most_full: as for :func:`screen_best`.
    """
    names = family.study.names
    carriers = {name: family.projected(name, prior_draws) for name in names}
    hypotheses: dict[Key[Feature], Hypothesis[Feature]] = {}
    levels: list[Level[Feature]] = [([Key(name, ()) for name in names], 0, -math.inf)]
    while keys := levels[-1][0]:
        classes = [
            family.hypothesis(carriers[key.baseline], key.features, family.full_name(key))
            for key in keys
        ]
        wanted = [(made, _simpler(k, hypotheses)) for k, made in zip(keys, classes, strict=True)]
        weights = [family.prior_weight(k.baseline, len(k.features), n_common(k)) for k in keys]
        masses = [each.approximate_log_mass.log_evidence for each in hypotheses.values()]
        fewer = float(np.logaddexp.reduce(masses, initial=-math.inf))
        n_features = len(keys[0].features)
        results = screen_best(wanted, weights, n_features, seed, run, fewer, quick, most_full)
        rows = zip(keys, classes, weights, results, strict=True)
        hypotheses.update((row[0], Hypothesis(*row)) for row in rows)
        if len(levels) == 1:
            # Where the posterior is, a smaller basis is more accurate.
            for key in keys:
                draws = hypotheses[key].screened.wide_draws
                carriers[key.baseline] = family.projected(key.baseline, draws)
        levels.append(_next_level(family, hypotheses, len(levels)))
    return hypotheses, levels


def is_common(feature: object) -> bool:
    """Whether it is one that all places share; most families have none of these."""
    return getattr(feature, "is_common", False)


def n_common(key: Key[Feature]) -> int:
    return sum(map(is_common, key.features))


def _simpler(
    key: Key[Feature], hypotheses: Mapping[Key[Feature], Hypothesis[Feature]]
) -> Screened | None:
    """The best hypothesis with one of these features less; None where there is none to leave."""
    fewer = [
        Key(key.baseline, tuple(other for other in key.features if other != feature))
        for feature in key.features
    ]
    known = [hypotheses[each].screened for each in fewer if each in hypotheses]
    return max(known, key=lambda each: each.log_evidence) if known else None


def _next_level(
    family: Family[Feature], hypotheses: Mapping[Key[Feature], Hypothesis[Feature]], n: int
) -> Level[Feature]:
    """Hypotheses with ``n`` features; none where so many are not considered, or do not help."""
    if n == len(family.options.number_weights):
        return [], 0, -math.inf
    if n == 1:
        all_ones = [Key(name, (one,)) for name, own in family.features.items() for one in own]
        return all_ones, 0, -math.inf
    heights = {key: each.screened.log_evidence for key, each in hypotheses.items()}
    ranked = sorted(hypotheses, key=lambda key: -heights[key])
    best, before = ([key for key in ranked if len(key.features) == k] for k in (n - 1, n - 2))
    if heights[best[0]] <= heights[before[0]]:
        return [], 0, -math.inf
    masses = [each.approximate_log_mass.log_evidence for each in hypotheses.values()]
    known = float(logsumexp(masses))
    able = [name for name, features in family.features.items() if len(features) >= n]
    extended = {name: _expected_log_masses(family, name, n, heights, known) for name in able}
    chosen: dict[Key[Feature], float] = {}
    likely: dict[Key[Feature], float] = {}
    for name, expected in extended.items():
        features = family.features[name]
        for parent in best[: family.options.branches]:
            if parent.baseline == name:
                chosen.update(_children(parent, features, expected[parent], -math.inf))
        for parent, row in expected.items():
            likely.update(_children(parent, features, row, math.log(LEAST_EXPECTED)))
    for key in sorted(likely, key=lambda key: -likely[key])[:MOST_EXPECTED]:
        chosen[key] = likely[key]
    n_all = sum(math.comb(len(family.features[name]), n) for name in extended)
    if n_all == len(chosen):
        return list(chosen), 0, -math.inf
    rows = [row for expected in extended.values() for row in expected.values()]
    # Each hypothesis extends as many as it has features.
    log_all = float(logsumexp(rows)) - math.log(n)
    log_chosen = float(logsumexp(list(chosen.values()))) if chosen else -math.inf
    share = -math.expm1(log_chosen - log_all)
    log_left = known + log_all + math.log(share) if share > 0.0 else -math.inf
    return list(chosen), n_all - len(chosen), log_left


def _expected_log_masses(
    family: Family[Feature], name: str, n: int, heights: Mapping[Key[Feature], float], known: float
) -> dict[Key[Feature], FloatArray]:
    """Hypothesis with ``n - 1`` features on a baseline → those that extend it, (n_features,).

    Their expected log masses less ``known``; minus infinity where it has the feature.
    """
    features = family.features[name]
    alone = np.array([heights[Key(name, (feature,))] for feature in features])
    gains = alone - heights[Key(name, ())]
    common = np.array([is_common(feature) for feature in features], dtype=np.intp)
    expected = {}
    for parent, height in heights.items():
        if parent.baseline == name and len(parent.features) == n - 1:
            ways = [n_common(parent) + more for more in range(1 + common.max())]
            log_weights = np.log([family.prior_weight(name, n, each) for each in ways])
            expected[parent] = height + gains + log_weights[common] - known
            expected[parent][[features.index(feature) for feature in parent.features]] = -math.inf
    return expected


def _children(
    parent: Key[Feature], features: Sequence[Feature], log_masses: FloatArray, least: float
) -> Iterator[tuple[Key[Feature], float]]:
    """What extends a hypothesis by one of ``features``, where its log mass is above a bound."""
    columns = np.flatnonzero(log_masses > least).tolist()
    taken = [features.index(feature) for feature in parent.features] if columns else []
    for column in columns:
        chosen = (features[i] for i in sorted((*taken, column)))
        yield Key(parent.baseline, tuple(chosen)), float(log_masses[column])


def _sampled(
    family: Family[Feature],
    hypotheses: Mapping[Key[Feature], Hypothesis[Feature]],
    seed: int,
    settings: SamplingSettings,
    run: Run,
) -> dict[Key[Feature], tuple[ModelClass, Posterior]]:
    """Classes and posteriors of the hypotheses on which the answer rests, and their baselines."""
    # Screening has searched, too, and has found where posteriors lie.
    settings = replace(settings, searches=math.ceil(settings.searches / 2))
    # Full solutions at draws correct the evidence, or enlarge the shared basis once.
    known_regions = RefinementSettings(error_share=0.5, most_rounds=2)
    approximate = {key: each.approximate_log_mass for key, each in hypotheses.items()}
    sampled: dict[Key[Feature], tuple[ModelClass, Posterior]] = {}
    log_masses: dict[Key[Feature], float] = {}
    accurate: dict[str, ModelClass] = {}
    while chosen := set(
        to_sample(approximate, log_masses, family.options.most_unsampled, family.most_sampled)
    ):
        # Parameters without any feature are part of the answer.
        chosen |= {Key(key.baseline, ()) for key in chosen}
        now = [key for key in hypotheses if key in chosen and key not in sampled]
        for name in {key.baseline for key in now} - accurate.keys():
            on_it = [each for key, each in hypotheses.items() if key.baseline == name]
            best = max(on_it, key=lambda each: each.approximate_log_mass.log_evidence)
            accurate[name] = family.accurate(best)
        classes = [family.to_sample(accurate[key.baseline], hypotheses[key]) for key in now]
        starts = [hypotheses[key].screened.maxima for key in now]
        posteriors = sample_all(classes, seed, settings, run, known_regions, starts)
        for key, made, posterior in zip(now, classes, posteriors, strict=True):
            sampled[key] = made, posterior
            log_masses[key] = hypotheses[key].log_mass(posterior)
    return {key: sampled[key] for key in hypotheses if key in sampled}
