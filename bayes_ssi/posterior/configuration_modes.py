"""The model's modes of each configuration after sampling, and their pairing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayes_ssi.arrays import FloatArray
from bayes_ssi.identification.any_pairing import AnyPairing
from bayes_ssi.identification.inferred_pairing import InferredPairing, infer_pairing
from bayes_ssi.model_class.model_class import ModelClass
from bayes_ssi.posterior.updated_modes import UpdatedModes, updated_modes

__all__ = ["ConfigurationModes", "configuration_modes"]


@dataclass(frozen=True)
class ConfigurationModes:
    """The model's modes in one configuration, and their pairing with the identified modes.

    Attributes:
        name: of the configuration; empty where there is but one and it has none.
        n_modes: how many the structure has.
        pairing: label of an identified mode → number of the model mode, from 1; where it was
            inferred, the most probable one.
        inferred_pairing: how probable pairings are; None where the pairing was given.
        updated: frequencies, MACs and shapes of the paired modes before and after updating; None
            in results of versions that did not keep them.
    """

    name: str
    n_modes: int
    pairing: Mapping[str, int]
    inferred_pairing: InferredPairing | None
    updated: UpdatedModes | None = None


def configuration_modes(
    model_class: ModelClass, values: FloatArray
) -> tuple[ConfigurationModes, ...]:
    """The modes of a class whose posterior has the draws ``values`` (n, n_parameters)."""
    records = []
    # The prior medians go the same way as the draws, as their first row.
    at = np.concatenate([model_class.values(np.zeros((1, values.shape[1]))), values])
    for configuration, likelihood, rows in model_class.parts(at):
        medians, own = rows[:1], rows[1:]
        inferred = infer_pairing(likelihood, own) if isinstance(likelihood, AnyPairing) else None
        pairing = dict(inferred.best if inferred else likelihood.pairing)
        n_modes = configuration.structure.n_modes
        updated = updated_modes(configuration, likelihood, pairing, own, medians)
        records.append(ConfigurationModes(configuration.name, n_modes, pairing, inferred, updated))
    return tuple(records)
