"""What a change may be, and where: a parameter, several together, or all of them in common."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.parameters.families import NearOne, Uniform
from bayes_ssi.parameters.prior import Prior
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.search.family import SearchLimits


@dataclass(frozen=True)
class ChangeSettings(SearchLimits):
    """What a change may be, and in how many places there may be one.

    Attributes:
        loss: prior of the share of a parameter that a change takes away; a gain where negative.
        common_sd: standard deviation of a share that all groups lose or gain in common, as by
            temperature or moisture, which is no change of the structure; not considered if None.
        covariate: name of a test → what the common share is proportional to, such as degrees; then
            ``common_sd`` is that of the share at the test that differs most from those before.
        shared: prior of the share of prediction errors that the tests have in common, where the
            class gives none; errors of different tests are independent if None.
        number_weights, branches, most_unsampled, most_sampled: how many changes, and how far the
            search goes, as in :class:`~bayes_ssi.studies.search.family.SearchLimits`.

    Raises:
        ValueError: as :class:`~bayes_ssi.studies.search.family.SearchLimits`; a loss could leave a
            negative stiffness; or the common share's standard deviation is not usable.
        TypeError: a prior is not a prior distribution.
    """

    loss: Prior = field(default_factory=lambda: Uniform(0.0, 1.0))
    common_sd: float | None = None
    covariate: Mapping[str, float] | None = None
    # What is not shared has any order of size, down to a hundredth of an error.
    shared: Prior | None = field(default_factory=lambda: NearOne(1e-4))

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require_priors("loss", "shared", optional=("shared",))
        if (highest := self.loss.support[1]) > 1.0:
            raise ValueError(
                f"ChangeSettings: a loss of {highest:g} would leave a negative stiffness; it must "
                f"be at most 1, got {self.loss!r}"
            )
        if self.common_sd is not None and not 0.0 < self.common_sd < 1.0:
            raise ValueError(
                f"ChangeSettings: common_sd must be between 0 and 1, got {self.common_sd!r}"
            )
        if self.covariate is not None and self.common_sd is None:
            raise ValueError("ChangeSettings: a covariate needs common_sd, which is not given")


@dataclass(frozen=True)
class ChangePlace:
    """Parameters of a class of which a change at one place takes a share."""

    name: str  # unique among the places
    parameters: tuple[str, ...]
    is_joined: bool = True  # whether all of them lose one share; else each loses one of its own
    is_common: bool = False  # whether this is a common factor of all places, which is no change
    height: float | None = None  # in storeys above the ground; None where it is not known

    # How drawings show it: in its storey.
    title, marker, is_outside = "change", "s", False
    direction = coordinates = None

    @property
    def description(self) -> str:
        return "a loss in common" if self.is_common else f"a loss in {self.name}"

    @property
    def losses(self) -> dict[str, tuple[str, ...]]:
        """Name of every loss → the parameters of which it takes a share."""
        if self.is_common:
            return {"common loss": self.parameters}
        if self.is_joined:
            return {f"loss, {self.name}": self.parameters}
        return {f"loss, {name}": (name,) for name in self.parameters}


def places_of(
    parameters: Sequence[str],
    joined: Mapping[str, Sequence[str]],
    places: Mapping[str, Sequence[str]],
    left_out: Sequence[str],
    structure: Structure,
    where: str,
) -> tuple[ChangePlace, ...]:
    """The places of change of a class: those that are given, then every other parameter alone.

    Args:
        parameters: names of those that can change.
        joined: name of a place → parameters that lose one share.
        places: name of a place → parameters of which each loses a share of its own.
        left_out: parameters that do not change.
        structure: which says how high parameters are.
        where: begins messages.

    Raises:
        ValueError: a parameter is unknown or named twice, two places have one name, or none is
            left.
    """
    groups = [(name, tuple(names), True) for name, names in joined.items()]
    groups += [(name, tuple(names), False) for name, names in places.items()]
    named = [*left_out, *(one for _, names, _ in groups for one in names)]
    require_known(f"{where}: no parameter", named, parameters)
    groups += [(name, (name,), True) for name in parameters if name not in named]
    groups = [group for group in groups if group[1]]
    for all_of, what in ((named, "parameter"), ([name for name, *_ in groups], "place")):
        for name in all_of:
            if all_of.count(name) > 1:
                raise ValueError(f"{where}: {what} {name!r} is named twice")
    if not groups:
        raise ValueError(f"{where}: every parameter is left out; leave one in")
    made = []
    for name, names, is_joined in groups:
        heights = [at for each in names if (at := structure.height_of(each)) is not None]
        height = sum(heights) / len(heights) if heights else None
        made.append(ChangePlace(name, names, is_joined, height=height))
    return tuple(made)
