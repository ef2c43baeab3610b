"""The model at posterior draws: its modes in each configuration, and the data one by one.

Tables, drawings and reports of a stored result are made from the records of modes, before and after
updating: they need neither the study nor its structures. Packages that compare or criticise models
ask for log-likelihoods and predictions of single data: leave-one-out cross-validation for the
first, posterior predictive checks for the second.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, IntArray, Places, evenly_spaced_indices, joined
from bayes_ssi.foundations.summaries import LEVELS
from bayes_ssi.inference.likelihood.likelihood import ComparedModes, ModalLikelihood
from bayes_ssi.inference.likelihood.paired_modes import PairedModes
from bayes_ssi.inference.likelihood.pairings import InferredPairing
from bayes_ssi.inference.model_class.configuration import Configuration, label_in, modes_with_shape
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.structures.modal import Modes, scaled_shapes, shape_signs

DRAWS_OF_INTERVALS = 200  # enough for a plot, at a small part of the sampling's cost
MOST_PLACES = 100  # with more degrees of freedom, shapes are kept at the sensors only
FAR_TURN = 0.2  # standard deviation in radians, from which a turn is remarked on

Interval = tuple[float, float, float]


@dataclass(frozen=True)
class UpdatedMode:
    """One paired mode, at the prior medians and over the posterior.

    Where the pairing was inferred, every draw has its own, as the order of model modes may change;
    draws that leave the mode out are left out. Intervals are the lower end, the median and the
    upper end of the central 90 %.

    Shapes are scaled by :func:`~bayes_ssi.structures.modal.scaled_shapes` and turned to the
    identified ones. Close modes are those of the pair at its mean turn, as their MACs are
    (:mod:`~bayes_ssi.inference.likelihood.close_modes`).
    """

    label: str
    model_mode: int  # number of the model mode, from 1, in the most probable pairing
    before_hz: float
    after_hz: Interval
    # MAC with the identified shape, at the prior medians; None where none is scored.
    mac_before: float | None
    mac_after: Interval | None  # interval of the MAC; None where none is scored
    # Interval of each component, (low, median, high) of (n_places,) each.
    shape_after: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True)
class UpdatedModes:
    places: tuple[str, ...]  # degrees of freedom at which shapes are given
    appendages: tuple[str, ...]
    modes: tuple[UpdatedMode, ...]


@dataclass(frozen=True)
class ConfigurationModes:
    name: str  # name of the configuration; empty where there is only one and it has no name
    n_modes: int
    # Label of an identified mode → number of the model mode, from 1; where it was inferred, the
    # most probable one.
    pairing: Mapping[str, int]
    # Probabilities of pairings; None where the pairing was given.
    inferred_pairing: InferredPairing | None
    updated: UpdatedModes


def configuration_modes(
    model_class: ModelClass, values: FloatArray
) -> tuple[ConfigurationModes, ...]:
    """The modes of a class at the posterior draws ``values`` (n, n_parameters)."""
    records = []
    # The prior medians are the first row, ahead of the draws.
    at = np.concatenate([model_class.values(np.zeros((1, values.shape[1]))), values])
    chosen = np.concatenate([[0], 1 + evenly_spaced_indices(len(values), DRAWS_OF_INTERVALS)])
    for configuration, likelihood, columns in model_class.parts(at):
        inferred = likelihood.inferred_pairing(columns[1:])
        pairing = dict(inferred.best if inferred else likelihood.pairing)
        n_modes = configuration.structure.n_modes
        updated = _updated_modes(configuration, likelihood, pairing, columns[chosen])
        records.append(ConfigurationModes(configuration.name, n_modes, pairing, inferred, updated))
    return tuple(records)


def _updated_modes(
    test: Configuration, likelihood: ModalLikelihood, pairing: Mapping[str, int], at: FloatArray
) -> UpdatedModes:
    """The paired modes at the prior medians, the first row of ``at``, and at draws, the others."""
    structure, data = test.structure, test.data
    modes = likelihood.modes(at)
    compared = likelihood.compared_modes(at, modes)
    pairs = likelihood.sampled_pairs(at, compared, np.random.default_rng(0))
    numbers = np.append(likelihood.pairs.model_modes, -1)[pairs]
    modes = _turned(likelihood, at, modes, numbers)
    seen = likelihood.shapes_at_sensors(modes)
    all_places, places = structure.degrees_of_freedom, structure.degrees_of_freedom
    if len(all_places) > MOST_PLACES:
        places = tuple(sensor for sensor in data.sensors if sensor in all_places)
    shown = [all_places.index(place) for place in places]
    main = [i for i, place in enumerate(all_places) if place not in structure.appendages]
    records = []
    for label, of_rows in zip(data.labels, numbers.T, strict=True):
        if label not in pairing:
            continue
        rows, own = _rows_with_mode(of_rows, pairing[label] - 1)
        whole, at_sensors = modes.shapes[rows, :, own], seen[rows, :, own]
        signs = shape_signs(whole[:, main], at_sensors, data.mode(label).unit_shape)
        shapes = scaled_shapes(whole[:, shown] * signs[:, None], whole[:, main])
        frequencies = modes.frequencies_hz[rows, own]
        pair = PairedModes.of(data, [(label, 1)])
        macs = (1.0 - pair.shape_distances(at_sensors[:, :, None])) ** 2
        low, median, high = map(tuple, _interval(shapes[1:]))
        records.append(
            UpdatedMode(
                label=label,
                model_mode=pairing[label],
                before_hz=float(frequencies[0]),
                after_hz=_interval(frequencies[1:]),
                mac_before=float(macs[0, 0]) if macs.size else None,
                mac_after=_interval(macs[1:, 0]) if macs.size else None,
                shape_after=(low, median, high),
            )
        )
    appendages = tuple(place for place in places if place in structure.appendages)
    return UpdatedModes(places, appendages, tuple(records))


def _turned(likelihood: ModalLikelihood, at: FloatArray, modes: Modes, numbers: IntArray) -> Modes:
    """Modes with close ones at their mean turn, each row in its own pairing, ``numbers`` (B, J)."""
    shapes = np.array(modes.shapes)
    for chosen in np.unique(numbers, axis=0):
        rows = np.flatnonzero((numbers == chosen).all(axis=1))
        named = zip(likelihood.data.labels, (chosen + 1).tolist(), strict=True)
        given = likelihood.given({label: number for label, number in named if number})
        own = Modes(modes.frequencies_hz[rows], modes.shapes[rows])
        shapes[rows] = given.turned_modes(at[rows], own).shapes
    return Modes(modes.frequencies_hz, shapes)


def _rows_with_mode(numbers: IntArray, usual: int) -> tuple[IntArray, IntArray]:
    """Rows in which an identified mode is paired, and the model mode that it is in each, from 0.

    The order of model modes may change from draw to draw, and the pairing with it: where it was
    inferred, every draw has its own, by its probability. Draws that leave the mode out are left
    out; the prior medians, the first row, never are. ``numbers`` (n,) are -1 where it is left out.
    """
    numbers = np.append(usual if numbers[0] < 0 else numbers[0], numbers[1:])
    rows = np.flatnonzero(numbers >= 0)
    if len(rows) == 1:  # the few draws taken here all leave it out
        return np.arange(len(numbers)), np.full(len(numbers), usual)
    return rows, numbers[rows]


def _interval(draws: FloatArray) -> Any:
    """The ends of the interval and the median between them, of draws (n,) or of each column."""
    return tuple(np.quantile(draws, LEVELS, axis=0).tolist())


class AtDraws(NamedTuple):
    """The model at B draws; columns run through all configurations in turn."""

    modes: tuple[ComparedModes, ...]  # of each configuration
    log_likelihoods: FloatArray  # (B, n_data), log-likelihood of each datum
    # (B, n_components), shapes at the sensors of the modes that the likelihood compares and their
    # neighbours: sensor by sensor, and mode by mode.
    sensor_shapes: FloatArray

    @property
    def frequencies_hz(self) -> FloatArray:
        """Model frequencies (B, n_modes)."""
        return np.concatenate([of_test.frequencies_hz for of_test in self.modes], axis=1)

    def rows(self, which: Places) -> "AtDraws":
        modes = tuple(of_test.rows(which) for of_test in self.modes)
        return AtDraws(modes, self.log_likelihoods[which], self.sensor_shapes[which])

    @classmethod
    def joined(cls, parts: "Sequence[AtDraws]") -> "AtDraws":
        modes, *arrays = zip(*parts, strict=True)
        return cls(tuple(map(joined, zip(*modes, strict=True))), *map(np.concatenate, arrays))


@dataclass(frozen=True, eq=False)
class DatumTerms:
    """A posterior datum by datum; labels of several configurations begin with their names."""

    # Names of the data: each identified mode, and the absence of others; or together the modes
    # whose errors are correlated, and all modes of a test whose pairing was inferred.
    data: tuple[str, ...]
    log_likelihoods: FloatArray  # (n_chains, n_steps, n_data); they add up to the log-likelihood
    identified: tuple[str, ...]
    identified_hz: FloatArray  # (n_identified,)
    # (n_chains, n_steps, n_identified), identified frequencies drawn from the class: the paired
    # model frequency with its error, or, for a mode that it calls spurious, anything in the band.
    # An inferred pairing is the most probable one.
    predicted_hz: FloatArray


def at_draws(model_class: ModelClass, values: FloatArray) -> AtDraws:
    """The model at ``values`` (B, n_parameters), its modes computed once."""
    of_tests, log_likelihoods, sensor_shapes = [], [], []
    for test, likelihood, columns in model_class.parts(values):
        modes = likelihood.modes(columns)
        of_tests.append(likelihood.compared_modes(columns, modes))
        log_likelihoods.append(likelihood.log_likelihoods(columns, of_tests[-1]))
        compared_shapes = modes_with_shape(test.data, test.pairing, test.structure.n_modes)
        shapes = likelihood.shapes_at_sensors(modes)[:, :, compared_shapes]
        sensor_shapes.append(shapes.reshape(len(values), -1))
    terms = np.concatenate(log_likelihoods, axis=1)
    groups = _joint_columns(model_class)
    if groups:
        ratios = model_class.correlated_errors.log_ratios(values, of_tests)
        for group, ratio in zip(groups, ratios.T, strict=True):
            terms[:, group[0]] = terms[:, group].sum(axis=1) + ratio
        others = [column for group in groups for column in group[1:]]
        terms = np.delete(terms, others, axis=1)
    return AtDraws(tuple(of_tests), terms, np.concatenate(sensor_shapes, axis=1))


def remarks_on_close_modes(
    model_class: ModelClass, values: FloatArray, model: AtDraws
) -> Iterator[str]:
    """Model modes that turn far together at draws ``values`` (n, n_parameters), a sentence each."""
    parts = zip(model_class.parts(values), model.modes, strict=True)
    for (test, likelihood, columns), modes in parts:
        close = likelihood.close_pairs(columns, modes.frequencies_hz)
        if close is None:
            continue
        n = len(close.rows)
        turns = 0.5 / np.sqrt(close.concentrations(np.full(n, np.nan), np.arange(n)))
        for number in np.unique(close.lower).tolist():
            far = (close.lower == number) & (turns > FAR_TURN)
            if far.sum() > 0.5 * len(values):
                yield label_in(
                    test.name,
                    f"model modes {number + 1} and {number + 2}, "
                    f"{100 * float(np.median(close.distances[far])):.2g} % apart, turn together in "
                    "their plane: the shape of one by itself says little, and MACs and drawings "
                    "are those of the pair as it is turned",
                )


def _joint_columns(model_class: ModelClass) -> list[list[int]]:
    """The columns of separate terms, all tests in turn, that correlated errors join."""
    errors = model_class.correlated_errors
    first = np.cumsum([0, *(len(own.datum_names) for own in model_class.likelihoods)])
    columns = [
        int(first[mode.test]) + model_class.likelihoods[mode.test].data.labels.index(mode.label)
        for mode in errors.modes
    ]
    return [[columns[position] for position in group] for group in errors.groups]


def datum_terms(
    model_class: ModelClass,
    values: FloatArray,
    model: AtDraws,
    pairings: Sequence[Mapping[str, int]],
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> DatumTerms:
    """The posterior of a class at all draws ``values`` (n, n_parameters), datum by datum.

    ``shape`` is (n_chains, n_steps).
    """
    identified: list[str] = []
    centres, normals, sds = [], [], []
    parts = zip(model_class.parts(values), model.modes, pairings, strict=True)
    for (configuration, likelihood, columns), modes, pairing in parts:
        own = np.array([mode.frequency_cov or 0.0 for mode in configuration.data.modes])
        variances = likelihood.prediction_var(columns)[:, :1] + own**2
        of_test = np.sqrt(variances) * configuration.data.frequencies_hz
        sds.append(np.broadcast_to(of_test, (len(values), len(own))))
        for label in configuration.data.labels:
            identified.append(label_in(configuration.name, label))
            if label in pairing:
                centres.append(modes.frequencies_hz[:, pairing[label] - 1])
                normals.append(rng.standard_normal(len(values)))
            else:
                centres.append(rng.uniform(*configuration.data.band_hz, len(values)))
                normals.append(np.zeros(len(values)))
    numbers = np.stack(normals, axis=-1)
    errors = model_class.correlated_errors
    if errors.groups:
        paired = numbers[:, errors.identified]
        numbers[:, errors.identified] = errors.correlated_normals(paired, values)
    predicted = np.stack(centres, axis=-1) + np.concatenate(sds, axis=1) * numbers
    return DatumTerms(
        tuple(_datum_names(model_class)),
        model.log_likelihoods.reshape(*shape, -1),
        tuple(identified),
        np.concatenate([test.data.frequencies_hz for test in model_class.configurations]),
        predicted.reshape(*shape, -1),
    )


def _datum_names(model_class: ModelClass) -> list[str]:
    """Names of the columns of log-likelihoods; a joint one has the names of all its data."""
    tests = zip(model_class.configurations, model_class.likelihoods, strict=True)
    names = [label_in(test.name, name) for test, own in tests for name in own.datum_names]
    others: list[int] = []
    for first, *rest in _joint_columns(model_class):
        names[first] = " and ".join(names[column] for column in (first, *rest))
        others += rest
    return [name for column, name in enumerate(names) if column not in others]
