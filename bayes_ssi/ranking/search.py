"""The search for hidden appendages: does one hang in the data, where, how heavy, tuned to what?

From a baseline model class it builds hypotheses: no appendage; a pendulum on each floor; an
infill out of its plane between each two neighbouring floors; then one more on the best of these,
as long as the evidence grows. Which identified mode is which is never assumed: every hypothesis
is scored over all pairings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bayes_ssi.evaluation.workers import Workers, as_workers
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.parameters import Parameter
from bayes_ssi.priors import LogNormal, LogUniform, Prior, prior_from_dict
from bayes_ssi.ranking.averages import AveragedParameter, averaged_parameters
from bayes_ssi.ranking.checkpoint import Checkpoint
from bayes_ssi.ranking.class_sampling import sample_all
from bayes_ssi.ranking.comparison import compare
from bayes_ssi.ranking.study import Ranking, Study
from bayes_ssi.sampling.sampled import SamplingSettings
from bayes_ssi.structures.elements import Element, OutOfPlaneInfill, Pendulum
from bayes_ssi.structures.lumped import LumpedStructure
from bayes_ssi.updating.posterior import Posterior

__all__ = [
    "AppendageSearch",
    "AppendageSummary",
    "AveragedBesideNaive",
    "Place",
    "SearchSettings",
    "hypothesis",
    "mean_mass",
    "places_of",
    "search",
    "search_record",
]

NO_APPENDAGE = "no appendage"
AND = " + "


@dataclass(frozen=True)
class Place:
    """Where an appendage may hang.

    Attributes:
        kind: "pendulum" on one floor, or "infill" between two.
        floors: the floor, or the two, 0 being the ground.
    """

    kind: str
    floors: tuple[int, ...]

    @property
    def name(self) -> str:
        return f"{self.kind} {'-'.join(map(str, self.floors))}"


@dataclass(frozen=True)
class SearchSettings:
    """What an appendage may be, and how many there may be.

    The defaults suit buildings: parapets, chimneys, tanks and infills that move out of their
    plane weigh mostly between 1 and 20 % of a floor, and are tuned to anything in the band.

    Attributes:
        mass_ratio: prior of the mass that vibrates, over the mean floor mass.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights: prior weights of no appendage, of one, of two, ...; the weight of a
            number is shared evenly by all ways to place so many. Its length bounds the search.
        branches: how many of the best hypotheses are extended by one more appendage.

    Raises:
        ValueError: fewer than two weights, one that is not positive, or no branch.
        TypeError: a prior is none.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogNormal(0.05, 1.0))
    frequency: Prior | None = None
    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "number_weights", tuple(self.number_weights))
        if len(self.number_weights) < 2 or not all(
            0.0 < weight < math.inf for weight in self.number_weights
        ):
            raise ValueError(
                "SearchSettings: number_weights must be two or more positive numbers, got "
                f"{self.number_weights!r}"
            )
        if self.branches < 1:
            raise ValueError(f"SearchSettings: branches must be at least 1, got {self.branches!r}")
        for name in ("mass_ratio", "frequency"):
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name == "frequency" and prior is None):
                raise TypeError(f"SearchSettings: {name} must be a prior, got {prior!r}")

    def as_dict(self) -> dict[str, Any]:
        """The settings, for a JSON record."""
        return {
            "mass_ratio": self.mass_ratio.as_dict(),
            "frequency": None if self.frequency is None else self.frequency.as_dict(),
            "number_weights": list(self.number_weights),
            "branches": self.branches,
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> SearchSettings:
        """The settings of a record that :meth:`as_dict` made; KeyError where it lacks one."""
        frequency = record["frequency"]
        return cls(
            mass_ratio=prior_from_dict(record["mass_ratio"]),
            frequency=None if frequency is None else prior_from_dict(frequency),
            number_weights=tuple(record["number_weights"]),
            branches=record["branches"],
        )


@dataclass(frozen=True)
class AppendageSummary:
    """One appendage of one hypothesis, with medians and 90 % intervals.

    Attributes:
        place: where it hangs.
        mass: of what vibrates, in the structure's unit.
        mass_ratio: the same over the mean floor mass.
        frequency_hz: natural frequency on fixed floors.
    """

    place: Place
    mass: tuple[float, float, float]
    mass_ratio: tuple[float, float, float]
    frequency_hz: tuple[float, float, float]


@dataclass(frozen=True)
class AveragedBesideNaive(AveragedParameter):
    """A parameter of the baseline, averaged over all hypotheses by their probability.

    Attributes:
        naive_mean, naive_sd: if no appendage is thought of.
    """

    naive_mean: float
    naive_sd: float


@dataclass(frozen=True, eq=False)
class AppendageSearch:
    """What a search found.

    Attributes:
        ranking: of all hypotheses that were sampled.
        places: hypothesis → the places of its appendages.
        candidates: all places that were considered.
        mass_scale: the mean floor mass, in the structure's unit.
        baseline: name of the model class that the hypotheses were built on.
        search_settings: what an appendage may be.
    """

    ranking: Ranking
    places: Mapping[str, tuple[Place, ...]]
    candidates: tuple[Place, ...]
    mass_scale: float
    baseline: str
    search_settings: SearchSettings

    @property
    def probability_of_any(self) -> float:
        """That there is at least one appendage."""
        return sum(
            row.probability for row in self.ranking.comparison.classes if self.places[row.name]
        )

    @property
    def place_probabilities(self) -> dict[Place, float]:
        """Every candidate place → the probability that an appendage hangs there."""
        found = dict.fromkeys(self.candidates, 0.0)
        for row in self.ranking.comparison.classes:
            for place in set(self.places[row.name]):
                found[place] += row.probability
        return found

    def may_have(self, name: str) -> bool:
        """Whether a hypothesis of this search is called so, with however many appendages."""
        own = {place.name for place in self.candidates}
        return name == NO_APPENDAGE or own.issuperset(name.split(AND))

    def appendages(self, name: str) -> tuple[AppendageSummary, ...]:
        """The appendages of one hypothesis."""
        posterior = next(p for p in self.ranking.posteriors if p.name == name)
        column = {parameter: i for i, parameter in enumerate(posterior.parameter_names)}

        def quantiles(parameter: str, scale: float) -> tuple[float, float, float]:
            values = scale * posterior.values[:, column[parameter]]
            low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
            return float(low), float(middle), float(high)

        return tuple(
            AppendageSummary(
                place,
                quantiles(_mass_name(place), self.mass_scale),
                quantiles(_mass_name(place), 1.0),
                quantiles(_frequency_name(place), 1.0),
            )
            for place in self.places[name]
        )

    @property
    def averaged_parameters(self) -> tuple[AveragedBesideNaive, ...]:
        """The baseline's parameters averaged over the hypotheses, beside the naive fit."""
        naive = next(p for p in self.ranking.posteriors if not self.places[p.name])
        averaged = averaged_parameters(self.ranking.posteriors, self.ranking.comparison)
        by_name = {row.name: row for row in averaged}
        return tuple(
            AveragedBesideNaive(
                **asdict(by_name[name]),
                naive_mean=float(naive.values[:, i].mean()),
                naive_sd=float(naive.values[:, i].std()),
            )
            for i, name in enumerate(naive.parameter_names)
        )


def places_of(structure: LumpedStructure) -> tuple[Place, ...]:
    """Every floor for a pendulum, and every storey for an infill."""
    floors = range(1, len(structure.main_degrees_of_freedom()) + 1)
    return (
        *(Place("pendulum", (floor,)) for floor in floors),
        *(Place("infill", (floor - 1, floor)) for floor in floors),
    )


def search(
    baseline: ModelClass,
    search_settings: SearchSettings | None = None,
    seed: int = 0,
    settings: SamplingSettings | None = None,
    progress: Callable[[str, str, float], None] | None = None,
    *,
    workers: int | Executor | Workers | None = None,
    checkpoint: str | Path | Checkpoint | None = None,
) -> AppendageSearch:
    """Search for hidden appendages on a baseline structure.

    Args:
        baseline: its structure has floors in a row; its pairing is not used.
        search_settings: what an appendage may be.
        seed: a hypothesis's result follows from it and the hypothesis's name.
        settings: how precisely to sample.
        progress: called with the name of the hypothesis, of the step, and the share of it done.
        workers: where whole hypotheses are sampled; here, one after another, if None.
        checkpoint: as for :func:`~bayes_ssi.ranking.study.rank`.

    Raises:
        ValueError: the structure has no floors to hang an appendage on, there are several
            configurations, or a hypothesis cannot be sampled.
    """
    options = search_settings or SearchSettings()
    settings = settings or SamplingSettings()
    structure = _with_floors(baseline)
    candidates = places_of(structure)
    build = partial(hypothesis, baseline, search_settings=options)
    found: dict[tuple[Place, ...], Posterior] = {}
    classes: dict[tuple[Place, ...], ModelClass] = {}
    with as_workers(workers) as pool:
        level: list[tuple[Place, ...]] = [(), *((place,) for place in candidates)]
        while level:
            classes.update({places: build(places) for places in level})
            sampled = sample_all(
                [classes[places] for places in level], seed, settings, progress, pool, checkpoint
            )
            found.update(zip(level, sampled, strict=True))
            level = _next_level(found, candidates, options)
    weights = {
        classes[places].name: _prior_weight(len(places), len(candidates), options)
        for places in found
    }
    study = Study(
        f"Appendages hidden in {baseline.name!r}", list(classes.values()), prior_weights=weights
    )
    posteriors = tuple(found.values())
    ranking = Ranking(study, posteriors, compare(posteriors, weights), seed, settings)
    return AppendageSearch(
        ranking,
        {classes[p].name: p for p in found},
        candidates,
        mean_mass(structure),
        baseline.name,
        options,
    )


def search_record(found: AppendageSearch) -> dict[str, Any]:
    """What a search found, for a JSON record."""
    return {
        "baseline": found.baseline,
        "search_settings": found.search_settings.as_dict(),
        "mass_scale": found.mass_scale,
        "probability_of_any": found.probability_of_any,
        "places": [
            {"kind": place.kind, "floors": list(place.floors), "probability": probability}
            for place, probability in found.place_probabilities.items()
        ],
        "hypotheses": [
            {
                "name": row.name,
                "probability": row.probability,
                "appendages": [asdict(each) for each in found.appendages(row.name)],
            }
            for row in found.ranking.comparison.classes
        ],
        "averaged_parameters": [asdict(row) for row in found.averaged_parameters],
    }


def _next_level(
    found: Mapping[tuple[Place, ...], Posterior],
    candidates: Sequence[Place],
    options: SearchSettings,
) -> list[tuple[Place, ...]]:
    """Hypotheses with one appendage more than the best so far; none if more do not help."""

    def log_evidence(places: tuple[Place, ...]) -> float:
        return found[places].evidence.log_evidence

    most = max(len(places) for places in found)
    if most + 1 == len(options.number_weights):
        return []
    top = [places for places in found if len(places) == most]
    fewer = [places for places in found if len(places) == most - 1]
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
    """A number's weight, shared by all ways to place so many appendages."""
    return options.number_weights[number] / math.comb(n_candidates, number)


def hypothesis(
    baseline: ModelClass,
    places: Sequence[Place],
    search_settings: SearchSettings | None = None,
) -> ModelClass:
    """The baseline with an appendage at each of ``places``, scored over all pairings.

    Raises:
        ValueError: its structure has no floors to hang an appendage on.
    """
    options = search_settings or SearchSettings()
    structure = _with_floors(baseline)
    scale = mean_mass(structure)
    frequency = options.frequency or _default_frequency(baseline)
    for place in places:
        ratio = Parameter(_mass_name(place), options.mass_ratio)
        tuned = Parameter(_frequency_name(place), frequency, unit="Hz")
        structure = structure.with_element(_element(place, ratio, tuned, scale))
    name = AND.join(place.name for place in places) or NO_APPENDAGE
    return baseline.with_any_pairing(baseline.name).with_structure(structure, name)


def _with_floors(baseline: ModelClass) -> LumpedStructure:
    if len(baseline.configurations) > 1:
        raise ValueError(
            f"model class {baseline.name!r}: a search needs a class with one configuration, got "
            f"{len(baseline.configurations)}: {', '.join(map(repr, baseline.configuration_names))}"
        )
    structure = baseline.structure
    if not isinstance(structure, LumpedStructure):
        raise ValueError(
            f"model class {baseline.name!r}: a search needs a structure with floors, such as a "
            f"ShearBuilding, got {type(structure).__name__}"
        )
    return structure


def _element(place: Place, ratio: Parameter, tuned: Parameter, mass_scale: float) -> Element:
    label = f"appendage {place.name}"
    if place.kind == "pendulum":
        return Pendulum(on=place.floors[0], mass=mass_scale * ratio, frequency=tuned, label=label)
    low, high = place.floors
    # Half of an infill vibrates.
    return OutOfPlaneInfill(
        between=(low, high), mass=2.0 * mass_scale * ratio, frequency=tuned, label=label
    )


def _default_frequency(baseline: ModelClass) -> Prior:
    lowest = min(mode.frequency_hz for mode in baseline.data.modes)
    return LogUniform(0.5 * lowest, baseline.data.band_hz[1])


def mean_mass(structure: LumpedStructure) -> float:
    """The mean mass of a floor, at the prior medians, in the structure's unit."""
    masses = [mass.mass.median for mass in structure.main_masses()]
    return sum(masses) / len(structure.main_degrees_of_freedom())


def _mass_name(place: Place) -> str:
    return f"mass ratio, {place.name}"


def _frequency_name(place: Place) -> str:
    return f"frequency, {place.name}"
