"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

On each of several baseline classes it builds hypotheses: no appendage; one appendage of each kind
at each of its places; then one more, as long as the evidence grows. No pairing of modes is assumed:
every hypothesis is scored over all pairings. All are screened, which gives approximate evidences;
those on which the answer rests are sampled.

What an appendage explains is its frequency. Hypotheses with equally many appendages at different
places share what these do to the modes. Draw by draw, the appendage of the lowest frequency is the
first: places may change hands, even between the draws of one hypothesis.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.studies.appendages.baselines import Baselines, Feature, MassScale, hypothesis
from bayes_ssi.studies.appendages.candidates import (
    VISIBLE_SHARE,
    AppendagePlace,
    SearchSettings,
    appendages_among,
)
from bayes_ssi.studies.ranking.comparison import VERY_STRONG
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import screen_all
from bayes_ssi.studies.search.family import Hypothesis
from bayes_ssi.studies.search.family_search import Draws, FamilySearch
from bayes_ssi.studies.search.findings import (
    FamilyRecord,
    FeatureDraws,
    Finding,
    HypothesisRecord,
    credible,
    feature_draws,
    findings,
)

FREQUENCIES_APART = 1.1  # frequencies with nothing between them over this factor are two answers,
LEAST_SHARE_OF_A_GROUP = 0.05  # if each has this share of the probability
# Motions without a mass that the model has are computed at this many amounts, up to this share of
N_AMOUNTS, LARGEST_LOSS = 9, 0.99  # a modal mass, and interpolated.
# Draws of the appendage of one rank by frequency, of several hypotheses in turn, a record each:
# numbers of the hypothesis, which do not fall, and of the place; what it is; its weight; and the
# weight under a prior that is uniform in the logarithm of mass.
RankedDraws = np.recarray[Any, Any]
COLUMNS = [
    *((name, np.intp) for name in ("hypothesis", "place")),
    *((name, float) for name in ("mass", "frequency_hz", "in_model", "weights", "by_data")),
]


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
    # The mass, in the structure's unit, that ratios refer to; None where no appendage was tried.
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
        highest = self.best_without_appendages.log_evidence
        possible = (each for each in self.baselines if each.prior_probability > 0.0)
        return tuple(each for each in possible if highest - each.log_evidence > VERY_STRONG)

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

    def model_class(self, study: Study, name: str) -> ModelClass:
        row = self.hypothesis(name)
        places: list[Any] = [each.place for each in row.features]
        baseline = {each.name: each for each in self.baselines}[row.baseline]
        (original,) = study.only(baseline.classes[:1]).model_classes
        carrier = original.with_any_pairing(row.baseline)
        options, present_in, scale = self.search_settings, self.present_in, baseline.mass_scale
        return hypothesis(carrier, places, options, name, present_in=present_in, scale=scale)


