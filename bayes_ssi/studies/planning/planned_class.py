"""A model class before a planned test: its modes at all candidate sensors, and tests it may give.

A simulated test is of all candidates, and any layout of sensors can read its data off. The errors
of a shape at the sensors of a layout have the density of
:mod:`~bayes_ssi.inference.likelihood.shape_density`: φ_e = cos t · u + sin t · τ, with u the unit
shape there. One vector ε of standard normal numbers, a number for each candidate, gives all
layouts their errors: τ is the direction of ε across u, and t has the probability of its length,
which is about t/σ. Layouts are so compared on the same errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, joined
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.parameters.parameters import (
    Parameter,
    ProductTable,
    as_product,
    collect_parameters,
    values_at,
)
from bayes_ssi.parameters.priors import log_standard_normal_density
from bayes_ssi.structures.geometry import Candidate, motion_of
from bayes_ssi.structures.modal import seen_shapes
from bayes_ssi.structures.structure import Requirement, Structure

BATCH = 4_000_000  # numbers in the largest array of a batch: 32 MB
N_FOR_MOMENTS = 2000  # draws of which moments are taken
N_FOR_ACCURACY = 200  # draws where approximate structures are made accurate
APPROXIMATION_SHARE = 0.1  # errors of approximate structures, as a share of the test's


class SeenModes(NamedTuple):
    """Modes at parameter values, with their errors."""

    frequencies_hz: FloatArray  # (…, n_modes)
    shapes: FloatArray  # (…, n_candidates, n_modes)
    variances: FloatArray  # (…, 2), squared errors of frequencies, as fractions, and of shapes


@dataclass(frozen=True, eq=False)
class PlannedClass:
    """A model class before the planned test, in one configuration.

    Its unknowns are z, standard-normal coordinates of :attr:`parameters`; what is known of them is
    their prior, or the posterior of an earlier test. The configuration's data give the band of the
    planned test and the root mean square errors of its identification.
    """

    model_class: ModelClass
    configuration: Configuration
    candidates: tuple[Candidate, ...]
    probability: float  # before the test
    posterior: Posterior | None = None

    def made_accurate(self) -> "PlannedClass":
        """With an approximate structure accurate enough where it will be used."""
        if not self.structure.is_approximate:
            return self
        z = self.drawn_before[:: N_FOR_MOMENTS // N_FOR_ACCURACY]
        errors = np.sqrt(np.median(self.error_variances(z), axis=0)) * APPROXIMATION_SHARE
        required = Requirement(self.structural_values(z), *errors.tolist())
        return self.with_structure(self.structure.accurate_at(required))

    def with_structure(self, structure: Structure) -> "PlannedClass":
        return replace(self, configuration=replace(self.configuration, structure=structure))

    @property
    def structure(self) -> Structure:
        return self.configuration.structure

    @property
    def n_structural(self) -> int:
        """Number of parameters of the structure, the first ones."""
        return len(self.structure.parameters)

    @cached_property
    def _sizes(self) -> ProductTable:
        error = self.model_class.error
        sizes = as_product(error.frequency_cov), as_product(error.shape_sd)
        of_errors = (parameter for size in sizes for parameter in size.parameters)
        own = self.structure.parameters
        return ProductTable(sizes, collect_parameters((*own, *of_errors)))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of the structure, then of the errors, then of earlier tests; the columns of z."""
        priors = self.model_class.priors
        own = [replace(p, prior=priors.get(p.name, p.prior)) for p in self._sizes.parameters]
        earlier = self.model_class.parameters if self.posterior is not None else ()
        names = {parameter.name for parameter in own}
        return (*own, *(parameter for parameter in earlier if parameter.name not in names))

    def structural_values(self, z: FloatArray) -> FloatArray:
        """Parameter values of the structure at z (B, n_parameters)."""
        return values_at(self.parameters[: self.n_structural], z[:, : self.n_structural])

    @cached_property
    def identification_errors(self) -> FloatArray:
        """Of frequencies, as fractions, and shapes, (2,); zero where the data give none."""
        modes = self.configuration.data.modes
        sizes = [[m.frequency_cov or 0.0, m.shape_sd or 0.0] for m in modes]
        return np.asarray(np.sqrt(np.square(sizes).mean(axis=0)))

    def modes(self, z: FloatArray) -> SeenModes:
        """The modes at z (…, n_parameters); NaN where the structure has none."""
        terms, shares = terms_of(self.candidates)
        structure = self.structure
        matrix = structure.sensor_matrix(terms)
        per_row = len(structure.degrees_of_freedom) * structure.n_modes
        step = max(1, BATCH // per_row)
        rows, parts = z.reshape(-1, z.shape[-1]), []
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            modes = structure.modes_or_nan(self.structural_values(some))
            shapes = seen_shapes(np.einsum("ct,btm->bcm", shares, matrix.apply(modes.shapes)))
            parts.append(SeenModes(modes.frequencies_hz, shapes, self.error_variances(some)))
        every = joined(parts)
        return SeenModes(*(array.reshape(*z.shape[:-1], *array.shape[1:]) for array in every))

    def error_variances(self, z: FloatArray) -> FloatArray:
        """Squared errors (B, 2) of frequencies, as fractions, and shapes, at z (B, n)."""
        n_own = len(self._sizes.parameters)
        values = values_at(self.parameters[:n_own], z[:, :n_own])
        prediction_var = self._sizes.evaluate(values) ** 2
        return np.asarray(prediction_var + self.identification_errors**2)

    def draw(self, n: int, rng: np.random.Generator) -> FloatArray:
        """z (n, n_parameters), drawn from what is known of them."""
        z = rng.standard_normal((n, len(self.parameters)))
        if self.posterior is not None:
            values = self.posterior.values[rng.integers(len(self.posterior.values), size=n)]
            for p, column in zip(self.model_class.parameters, self._earlier, strict=True):
                at = self.posterior.parameter_names.index(p.name)
                z[:, column] = p.prior.to_normal(values[:, at])
        return z

    def log_before(self, z: FloatArray) -> FloatArray:
        """Log density (B,) of z (B, n_parameters) before the planned test."""
        density = np.asarray(log_standard_normal_density(z).sum(axis=1))
        if self.posterior is None:
            return density
        earlier = self.model_class.log_likelihood_at(z[:, self._earlier])
        return density + np.nan_to_num(earlier, nan=-np.inf) - self.posterior.evidence.log_evidence

    @cached_property
    def _earlier(self) -> list[int]:
        names = [parameter.name for parameter in self.parameters]
        return [names.index(name) for name in self.model_class.parameter_names]

    @cached_property
    def precision(self) -> FloatArray:
        """Inverse of the covariance of z before the test."""
        covariance = np.cov(self.drawn_before, rowvar=False)
        return np.asarray(np.linalg.inv(covariance.reshape(len(self.parameters), -1)))

    @cached_property
    def drawn_before(self) -> FloatArray:
        """Draws (N_FOR_MOMENTS, n_parameters) before the test, always the same."""
        return self.draw(N_FOR_MOMENTS, np.random.default_rng(0))


def terms_of(candidates: tuple[Candidate, ...]) -> tuple[list[str], FloatArray]:
    """Labels that candidates combine, and their shares (n_candidates, n_terms)."""
    motions = [{str(place): share for place, share in motion_of(c.place)} for c in candidates]
    terms = list(dict.fromkeys(label for motion in motions for label in motion))
    shares = [[motion.get(label, 0.0) for label in terms] for motion in motions]
    return terms, np.array(shares)


class SimulatedTests(NamedTuple):
    """N tests, each with up to J identified modes at all candidate sensors."""

    frequencies_hz: FloatArray  # (N, J), identified ones; NaN where there is none
    shapes: FloatArray  # (N, n_candidates, J), of the structure; 0 for spurious modes
    noise: FloatArray  # (N, n_candidates, J), ε
    shape_sd: FloatArray  # (N,), σ

    @classmethod
    def joined(cls, parts: "Sequence[SimulatedTests]") -> "SimulatedTests":
        """Tests of several classes, with as many places for modes as any of them needs."""
        most = max(part.frequencies_hz.shape[1] for part in parts)
        wider = []
        for hz, shapes, noise, shape_sd in parts:
            room = [(0, 0), (0, 0), (0, most - hz.shape[1])]
            own_hz = np.pad(hz, room[1:], constant_values=np.nan)
            wider.append(cls(own_hz, np.pad(shapes, room), np.pad(noise, room), shape_sd))
        return joined(wider)

    def rows(self, which: slice) -> "SimulatedTests":
        return SimulatedTests._make(array[which] for array in self)

    def identified_shapes(self, layout: Sequence[int]) -> FloatArray:
        """Unit shapes (N, d, J) as the d sensors of a layout give them."""
        shapes, noise = self.shapes[:, layout], self.noise[:, layout]
        length = np.sqrt(np.square(shapes).sum(axis=1, keepdims=True))
        unit = shapes / np.where(length > 0.0, length, 1.0)
        across = noise - unit * (unit * noise).sum(axis=1, keepdims=True)
        size = np.sqrt(np.square(across).sum(axis=1, keepdims=True))
        size = np.maximum(size, np.finfo(float).tiny)  # at one sensor nothing is across
        distance = shape_distances(size, self.shape_sd[:, None, None], len(layout))
        cosine = np.where(length > 0.0, 1.0 - distance, 0.0)
        return np.asarray(cosine * unit + np.sqrt(1.0 - cosine * cosine) * across / size)


def shape_distances(lengths: FloatArray, shape_sd: FloatArray, d: int) -> FloatArray:
    """1 - |φ_e·φ| that is as probable as the length of d - 1 standard normal numbers.

    The density of y = 1 - cos t is that of x = 2y/σ², χ² with d - 1 degrees of freedom, times
    (1 - y/2)^((d-3)/2), of which the first term of the logarithm, -(d - 3) y/4, is another rate.
    """
    rate = 1.0 + 0.25 * (d - 3) * shape_sd**2
    return np.asarray(np.clip(0.5 * shape_sd**2 * lengths**2 / rate, 0.0, 1.0))


def simulate(planned: PlannedClass, n: int, rng: np.random.Generator) -> SimulatedTests:
    """n tests of a class: parameters, identified, missed and spurious modes, and their errors."""
    modes = planned.modes(planned.draw(n, rng))
    identification = planned.model_class.identification
    low, high = planned.configuration.data.band_hz
    shape = modes.frequencies_hz.shape
    errors = np.sqrt(modes.variances[:, :1]) * rng.standard_normal(shape)
    identified_hz = modes.frequencies_hz * (1.0 + errors)
    seen = rng.random(shape) < identification.detection_probability
    identified_hz[~(seen & (identified_hz > low) & (identified_hz < high))] = np.nan
    n_spurious = rng.poisson(identification.expected_spurious_modes, n)
    spurious = rng.uniform(low, high, (n, max(int(n_spurious.max()), 1)))
    spurious[np.arange(spurious.shape[1]) >= n_spurious[:, None]] = np.nan
    frequencies = np.concatenate([identified_hz, spurious], axis=1)
    without = np.zeros((n, modes.shapes.shape[1], spurious.shape[1]))
    shapes = np.concatenate([modes.shapes, without], axis=2)
    noise = rng.standard_normal(shapes.shape)
    # Identified modes first, as many places as the test with the most needs.
    missing = np.isnan(frequencies)
    order = np.argsort(missing, axis=1, kind="stable")[:, : max(int((~missing).sum(1).max()), 1)]
    shapes = np.where(missing[:, None], 0.0, shapes)
    return SimulatedTests(
        np.take_along_axis(frequencies, order, axis=1),
        np.take_along_axis(shapes, order[:, None], axis=2),
        np.take_along_axis(noise, order[:, None], axis=2),
        np.sqrt(modes.variances[:, 1]),
    )
