"""The search for hidden appendages: is there one, where, how heavy, and at which frequency?

On each of several baseline classes it builds hypotheses: no appendage; one appendage of each kind
at each of its places; then one more, as long as the evidence grows. No pairing of modes is assumed:
every hypothesis is scored over all pairings. All are screened, which gives approximate evidences;
those on which the answer rests are sampled.

What an appendage explains is its frequency. Hypotheses with equally many appendages at different
places share what these do to the modes. Draw by draw, the appendage of the lowest frequency is the
first: places may change hands, even between the draws of one hypothesis.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import checked
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.summaries import Quantiles, weighted_quantiles
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.sampling.settings import SamplingSettings
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.structures.geometry import Candidate
from bayes_ssi.studies.appendages.baselines import (
    Baselines,
    choose_baselines,
    frequency_name,
    mass_name,
    tests_with_appendages,
)
from bayes_ssi.studies.appendages.candidates import CRITERIA, AppendagePlace, SearchSettings
from bayes_ssi.studies.appendages.search_result import (
    AppendagesRecord,
    AppendageSummary,
    BaselineRecord,
    MatchedAppendage,
    PlaceOfAppendage,
    PlaceRecord,
    SearchRecord,
)
from bayes_ssi.studies.ranking.study import Study
from bayes_ssi.studies.search.approximate_evidence import Screened, ToScreen, screen_all
from bayes_ssi.studies.search.family import Hypothesis
from bayes_ssi.studies.search.family_search import FamilySearch, search_family
from bayes_ssi.studies.search.search_record import (
    SearchResult,
    averaged_features,
    records_by_probability,
)


class AppendageDraws(NamedTuple):
    """Posterior draws of one appendage, (n,) each; ``mass`` in the structure's unit."""

    mass_ratio: FloatArray
    mass: FloatArray
    frequency_hz: FloatArray
    weights: FloatArray

    def summary(self, place: AppendagePlace) -> AppendageSummary:
        numbers = (self.mass, self.mass_ratio, self.frequency_hz)
        quantiles = (weighted_quantiles(each, self.weights) for each in numbers)
        return AppendageSummary(place, *quantiles)


# Name of a hypothesis → its appendages.
DrawsOfAll = Mapping[str, Mapping[AppendagePlace, AppendageDraws]]


def appendage_draws(
    baselines: Baselines, found: FamilySearch[AppendagePlace]
) -> dict[str, dict[AppendagePlace, AppendageDraws]]:
    draws: dict[str, dict[AppendagePlace, AppendageDraws]] = {}
    for hypothesis in found.hypotheses:
        name = hypothesis.model_class.name
        of_all, scale = found.draws[name], baselines.scales[hypothesis.key.baseline].mass
        of_places = draws[name] = {}
        for place in hypothesis.key.features:
            ratio, frequency = map(of_all.column, (mass_name(place), frequency_name(place)))
            of_places[place] = AppendageDraws(ratio, scale * ratio, frequency, of_all.weights)
    return draws


class RankedDraws(NamedTuple):
    """Draws of the appendage of one rank by frequency, of several hypotheses in turn: (n,) each."""

    hypothesis: NDArray[np.intp]  # numbers of the hypotheses, which do not fall
    place: NDArray[np.intp]  # numbers of the places
    mass: FloatArray
    frequency_hz: FloatArray
    weights: FloatArray
    by_data: FloatArray  # weights under a prior that is uniform in the logarithm of mass

    def where(self, chosen: NDArray[np.bool_]) -> "RankedDraws":
        columns: Iterable[Any] = (column[chosen] for column in self)
        return RankedDraws(*columns)


class Motions(NamedTuple):
    """Motions in the modes of a baseline that the sensors see, at unit modal mass."""

    numbers: NDArray[np.intp]  # (m,), of the modes, from 1
    frequencies_hz: FloatArray  # (m,)
    of_places: Mapping[AppendagePlace, FloatArray]  # place → (m,)
    of_sensors: FloatArray  # (m,), that of the sensor that moves most


