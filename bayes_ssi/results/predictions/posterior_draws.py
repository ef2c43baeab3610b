"""Posterior draws of one model class with its structure, and draws of what they predict."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.argument_types import checked, require_known
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.displayed import Displayed, counted
from bayes_ssi.foundations.summaries import LEVEL
from bayes_ssi.inference.likelihood.joint_errors import ModeOfTest
from bayes_ssi.inference.likelihood.likelihood import ModalLikelihood
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.structures.modal import Modes
from bayes_ssi.structures.structure import Requirement, Structure

# Numbers that decide how predictions are computed and shown.
DRAWS_OF_A_PREDICTION = 1000  # of a prediction, by default
# Numbers in the largest array of a batch of draws: 2e7 of 8 bytes are 160 MB.
ARRAY_SIZE = 20_000_000
# Of an approximate structure at the draws, at most, and ``SHAPE_ERROR``.
FREQUENCY_ERROR = 1e-4
SHAPE_ERROR = 0.01
# Of frequencies that an approximate structure gave, relative to the largest at the few draws
# where it is known, at most.
STORED_ERROR = 4.0
# Of transfer functions; of a thousand draws at more, they take minutes.
MOST_FREQUENCIES = 6000
MOST_PLACES = 60  # in a table; where there are more, those with sensors are shown alone


class Band(NamedTuple):
    """A central interval at every point of a prediction, and the median."""

    low: FloatArray
    median: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Displayed):
    """Draws of a predicted quantity, equally weighted.

    Attributes:
        draws: (n_draws, ...).
        share: of the draws that predict the quantity; below 1 where classes do not explain a mode.
    """

    draws: FloatArray
    share: float = 1.0

    def band(self, level: float = LEVEL) -> Band:
        """The central interval that holds ``level`` of the draws, point by point.

        Raises:
            ValueError: the level is not strictly between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"band: level must lie strictly between 0 and 1, got {level!r}")
        levels = [0.5 * (1.0 - level), 0.5, 0.5 * (1.0 + level)]
        return Band(*np.quantile(self.draws, levels, axis=0))

    def _line(self) -> str:
        return f"{counted(len(self.draws), 'draw')} of shape {self.draws.shape[1:]}"

    def _rows(self) -> list[dict[str, Any]]:
        bands = zip(*(part.ravel().tolist() for part in self.band()), strict=True)
        return [dict(zip(("5 %", "median", "95 %"), band, strict=True)) for band in bands]