class Motions(NamedTuple):
    """Motions in the modes of a baseline, at unit modal mass."""

    seen: NDArray[np.intp]  # the modes that sensors see, from 0
    frequencies_hz: FloatArray  # (m,)
    of_places: Mapping[AppendagePlace, FloatArray]  # place → (n_ends, m)
    of_sensors: FloatArray  # (n_sensors, m)

    def without(
        self, place: AppendagePlace, mode: int, in_model: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Of a place and of the sensor that moves most, less vibrating masses ``in_model`` (n,).

        Of the structure without an appendage that it has as mass at the place, by its modes in the
        coordinates of these: Λ v = μ (I - Σ m_k φ_k φ_kᵀ) v.
        """
        whole: Any = place.element(1.0, 1.0)
        shares = [whole.mass * share for _, share in whole.as_mass().shares]
        ends = self.of_places[place]
        lost = np.einsum("k,ki,kj", shares, ends, ends)
        most = min(in_model.max(), LARGEST_LOSS / max(float(np.linalg.norm(lost, 2)), 1e-99))
        amounts = np.unique(np.linspace(0.0, most, N_AMOUNTS))
        stiffness, mass = np.diag(self.frequencies_hz**2), np.eye(len(lost))
        shapes = np.array([eigh(stiffness, mass - amount * lost)[1] for amount in amounts])
        same = np.abs(shapes[:, mode]).argmax(axis=1)
        shape = shapes[np.arange(len(amounts)), :, same]
        # What hangs between two places is driven by the mean of their motions.
        of_place = np.abs(shape @ ends.mean(axis=0))
        largest = np.abs(shape @ self.of_sensors.T).max(axis=1)
        return np.interp(in_model, amounts, of_place), np.interp(in_model, amounts, largest)


def matched_appendages(
    draws: FeatureDraws[Feature],
    rows: Sequence[HypothesisRecord],
    baselines: Baselines,
    hypotheses: Sequence[Hypothesis[Feature]],
) -> tuple[MatchedAppendage, ...]:
    """The appendages of the most probable number of them, the lowest frequency first."""
    shares: dict[int, float] = {}
    for row in rows:
        n = len(row.claimed)
        shares[n] = shares.get(n, 0.0) + (row.probability if n else 0.0)
    number = max(shares, key=lambda n: shares[n])
    if not shares[number] > 0.0:
        return ()
    chosen = [row for row in rows if len(row.claimed) == number and row.probability > 0.0]
    by_name = {each.model_class.name: each for each in hypotheses}
    best = {row.baseline: by_name[row.name] for row in reversed(chosen)}
    of_baselines = {name: _motions(baselines, each) for name, each in best.items()}
    motions = {i: known for i, row in enumerate(chosen) if (known := of_baselines[row.baseline])}
    own_shares = [row.probability / shares[number] for row in chosen]
    scales = [baselines.scales[row.baseline].mass for row in chosen]
    priors = [baselines.options.prior_of_mass_ratio(scale) for scale in scales]
    of_rows = [
        {each: of_one for each, of_one in draws[row.name].items() if not each.is_common}
        for row in chosen
    ]
    places = appendages_among(dict.fromkeys(place for own in of_rows for place in own))
    of_ranks = ranked_draws(of_rows, own_shares, priors, places)
    return tuple(matched(each, places, motions) for each in of_ranks)


def ranked_draws(
    draws: Sequence[Mapping[Any, Draws]],
    shares: Sequence[float],
    priors: Sequence[Prior],
    places: Sequence[AppendagePlace],
) -> list[RankedDraws]:
    """The draws of every appendage, by the rank of its frequency in each draw.

    ``draws`` are of hypotheses with equally many appendages; ``shares`` those of the probability,
    ``priors`` those of mass ratios.
    """
    blocks = []
    for number, (appendages, share, prior) in enumerate(zip(draws, shares, priors, strict=True)):
        masses, ratios, frequencies, in_model = (
            np.stack([each.column(name) for each in appendages.values()])
            for name in ("mass", "mass_ratio", "frequency_hz", "in_model")
        )
        weights = share * np.stack([each.weights for each in appendages.values()])
        # The prior density of the logarithm of a mass, which weighs draws in a uniform one's place.
        density = ratios * np.exp(prior.log_density(ratios))
        by_data = np.divide(weights, density, out=np.zeros_like(weights), where=density > 0.0)
        numbers = np.array([places.index(place) for place in appendages])
        order = np.argsort(frequencies, axis=0)
        columns = (masses, frequencies, in_model, weights, by_data)
        sorted_columns = (np.take_along_axis(column, order, axis=0) for column in columns)
        blocks.append((np.full_like(order, number), numbers[order], *sorted_columns))
    joined = [np.concatenate(column, axis=1) for column in zip(*blocks, strict=True)]
    return [np.rec.fromarrays(ranks, dtype=COLUMNS) for ranks in zip(*joined, strict=True)]


def matched(
    draws: RankedDraws, places: Sequence[AppendagePlace], motions: Mapping[int, Motions]
) -> MatchedAppendage:
    """One appendage; ``motions`` are those known, by the numbers of their hypotheses."""
    groups = _of_one_frequency(draws)
    shares = [float(group.weights.sum()) for group in groups]
    frequencies = [weighted_quantiles(group.frequency_hz, group.weights) for group in groups]
    mode, mass, ratio = _effective(groups[0], frequencies[0][1], places, motions)
    return MatchedAppendage(
        frequency_hz=frequencies[0],
        probability=shares[0],
        other_frequencies_hz=tuple(zip(shares[1:], frequencies[1:], strict=True)),
        effective_mass=mass,
        effective_ratio=ratio,
        mode=mode,
        places=_places(groups[0], places),
    )


def _effective(
    group: RankedDraws,
    frequency_hz: float,
    places: Sequence[AppendagePlace],
    motions: Mapping[int, Motions],
) -> tuple[int, Quantiles | None, Quantiles | None]:
    """The mode next to a frequency; the effective mass, and the same over the modal mass."""
    if not motions.keys() >= set(group.hypothesis.tolist()):
        return 0, None, None
    first = motions[int(group.hypothesis[0])]
    nearest = int(first.seen[np.abs(first.frequencies_hz[first.seen] - frequency_hz).argmin()])
    moved, largest = np.empty((2, len(group)))
    for number, place in set(zip(group.hypothesis.tolist(), group.place.tolist(), strict=True)):
        if nearest not in motions[number].seen:
            return 0, None, None
        own = (group.hypothesis == number) & (group.place == place)
        in_model = group.mass[own] * group.in_model[own]
        moved[own], largest[own] = motions[number].without(places[place], nearest, in_model)
    ratios = group.mass * moved**2
    masses = ratios / largest**2
    mass, ratio = (weighted_quantiles(each, group.weights) for each in (masses, ratios))
    return nearest + 1, mass, ratio


def _of_one_frequency(draws: RankedDraws) -> list[RankedDraws]:
    """The draws in groups of frequencies that are apart, the most probable group first."""
    order = np.argsort(draws.frequency_hz)
    hz, weights = draws.frequency_hz[order], draws.weights[order]
    least = LEAST_SHARE_OF_A_GROUP * weights.sum()
    ends, begin = [], 0
    for i in np.flatnonzero(hz[1:] > FREQUENCIES_APART * hz[:-1]).tolist():
        if min(weights[begin : i + 1].sum(), weights[i + 1 :].sum()) >= least:
            ends.append(float(hz[i]))
            begin = i + 1
    numbers = np.searchsorted(ends, draws.frequency_hz)
    groups = [draws[numbers == number] for number in range(len(ends) + 1)]
    return sorted(groups, key=lambda group: -group.weights.sum())


def _places(draws: RankedDraws, places: Sequence[AppendagePlace]) -> tuple[Finding, ...]:
    """Where an appendage may be, the most probable place first."""
    amounts, possible = ("mass", "frequency_hz", "in_model"), []
    for number in np.unique(draws.place).tolist():
        there = draws[draws.place == number]
        if there.weights.sum() > 0.0:
            share = float(there.weights.sum() / draws.weights.sum())
            by_data = float(there.by_data.sum() / draws.by_data.sum())
            quantiles = {name: weighted_quantiles(there[name], there.weights) for name in amounts}
            possible.append(Finding(places[number], share, quantiles, by_data=by_data))
    return tuple(sorted(possible, key=lambda place: -place.probability))


def _motions(baselines: Baselines, hypothesis: Hypothesis[Any]) -> Motions | None:
    """Motions at the means of the parameters of the most probable hypothesis on a baseline."""
    name, model_class = hypothesis.key.baseline, hypothesis.model_class
    of_parameters = hypothesis.screened.weights @ model_class.values(hypothesis.screened.z)
    values = dict(zip(model_class.parameter_names, of_parameters, strict=True))
    test = baselines.tests(baselines[name])[0]
    structure, places = test.structure, baselines.appendages(name)
    at = np.array([[values[parameter.name] for parameter in structure.parameters]])
    moved = structure.place_shapes([end for place in places for end in place.candidate.ends], at)
    if moved is None:
        return None
    modes = structure.modes(at)
    at_sensors = structure.sensor_matrix(test.data.sensors).apply(modes.shapes)[0]
    largest = np.abs(at_sensors).max(axis=0, initial=0.0)
    seen = np.flatnonzero(largest >= VISIBLE_SHARE * largest.max())
    if not len(seen) or not largest.any():
        return None
    first_ends = np.cumsum([len(place.candidate.ends) for place in places])[:-1]
    of_ends = np.split(moved[:, : len(largest)], first_ends)
    of_places = dict(zip(places, of_ends, strict=True))
    return Motions(seen, modes.frequencies_hz[0], of_places, at_sensors)


def appendage_findings(
    baselines: Baselines, search: FamilySearch[Feature], seed: int, run: Run
) -> SearchRecord:
    """What was found on the baselines, and the classes compared with them without appendages."""
    rivals = screen_all([(rival, None) for rival in baselines.rivals], seed, run)
    draws = feature_draws(baselines, search)
    common = findings(search, draws)
    rows: tuple[HypothesisRecord, ...] = common["hypotheses"]
    findings_of_all: tuple[Finding, ...] = common.pop("places")
    common["places"] = tuple(
        replace(each, is_observed=each.place not in baselines.unobserved)
        for each in findings_of_all
        if not each.place.is_common
    )
    return SearchRecord(
        baselines=(
            *sorted(_searched(baselines, rows), key=lambda record: -record.probability),
            *(
                BaselineRecord(rival.name, (), screened.log_evidence, 0.0, 0.0, None)
                for rival, screened in zip(baselines.rivals, rivals, strict=True)
            ),
        ),
        left_out=dict(baselines.left_out),
        present_in=baselines.present_in,
        search_settings=baselines.options,
        geometry=baselines.geometry,
        matched=matched_appendages(draws, rows, baselines, search.hypotheses),
        mass_unit=baselines.study.mass_unit,
        motions=tuple(each for each in findings_of_all if each.place.is_common),
        **common,
    )


def _searched(baselines: Baselines, rows: Sequence[HypothesisRecord]) -> Iterator[BaselineRecord]:
    """The baselines that appendages were hung on."""
    for name in baselines.study.names:
        on_it = [row for row in rows if row.baseline == name]
        (without,) = [row for row in on_it if not row.features]
        yield BaselineRecord(
            name=name,
            classes=baselines.study.stands_for[name],
            log_evidence=without.log_evidence,
            prior_probability=sum(row.prior_probability for row in on_it),
            probability=sum(row.probability for row in on_it),
            mass_scale=baselines.scales[name],
        )
