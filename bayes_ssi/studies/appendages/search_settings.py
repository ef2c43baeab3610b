"""What an appendage may be: the settings of a search, and what counts as seen, near or apart."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bayes_ssi.parameters.families import LogUniform
from bayes_ssi.parameters.prior import Prior


@dataclass(frozen=True)
class SearchSettings:
    """What an appendage may be, and how many there may be.

    What modes determine is not a mass but its effective mass, the mass times the square of the
    motion of its place in the mode beside which it vibrates. The default prior is uniform in the
    logarithm of both, so that within its range it prefers no place to any other.

    Attributes:
        mass_ratio: prior of the vibrating mass over the mean floor mass, or the median modal
            mass where there are no floors
            (:func:`~bayes_ssi.studies.appendages.hypotheses.scale_of`).
        mass: instead of ``mass_ratio``, the lightest and the heaviest vibrating mass, in the
            structure's unit; log-uniform between them.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights: prior weights of no appendage, of one, of two, ...; the weight of a
            number is shared evenly by all ways to place that many. Its length limits the search.
        branches: number of best hypotheses that are extended by one more appendage.
        most_unsampled: as many hypotheses are sampled as it takes until sampling the others, whose
            evidences are approximations, would change no probability by more than this. All are
            where it is zero.
        most_sampled: largest number of hypotheses that are sampled, the most probable ones, each
            with a probability above ``most_unsampled``; if None, twelve, or all where
            ``most_unsampled`` is zero; but six of finite-element models in a reduced basis, each of
            which takes some 20 full solutions.

    Raises:
        ValueError: there are fewer than two weights, one is not positive, there is no branch, none
            is to be sampled, or ``most_unsampled`` is not a probability.
        TypeError: a prior is not a prior distribution.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogUniform(0.001, 0.5))
    mass: tuple[float, float] | None = None
    frequency: Prior | None = None
    number_weights: tuple[float, ...] = (1.0, 1.0, 0.2)
    branches: int = 2
    most_unsampled: float = 0.01
    most_sampled: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "number_weights", tuple(self.number_weights))
        if len(self.number_weights) < 2 or not all(
            0.0 < weight < math.inf for weight in self.number_weights
        ):
            raise ValueError(
                "SearchSettings: number_weights must be two or more positive numbers, got "
                f"{self.number_weights!r}"
            )
        if self.mass is not None:
            lightest, heaviest = self.mass
            LogUniform(lightest, heaviest)  # which refuses what is no range
            object.__setattr__(self, "mass", (lightest, heaviest))
        if self.branches < 1:
            raise ValueError(f"SearchSettings: branches must be at least 1, got {self.branches!r}")
        if not 0.0 <= self.most_unsampled < 1.0:
            raise ValueError(
                "SearchSettings: most_unsampled must be at least 0 and below 1, got "
                f"{self.most_unsampled!r}"
            )
        if self.most_sampled is not None and self.most_sampled < 1:
            raise ValueError(
                f"SearchSettings: most_sampled must be at least 1, got {self.most_sampled!r}"
            )
        for name in ("mass_ratio", "frequency"):
            prior = getattr(self, name)
            if not isinstance(prior, Prior) and not (name == "frequency" and prior is None):
                raise TypeError(f"SearchSettings: {name} must be a prior, got {prior!r}")

    def prior_of_mass_ratio(self, scale: float) -> Prior:
        """The prior of the vibrating mass over ``scale``, a mass in the structure's unit."""
        if self.mass is None:
            return self.mass_ratio
        return LogUniform(self.mass[0] / scale, self.mass[1] / scale)


@dataclass(frozen=True)
class SearchCriteria:
    """What a search takes for seen, near or apart, and for too many."""

    # A mode moves the sensors by at least this share of the one that moves them most, at unit modal
    # mass.
    visible: float = 0.05
    # A place moves in a mode by this share of what the sensors do; less, and an appendage of a
    # tenth of the modal mass moves its frequencies apart by less than 0.3 %.
    takes_part: float = 0.01
    least_in_band: float = 0.01  # share of the prior of an appendage's frequency
    apart: float = 1.1  # frequencies with nothing between them over this factor are two answers,
    share_of_a_group: float = 0.05  # if each has this share of the probability
    # Modes closer than this, relative to their frequencies, may be one that is split.
    near: float = 0.1
    most_places: int = 30  # more are not screened in a few seconds, for a warning
    credible: float = 0.95  # share of the probability of appendages that the named places hold
    # Sampling takes as long as screening five hypotheses; with more, errors of a tenth of a nat,
    # which are independent, change sums little.
    most_sampled: int = 12
    # Baselines included, where each takes some 20 full solutions of a finite-element model.
    most_with_full_solutions: int = 6


CRITERIA = SearchCriteria()