def matched_appendages(
    draws: DrawsOfAll,
    rows: Sequence[AppendagesRecord],
    baselines: Baselines,
    hypotheses: Sequence[Hypothesis[AppendagePlace]],
) -> tuple[MatchedAppendage, ...]:
    """The appendages of the most probable number of them, the lowest frequency first."""
    shares: dict[int, float] = {}
    for row in rows:
        n = len(row.appendages)
        shares[n] = shares.get(n, 0.0) + (row.probability if n else 0.0)
    number = max(shares, key=lambda n: shares[n])
    if not shares[number] > 0.0:
        return ()
    chosen = [row for row in rows if len(row.appendages) == number and row.probability > 0.0]
    by_name = {each.model_class.name: each for each in hypotheses}
    best = {row.baseline: by_name[row.name] for row in reversed(chosen)}
    of_baselines = {name: _motions(baselines, each) for name, each in best.items()}
    motions = {i: known for i, row in enumerate(chosen) if (known := of_baselines[row.baseline])}
    scales = [baselines.scales[row.baseline].mass for row in chosen]
    places = list(dict.fromkeys(place for row in chosen for place in draws[row.name]))
    of_ranks = ranked_draws(
        [draws[row.name] for row in chosen],
        [row.probability / shares[number] for row in chosen],
        [baselines.options.prior_of_mass_ratio(scale) for scale in scales],
        places,
    )
    return tuple(matched(each, places, motions) for each in of_ranks)


