"""Whether a mode looks as if an appendage that no class models had split it: a check of rankings.

A resonant appendage makes two modes of one. Evidence ranks the classes that are there: one that
takes either of the two for the mode, and the other for spurious, fits perfectly with stiffnesses
that are wrong. So the most probable class is compared with itself plus an appendage, by the quick
screening of a search.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.inference.model_class.configuration import label_in
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.studies.appendages.baselines import Baselines, choose_baselines
from bayes_ssi.studies.appendages.candidates import FREQUENCIES_NEAR, MOST_PLACES_FOR_A_WARNING
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.comparison import Check
from bayes_ssi.studies.ranking.study import Ranking, Study
from bayes_ssi.studies.search.approximate_evidence import EFFORTS, ToScreen, screen_all

ASK = "; ask with a search for appendages"


def missing_appendage(ranking: Ranking, run: Run) -> Iterator[Check]:
    """Why the answer may be that of an analyst who misses an appendage, if it may."""
    if words := unmodelled_appendage(ranking, run):
        yield Check("appendage", words)


def unmodelled_appendage(ranking: Ranking, run: Run) -> str:
    study = ranking.study
    if any(
        test.structure.appendages for each in study.model_classes for test in each.configurations
    ):
        return ""
    best = next(each for each in study.model_classes if each.name == ranking.comparison.best.name)
    posterior = next(each for each in ranking.posteriors if each.name == best.name)
    spurious = [
        (test.data, modes.name, [each for each in test.data.labels if each not in modes.pairing])
        for test, modes in zip(best.configurations, posterior.configurations, strict=True)
    ]
    if not any(labels for *_, labels in spurious):
        return ""
    pairs = [pair for data, name, labels in spurious for pair in _split(data, name, labels)]
    looks = (
        f"modes {'; modes '.join(pairs)} look like one mode that an appendage splits"
        if pairs
        else ""
    )
    try:
        baselines = choose_baselines(Study(study.name, [best]))
    except ValueError:  # nothing can be hung on it
        return looks and f"{looks}, and no class models one"
    if not is_cheap(best) or len(baselines.features[best.name]) > MOST_PLACES_FOR_A_WARNING:
        return looks and f"{looks}, and no class models one{ASK}"
    nats, where = _screened(baselines, best, ranking.seed, run)
    if nats <= 0.0:
        return ""
    left = ", ".join(label_in(name, repr(one)) for _, name, labels in spurious for one in labels)
    looks = looks or f"{best.name!r} takes {left} for spurious"
    return (
        f"{looks}, and no class models one: with an appendage, most probably {where}, the data "
        f"are {_times(nats)} as probable as by {best.name!r} alone, whose parameters then stand "
        f"for what it lacks{ASK}"
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


def _screened(baselines: Baselines, best: ModelClass, seed: int, run: Run) -> tuple[float, str]:
    """Nats by which one appendage anywhere is more probable than none, and the best place."""
    places = baselines.features[best.name]
    none = ToScreen(baselines.hypothesis(best, (), best.name), None)
    alone = screen_all([none], seed, run, EFFORTS.quick)[0]
    ones = [ToScreen(baselines.hypothesis(best, (place,), place.name), alone) for place in places]
    evidences = np.array([each.log_evidence for each in screen_all(ones, seed, run, EFFORTS.quick)])
    nats = float(logsumexp(evidences)) - math.log(len(places)) - alone.log_evidence
    return nats, places[int(evidences.argmax())].description


def _times(nats: float) -> str:
    return f"{math.exp(nats):.2g} times" if nats < 10.0 else f"e^{nats:.0f} times"
