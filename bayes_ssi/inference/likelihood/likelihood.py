"""The likelihood: a proper density of the identified modes in the band, given a structure.

Every identified mode in the band has a density, even one that the model does not explain: only so
are the evidences of different model classes comparable. For one pairing of identified with model
modes,

    p(D | θ) = e^(-ν) · Π over unpaired data of ν / ((f_hi - f_lo) |S^(d-1)|)
                      · Π over pairs of p_D N(f_e; f, (σ_f f_e)²) p(φ_e | φ)
                      · Π over unpaired model modes of (1 - p_D P_in)

with p_D the probability that a model mode in the band is identified, ν the expected number of
spurious modes, uniform over the band and over the sphere of shapes, and P_in the probability
that a model mode would have been identified inside the band. Where errors are correlated, the joint
density of pairs takes the place of their product
(:mod:`~bayes_ssi.inference.likelihood.correlated_errors`).

Close modes turn together, and the mean over their turns takes the place of the product of their
shapes' densities (:mod:`~bayes_ssi.inference.likelihood.close_modes`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_ssi.foundations.arrays import FloatArray, Places, row_sums
from bayes_ssi.inference.likelihood.close_modes import (
    CloseCases,
    ClosePairs,
    close_pairs,
    relative_distances,
)
from bayes_ssi.inference.likelihood.error_model import ErrorModel, IdentificationModel
from bayes_ssi.inference.likelihood.joint_errors import JointPairs
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.likelihood.shape_density import log_shape_normaliser, log_sphere_area
from bayes_ssi.inference.likelihood.turning_shapes import Turned, TurningShapes
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.parameters.parameters import (
    Parameter,
    Product,
    ProductTable,
    as_product,
    collect_parameters,
)
from bayes_ssi.structures.geometry import SensorMatrix
from bayes_ssi.structures.modal import Modes, seen_shapes
from bayes_ssi.structures.structure import Structure

# The datum that no other modes were identified.
MISSED = "no other mode"


class ComparedModes(NamedTuple):
    """The modes of a model at a batch of B parameter values, compared with the identified ones."""

    frequencies_hz: FloatArray  # (B, n_modes), of the model
    # (B, n_shape_pairs), 1 - |φ_e·φ| of the pairs whose shape is scored, at the mean turn of close
    # modes.
    shape_distances: FloatArray
    # (B, n_shape_pairs), log of the mean density over turns, over the one at the mean turn, which
    # both modes of a pair share; (B, 0) where nothing turns.
    turned: FloatArray
    # (B, n_shape_pairs · n_sensors), these model shapes at unit length, with the signs of the
    # identified ones, pair by pair; (B, 0) where errors are independent.
    unit_shapes: FloatArray
    # (B, n_modes - 1, J, J), of identified modes as two model modes that turn together, where the
    # pairing is inferred (PairingWeights.log_gains); (B, 0, 0, 0) where nothing turns.
    log_gains: FloatArray

    def rows(self, which: Places) -> "ComparedModes":
        return ComparedModes(*(array[which] for array in self))


class ModalTerms(NamedTuple):
    """Terms of the log-likelihood at a batch of B parameter values, which sum to the whole."""

    frequency: FloatArray  # (B, n_pairs), terms of the paired frequencies, p_D included
    shape: FloatArray  # (B, n_shape_pairs), terms of the paired modes whose shape is scored
    missed: FloatArray  # (B, n_unpaired), terms of the unpaired model modes
    spurious: float  # the term of all unpaired data, and of e^(-ν)

    def total(self) -> FloatArray:
        paired = row_sums(self.frequency) + row_sums(self.shape)
        return paired + row_sums(self.missed) + self.spurious


@dataclass(frozen=True, eq=False)
class ModalLikelihood:
    """The log-likelihood of identified modes for one explicit pairing with model modes."""

    structure: Structure
    data: ModalData
    error: ErrorModel
    identification: IdentificationModel
    pairing: Mapping[str, int]  # label of an identified mode → number of the model mode, from 1

    # Whether ``pairing`` says which mode is which, or that is inferred.
    pairing_is_given: ClassVar[bool] = True

    @cached_property
    def pairs(self) -> PairedModes:
        return PairedModes.of(self.data, self.pairing.items(), self.structure.shape_variances)

    def inferred_pairing(self, values: FloatArray) -> InferredPairing | None:  # noqa: ARG002
        """Pairings by their probability over draws (n, n_parameters); None where one is given."""
        return None

    def sampled_pairs(
        self,
        values: FloatArray,
        modes: ComparedModes,  # noqa: ARG002 - for inferred pairings
        rng: np.random.Generator,  # noqa: ARG002
    ) -> NDArray[np.intp]:
        """Which of :attr:`pairs` each identified mode is in, (B, J); -1 for spurious ones.

        Where the pairing is inferred, that of each row is drawn by its probability.
        """
        numbers = {mode.label: i for i, mode in enumerate(self.pairs.modes)}
        which = [numbers.get(label, -1) for label in self.data.labels]
        return np.tile(np.array(which, dtype=np.intp), (len(values), 1))

    @cached_property
    def _sizes(self) -> tuple[Product, ...]:
        """Prediction errors of frequencies and, where a shape is scored, of shapes."""
        sizes = as_product(self.error.frequency_cov), as_product(self.error.shape_sd)
        return sizes if len(self.pairs.with_shape) else sizes[:1]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The structure's parameters, then those of the errors that the paired data need."""
        products = (*self._sizes, *self.error.correlations)
        of_errors = (p for product in products for p in product.parameters)
        return collect_parameters((*self.structure.parameters, *of_errors))

    def log_density(self, values: FloatArray, modes: ComparedModes | None = None) -> FloatArray:
        """The log-likelihood (B,) at ``values`` (B, n_parameters); NaN where there are no modes.

        Columns are as in :attr:`parameters`. Errors count as independent; where they are not,
        :class:`~bayes_ssi.inference.likelihood.correlated_errors.CorrelatedErrors` adds the rest.
        ``modes`` are the modes at ``values``, where already known.
        """
        return self.terms(values, modes).total()

    def terms(self, values: FloatArray, modes: ComparedModes | None = None) -> ModalTerms:
        """As :meth:`log_density`, in parts."""
        modes = self.compared_modes(values) if modes is None else modes
        error_var = self.prediction_var(values)
        # Far out in the tail of its prior an error size can be so small that its square is zero.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            unpaired = self._unpaired_model_modes
            return ModalTerms(
                self._frequency_terms(modes, error_var[:, :1]),
                self._shape_terms(modes, error_var[:, 1:]),
                self.log_missed(modes.frequencies_hz, error_var[:, :1], unpaired),
                self._unpaired_data,
            )

    @property
    def datum_names(self) -> tuple[str, ...]:
        """The columns of :meth:`log_likelihoods`."""
        return (*self.data.labels, MISSED)

    def log_likelihoods(self, values: FloatArray, modes: ComparedModes) -> FloatArray:
        """The log-likelihood of each datum, (B, n_data); the sum of a row is the whole.

        One column for each identified mode, paired or spurious; the last one for what was not
        identified: unpaired model modes, and no further spurious modes.
        """
        terms = self.terms(values, modes)
        spurious = [self.log_spurious(mode) for mode in self.data.modes]
        undetected = row_sums(terms.missed) - self.identification.expected_spurious_modes
        log_likelihoods = np.column_stack([np.tile(spurious, (len(values), 1)), undetected])
        column = np.array(
            [self.data.labels.index(m.label) for m in self.pairs.modes], dtype=np.intp
        )
        log_likelihoods[:, column] = terms.frequency
        log_likelihoods[:, column[self.pairs.with_shape]] += terms.shape
        return log_likelihoods

    def modes(self, values: FloatArray) -> Modes:
        """The structure's modes at ``values``, columns as in :attr:`parameters`."""
        return Modes(*self.structure.modes(values[:, : len(self.structure.parameters)]))

    def compared_modes(self, values: FloatArray, modes: Modes | None = None) -> ComparedModes:
        """The structure's modes at ``values``, or the given ones, compared with the data's."""
        modes = self.modes(values) if modes is None else modes
        # In memory the rows of the batch next to each other: columns are longer than rows.
        frequencies = np.asfortranarray(modes.frequencies_hz)
        unit, gains = np.zeros((len(values), 0)), np.zeros((len(values), 0, 0, 0))
        if not len(self.pairs.with_shape):
            return ComparedModes(frequencies, unit, unit, unit, gains)
        shapes = self.shapes_at_sensors(modes)
        distances = self.pairs.shape_distances(shapes)
        turned = np.zeros_like(distances)
        if self.error.repeats_between_tests or self.data.covariance is not None:
            unit = self.pairs.unit_model_shapes(shapes)
        close = self.close_pairs(values, frequencies)
        if close is not None:
            cases = self._cases(close, frequencies)
            mean = self._mean_over_turns(close, cases, shapes)
            i, which = np.nonzero(cases.columns >= 0)
            columns, shared = cases.columns[i, which], (cases.columns >= 0).sum(axis=0)
            at = close.rows[cases.pairs[which]], columns
            distances[at] = mean.distances[i, which]
            turned[at] = (mean.log_gains / shared)[which]
            if unit.size:
                of_turned = cases.turned(close, shapes, mean.angles)[:, i, which]
                of_columns = unit.reshape(*distances.shape, -1)
                of_columns[at] = self.pairs.unit_shapes_like(columns, of_turned)
        compared = ComparedModes(frequencies, distances, turned, unit, gains)
        if close is None:
            return compared
        return compared._replace(log_gains=self._log_gains(close, shapes, compared))

    def close_pairs(self, values: FloatArray, frequencies_hz: FloatArray) -> ClosePairs | None:
        """The pairs of model modes that turn together, at model frequencies (B, n_modes).

        None where errors are shared between tests: the turn would be, too.
        """
        if not len(self.pairs.with_shape) or self.error.repeats_between_tests:
            return None
        observed = self._observed_distances[:, None]
        order = observed if self.pairing_is_given else math.nan
        if not self.pairing_is_given:  # two may be identified, or one alone
            apart = relative_distances(frequencies_hz.T[:-1], frequencies_hz.T[1:])
            observed = np.minimum(observed, apart)
        return close_pairs(frequencies_hz, observed, self.prediction_var(values), order)

    @cached_property
    def _observed_distances(self) -> FloatArray:
        """Relative distances (n_modes - 1,) of the identified modes of neighbouring model modes.

        NaN where one of them is not identified; infinite where neither has a shape that is scored.
        """
        identified = np.full(self.structure.n_modes, np.nan)
        identified[self.pairs.model_modes] = self.pairs.frequencies_hz
        scored = np.isin(np.arange(len(identified)), self.pairs.model_modes[self.pairs.with_shape])
        distances = relative_distances(identified[1:], identified[:-1])
        return np.where(scored[1:] | scored[:-1], distances, np.inf)

    def _cases(self, close: ClosePairs, frequencies_hz: FloatArray) -> CloseCases:  # noqa: ARG002
        """The identified shapes beside close pairs, at model frequencies (B, n_modes)."""
        columns = self._columns[np.array([close.lower, close.lower + 1])]
        observed = self._observed_distances[close.lower]
        is_upper = np.array([[False], [True]])
        return CloseCases(np.arange(len(close.rows)), columns, is_upper, observed)

    @cached_property
    def _columns(self) -> NDArray[np.intp]:
        """Column (n_modes,) among scored shapes of the one that is each model mode; -1 if none."""
        columns = np.full(self.structure.n_modes, -1)
        columns[self.pairs.model_modes[self.pairs.with_shape]] = range(len(self.pairs.with_shape))
        return columns

    def _mean_over_turns(self, close: ClosePairs, cases: CloseCases, shapes: FloatArray) -> Turned:
        """Of model shapes (B, n_sensors, n_modes), at the sensors."""
        units, measured, variances = self._shapes_or_none
        turning = TurningShapes.of(
            *cases.modes(close, shapes),
            units[:, cases.columns],
            measured[:, cases.columns],
            close.variances[cases.pairs, 1] + variances[cases.columns],
        )
        return Turned.of(close.concentrations(cases.observed, cases.pairs), turning, cases.least)

    @cached_property
    def _shapes_or_none(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unit shapes (s, S + 1), where they were measured and squared errors; the last is none."""
        none = np.zeros((len(self.data.sensors), 1))
        units, measured = self.pairs.unit_shapes, self.pairs.measured
        return (
            np.hstack([units, none]),
            np.hstack([measured, none + 1.0]),
            np.append(self.pairs.shape_var, np.inf),
        )

    def turned_modes(self, values: FloatArray, modes: Modes) -> Modes:
        """Modes with close ones at their mean turn."""
        close = self.close_pairs(values, modes.frequencies_hz)
        if close is None:
            return modes
        cases = self._cases(close, modes.frequencies_hz)
        angles = self._mean_over_turns(close, cases, self.shapes_at_sensors(modes)).angles
        turned, shapes = cases.turned(close, modes.shapes, angles), np.array(modes.shapes)
        for i in (0, 1):
            shapes[close.rows, :, close.lower + i] = turned[:, i].T
        return Modes(modes.frequencies_hz, shapes)

    def given(self, pairing: Mapping[str, int]) -> "ModalLikelihood":
        """The likelihood for one pairing."""
        parts = self.structure, self.data, self.error, self.identification
        return ModalLikelihood(*parts, pairing)

    def _log_gains(
        self,
        close: ClosePairs,  # noqa: ARG002 - for inferred pairings
        shapes: FloatArray,  # noqa: ARG002
        compared: ComparedModes,
    ) -> FloatArray:
        """As :attr:`ComparedModes.log_gains`, of modes compared with each turned by itself."""
        return compared.log_gains

    def shapes_at_sensors(self, modes: Modes) -> FloatArray:
        """Model shapes reduced to the sensors, (B, n_sensors, n_modes), not normalised.

        Zero where a sensor does not see a mode, which then resembles no shape identified there.
        """
        return seen_shapes(self._sensor_matrix.apply(modes.shapes))

    def prediction_var(self, values: FloatArray) -> FloatArray:
        """Squared prediction errors (B, 1 or 2) of frequencies and, where scored, shapes.

        One row, (1, 1 or 2), where no parameter enters them.
        """
        fixed = self._fixed_var
        return self._size_table.evaluate(values) ** 2 if fixed is None else fixed

    @cached_property
    def _fixed_var(self) -> FloatArray | None:
        """As :meth:`prediction_var`, where no parameter enters it."""
        if any(size.parameters for size in self._sizes):
            return None
        return np.array([[size.scale for size in self._sizes]]) ** 2

    @cached_property
    def _size_table(self) -> ProductTable:
        return ProductTable(self._sizes, self.parameters)

    def standard_errors(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard errors of the paired frequencies (B, P), as fractions, and shapes (B, S)."""
        prediction_var = self._size_table.evaluate(values) ** 2
        frequency_sds = np.sqrt(prediction_var[:, :1] + self.pairs.frequency_var)
        return frequency_sds, np.sqrt(prediction_var[:, -1:] + self.pairs.shape_var)

    def least_errors(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Smallest standard errors (B,) of a paired frequency and of a paired shape.

        They combine identification and prediction errors, and are infinite where no mode is
        paired or no shape is scored. Where errors are correlated, this is the error of the
        difference between modes or tests that the data determine best.
        """
        own = self.pairs.frequency_var, self.pairs.shape_var
        if self.joint_pairs is not None:
            own = self.joint_pairs.least_variances
        tests, modes = ProductTable(self.error.correlations, self.parameters).evaluate(values).T
        # The smallest eigenvalue of the correlation matrix is 1 - ρ for one correlation for all,
        # and above (1 - ρ)/(1 + ρ) for ρ^|i - j|. Shapes of different modes err independently.
        independent = (1.0 - tests) * (1.0 - modes) / (1.0 + modes), 1.0 - tests
        prediction_var = self.prediction_var(values)
        frequency, shape = (
            np.sqrt(prediction_var[:, column] * share + variances.min(initial=np.inf))
            for column, share, variances in zip((0, -1), independent, own, strict=True)
        )
        return frequency, shape

    def log_missed(
        self, frequencies_hz: FloatArray, prediction_var: FloatArray, which: Sequence[int]
    ) -> FloatArray:
        """Log probability (B, len(which)) that these model modes, from 0, are missed.

        ``frequencies_hz`` (B, n_modes) are those of all, ``prediction_var`` (B, 1).
        """
        if not which:
            return np.zeros((len(frequencies_hz), 0))
        variances = prediction_var + self._typical_frequency_var
        frequencies = frequencies_hz.T[which].T
        return self.identification.log_missed(frequencies, variances, self.data.band_hz)

    def log_spurious(self, mode: IdentifiedMode) -> float:
        """The log density of an identified mode that belongs to no model mode."""
        low, high = self.data.band_hz
        density = math.log(self.identification.expected_spurious_modes / (high - low))
        return density - (log_sphere_area(mode.n_measured) if mode.scored_shape is not None else 0)

    @cached_property
    def _typical_frequency_var(self) -> float:
        """Squared identification error assumed for modes that were not identified."""
        return float(np.mean([(mode.frequency_cov or 0.0) ** 2 for mode in self.data.modes]))

    def at_band_edge(self, values: FloatArray, frequencies: FloatArray) -> NDArray[np.bool_]:
        """Whether each model mode is unpaired and at the edge of the band, (B, n_modes).

        A mode is at the edge within two standard errors of a limit other than zero.
        ``frequencies`` (B, n_modes), in Hz, are the model frequencies at ``values``.
        """
        prediction_var = self.prediction_var(values)[:, :1]
        reach = 2.0 * np.sqrt(prediction_var + self._typical_frequency_var) * frequencies
        limits = [limit for limit in self.data.band_hz if limit > 0]
        near = [np.abs(frequencies - limit) < reach for limit in limits]
        return np.any(near, axis=0) & self._is_unpaired(values)

    def _is_unpaired(self, values: FloatArray) -> NDArray[np.bool_]:  # noqa: ARG002
        """Whether each model mode is paired with nothing, (B or 1, n_modes)."""
        return np.isin(np.arange(self.structure.n_modes), self._unpaired_model_modes)[None]

    @cached_property
    def joint_pairs(self) -> JointPairs | None:
        """The errors of single pairs; None where the data have no joint covariance."""
        if self.data.covariance is None or not self.pairs.modes:
            return None
        return JointPairs(self.data, self.pairs)

    def residuals(
        self, values: FloatArray, modes: ComparedModes
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What :attr:`joint_pairs` need."""
        frequencies = self.pairs.frequency_residuals(modes.frequencies_hz)
        return frequencies, modes.unit_shapes, self.prediction_var(values)

    def _frequency_terms(self, modes: ComparedModes, prediction_var: FloatArray) -> FloatArray:
        variance = prediction_var + self.pairs.frequency_var
        residuals = self.pairs.frequency_residuals(modes.frequencies_hz)
        terms = residuals * residuals / variance + np.log(variance)
        return self._frequency_constants - 0.5 * terms

    @cached_property
    def _frequency_constants(self) -> FloatArray:
        detected = math.log(self.identification.detection_probability)
        return detected - 0.5 * math.log(2.0 * math.pi) - np.log(self.pairs.frequencies_hz)

    def _shape_terms(self, modes: ComparedModes, prediction_var: FloatArray) -> FloatArray:
        if not len(self.pairs.with_shape):
            return modes.shape_distances
        variance = prediction_var + self.pairs.shape_var
        normalisers = self._fixed_normalisers
        if normalisers is None:
            normalisers = self._log_normalisers(variance)
        return modes.turned - modes.shape_distances / variance - normalisers

    @cached_property
    def _fixed_normalisers(self) -> FloatArray | None:
        """As :meth:`_log_normalisers`, where no parameter enters them."""
        fixed = self._fixed_var
        return None if fixed is None else self._log_normalisers(fixed[:, 1:] + self.pairs.shape_var)

    def _log_normalisers(self, variance: FloatArray) -> FloatArray:
        """log Z_d(σ) for shape variances (B, S), computed once for shapes with one error."""
        kinds = list(zip(self.pairs.shape_var.tolist(), self.pairs.n_measured, strict=True))
        known = {kind: log_shape_normaliser(np.sqrt(variance[:, kinds.index(kind)]), kind[1])
                 for kind in set(kinds)}  # fmt: skip
        return np.array([known[kind] for kind in kinds]).T

    @cached_property
    def _unpaired_data(self) -> float:
        unpaired = [mode for mode in self.data.modes if mode.label not in self.pairing]
        return sum(map(self.log_spurious, unpaired)) - self.identification.expected_spurious_modes

    @cached_property
    def _sensor_matrix(self) -> SensorMatrix:
        return self.structure.sensor_matrix(self.data.sensors)

    @cached_property
    def _unpaired_model_modes(self) -> list[int]:
        return sorted(set(range(self.structure.n_modes)) - set(self.pairs.model_modes.tolist()))
