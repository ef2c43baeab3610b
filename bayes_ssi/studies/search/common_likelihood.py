"""Log-likelihoods of model classes that compare modes with the data alike, in common batches.

Such as hypotheses that differ in where a feature is: their modes differ, what follows does not.
"""

from collections.abc import Callable, Hashable, Sequence

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, IntArray, joined
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.structures.finite_elements.projected_structure import all_but_places, modes_at_places
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Structure

ROWS_IN_CACHE = 256  # more rows of a batch leave the processor's cache

# The number of a class, and coordinates (B, d).
Question = tuple[int, FloatArray]


def in_common(model_class: ModelClass) -> Hashable:
    """What classes have in common whose log-likelihoods :func:`common_log_likelihoods` has."""
    numbers = np.arange(float(len(model_class.parameters)))[None]
    columns = [own.tobytes() for _, _, own in model_class.parts(numbers)]
    of_tests = map(_of_test, model_class.configurations)
    return id(model_class.error), id(model_class.identification), *columns, *of_tests


def _of_test(test: Configuration) -> Hashable:
    structure, pairing = test.structure, test.pairing
    sensors = structure.sensor_matrix(test.data.sensors)
    return (
        id(test.data),
        pairing if isinstance(pairing, str) else tuple(pairing.items()),
        all_but_places(structure),
        len(structure.degrees_of_freedom),
        structure.n_modes,
        len(structure.parameters),
        tuple(structure.shape_variances.items()),
        sensors.rows.tobytes(),
        sensors.weights.tobytes(),
    )


def common_log_likelihoods(
    classes: Sequence[ModelClass],
) -> Callable[[Sequence[Question]], Sequence[FloatArray | Exception]]:
    """Log-likelihoods (B,) for each of several questions; what a class raised where one did.

    The classes have :func:`in_common` in common.
    """
    first = classes[0]
    tests = zip(*(each.configurations for each in classes), strict=True)
    of_tests = [_modes_of_rows([test.structure for test in of_test]) for of_test in tests]

    def of_rows(values: FloatArray, which: IntArray) -> FloatArray:
        modes = [
            modes_of(own[:, : len(test.structure.parameters)], which)
            for modes_of, (test, _, own) in zip(of_tests, first.parts(values), strict=True)
        ]
        return first.log_density_of_modes(values, modes)

    def together(questions: Sequence[Question]) -> list[FloatArray]:
        lengths = [len(z) for _, z in questions]
        which = np.repeat([i for i, _ in questions], lengths)
        values = np.concatenate([classes[i].values(z) for i, z in questions])
        begins, n = range(0, len(which), ROWS_IN_CACHE), ROWS_IN_CACHE
        rows = np.concatenate([of_rows(values[i : i + n], which[i : i + n]) for i in begins])
        return np.split(rows, np.cumsum(lengths[:-1]))

    def alone(question: Question) -> FloatArray | Exception:
        i, z = question
        try:
            return classes[i].log_likelihood_at(z)
        except Exception as error:  # noqa: BLE001 - whatever a user's structure may raise
            return error

    def of_all(questions: Sequence[Question]) -> Sequence[FloatArray | Exception]:
        try:
            return together(questions)
        except Exception:  # noqa: BLE001 - by one of them, which raises it again
            return [alone(question) for question in questions]

    return of_all


def _modes_of_rows(structures: Sequence[Structure]) -> Callable[[FloatArray, IntArray], Modes]:
    """The modes (B, ...) of structures ``which`` (B,), in runs, at values (B, n_parameters)."""
    if all_but_places(structures[0]) is not None:
        return modes_at_places(structures)

    def modes(values: FloatArray, which: IntArray) -> Modes:
        runs = np.split(np.arange(len(which)), np.flatnonzero(np.diff(which)) + 1)
        return joined([Modes(*structures[which[run[0]]].modes(values[run])) for run in runs])

    return modes
