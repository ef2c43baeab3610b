"""Places of change: a parameter, several together, or all of them in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from bayes_ssi.foundations.choices import require_known
from bayes_ssi.parameters.families import TruncatedNormal
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.changes.change_settings import ChangeSettings


@dataclass(frozen=True)
class ChangePlace:
    """Parameters of a class of which a change at one place takes a share.

    Attributes:
        name: unique among the places.
        parameters: their names.
        is_joined: whether all of them lose one share; else each of them loses one of its own.
        is_common: whether this is a common factor of all places, which is no change.
        height: in storeys above the ground; None where it is not known.
    """

    name: str
    parameters: tuple[str, ...]
    is_joined: bool = True
    is_common: bool = False
    height: float | None = None

    # How drawings show it: in its storey.
    title, marker, is_outside = "change", "s", False
    direction = coordinates = None

    @property
    def description(self) -> str:
        return "a loss in common" if self.is_common else f"a loss in {self.name}"

    def losses(self, settings: ChangeSettings) -> Iterator[tuple[Parameter, tuple[str, ...]]]:
        """Every loss, and the names of the parameters of which it takes a share."""
        if self.is_common:
            assert settings.common_sd is not None
            prior = TruncatedNormal(0.0, settings.common_sd, -1.0, 1.0)
            yield Parameter("common loss", prior), self.parameters
        elif self.is_joined:
            yield Parameter(f"loss, {self.name}", settings.loss), self.parameters
        else:
            for name in self.parameters:
                yield Parameter(f"loss, {name}", settings.loss), (name,)


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
    alone = [name for name in parameters if name not in named]
    made = [ChangePlace(*group) for group in groups if group[1]]
    made += [ChangePlace(name, (name,)) for name in alone]
    for names, what in ((named, "parameter"), ([place.name for place in made], "place")):
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{where}: {what} {name!r} is named twice")
    if not made:
        raise ValueError(f"{where}: every parameter is left out; leave one in")
    return tuple(replace(place, height=_height(place, structure)) for place in made)


def _height(place: ChangePlace, structure: Structure) -> float | None:
    """The mean of those of its parameters."""
    heights = [structure.height_of(name) for name in place.parameters]
    known = [height for height in heights if height is not None]
    return sum(known) / len(known) if known else None
