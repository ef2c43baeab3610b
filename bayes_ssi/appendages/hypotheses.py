"""Hypotheses of a search: a building with appendages on its floors and in its storeys."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from bayes_ssi.appendages.places import KINDS, AppendagePlace
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.parameters import Parameter
from bayes_ssi.priors.families import LogNormal, LogUniform
from bayes_ssi.priors.prior import Prior
from bayes_ssi.structures.lumped import LumpedStructure

NO_APPENDAGE = "no appendage"
# Of the prior of an appendage's frequency, at least one draw in a hundred lies in the band.
LEAST_IN_BAND = 0.01


@dataclass(frozen=True)
class SearchSettings:
    """What an appendage may be, and how many there may be.

    The defaults suit buildings: parapets, chimneys, tanks and infills that move out of their
    plane mostly weigh between 1 and 20 % of a floor, and may have any frequency in the band.

    Attributes:
        mass_ratio: prior of the vibrating mass over the mean floor mass.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights: prior weights of no appendage, of one, of two, ...; the weight of a
            number is shared evenly by all ways to place that many. Its length limits the search.
        branches: number of best hypotheses that are extended by one more appendage.
        most_unsampled: largest probability of all hypotheses together whose evidences are
            approximations; the others are sampled. All are where it is zero.

    Raises:
        ValueError: there are fewer than two weights, one is not positive, there is no branch, or
            ``most_unsampled`` is not a probability.
        TypeError: a prior is not a prior distribution.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogNormal(0.05, 1.0))
    frequency: Prior | None = None
    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2
    most_unsampled: float = 0.01

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
        if not 0.0 <= self.most_unsampled < 1.0:
            raise ValueError(
                "SearchSettings: most_unsampled must be at least 0 and below 1, got "
                f"{self.most_unsampled!r}"
            )
        for name in ("mass_ratio", "frequency"):
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name == "frequency" and prior is None):
                raise TypeError(f"SearchSettings: {name} must be a prior, got {prior!r}")


def places_of(structure: LumpedStructure) -> tuple[AppendagePlace, ...]:
    """Every place of a structure with floors, for every kind of appendage."""
    n_floors = len(structure.main_degrees_of_freedom())
    return tuple(place for kind in KINDS for place in kind.all_of(n_floors))


def hypothesis(
    baseline: ModelClass,
    places: Sequence[AppendagePlace],
    search_settings: SearchSettings | None = None,
    name: str | None = None,
) -> ModelClass:
    """The baseline with an appendage at each of ``places``, scored over all pairings.

    Args:
        baseline: the class that has none of these appendages.
        places: where they are.
        search_settings: what an appendage may be.
        name: of the hypothesis; that of the places if None.

    Raises:
        ValueError: its structure has no floors, or lacks some of these.
    """
    options = search_settings or SearchSettings()
    structure = structure_with_floors(baseline)
    scale = mean_mass(structure)
    prior = _frequency_prior(baseline, options)
    for place in places:
        ratio = Parameter(mass_name(place), options.mass_ratio)
        frequency = Parameter(frequency_name(place), prior, unit="Hz")
        structure = structure.with_element(place.element(scale * ratio, frequency))
    own_name = name or name_of(places)
    return baseline.with_any_pairing(baseline.name).with_structure(structure, own_name)


def name_of(places: Sequence[AppendagePlace]) -> str:
    """What a hypothesis with these appendages is called, where there is one baseline."""
    return " + ".join(place.name for place in places) or NO_APPENDAGE


def structure_with_floors(baseline: ModelClass) -> LumpedStructure:
    """The structure of a class, if appendages can be hung on it.

    Raises:
        ValueError: it has no floors, or there are several configurations.
    """
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


def _frequency_prior(baseline: ModelClass, options: SearchSettings) -> Prior:
    """The prior of an appendage's frequency.

    Raises:
        ValueError: it lies outside the band, in which modes were searched for.
    """
    low, high = baseline.data.band_hz
    prior = options.frequency
    if prior is None:
        lowest = min(mode.frequency_hz for mode in baseline.data.modes)
        return LogUniform(0.5 * lowest, high)
    if prior.probability_below(high) - prior.probability_below(low) < LEAST_IN_BAND:
        raise ValueError(
            f"model class {baseline.name!r}: an appendage's frequency, {prior!r} Hz, lies outside "
            f"the band {low:g} to {high:g} Hz in which modes were identified"
        )
    return prior


def mean_mass(structure: LumpedStructure) -> float:
    """The mean mass of a floor, at the prior medians, in the structure's unit."""
    masses = [mass.mass.median for mass in structure.main_masses()]
    return sum(masses) / len(structure.main_degrees_of_freedom())


def mass_name(place: AppendagePlace) -> str:
    """Name of the parameter for the vibrating mass over the mean floor mass."""
    return f"mass ratio, {place.name}"


def frequency_name(place: AppendagePlace) -> str:
    """Name of the parameter for the appendage's frequency."""
    return f"frequency, {place.name}"
