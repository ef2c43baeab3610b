"""The posterior of one model class: draws, summaries, evidence, and what was checked.

With the modes that it keeps at its draws, a likelihood under other settings is computed without
solving for any mode.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bayes_ssi.foundations.argument_types import require_known
from bayes_ssi.foundations.arrays import FloatArray, IntArray, evenly_spaced_indices
from bayes_ssi.foundations.arviz_functions import in_arviz, mcse_mean, mcse_sd
from bayes_ssi.foundations.displayed import Displayed, columns, counted
from bayes_ssi.foundations.summaries import LEVELS, Summary
from bayes_ssi.inference.criticism.adequacy import Adequacy
from bayes_ssi.inference.criticism.misfit import AtEdge
from bayes_ssi.inference.model_class.configuration import modes_with_shape
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.inference.posterior.model_at_draws import ConfigurationModes, DatumTerms
from bayes_ssi.inference.sampling.diagnostics import EvidenceEstimate
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import Parameter
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure

# At which shapes at the sensors are kept: enough for means and evidences under changed settings
# to a few hundredths of a standard deviation and of a nat.
DRAWS_WITH_SHAPES = 4000


@dataclass(frozen=True)
class Evidence:
    """The log evidence of a model class in nats, and the estimates that check it.

    Attributes:
        log_evidence: by mixture importance sampling, the quoted value.
        error: its standard error.
        effective_sample_size: of the importance draws.
        pareto_k: shape of the tail of their weights; the error can be trusted below 0.7.
        n_draws: number of importance draws.
        mean_log_likelihood: posterior mean of the log-likelihood, how well the class fits.
        checks: estimates of the log evidence by other methods.
    """

    log_evidence: float
    error: float
    effective_sample_size: float
    pareto_k: float
    n_draws: int
    mean_log_likelihood: float
    checks: tuple[EvidenceEstimate, ...]

    def check(self, name: str) -> EvidenceEstimate | None:
        """The estimate by the named method; None if there is none."""
        return next((check for check in self.checks if check.name == name), None)

    @property
    def information_gained(self) -> float:
        """Information that the data give about the parameters, in nats; the penalty on the fit.

        The relative entropy of posterior to prior; log evidence = mean log-likelihood - this.
        """
        return self.mean_log_likelihood - self.log_evidence


@dataclass(frozen=True)
class Region:
    """A part of the posterior separated from the others by valleys.

    Attributes:
        share: probability of the region, by importance sampling.
        error: its standard error.
        n_searches: number of independent searches for maxima that found one in it.
        mean: posterior mean of every parameter within the region.
    """

    share: float
    error: float
    n_searches: int
    mean: tuple[float, ...]


@dataclass(frozen=True)
class ParameterSummary(Summary):
    """Posterior of one parameter.

    ``mean_error`` and ``sd_error`` are Monte Carlo errors; ``relative_spread`` is as in
    :class:`Posterior`.
    """

    mean_error: float
    sd_error: float
    relative_spread: float


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Displayed):
    """The posterior of one model class.

    Attributes:
        name: of the model class.
        parameter_names: columns of ``draws``.
        draws: (n_chains, n_steps, n_parameters), equally weighted parameter values after burn-in;
            a chain is a walker of one of emcee's ensembles. One row of draws where ``remarks`` say
            that they are no chains.
        log_likelihoods: (n_chains, n_steps).
        frequencies_hz: (n_chains, n_steps, n_modes), model frequencies at the draws; with several
            configurations, the modes of all of them in turn.
        effective_sample_sizes: (n_parameters,), of the bulk of the chains, by arviz.
        tail_effective_sample_sizes: (n_parameters,), of their 5 and 95 % quantiles, the smaller.
        evidence: log evidence and its checks.
        regions: separate regions, the most probable first.
        maxima: (m, n_parameters), parameter values at the maxima of likelihood times prior
            density in standard-normal coordinates, the highest first.
        r_hat: the largest rank-normalised split R-hat of any parameter over all chains, by arviz.
        burn_in: steps of each chain that were left out before ``draws``.
        thinned_by: one in so many of the other steps is kept.
        autocorrelation_time: emcee's, the longest of any parameter and ensemble, in steps; NaN
            where a walker never moved.
        acceptance_fraction: emcee's, the mean over walkers.
        n_evaluations: of the log-likelihood, all steps together.
        n_searches: independent searches for maxima.
        largest_unseen_mass: prior mass of a region that no prior draw of the searches hit with a
            probability of 5 %, as in
            :attr:`~bayes_ssi.inference.sampling.multistart.MultistartSearch.largest_unseen_mass`.
        seconds: wall-clock time.
        failed_checks: what should have agreed and did not, a sentence each.
        edges: settings at whose edge most of it lies, so that it depends on them.
        data_digest: identifies the data whose density the evidence is.
        configurations: the model's modes and their pairing, configuration by configuration.
        relative_spreads: (n_parameters,), posterior over prior standard deviation, both in
            standard-normal coordinates: 1 where the data say nothing.
        prior_quantiles: (n_parameters, 3), 5, 50 and 95 % quantiles of the priors.
        sensor_shapes: (m, n_components), shapes at the sensors at
            :func:`~bayes_ssi.inference.posterior.posterior.draws_with_shapes`, as in
            :class:`~bayes_ssi.inference.posterior.model_at_draws.AtDraws`; None where they are not
            known.
        datum_terms: log-likelihoods and predictions datum by datum, for other packages.
        prior_draws: (m, n_parameters), likewise.
        adequacy: how far the data are from what the class says they should be.
        remarks: further remarks on how it was computed, a sentence each.
        frequency_error: largest error of ``frequencies_hz``, as a fraction, at the draws at which
            approximate structures were solved exactly; zero where no structure is approximate.
        emulators: what was emulated, configuration by configuration, None for other structures;
            not stored.
        importance_draws: what the log evidence is recomputed from: the arrays of
            :attr:`~bayes_ssi.inference.sampling.importance.ImportanceSample.arrays`, and where it
            was corrected by exact solutions of the structures, their log-likelihoods minus those
            that were sampled, ``changes`` (m,), at posterior draws; saved, but not read back.
    """

    name: str
    parameter_names: tuple[str, ...]
    draws: FloatArray
    log_likelihoods: FloatArray
    frequencies_hz: FloatArray
    effective_sample_sizes: FloatArray
    tail_effective_sample_sizes: FloatArray
    evidence: Evidence
    regions: tuple[Region, ...]
    maxima: FloatArray
    r_hat: float
    burn_in: int
    thinned_by: int
    autocorrelation_time: float
    acceptance_fraction: float
    n_evaluations: int
    n_searches: int
    largest_unseen_mass: float
    seconds: float
    failed_checks: tuple[str, ...]
    edges: tuple[AtEdge, ...]
    data_digest: str
    configurations: tuple[ConfigurationModes, ...]
    relative_spreads: FloatArray
    prior_quantiles: FloatArray
    sensor_shapes: FloatArray | None = None
    datum_terms: DatumTerms | None = None
    prior_draws: FloatArray | None = None
    adequacy: Adequacy | None = None
    remarks: tuple[str, ...] = ()
    frequency_error: float = 0.0
    emulators: tuple[Any, ...] = ()
    importance_draws: Mapping[str, Any] | None = None

    @property
    def configuration_names(self) -> tuple[str, ...]:
        """Names of the tests; one empty name where there was one test."""
        return tuple(configuration.name for configuration in self.configurations)

    def configuration(self, name: str) -> tuple[ConfigurationModes, FloatArray]:
        """The modes of one configuration, and its part of ``frequencies_hz``.

        Raises:
            ValueError: no configuration has that name.
        """
        names = self.configuration_names
        require_known(f"posterior of {self.name!r}: no configuration", [name], names)
        place = names.index(name)
        modes = self.configurations[place]
        begin = sum(before.n_modes for before in self.configurations[:place])
        return modes, self.frequencies_hz[..., begin : begin + modes.n_modes]

    @property
    def values(self) -> FloatArray:
        """All draws, (n_draws, n_parameters)."""
        return self.draws.reshape(-1, len(self.parameter_names))

    @cached_property
    def summary(self) -> tuple[ParameterSummary, ...]:
        """Mean, standard deviation and quantiles of every parameter."""
        means, sds = self.values.mean(0), self.values.std(0)
        # Effect of the errors of the regions' shares on the mean. Shares add up to one, so their
        # errors go together: exact for two regions, a bound for more.
        between = sum(region.error * np.abs(region.mean - means) for region in self.regions)
        # Of draws in one row, which are no chains, as many count as of the chains they come from.
        n = self.effective_sample_sizes if len(self.draws) == 1 else len(self.values)
        more = np.sqrt(len(self.values) / n)
        mean_errors = np.hypot(more * mcse_mean(self.draws), between)
        quantiles = np.quantile(self.values, LEVELS, axis=0)
        errors = [mean_errors, more * mcse_sd(self.draws)]
        numbers = np.stack([means, sds, *quantiles, *errors, self.relative_spreads])
        return tuple(map(ParameterSummary, self.parameter_names, *numbers.tolist()))

    def to_arviz(self) -> Any:
        """The draws as arviz holds them: an ``InferenceData``, from arviz 1.0 on a ``DataTree``."""
        return in_arviz(self)

    @property
    def pairing_is_given(self) -> bool:
        """By the analyst, in any test."""
        return any(test.inferred_pairing is None for test in self.configurations)

    def _line(self) -> str:
        evidence = f"log evidence {self.evidence.log_evidence:.3f} ± {self.evidence.error:.3f}"
        failed = counted(len(self.failed_checks), "failed check")
        draws = counted(len(self.values), "draw")
        return f"of {self.name!r}: {evidence}, {draws}, {failed}"

    def _rows(self) -> list[dict[str, Any]]:
        names = ("name", "mean", "sd", "quantile_05", "median", "quantile_95", "relative_spread")
        return [columns(row, names) for row in self.summary]


def check_names(posteriors: Iterable[Posterior]) -> list[str]:
    """Methods that check the log evidence of any of the posteriors, each once."""
    names = (check.name for posterior in posteriors for check in posterior.evidence.checks)
    return list(dict.fromkeys(names))


def draws_with_shapes(n_draws: int) -> IntArray:
    """The draws, of all chains in turn, at which a posterior keeps shapes at the sensors."""
    return evenly_spaced_indices(n_draws, DRAWS_WITH_SHAPES)


@dataclass(frozen=True, eq=False)
class KnownModes(Structure):
    """A structure with known modes at some parameter values; degrees of freedom are sensors."""

    values: FloatArray  # (B, n_parameters)
    known: Modes  # the modes at these values, shapes (B, n_sensors, n_modes) at the sensors
    parameters: tuple[Parameter, ...] = ()
    degrees_of_freedom: tuple[str, ...] = ()

    @property
    def n_modes(self) -> int:
        return self.known.frequencies_hz.shape[1]

    def modes(self, values: FloatArray) -> Modes:
        """The modes at some of the known values; ValueError at any others."""
        try:
            rows = [self._row[value.tobytes()] for value in np.ascontiguousarray(values)]
        except KeyError:
            raise ValueError("modes are known at the stored draws only") from None
        return Modes(*(array[rows] for array in self.known))

    @cached_property
    def _row(self) -> dict[bytes, int]:
        return {row.tobytes(): i for i, row in enumerate(np.ascontiguousarray(self.values))}


def known_structures(
    posterior: Posterior, tests: Iterable[tuple[ModalData, Pairing, Sequence[Parameter]]]
) -> list[KnownModes]:
    """The structure of each configuration, known at draws whose shapes the posterior keeps.

    ``tests`` have data, pairing and the structure's parameters of each configuration.
    """
    if posterior.sensor_shapes is None:
        raise ValueError(f"posterior of {posterior.name!r}: keeps no mode shapes at its draws")
    draws, remaining = draws_with_shapes(len(posterior.values)), posterior.sensor_shapes
    known = []
    for (data, pairing, parameters), modes in zip(tests, posterior.configurations, strict=True):
        kept = modes_with_shape(data, pairing, modes.n_modes)
        n_sensors = len(data.sensors)
        components, remaining = np.split(remaining, [n_sensors * len(kept)], axis=1)
        shapes = np.full((len(draws), n_sensors, modes.n_modes), np.nan)
        shapes[:, :, kept] = components.reshape(len(draws), n_sensors, len(kept))
        _, frequencies = posterior.configuration(modes.name)
        at_draws = Modes(frequencies.reshape(-1, modes.n_modes)[draws], shapes)
        columns = [posterior.parameter_names.index(p.name) for p in parameters]
        values = posterior.values[draws][:, columns]
        known.append(KnownModes(values, at_draws, tuple(parameters), data.sensors))
    return known


def known_at_draws(model_class: ModelClass, posterior: Posterior) -> ModelClass:
    """The class with structures that know their modes at the draws at which shapes are kept."""
    tests = ((t.data, t.pairing, t.structure.parameters) for t in model_class.configurations)
    known = known_structures(posterior, tests)
    return model_class.with_structures(lambda _, i: known[i])
