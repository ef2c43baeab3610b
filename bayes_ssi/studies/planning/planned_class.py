"""A model class as a planned test would see it: its modes at all candidate sensors, and errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.pair_errors import UnpairedModes
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import (
    Parameter,
    Product,
    ProductTable,
    as_product,
    collect_parameters,
    values_at,
)
from bayes_ssi.parameters.prior import log_standard_normal_density
from bayes_ssi.structures.geometry import Candidate, motion_of
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Structure
from bayes_ssi.studies.planning.plan_settings import PLANNING


@dataclass(frozen=True)
class PlannedTest:
    """What is known of a test before it: its band, and how well modes will be identified.

    Attributes:
        band_hz: in which modes will be sought.
        frequency_cov: identification error of frequencies, a fraction; 0 where it is unknown, and
            the prediction errors of the classes are all there is.
        shape_sd: the same of each component of shapes at unit length.
        factor: of these errors, and of all errors where neither is known.
        sensors: of the data that this is known from.
    """

    band_hz: tuple[float, float]
    frequency_cov: float = 0.0
    shape_sd: float = 0.0
    factor: float = 1.0
    sensors: tuple[str, ...] = ()

    @classmethod
    def like(cls, data: ModalData) -> PlannedTest:
        """A test as that of the data: their band, and their root mean square errors."""
        sizes = [
            [getattr(mode, name) or 0.0 for mode in data.modes]
            for name in ("frequency_cov", "shape_sd")
        ]
        frequency_cov, shape_sd = (math.sqrt(np.square(each).mean()) for each in sizes)
        return cls(data.band_hz, frequency_cov, shape_sd, sensors=data.sensors)

    @property
    def states_errors(self) -> bool:
        """Whether errors of identification are known."""
        return self.frequency_cov > 0.0 or self.shape_sd > 0.0

    def variances(self, prediction_var: FloatArray) -> FloatArray:
        """Squared errors (B, 2) of frequencies and shapes, from those of prediction alone."""
        if not self.states_errors:
            return prediction_var * self.factor**2
        return prediction_var + np.square([self.frequency_cov, self.shape_sd]) * self.factor**2

    @property
    def log_spurious(self) -> float:
        """Less log ν: the log density of a spurious mode's frequency."""
        return -math.log(self.band_hz[1] - self.band_hz[0])


class SeenModes(NamedTuple):
    """Modes of a structure at the candidate sensors, for B parameter values."""

    frequencies_hz: FloatArray  # (B, n_modes)
    shapes: FloatArray  # (B, n_candidates, n_modes)