@dataclass(frozen=True, eq=False)
class PosteriorDraws:
    """Posterior draws of the parameters of one configuration of a model class."""

    name: str
    likelihood: ModalLikelihood  # with the pairing, or the most probable one
    of_likelihood: FloatArray  # (n_draws, n_parameters), parameter values of the likelihood

    @property
    def structure(self) -> Structure:
        return self.likelihood.structure

    @property
    def pairing(self) -> Mapping[str, int]:
        """Label of an identified mode → number of the model mode, from 1."""
        return self.likelihood.pairing

    @property
    def values(self) -> FloatArray:
        """(n_draws, n_parameters), parameter values of the structure."""
        return self.of_likelihood[:, : len(self.structure.parameters)]

    @property
    def main_places(self) -> tuple[str, ...]:
        """Degrees of freedom of the main structure."""
        appendages = self.structure.appendages
        return tuple(dof for dof in self.structure.degrees_of_freedom if dof not in appendages)

    @cached_property
    def frequencies_hz(self) -> FloatArray:
        """(n_draws, n_modes)."""
        return self.evaluate(lambda x: Modes(*self.structure.modes(x)).frequencies_hz, self.values)

    def shapes(self, number: int, places: Sequence[str]) -> FloatArray:
        """The shape of a model mode at places, (n_draws, n_places), in the structure's scale.

        Close modes are at their mean turn.
        """
        matrix = self.structure.sensor_matrix(places, "place")

        def at_places(values: FloatArray) -> FloatArray:
            turned = self.likelihood.turned_modes(values, self.likelihood.modes(values))
            return matrix.apply(turned.shapes[:, :, number - 1])

        return self.evaluate(at_places, self.of_likelihood)

    def evaluate(
        self, function: Callable[[FloatArray], FloatArray], values: FloatArray, size: int = 0
    ) -> FloatArray:
        """A function of parameter values (n, n_parameters), batch by batch.

        ``size`` is that of its largest array for each draw, in numbers, if that is larger than the
        mode shapes.
        """
        shapes_size = max(1, len(self.structure.degrees_of_freedom)) * self.structure.n_modes
        rows = max(1, ARRAY_SIZE // max(shapes_size, size))
        # The matrices of a draw are small: threads inside BLAS would only wait for one another.
        with threadpool_limits(limits=1, user_api="blas"):
            return np.concatenate(
                [function(values[start : start + rows]) for start in range(0, len(values), rows)]
            )


def thinned_draws(
    posterior: Posterior,
    model_class: ModelClass,
    n_draws: int = DRAWS_OF_A_PREDICTION,
    configuration: str | None = None,
) -> PosteriorDraws:
    """Draws of a posterior, thinned evenly to ``n_draws``, with the class's structure."""
    if n_draws < 1:
        raise ValueError(f"predictions: the number of draws must be at least 1, got {n_draws!r}")
    test = model_class.configuration(configuration)
    structure = test.structure
    of_test = model_class.likelihoods[model_class.configurations.index(test)]
    names = [parameter.name for parameter in of_test.parameters]
    changed = f"model class {posterior.name!r} is not the one that was sampled"
    require_known(f"{changed}: no stored parameter", names, posterior.parameter_names)
    require_known(f"{changed}: no stored configuration", [test.name], posterior.configuration_names)
    columns = [posterior.parameter_names.index(name) for name in names]
    rows = thinned_rows(len(posterior.values), n_draws)
    of_likelihood = posterior.values[rows][:, columns]
    values = of_likelihood[:, : len(structure.parameters)]
    model_class.check_structure()
    # Another machine reproduces frequencies up to rounding errors. Sampling made an approximate
    # structure accurate at its draws; the same is done here.
    tolerance = max(1e-6, STORED_ERROR * posterior.frequency_error)
    if structure.is_approximate:
        tolerance = FREQUENCY_ERROR
        structure = structure.accurate_at(Requirement(values, tolerance, SHAPE_ERROR))
    modes, stored_hz = posterior.configuration(test.name)
    some = slice(0, 8)  # enough to notice another structure, few enough to cost nothing
    stored_hz = stored_hz.reshape(len(posterior.values), -1)[rows[some]]
    frequencies_hz = structure.modes(values[some]).frequencies_hz
    is_alike = frequencies_hz.shape == stored_hz.shape
    if not (is_alike and np.allclose(frequencies_hz, stored_hz, rtol=tolerance, atol=0)):
        now, stored = (
            ", ".join([f"{f:.4g}" for f in hz[0, :6]] + ["..."] * (hz.shape[1] > 6))
            for hz in (frequencies_hz, stored_hz)
        )
        raise ValueError(
            f"{changed}: at a stored draw its structure has the frequencies {now} Hz, stored are "
            f"{stored} Hz"
        )
    likelihood = replace(of_test.given(modes.pairing), structure=structure)
    return PosteriorDraws(posterior.name, likelihood, of_likelihood)


def thinned_rows(n_values: int, n_draws: int) -> NDArray[np.intp]:
    return np.arange(n_draws) * n_values // n_draws


@checked
def predict_frequencies(
    posterior: Posterior,
    model_class: ModelClass,
    state: Structure | str,
    modes: Mapping[str, int],
    n_draws: int = DRAWS_OF_A_PREDICTION,
    seed: int = 0,
) -> Prediction:
    """Frequencies of the structure itself, in a state that was not tested or in a tested one.

    Every draw is the frequency of the model at a posterior draw with a draw of the prediction
    error, given the errors of the identified modes: where errors are correlated, what the model
    missed in other tests, or in other modes, is expected again. Identification errors are left out.

    Args:
        posterior: posterior of the class.
        model_class: the class.
        state: the structure in a state that was not tested, its parameters among those of the
            class; or the name of a tested configuration, to predict further modes of it.
        modes: label of a mode → number of the model mode in this state, from 1. A label among those
            of the identified modes stands for the same mode.
        n_draws: number of draws.
        seed: seed of the draws of prediction errors.

    Returns:
        Frequencies in Hz, draws (n_draws, n_modes), in the order of ``modes``.

    Raises:
        ValueError: there is no draw to take, no such configuration or no such mode, a parameter of
            the structure is not one of the class, or the class is not the one that was sampled.
    """
    tests = [
        thinned_draws(posterior, model_class, n_draws, c.name) for c in model_class.configurations
    ]
    columns = [posterior.parameter_names.index(name) for name in model_class.parameter_names]
    values = posterior.values[thinned_rows(len(posterior.values), n_draws)][:, columns]
    if isinstance(state, str):
        test = list(model_class.configurations).index(model_class.configuration(state))
        structure, model_hz = tests[test].structure, tests[test].frequencies_hz
    else:
        test, structure, known = len(tests), state, model_class.parameter_names
        wanted = [parameter.name for parameter in state.parameters]
        what = f"predict_frequencies: model class {model_class.name!r} has no parameter"
        require_known(what, wanted, known)
        own = values[:, [known.index(name) for name in wanted]]
        likelihood = replace(tests[0].likelihood, structure=state)
        model_hz = replace(tests[0], likelihood=likelihood, of_likelihood=own).frequencies_hz
    for label, number in modes.items():
        if not 1 <= number <= structure.n_modes:
            raise ValueError(
                f"predict_frequencies: mode {label!r} is model mode {number!r}; the structure has "
                f"modes 1 to {structure.n_modes}"
            )
    further = [ModeOfTest(test, label, number) for label, number in modes.items()]
    tested_hz = [each.frequencies_hz for each in tests]
    residuals = _residuals(model_class, values, tested_hz, further, np.random.default_rng(seed))
    # A residual is f/f_e - 1, with f the model's frequency.
    return Prediction(model_hz[:, [mode.number - 1 for mode in further]] / (1.0 + residuals))


def _residuals(
    model_class: ModelClass,
    values: FloatArray,
    tested_hz: list[FloatArray],
    further: list[ModeOfTest],
    rng: np.random.Generator,
) -> FloatArray:
    """Prediction errors (n_draws, n_modes) of further modes, given those of the paired modes."""
    errors = model_class.correlated_errors
    n_rows = max(1, ARRAY_SIZE // (len(errors.modes) + len(further)) ** 2)
    parts = []
    for start in range(0, len(values), n_rows):
        part = slice(start, start + n_rows)
        means, covariance = errors.conditional(
            values[part], [each[part] for each in tested_hz], further
        )
        variances, axes = np.linalg.eigh(covariance)
        # Errors that the data determine have no variance left, up to rounding.
        spread = axes * np.sqrt(np.maximum(variances, 0.0))[..., None, :]
        normals = rng.standard_normal(means.shape)
        parts.append(means + (spread * normals[:, None, :]).sum(axis=2))
    return np.concatenate(parts)