def ranked_draws(
    draws: Sequence[Mapping[AppendagePlace, AppendageDraws]],
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
        ratios, masses, frequencies, weights = map(np.stack, zip(*appendages.values(), strict=True))
        weights = share * weights
        # The prior density of the logarithm of a mass, which weighs draws in a uniform one's place.
        density = ratios * np.exp(prior.log_density(ratios))
        by_data = np.divide(weights, density, out=np.zeros_like(weights), where=density > 0.0)
        numbers = np.array([places.index(place) for place in appendages])
        order = np.argsort(frequencies, axis=0)
        columns = (masses, frequencies, weights, by_data)
        sorted_columns = (np.take_along_axis(column, order, axis=0) for column in columns)
        blocks.append((np.full_like(order, number), numbers[order], *sorted_columns))
    joined = [np.concatenate(column, axis=1) for column in zip(*blocks, strict=True)]
    return [RankedDraws(*of_rank) for of_rank in zip(*joined, strict=True)]


def matched(
    draws: RankedDraws, places: Sequence[AppendagePlace], motions: Mapping[int, Motions]
) -> MatchedAppendage:
    """One appendage; ``motions`` are those known, by the numbers of their hypotheses."""
    groups = _of_one_frequency(draws)
    shares = [float(group.weights.sum()) for group in groups]
    frequencies = [weighted_quantiles(group.frequency_hz, group.weights) for group in groups]
    mode, effective_mass, effective_ratio = _effective(
        groups[0], frequencies[0][1], places, motions
    )
    return MatchedAppendage(
        frequency_hz=frequencies[0],
        probability=shares[0],
        other_frequencies_hz=tuple(zip(shares[1:], frequencies[1:], strict=True)),
        effective_mass=effective_mass,
        effective_ratio=effective_ratio,
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
    nearest = int(np.abs(first.frequencies_hz - frequency_hz).argmin())
    moved, largest = [], []
    for number, place in zip(group.hypothesis.tolist(), group.place.tolist(), strict=True):
        if nearest >= len(motions[number].of_sensors):
            return 0, None, None
        moved.append(motions[number].of_places[places[place]][nearest])
        largest.append(motions[number].of_sensors[nearest])
    ratios = group.mass * np.array(moved) ** 2
    masses = ratios / np.array(largest) ** 2
    mass, ratio = (weighted_quantiles(each, group.weights) for each in (masses, ratios))
    return int(first.numbers[nearest]), mass, ratio


def _of_one_frequency(draws: RankedDraws) -> list[RankedDraws]:
    """The draws in groups of frequencies that are apart, the most probable group first."""
    order = np.argsort(draws.frequency_hz)
    hz, weights = draws.frequency_hz[order], draws.weights[order]
    least = CRITERIA.share_of_a_group * weights.sum()
    ends, begin = [], 0
    for i in np.flatnonzero(hz[1:] > CRITERIA.apart * hz[:-1]).tolist():
        if min(weights[begin : i + 1].sum(), weights[i + 1 :].sum()) >= least:
            ends.append(float(hz[i]))
            begin = i + 1
    numbers = np.searchsorted(ends, draws.frequency_hz)
    groups = [draws.where(numbers == number) for number in range(len(ends) + 1)]
    return sorted(groups, key=lambda group: -group.weights.sum())


def _places(draws: RankedDraws, places: Sequence[AppendagePlace]) -> tuple[PlaceOfAppendage, ...]:
    """Where an appendage may be, the most probable place first."""
    found = []
    for number in np.unique(draws.place).tolist():
        there = draws.where(draws.place == number)
        if there.weights.sum() > 0.0:
            found.append(
                PlaceOfAppendage(
                    place=places[number],
                    probability=float(there.weights.sum() / draws.weights.sum()),
                    mass=weighted_quantiles(there.mass, there.weights),
                    by_data=float(there.by_data.sum() / draws.by_data.sum()),
                )
            )
    return tuple(sorted(found, key=lambda place: -place.probability))


def _motions(baselines: Baselines, hypothesis: Hypothesis[AppendagePlace]) -> Motions | None:
    """Motions at the means of the parameters of the most probable hypothesis on a baseline."""
    name, model_class = hypothesis.key.baseline, hypothesis.model_class
    mean_values = hypothesis.screened.weights @ model_class.values(hypothesis.screened.z)
    means = dict(zip(model_class.parameter_names, mean_values, strict=True))
    test = tests_with_appendages(baselines[name], baselines.present_in)[0]
    structure, places = test.structure, baselines.features[name]
    at = np.array([[means[parameter.name] for parameter in structure.parameters]])
    moved = structure.place_shapes([end for place in places for end in place.candidate.ends], at)
    if moved is None:
        return None
    modes = structure.modes(at)
    at_sensors = structure.sensor_matrix(test.data.sensors).apply(modes.shapes)[0]
    largest = np.abs(at_sensors).max(axis=0, initial=0.0)
    seen = np.flatnonzero(largest >= CRITERIA.visible * largest.max())
    if not len(seen) or not largest.any():
        return None
    of_places, begin = {}, 0
    for place in places:
        n = len(place.candidate.ends)
        # What hangs between two places is driven by the mean of their motions.
        of_places[place] = moved[begin : begin + n, seen].mean(axis=0)
        begin += n
    return Motions(seen + 1, modes.frequencies_hz[0, seen], of_places, largest[seen])


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
) -> SearchResult[SearchRecord]:
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
    if isinstance(baseline, ModelClass):
        baseline = Study(baseline.name, [baseline])
    chosen = choose_baselines(baseline, baselines, candidates, present_in, search_settings)
    return search_on(chosen, seed, settings or SamplingSettings(), run or Run())


def search_on(
    baselines: Baselines, seed: int, settings: SamplingSettings, run: Run
) -> SearchResult[SearchRecord]:
    with run.working():
        found = search_family(baselines, seed, settings, run)
        rivals = screen_all([ToScreen(rival, None) for rival in baselines.rivals], seed, run)
    return SearchResult(found.ranking, _record(baselines, rivals, found))


def _record(
    baselines: Baselines, rivals: Sequence[Screened], found: FamilySearch[AppendagePlace]
) -> SearchRecord:
    draws = appendage_draws(baselines, found)
    rows = records_by_probability(found, draws, AppendagesRecord)
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
        probability_of_any=sum(each.probability for each in rows if each.appendages),
        places=tuple(
            PlaceRecord(appendage, probability, place not in baselines.unobserved)
            for place, probability, appendage in averaged_features(draws, found.probabilities)
        ),
        geometry=baselines.geometry,
        hypotheses=rows,
        matched=matched_appendages(draws, rows, baselines, found.hypotheses),
        mass_unit=baselines.study.mass_unit,
        **found.findings,
    )


def _searched(baselines: Baselines, rows: Sequence[AppendagesRecord]) -> Iterator[BaselineRecord]:
    """The baselines that appendages were hung on."""
    for name in baselines.study.names:
        on_it = [row for row in rows if row.baseline == name]
        (without,) = [row for row in on_it if not row.appendages]
        yield BaselineRecord(
            name=name,
            classes=baselines.study.stands_for[name],
            log_evidence=without.log_evidence,
            prior_probability=sum(row.prior_probability for row in on_it),
            probability=sum(row.probability for row in on_it),
            mass_scale=baselines.scales[name],
        )