@dataclass(frozen=True, eq=False)
class PlannedClass:
    """A model class before the planned test.

    Its unknowns are z, the standard-normal coordinates of its :attr:`parameters`, as in
    :class:`~bayes_ssi.inference.model_class.model_class.ModelClass`. What is known of them is
    their prior, or the posterior of an earlier test.
    """

    model_class: ModelClass
    structure: Structure
    candidates: tuple[Candidate, ...]
    test: PlannedTest
    probability: float  # before the test
    # Of an earlier test of the class, with its log evidence; None before any test.
    posterior: Posterior | None = None

    @property
    def name(self) -> str:
        return self.model_class.name

    @property
    def error(self) -> ErrorModel:
        return self.model_class.error

    @property
    def identification(self) -> IdentificationModel:
        return self.model_class.identification

    @cached_property
    def _as_given(self) -> tuple[Parameter, ...]:
        sizes = (parameter for size in self._sizes for parameter in size.parameters)
        return collect_parameters((*self.structure.parameters, *sizes))

    @property
    def _sizes(self) -> tuple[Product, Product]:
        return as_product(self.error.frequency_cov), as_product(self.error.shape_sd)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of the structure, then of the errors, then of other tests; the columns of z."""
        priors = self.model_class.priors
        own = [replace(p, prior=priors.get(p.name, p.prior)) for p in self._as_given]
        names = {parameter.name for parameter in own}
        earlier = self.model_class.parameters if self.posterior is not None else ()
        return (*own, *(parameter for parameter in earlier if parameter.name not in names))

    @property
    def n_structural(self) -> int:
        """Number of parameters of the structure, the first ones."""
        return len(self.structure.parameters)

    def values(self, z: FloatArray) -> FloatArray:
        """Values (B, m) of the first m parameters."""
        return values_at(self.parameters[: z.shape[1]], z)

    def modes(self, z: FloatArray) -> SeenModes:
        """The modes at z (B, n_parameters); NaN where the structure has none."""
        values = self.values(z[:, : self.n_structural])
        per_row = len(self.structure.degrees_of_freedom) * self.structure.n_modes
        step = max(1, PLANNING.array_size // per_row)
        parts = [self._modes(values[i : i + step]) for i in range(0, len(values), step)]
        return SeenModes(*(np.concatenate(each) for each in zip(*parts, strict=True)))

    def _modes(self, values: FloatArray) -> SeenModes:
        modes = self.structure.modes_or_nan(values)
        terms, shares = self._terms
        single = self.structure.sensor_matrix(terms, "candidate").apply(modes.shapes)
        shapes = single if shares is None else np.einsum("ct,btm->bcm", shares, single)
        return SeenModes(modes.frequencies_hz, seen_shapes(shapes))

    @cached_property
    def _terms(self) -> tuple[list[str], FloatArray | None]:
        """Labels that candidates combine, and shares (n_candidates, n_terms); None where single."""
        return terms_of(self.candidates)

    @cached_property
    def _size_table(self) -> ProductTable:
        return ProductTable(self._sizes, self._as_given)

    def error_variances(self, z: FloatArray) -> FloatArray:
        """Squared errors (B, 2) of identified frequencies, as fractions, and of shapes."""
        values = self.values(z[:, : len(self._as_given)])
        return self.test.variances(self._size_table.evaluate(values) ** 2)

    @cached_property
    def has_fixed_errors(self) -> bool:
        return len(self.parameters) == self.n_structural

    def log_missed(self, frequencies_hz: FloatArray, variances: FloatArray) -> FloatArray:
        """log(1 - p_D P_in) (B, n_modes) at squared errors (B, 2)."""
        low, high = self.test.band_hz
        any_mode = ModalData((IdentifiedMode("any", 0.5 * (low + high)),), (low, high))
        unpaired = UnpairedModes(any_mode, self.identification)
        return unpaired.log_missed(frequencies_hz, variances[:, :1], range(frequencies_hz.shape[1]))

    def log_before(self, z: FloatArray) -> FloatArray:
        """Log density (B,) of z (B, n_parameters) before the planned test."""
        density = np.asarray(log_standard_normal_density(z).sum(axis=1))
        if self.posterior is None:
            return density
        earlier = self.model_class.log_likelihood_at(z[:, self._columns_of_earlier])
        log_evidence = self.posterior.evidence.log_evidence
        return density + np.nan_to_num(earlier, nan=-np.inf) - log_evidence

    @cached_property
    def _columns_of_earlier(self) -> list[int]:
        """The columns of z that are the parameters of the class in the earlier test."""
        names = [parameter.name for parameter in self.parameters]
        return [names.index(name) for name in self.model_class.parameter_names]

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """z (n, n_parameters), drawn from what is known of them."""
        z = rng.standard_normal((n, len(self.parameters)))
        if self.posterior is not None:
            rows = rng.integers(len(self.posterior.values), size=n)
            for parameter, column in zip(
                self.model_class.parameters, self._columns_of_earlier, strict=True
            ):
                at = self.posterior.parameter_names.index(parameter.name)
                z[:, column] = parameter.prior.to_normal(self.posterior.values[rows, at])
        return z

    @cached_property
    def before(self) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of z before the test."""
        d = len(self.parameters)
        if self.posterior is None:
            return np.zeros(d), np.eye(d)
        z = self.draw(PLANNING.n_for_moments, np.random.default_rng(0))
        return z.mean(axis=0), np.cov(z, rowvar=False).reshape(d, d)


def terms_of(candidates: Sequence[Candidate]) -> tuple[list[str], FloatArray | None]:
    """Labels that candidates combine, and shares (n_candidates, n_terms); None where single."""
    motions = [[(str(place), share) for place, share in motion_of(c.place)] for c in candidates]
    terms = list(dict.fromkeys(label for motion in motions for label, _ in motion))
    if all(len(motion) == 1 and motion[0][1] == 1.0 for motion in motions):
        return terms, None
    shares = np.zeros((len(candidates), len(terms)))
    for i, motion in enumerate(motions):
        for label, share in motion:
            shares[i, terms.index(label)] += share
    return terms, shares
