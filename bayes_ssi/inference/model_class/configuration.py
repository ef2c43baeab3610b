"""A configuration: one test of a structure in a known state, and its pairing of modes."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

from bayes_ssi.foundations.argument_types import listed_choices, repeated, require, require_known
from bayes_ssi.foundations.text_files import require_name
from bayes_ssi.inference.likelihood.any_pairing import AnyPairing
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import check_pairing
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.structure import Structure

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Configuration:
    """One test: the structure in its state at the time, and the modes identified in it.

    A structure is often tested several times with known changes in between: bare, with masses
    added, with an appendage on its roof. Use the same Parameter in the structures of all
    configurations for what does not change.

    Attributes:
        name: unique in a model class; empty only where there is one configuration.
        structure: the structural model in this state; its parameters carry their priors.
        data: the modes identified in this test.
        pairing: label of an identified mode → number of the model mode that it is, from 1.
            Identified modes that are left out count as spurious, model modes that are left out
            as not identified. Or "any": the likelihood is summed over all pairings, and which
            mode is which is inferred.

    Raises:
        ValueError: a sensor is not on the structure, the pairing is not valid, or the name is
            not one that a file could hold. The message begins with the configuration's name.
        TypeError: a field has the wrong type.
    """

    name: str
    structure: Structure
    data: ModalData
    pairing: Mapping[str, int] | Literal["any"] = field(kw_only=True)

    def __post_init__(self) -> None:
        if self.name != "":
            require_name(self.name, "Configuration: name")
        try:
            require(self.structure, Structure, "structure")
            require(self.data, ModalData, "data")
            of_data = f"data ({self.data.source}): " if self.data.source else ""
            self.structure.sensor_matrix(self.data.sensors, f"{of_data}sensor")
            if self.pairing != "any":
                check_pairing(self.pairing, self.data, self.structure.n_modes)
                object.__setattr__(self, "pairing", {k: int(i) for k, i in self.pairing.items()})
        except (TypeError, ValueError) as error:
            if not self.name:
                raise
            raise type(error)(f"configuration {self.name!r}: {error}") from None

    def likelihood(self, error: ErrorModel, identification: IdentificationModel) -> ModalLikelihood:
        """The likelihood of this test's modes, given prediction errors and identification model."""
        parts = (self.structure, self.data, error, identification)
        if self.pairing == "any":
            return AnyPairing(*parts, pairing={})
        return ModalLikelihood(*parts, self.pairing)


def configurations_of(
    given: Sequence[Configuration] | None, own: Mapping[str, Any]
) -> tuple[Configuration, ...]:
    """The given configurations with ``own`` fields replaced, or one made of the ``own`` fields."""
    if given is None:
        missing = [name for name in ("structure", "data", "pairing") if name not in own]
        if missing:
            raise TypeError(f"no {missing[0]}; give structure, data and pairing, or configurations")
        return (Configuration("", **own),)
    if not given:
        raise ValueError("configurations is empty; give one or more")
    for each in given:
        if not isinstance(each, Configuration):
            raise TypeError(f"configurations must be Configurations, got {each!r}")
    names = [each.name for each in given]
    if twice := repeated(names):
        raise ValueError(f"two configurations are named {twice[0]!r}")
    if len(given) > 1 and "" in names:
        raise ValueError("a configuration has no name; where there are several, each needs one")
    return tuple(replace(each, **own) if own else each for each in given)


def modes_with_shape(
    data: ModalData, pairing: Mapping[str, int] | Literal["any"], n_modes: int
) -> list[int]:
    """The model modes, counted from 0, whose shapes the likelihood compares with the data's.

    And those next to them, with which they may turn together.
    """
    scored = [mode.label for mode in data.modes if mode.scored_shape is not None]
    if pairing == "any":
        return list(range(n_modes)) if scored else []
    own = [pairing[label] - 1 for label in scored if label in pairing]
    return sorted({i for mode in own for i in (mode - 1, mode, mode + 1) if 0 <= i < n_modes})


def joint_digest(tests: Mapping[str, ModalData]) -> str:
    """Digest of the data of all configurations, by name, whose density an evidence is."""
    if list(tests) == [""]:
        return tests[""].digest
    digests = sorted((name, data.digest) for name, data in tests.items())
    return hashlib.sha256(json.dumps(digests).encode()).hexdigest()[:16]


def failed_data_checks(tests: Mapping[str, ModalData]) -> tuple[str, ...]:
    """Failed checks of the data of all configurations, with their names, a sentence each."""
    return tuple(
        label_in(name, check) for name, data in tests.items() for check in data.all_failed_checks
    )


def label_in(configuration: str, label: str) -> str:
    """A mode's name that is unique among those of several configurations."""
    return f"{configuration}: {label}" if configuration else label


def choose_configuration(items: Mapping[str, T], name: str | None, owner: str) -> T:
    """The item of one configuration, or the only item if no name is given."""
    if name is None and len(items) == 1:
        return next(iter(items.values()))
    if name is None:
        raise ValueError(
            f"{owner} has {len(items)} configurations; choose one of {listed_choices(items)}"
        )
    if list(items) == [""] and name:
        raise ValueError(f"{owner} has one configuration, without a name; got {name!r}")
    require_known(f"{owner} has no configuration", [name], items)
    return items[name]
