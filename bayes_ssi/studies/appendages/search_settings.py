"""What an appendage may be: the settings of a search, and what counts as seen, near or apart."""

from dataclasses import dataclass, field

from bayes_ssi.parameters.families import LogUniform
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.studies.search.family import SearchLimits


@dataclass(frozen=True)
class SearchSettings(SearchLimits):
    """What an appendage may be, and how many there may be.

    What modes determine is not a mass but its effective mass, the mass times the square of the
    motion of its place in the mode beside which it vibrates. The default prior is uniform in the
    logarithm of both, so that within its range it prefers no place to any other.

    Attributes:
        mass_ratio: prior of the vibrating mass over the mean floor mass, or the median modal
            mass where there are no floors
            (:func:`~bayes_ssi.studies.appendages.baselines.scale_of`).
        mass: instead of ``mass_ratio``, the lightest and the heaviest vibrating mass, in the
            structure's unit; log-uniform between them.
        frequency: prior of the appendage's natural frequency in Hz; if None, log-uniform from
            half the lowest identified frequency to the band's upper limit.
        number_weights, branches, most_unsampled, most_sampled: how many appendages, and how far the
            search goes, as in :class:`~bayes_ssi.studies.search.family.SearchLimits`.

    Raises:
        ValueError: as :class:`~bayes_ssi.studies.search.family.SearchLimits`, or a mass is not
            usable.
        TypeError: a prior is not a prior distribution.
    """

    mass_ratio: Prior = field(default_factory=lambda: LogUniform(0.001, 0.5))
    mass: tuple[float, float] | None = None
    frequency: Prior | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None:
            lightest, heaviest = self.mass
            LogUniform(lightest, heaviest)  # which refuses what is no range
            object.__setattr__(self, "mass", (lightest, heaviest))
        self._require_priors("mass_ratio", "frequency", optional=("frequency",))

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


CRITERIA = SearchCriteria()
