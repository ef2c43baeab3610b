"""Mistakes in the data, or in the pairing, that a model class can be tried without."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from bayes_ssi.inference.model_class.configuration import Configuration, joint_digest, label_in
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.measurements.modes.modal_data import ModalData

Change = Callable[[ModalData], ModalData]

# A scanning instrument has no channels to exchange, and pairs grow with the square of the number.
MOST_CHANNELS = 50
# What brings frequencies in other units, or converted once too often, to Hz.
UNITS = {
    1.0 / (2.0 * math.pi): "frequencies seem to be in rad/s, not in Hz",
    2.0 * math.pi: "frequencies seem to be divided by 2π once too often",
    1.0 / 60.0: "frequencies seem to be per minute, not per second",
    60.0: "frequencies seem to be divided by 60 once too often",
    **{
        10.0**k: f"frequencies seem to be {10.0**-k:g} times what they are in Hz"
        for k in (-3, -2, -1, 1, 2, 3)
    },
}


@dataclass(frozen=True, eq=False)
class Repair:
    """A model class with one mistake undone."""

    mistake: str  # what seems to be wrong, in words; empty for a pairing, which the fit shows
    original: ModelClass
    configurations: tuple[Configuration, ...]
    # Log density of the original data over that of the changed ones; not zero where frequencies are
    # scaled.
    log_scale: float = 0.0
    # The pairing of each configuration before it was inferred.
    given_pairings: tuple[Pairing, ...] = ()

    @cached_property
    def model_class(self) -> ModelClass:
        """The class without the mistake; of hundreds of repairs, few are fitted and need one."""
        return replace(self.original, configurations=self.configurations)

    @property
    def data_digest(self) -> str:
        return joint_digest({test.name: test.data for test in self.configurations})


def repairs_of_shapes(model_class: ModelClass) -> list[Repair]:
    """Each two sensors exchanged and each sensor's sign turned, in one test and in all of them."""
    changes = [
        (mistake + where, tests, change)
        for where, tests in _tests(model_class)
        for mistake, change in _changes([test.data for test in tests])
    ]
    return _different(model_class, changes)


def repairs_of_single_shapes(model_class: ModelClass) -> list[Repair]:
    """Each two sensors exchanged and each sensor's sign turned, in one mode only."""
    changes = [
        (f"{mistake} in mode {label_in(test.name, mode.label)!r}", [test], change)
        for test in model_class.configurations
        for mode in test.data.modes
        if mode.scored_shape is not None
        for mistake, change in _changes([test.data], mode.label)
    ]
    return _different(model_class, changes)


def _changes(tests: Sequence[ModalData], label: str | None = None) -> Iterator[tuple[str, Change]]:
    """Mistakes in the sensors that all tests have, in one mode or in all, and what undoes them."""
    sensors = [s for s in tests[0].sensors if all(s in data.sensors for data in tests)]
    if len(sensors) <= MOST_CHANNELS:
        for a, b in combinations(sensors, 2):
            exchanged = partial(_with_shapes, {a: b, b: a}, "", label)
            yield f"channels {a!r} and {b!r} seem to be exchanged", exchanged
    for sensor in sensors:
        turned = partial(_with_shapes, {}, sensor, label)
        yield f"the sign of {sensor!r} seems to be wrong", turned


def _with_shapes(
    other: Mapping[str, str], turned: str, label: str | None, data: ModalData
) -> ModalData:
    """Data in which sensors stand for ``other`` ones, or one is ``turned``, in one mode or all."""
    order = [data.sensors.index(other.get(sensor, sensor)) for sensor in data.sensors]
    signs = np.where(np.array(data.sensors) == turned, -1.0, 1.0)
    modes = (
        replace(mode, shape=signs * mode.shape[order])
        if mode.shape is not None and label in (None, mode.label)
        else mode
        for mode in data.modes
    )
    return replace(data, modes=tuple(modes))


def _different(
    model_class: ModelClass, changes: Sequence[tuple[str, list[Configuration], Change]]
) -> list[Repair]:
    """The changed classes; changes that come to the same are one, as two signs of two sensors."""
    by_digest: dict[str, Repair] = {}
    for mistake, tests, change in changes:
        repair = Repair(mistake, model_class, _with_data(model_class, tests, change))
        digest = repair.data_digest
        if same := by_digest.get(digest):
            repair = replace(repair, mistake=f"{same.mistake}, or {mistake}")
        by_digest[digest] = repair
    by_digest.pop(model_class.data_digest, None)
    return list(by_digest.values())


def repairs_of_frequencies(model_class: ModelClass) -> list[Repair]:
    """All frequencies in another unit, in one test and in all of them."""
    return [
        _scaled(model_class, tests, factor, mistake + where)
        for where, tests in _tests(model_class)
        for factor, mistake in UNITS.items()
    ]


def common_factor(model_class: ModelClass) -> Iterator[Repair]:
    """All frequencies times the factor that fits the model at its prior medians best."""
    for where, tests in _tests(model_class):
        logs = []
        medians = model_class.values(np.zeros((1, len(model_class.parameters))))
        for test, likelihood, own in model_class.parts(medians):
            if test in tests and likelihood.pairing:
                model_hz = likelihood.modes(own).frequencies_hz
                logs += np.log1p(likelihood.pairs.frequency_residuals(model_hz)[0]).tolist()
        if logs:
            factor = math.exp(sum(logs) / len(logs))
            words = f"all frequencies seem to be {1.0 / factor:.3g} times what they should be"
            yield _scaled(model_class, tests, factor, words + where)


def repair_of_pairing(model_class: ModelClass) -> Iterator[Repair]:
    """The pairing inferred where it was given; none where errors that repeat forbid that."""
    if model_class.error.is_correlated:
        return
    if any(test.pairing != "any" for test in model_class.configurations):
        given = tuple(test.pairing for test in model_class.configurations)
        changed = model_class.with_any_pairing(model_class.name)
        yield Repair("", model_class, changed.configurations, given_pairings=given)


def _tests(model_class: ModelClass) -> Iterator[tuple[str, list[Configuration]]]:
    """Where a mistake may be: in all tests together, in words, or in one of several."""
    tests = list(model_class.configurations)
    yield ("" if len(tests) == 1 else " in all configurations"), tests
    if len(tests) > 1:
        yield from ((f" in configuration {test.name!r}", [test]) for test in tests)


def _with_data(
    model_class: ModelClass, tests: list[Configuration], change: Change
) -> tuple[Configuration, ...]:
    return tuple(
        replace(test, data=change(test.data)) if test in tests else test
        for test in model_class.configurations
    )


def _scaled(
    model_class: ModelClass, tests: list[Configuration], factor: float, mistake: str
) -> Repair:
    """Frequencies and band times a factor, by which densities of frequencies are divided."""

    def change(data: ModalData) -> ModalData:
        low, high = data.band_hz
        modes = (replace(mode, frequency_hz=factor * mode.frequency_hz) for mode in data.modes)
        return replace(data, modes=tuple(modes), band_hz=(factor * low, factor * high))

    n_scaled = sum(len(test.data.modes) for test in tests)
    changed = _with_data(model_class, tests, change)
    return Repair(mistake, model_class, changed, n_scaled * math.log(factor))
