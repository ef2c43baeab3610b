"""What an appendage that no class models would do to the answer: checks of rankings.

A resonant appendage makes two modes of one. Evidence ranks the classes that are there: one that
takes either of the two for the mode, and the other for spurious, fits perfectly with stiffnesses
that are wrong. So the most probable class is compared with itself plus an appendage, by the quick
screening of a search.

If the other mode was not identified, nothing in the table is spurious. Then only a prior says how
probable an appendage is; what the parameters would be with one near a mode, the data say. That is
said of the modes near which a parameter would leave its own interval.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, softmax

from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.priors import LogUniform
from bayes_ssi.studies.appendages.baselines import Baselines, choose_baselines, frequency_prior
from bayes_ssi.studies.appendages.candidates import AppendagePlace
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.comparison import Check, probability_text
from bayes_ssi.studies.ranking.study import Ranking, Study
from bayes_ssi.studies.search.approximate_evidence import QUICK, Screened, screen_all
from bayes_ssi.studies.search.family import prior_draws

ASK = "; ask with a search for appendages"
# Modes closer than this, relative to their frequencies, may be one that is split.
FREQUENCIES_NEAR = 0.1
MOST_PLACES_FOR_A_WARNING = 30  # more are not screened in a few seconds, for a warning
NEAR_A_MODE = 1.15  # an appendage splits a mode within this factor of its own frequency
PLACES_NEAR_A_MODE = 3  # those that move most in it, which stand for all
LEAST_PROBABILITY = 0.005  # of a hidden appendage of which something is said
MOST_SHOWN = 3  # parameters that a hidden appendage would change


def appendage_checks(ranking: Ranking, run: Run) -> Iterator[Check]:
    """Why the answer may be that of an analyst who misses an appendage, if it may."""
    if words := unmodelled_appendage(ranking, run):
        yield Check("appendage", words)
    elif hidden := hidden_appendages(ranking, run):
        yield Check("hidden", " ".join(map(str, hidden)), fails=False)


class Hidden(NamedTuple):
    """An appendage near an identified mode, whose other mode was not identified."""

    label: str  # of the mode
    probability: float  # with the usual priors, beside one near any other mode, and none
    # Parameter → its median in the answer, and 5, 50 and 95 % quantiles with the appendage, of
    # those that would leave their own 90 % intervals, the largest change first.
    changed: Mapping[str, tuple[float, Quantiles]]

    def __str__(self) -> str:
        shown = "; ".join(
            f"{name} = {middle:.3g} ({low:.3g} to {high:.3g}) in place of {before:.3g}"
            for name, (before, (low, middle, high)) in list(self.changed.items())[:MOST_SHOWN]
        )
        return (
            f"If an appendage that no mode of the table shows vibrates near mode {self.label!r}: "
            f"{shown} (probability {probability_text(self.probability)} with the usual priors)."
        )


def hidden_appendages(ranking: Ranking, run: Run) -> list[Hidden]:
    """Those that may be and would change parameters of the best class, the largest change first."""
    best, posterior = _best(ranking)
    try:
        baselines = choose_baselines(Study(best.name, [best]))
        prior = frequency_prior(best, baselines.tests(best), baselines.options)
    except ValueError:  # nothing can be hung on it
        return []
    if not is_cheap(best):
        return []
    alone, carrier = _alone(baselines, best, ranking.seed, run)
    near: dict[str, list[ModelClass]] = {}
    shares = []  # of the prior of frequencies, near each mode
    for label, (hz, places) in _places_near(baselines, best, posterior).items():
        low, high = max(hz / NEAR_A_MODE, prior.support[0]), min(hz * NEAR_A_MODE, prior.support[1])
        options = replace(baselines.options, frequency=LogUniform(low, high))
        of_mode = replace(baselines, options=options)
        near[label] = [of_mode.hypothesis(carrier, (p,), f"{p.name}, {label}") for p in places]
        shares.append(prior.probability_below(high) - prior.probability_below(low))
    of_all = iter(_screened(list(chain.from_iterable(near.values())), alone, ranking.seed, run))
    log_odds, changed = [0.0], {}
    for (label, classes), share in zip(near.items(), shares, strict=True):
        screened = list(islice(of_all, len(classes)))
        log_odds.append(_nats(screened, alone) + math.log(share))
        changed[label] = _changed(posterior, best, classes, screened)
    hidden = map(Hidden, changed, softmax(log_odds)[1:].tolist(), changed.values())
    shown = [each for each in hidden if each.changed and each.probability >= LEAST_PROBABILITY]
    return sorted(shown, key=lambda each: -max(map(_change, each.changed.values())))


def _change(of: tuple[float, Quantiles]) -> float:
    before, (_, after, _) = of
    return abs(after / before - 1.0)


def _changed(
    posterior: Posterior,
    best: ModelClass,
    classes: Sequence[ModelClass],
    screened: Sequence[Screened],
) -> dict[str, tuple[float, Quantiles]]:
    """The parameters of the structure whose medians would leave their own 90 % intervals."""
    pairs = list(zip(classes, screened, strict=True))
    shares = softmax([each.log_evidence for each in screened])
    weights = np.concatenate([s * each.weights for s, each in zip(shares, screened, strict=True)])
    own = {parameter.name for parameter in best.structural_parameters}
    changed = []
    for row in posterior.summary:
        if row.name in own:
            draws = [
                made.values(one.z)[:, made.parameter_names.index(row.name)] for made, one in pairs
            ]
            after = weighted_quantiles(np.concatenate(draws), weights)
            if not row.quantile_05 <= after[1] <= row.quantile_95:
                changed.append((row.name, (row.median, after)))
    return dict(sorted(changed, key=lambda one: -_change(one[1])))


def _places_near(
    baselines: Baselines, best: ModelClass, posterior: Posterior
) -> dict[str, tuple[float, list[AppendagePlace]]]:
    """Label of an explained mode → its frequency, and the places that move most in it."""
    places = baselines.appendages(best.name)
    ends = [end for place in places for end in place.candidate.ends]
    n_ends = [len(place.candidate.ends) for place in places]
    near: dict[str, tuple[float, list[AppendagePlace]]] = {}
    medians = {row.name: row.median for row in posterior.summary}
    have_places = {test.name for test in baselines.tests(best)}
    for test, modes in zip(best.configurations, posterior.configurations, strict=True):
        if test.name not in have_places:
            continue
        values = np.array([[medians[p.name] for p in test.structure.parameters]])
        moved = test.structure.place_shapes(ends, values)
        if moved is None:
            continue
        for label, number in modes.pairing.items():
            sums = np.add.reduceat(moved[:, number - 1], np.cumsum([0, *n_ends[:-1]]))
            most = np.argsort(-np.abs(sums / n_ends), kind="stable")[:PLACES_NEAR_A_MODE]
            near.setdefault(label, (test.data.mode(label).frequency_hz, [places[i] for i in most]))
    return near


def _best(ranking: Ranking) -> tuple[ModelClass, Posterior]:
    name = ranking.comparison.best.name
    best = next(each for each in ranking.study.model_classes if each.name == name)
    return best, ranking.posterior(name)


def _screened(
    classes: Sequence[ModelClass], simpler: Screened | None, seed: int, run: Run
) -> list[Screened]:
    return screen_all([(each, simpler) for each in classes], seed, run, QUICK)


def _alone(
    baselines: Baselines, best: ModelClass, seed: int, run: Run
) -> tuple[Screened, ModelClass]:
    """The class without an appendage, screened, and what appendages are hung on."""
    carrier = baselines.projected(best.name, prior_draws)
    (alone,) = _screened([baselines.hypothesis(carrier, (), best.name)], None, seed, run)
    return alone, baselines.projected(best.name, alone.wide_draws)


def _nats(ones: Sequence[Screened], alone: Screened) -> float:
    """By which one appendage, at any of several places, is more probable than none."""
    heights = [each.log_evidence for each in ones]
    return float(logsumexp(heights)) - math.log(len(heights)) - alone.log_evidence


def unmodelled_appendage(ranking: Ranking, run: Run) -> str:
    """Why a mode that the best class takes for spurious looks like one of a pair."""
    best, posterior = _best(ranking)
    spurious = [
        (test.data, modes.name, [each for each in test.data.labels if each not in modes.pairing])
        for test, modes in zip(best.configurations, posterior.configurations, strict=True)
    ]
    if not any(labels for *_, labels in spurious):
        return ""
    pairs = [pair for data, name, labels in spurious for pair in _split(data, name, labels)]
    split = f"modes {'; modes '.join(pairs)} look like one that an appendage splits, which "
    looks = f"{split}{best.name!r} lacks" if pairs else ""
    try:
        baselines = choose_baselines(Study(best.name, [best]))
    except ValueError:  # nothing can be hung on it
        return looks
    places = baselines.appendages(best.name)
    if not is_cheap(best) or len(places) > MOST_PLACES_FOR_A_WARNING:
        return looks and f"{looks}{ASK}"
    alone, carrier = _alone(baselines, best, ranking.seed, run)
    classes = [baselines.hypothesis(carrier, (place,), place.name) for place in places]
    screened = _screened(classes, alone, ranking.seed, run)
    nats = _nats(screened, alone)
    if nats <= 0.0:
        return ""
    where = places[int(np.argmax([each.log_evidence for each in screened]))].description
    left = ", ".join(label_in(name, repr(one)) for _, name, labels in spurious for one in labels)
    looks = looks or f"{best.name!r} takes {left} for spurious"
    times = f"{math.exp(nats):.2g}" if nats < 10.0 else f"e^{nats:.0f}"
    return (
        f"{looks}: with an appendage, most probably {where}, the data are {times} times as "
        f"probable as by {best.name!r} alone, whose parameters then stand for what it lacks{ASK}"
    )


def _split(data: ModalData, name: str, spurious: list[str]) -> list[str]:
    """Pairs of neighbouring modes, one of them spurious, with similar shapes or frequencies."""
    alike = {(low.label, high.label): mac for low, high, mac in data.alike}
    pairs = []
    for low, high in zip(data.modes, data.modes[1:], strict=False):
        gap = high.frequency_hz / low.frequency_hz - 1.0
        mac = alike.get((low.label, high.label))
        if not {low.label, high.label}.intersection(spurious) or (
            mac is None and gap > FREQUENCIES_NEAR
        ):
            continue
        shapes = "" if mac is None else f", MAC {mac:.2f}"
        two = f"{low.label!r} and {high.label!r} ({100.0 * gap:.0f} % apart{shapes})"
        pairs.append(label_in(name, two))
    return pairs
