"""A model class: a structure, priors and a likelihood of the identified modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from bayes_ssi.any_pairing import AnyPairing
from bayes_ssi.data import ModalData
from bayes_ssi.errors import ErrorModel, IdentificationModel
from bayes_ssi.likelihood import ModalLikelihood, check_pairing
from bayes_ssi.parameters import Parameter
from bayes_ssi.priors import FloatArray
from bayes_ssi.structures.base import Structure

__all__ = ["ModelClass"]


@dataclass(frozen=True, eq=False)
class ModelClass:
    """One hypothesis about a structure: which model, which unknowns, which mode is which.

    Attributes:
        name: unique in a study.
        structure: the structural model; its parameters carry their priors.
        data: the identified modes.
        error: prediction errors, inferred by default.
        pairing: label of an identified mode → number of the model mode that it is, from 1.
            Identified modes that are left out count as spurious, model modes that are left out
            as not identified. Or "any": the likelihood is summed over all pairings, and which
            mode is which is inferred.
        identification: how modes are found and missed.
        description: a sentence for reports.

    Raises:
        ValueError: names repeat among different parameters, nothing is inferred, a sensor has no
            degree of freedom, or the pairing is not valid. The message begins with the class's
            name.
        TypeError: the name, structure, data or errors are of the wrong kind.
    """

    name: str
    structure: Structure
    data: ModalData
    error: ErrorModel = field(default_factory=ErrorModel)
    pairing: Mapping[str, int] | Literal["any"] = field(kw_only=True)
    identification: IdentificationModel = field(default_factory=IdentificationModel, kw_only=True)
    description: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise TypeError(f"ModelClass: name must be text and not empty, got {self.name!r}")
        for name, kind in (
            ("structure", Structure),
            ("data", ModalData),
            ("error", ErrorModel),
            ("identification", IdentificationModel),
        ):
            if not isinstance(getattr(self, name), kind):
                raise TypeError(
                    f"model class {self.name!r}: {name} must be a {kind.__name__}, "
                    f"got {getattr(self, name)!r}"
                )
        try:
            if self.pairing != "any":
                check_pairing(self.pairing, self.data, self.structure.n_modes)
                object.__setattr__(self, "pairing", {k: int(i) for k, i in self.pairing.items()})
            if not self.parameters:
                raise ValueError("nothing is inferred; put a Parameter in the structure's fields")
        except (TypeError, ValueError) as error:
            raise type(error)(f"model class {self.name!r}: {error}") from None

    @cached_property
    def likelihood(self) -> ModalLikelihood:
        parts = (self.structure, self.data, self.error, self.identification)
        if self.pairing == "any":
            return AnyPairing(*parts, pairing={})
        return ModalLikelihood(*parts, self.pairing)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The inferred parameters: the columns of ``values`` and of ``z``."""
        return self.likelihood.parameters

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def values(self, z: FloatArray) -> FloatArray:
        """Parameter values (B, n_parameters) at standard-normal coordinates ``z``."""
        values = np.empty(z.shape)
        for column, parameter in enumerate(self.parameters):
            values[:, column] = parameter.prior.from_normal(z[:, column])
        return values

    def coordinates(self, values: FloatArray) -> FloatArray:
        """Standard-normal coordinates of parameter values; the inverse of :meth:`values`."""
        z = np.empty(values.shape)
        for column, parameter in enumerate(self.parameters):
            z[:, column] = parameter.prior.to_normal(values[:, column])
        return z

    def log_likelihood(self, values: FloatArray) -> FloatArray:
        """log p(data | values), (B,), for ``values`` (B, n_parameters)."""
        return self.likelihood.log_likelihood(np.asarray(values, dtype=float))

    def log_likelihood_at(self, z: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at standard-normal coordinates ``z`` (B, n_parameters).

        NaN where the structure has no modes, so that whoever samples can count such points.
        """
        return self.likelihood.log_density(self.values(z))

    def check_structure(self) -> None:
        """Ask the structure once, at the prior medians, whether it answers as it should.

        Raises:
            ValueError: it raises, or what it returns has not the shapes that it announces.
        """
        n_dof, n_modes = len(self.structure.degrees_of_freedom), self.structure.n_modes
        kind = f"model class {self.name!r}: structure {type(self.structure).__name__}"
        try:
            frequencies_hz, shapes = self.structure.modes(self.structure.medians())
        except Exception as error:  # whatever a user's structure may raise
            raise ValueError(
                f"{kind} fails at the prior medians: {type(error).__name__}: {error}"
            ) from error
        found = np.shape(frequencies_hz), np.shape(shapes)
        if found != ((1, n_modes), (1, n_dof, n_modes)):
            raise ValueError(
                f"{kind} returns frequencies and shapes of shapes {found[0]} and {found[1]} for "
                f"one set of values, expected {(1, n_modes)} and {(1, n_dof, n_modes)}"
            )

    def summary(self) -> dict[str, Any]:
        """What the class is, for a JSON record."""
        return {
            "name": self.name,
            "description": self.description,
            "structure": type(self.structure).__name__,
            "definition": repr(self.structure),
            "error": repr(self.error),
            "degrees_of_freedom": list(self.structure.degrees_of_freedom),
            "parameters": [
                {"name": p.name, "unit": p.unit, "prior": p.prior.as_dict()}
                for p in self.parameters
            ],
            "pairing": self.pairing if self.pairing == "any" else dict(self.pairing),
            "spurious": None
            if self.pairing == "any"
            else [label for label in self.data.labels if label not in self.pairing],
            "detection_probability": self.identification.detection_probability,
            "expected_spurious_modes": self.identification.expected_spurious_modes,
            "identification_errors": {
                mode.label: {"frequency_cov": mode.frequency_cov, "shape_sd": mode.shape_sd}
                for mode in self.data.modes
            },
            "data_digest": self.data.digest,
        }
