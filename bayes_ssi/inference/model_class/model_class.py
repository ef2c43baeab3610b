"""A model class: a structure, priors and a likelihood of the identified modes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from bayes_ssi.foundations.argument_types import checked, require, require_known
from bayes_ssi.foundations.arrays import FloatArray, IntArray, row_sums
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.foundations.error_places import with_place
from bayes_ssi.foundations.text_files import require_name
from bayes_ssi.inference.likelihood.correlated_errors import CorrelatedErrors
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.configuration import (
    Configuration,
    choose_configuration,
    configurations_of,
    joint_digest,
)
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter, checked_values, collect_parameters, values_at
from bayes_ssi.parameters.priors import Prior
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure

Pairing = Mapping[str, int] | Literal["any"]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class ModelClass(Displayed):
    """One hypothesis about a structure: its model, its unknowns, and which mode is which.

    The structure was tested once, or in several configurations: then parameters with the same name
    are the same, and the likelihood is the product of the tests' likelihoods, unless errors are
    correlated between tests.

    Attributes:
        name: unique in a study.
        configurations: the tests; a single unnamed one where ``structure`` and ``data`` were given.
        error: prediction errors, inferred by default, the same in all configurations.
        identification: detection and spurious modes, the same in all configurations.
        description: a sentence for reports.
        priors: name of a parameter → prior in place of its own.

    >>> frame = bs.ShearBuilding((1.0, 1.0), 2 * (bs.Parameter("k", bs.LogNormal(40.0, 0.3)),))
    >>> modes = bs.ModalData((bs.IdentifiedMode("1", 0.622),), band_hz=(0.0, 1.0))
    >>> bs.ModelClass("frame", frame, modes, pairing={"1": 1}).parameter_names
    ('k', 'frequency_cov')
    """

    name: str
    configurations: tuple[Configuration, ...]
    error: ErrorModel
    identification: IdentificationModel
    description: str
    priors: Mapping[str, Prior]

    def __init__(
        self,
        name: str,
        structure: Structure | None = None,
        data: ModalData | None = None,
        error: ErrorModel | None = None,
        *,
        pairing: Pairing | None = None,
        configurations: Sequence[Configuration] | None = None,
        identification: IdentificationModel | None = None,
        description: str = "",
        priors: Mapping[str, Prior] | None = None,
    ) -> None:
        """Define a class by a structure, its data and pairing, or by several configurations.

        Args:
            structure: of a single configuration, as ``data`` and ``pairing``, described in
                :class:`~bayes_ssi.inference.model_class.configuration.Configuration`.
            configurations: the tests, where there are several. A structure, data or pairing that
                is also given replaces theirs.

        Raises:
            ValueError: the name is empty or cannot be printed, two parameters or configurations
                share a name, nothing is inferred, a prior belongs to no parameter, a sensor is not
                on the structure, a pairing is not valid, or it does not suit correlated errors.
                The message begins with the class's name.
            TypeError: an argument is missing or has the wrong type.
        """
        require_name(name, "ModelClass: name")
        parts = {"structure": structure, "data": data, "pairing": pairing}
        own = {field: value for field, value in parts.items() if value is not None}
        try:
            require(error, ErrorModel | None, "error")
            require(identification, IdentificationModel | None, "identification")
            require(priors, Mapping[str, Prior] | None, "priors")
            for field, value in (
                ("name", name),
                ("configurations", configurations_of(configurations, own)),
                ("error", error or ErrorModel()),
                ("identification", identification or IdentificationModel()),
                ("description", description),
                ("priors", dict(priors or {})),
            ):
                object.__setattr__(self, field, value)
            if not self.parameters:
                raise ValueError("nothing is inferred; put a Parameter in the structure's fields")
            require_known("priors: no parameter", self.priors, self.parameter_names)
            _ = self.correlated_errors  # refuses labels that it cannot use
        except (TypeError, ValueError) as wrong:
            raise type(wrong)(f"model class {name!r}: {wrong}") from None

    @checked
    def configuration(self, name: str | None = None) -> Configuration:
        """The configuration of that name, or the only one if None.

        Raises:
            ValueError: there is no such configuration, or there are several and none is named.
        """
        by_name = {each.name: each for each in self.configurations}
        return choose_configuration(by_name, name, f"model class {self.name!r}")

    @property
    def structure(self) -> Structure:
        """The structure of a class with one configuration; ValueError where there are several."""
        return self.configuration().structure

    @property
    def data(self) -> ModalData:
        """The identified modes of a class with one configuration; ValueError otherwise."""
        return self.configuration().data

    @property
    def pairing(self) -> Pairing:
        """The pairing of a class with one configuration; ValueError otherwise."""
        return self.configuration().pairing

    @property
    def configuration_names(self) -> tuple[str, ...]:
        """Names of the tests; one empty name where there is one test."""
        return tuple(configuration.name for configuration in self.configurations)

    @cached_property
    def likelihoods(self) -> tuple[ModalLikelihood, ...]:
        """The likelihoods of the configurations' modes."""
        return tuple(c.likelihood(self.error, self.identification) for c in self.configurations)

    @cached_property
    def correlated_errors(self) -> CorrelatedErrors:
        """Errors of the paired modes of all configurations together."""
        return CorrelatedErrors(self.error, self.likelihoods, self._parameters_as_given)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The inferred parameters, the columns of ``values`` and of ``z``.

        Parameters of the structures come first, then those of the errors.
        """
        own = self._parameters_as_given
        return tuple(replace(p, prior=self.priors.get(p.name, p.prior)) for p in own)

    @cached_property
    def _parameters_as_given(self) -> tuple[Parameter, ...]:
        """Those of :attr:`parameters` with the priors that structures and errors give them."""
        of_all = (p for likelihood in self.likelihoods for p in likelihood.parameters)
        return collect_parameters((*self._of_structures, *of_all))

    @property
    def structural_parameters(self) -> tuple[Parameter, ...]:
        """The structures' parameters, the first of :attr:`parameters`; the others are errors."""
        return self.parameters[: len(collect_parameters(self._of_structures))]

    @property
    def _of_structures(self) -> tuple[Parameter, ...]:
        return tuple(p for c in self.configurations for p in c.structure.parameters)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of :attr:`parameters`, in their order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def has_shapes(self) -> bool:
        """Whether the data of any configuration have shapes that carry information."""
        modes = (mode for test in self.configurations for mode in test.data.modes)
        return any(mode.scored_shape is not None for mode in modes)

    @property
    def data_digest(self) -> str:
        """Digest of the data, of all configurations, whose density the evidence is."""
        return joint_digest({c.name: c.data for c in self.configurations})

    def values(self, z: FloatArray) -> FloatArray:
        """Parameter values (B, n_parameters) at standard-normal coordinates ``z``."""
        return values_at(self.parameters, z)

    def coordinates(self, values: FloatArray) -> FloatArray:
        """Standard-normal coordinates ``z`` of parameter values (B, n_parameters)."""
        columns = zip(self.parameters, values.T, strict=True)
        return np.column_stack([parameter.prior.to_normal(column) for parameter, column in columns])

    def parts(
        self, values: FloatArray
    ) -> Iterator[tuple[Configuration, ModalLikelihood, FloatArray]]:
        """Every configuration, its likelihood, and its columns of ``values`` (B, n_parameters)."""
        for configuration, likelihood, columns in zip(
            self.configurations, self.likelihoods, self._columns, strict=True
        ):
            own = values if len(self.configurations) == 1 else values[:, columns]
            yield configuration, likelihood, own

    def modes_or_nan(self, values: FloatArray) -> list[Modes]:
        """Modes of every configuration at ``values``; NaN in rows where its structure fails."""
        return [
            test.structure.modes_or_nan(own[:, : len(test.structure.parameters)])
            for test, _, own in self.parts(values)
        ]

    @cached_property
    def _columns(self) -> list[IntArray]:
        """The columns of each configuration's parameters among those of all."""
        place = self.parameter_names.index
        of_tests = ([place(p.name) for p in each.parameters] for each in self.likelihoods)
        return [np.array(columns, dtype=np.intp) for columns in of_tests]

    def log_likelihood(self, values: FloatArray) -> FloatArray:
        """log p(data | values), (B,), for ``values`` (B, n_parameters); -inf without modes."""
        values = checked_values(values, self.parameters, f"model class {self.name!r}: values")
        total = self.log_density_of_modes(values, self.modes(values))
        return np.where(np.isnan(total), -np.inf, total)

    def log_likelihood_at(self, z: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at standard-normal coordinates ``z`` (B, n_parameters).

        NaN where a structure has no modes, so that samplers can count such points.
        """
        values = self.values(z)
        return self.log_density_of_modes(values, self.modes(values))

    def modes(self, values: FloatArray) -> list[Modes]:
        """The modes of each configuration at ``values``."""
        return [likelihood.modes(own) for _, likelihood, own in self.parts(values)]

    def log_density_of_modes(self, values: FloatArray, modes: Sequence[Modes]) -> FloatArray:
        """The log-likelihood (B,) at ``values``, where the modes of each configuration are known.

        NaN where a structure has no modes.
        """
        total, compared = np.zeros(len(values)), []
        for (_, likelihood, own), of_test in zip(self.parts(values), modes, strict=True):
            compared.append(likelihood.compared_modes(own, of_test))
            total += likelihood.log_density(own, compared[-1])
        if self.correlated_errors.groups:
            total += row_sums(self.correlated_errors.log_ratios(values, compared))
        return total

    def with_any_pairing(self, name: str) -> "ModelClass":
        """The class, under another name, with the pairing of every configuration inferred."""
        tests = tuple(replace(test, pairing="any") for test in self.configurations)
        return replace(self, name=name, configurations=tests)

    def with_independent_errors(self) -> "ModelClass":
        """The class with the identification errors of different data independent, and their sizes
        as they are; the class itself where no data have a joint covariance.
        """
        if all(test.data.covariance is None for test in self.configurations):
            return self
        tests = tuple(replace(t, data=t.data.without_covariance()) for t in self.configurations)
        return replace(self, configurations=tests)

    def with_structures(self, change: Callable[[Structure, int], Structure]) -> "ModelClass":
        """The class with other structures; the class itself if none changes.

        Args:
            change: called with the structure of each configuration and the configuration's index.
        """
        changed = [(test, change(test.structure, i)) for i, test in enumerate(self.configurations)]
        if all(structure is test.structure for test, structure in changed):
            return self
        tests = tuple(replace(test, structure=structure) for test, structure in changed)
        return replace(self, configurations=tests)

    def check_structure(self) -> None:
        """Compute every structure's modes at the prior medians as a check.

        Raises:
            ValueError: it raises an error, or returns arrays of the wrong shapes.
        """
        for test in self.configurations:
            structure, where = test.structure, f"model class {self.name!r}: "
            where += f"configuration {test.name!r}: " if test.name else ""
            where += f"structure {type(structure).__name__}"
            try:
                frequencies_hz, shapes = structure.modes(structure.prior_medians())
            except Exception as error:  # whatever a user's structure may raise
                reason = with_place(error)
                raise ValueError(f"{where} fails at the prior medians: {reason}") from error
            n_dof, n_modes = len(structure.degrees_of_freedom), structure.n_modes
            sizes = np.shape(frequencies_hz), np.shape(shapes)
            if sizes != ((1, n_modes), (1, n_dof, n_modes)):
                raise ValueError(
                    f"{where} returns frequencies and shapes of shapes {sizes[0]} and {sizes[1]} "
                    f"for one set of values, expected {(1, n_modes)} and {(1, n_dof, n_modes)}"
                )

    def _line(self) -> str:
        parameters = counted(len(self.parameters), "parameter")
        structure = type(self.configurations[0].structure).__name__
        tests = counted(len(self.configurations), "configuration")
        return f"{self.name!r}: {structure}, {parameters}, {tests}"

    def _rows(self) -> list[dict[str, Any]]:
        return [
            {"parameter": p.name, "unit": p.unit, "prior": str(p.prior),
             "median": p.prior.quantile(0.5)}
            for p in self.parameters
        ]  # fmt: skip
