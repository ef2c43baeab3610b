"""The smallest loss at each place that two tests would have shown.

Tests after a loss are simulated from the posterior of "nothing changed": with its parameters, the
prediction errors that the tests before had, as far as they are shared, and new errors of the rest.
Laplace's approximation then says how much more probable a change there is than none. That rises
with the loss, and scatters from simulation to simulation: a line through its root says where nine
in ten are above the odds that count as shown.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.to_posterior import class_target, seed_of
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.inference.sampling.resampling import systematic_indices
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.measurements.modes.identified_mode import IdentifiedMode
from bayes_ssi.parameters.parameters import ProductTable, as_product
from bayes_ssi.studies.changes.change_places import ChangePlace
from bayes_ssi.studies.changes.changes_family import Changes
from bayes_ssi.studies.search.approximate_evidence import each_in_workers
from bayes_ssi.studies.search.family import Hypothesis


@dataclass(frozen=True)
class VisibilitySettings:
    """When a loss counts as shown, and how many tests are simulated."""

    shown: float = 0.9  # probability from which on a change counts as shown
    odds: float = 9.0  # the same of one place, against none
    share: float = 0.9  # of the tests that show it
    # Losses of the first simulations, which find where odds pass the wanted ones, and the range of
    # those that follow, relative to it.
    first: tuple[float, ...] = (0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
    around: tuple[float, float] = (0.7, 1.6)
    # An error of 5 % in the loss, or of three in a hundred tests, where odds scatter as a normal
    # variable's square.
    n_simulated: int = 18
    n_draws: int = 64  # of the posterior, for them and the first
    largest: float = 0.95  # losses beyond are no answer


VISIBILITY = VisibilitySettings()


class ToSimulate(NamedTuple):
    """A loss at a place of a class: tests after it are simulated."""

    unchanged: ModelClass
    changed: ModelClass
    after: tuple[str, ...]  # names of tests
    z: FloatArray  # (d,), a draw of "nothing changed", in standard-normal coordinates
    loss: float
    number: int  # of the simulation


def smallest_visible(
    family: Changes, nothing: Hypothesis[ChangePlace], seed: int, run: Run
) -> dict[ChangePlace, float | None]:
    """Place → the smallest loss of all its parameters that would be shown; None if none would.

    Args:
        nothing: the hypothesis that nothing changed.
    """
    baseline, unchanged, screened = nothing.key.baseline, nothing.model_class, nothing.screened
    rng = np.random.default_rng(seed_of("posterior of nothing changed", seed))
    z = rng.permutation(screened.z[systematic_indices(screened.weights, VISIBILITY.n_draws, rng)])
    places = [each for each in family.features[baseline] if not each.is_common]
    classes = [family.hypothesis(unchanged, (place,), place.name) for place in places]
    weights = [family.prior_weight(baseline, number) for number in (1, 0)]
    needed = math.log(VISIBILITY.odds) - math.log(weights[0] / weights[1])

    def log_odds(losses: Sequence[FloatArray], begin: int) -> list[FloatArray]:
        items = [
            ToSimulate(unchanged, changed, family.after, z[(begin + i) % len(z)], loss, begin + i)
            for changed, own in zip(classes, losses, strict=True)
            for i, loss in enumerate(own.tolist())
        ]
        n_done = 0

        def done(_: int) -> None:
            nonlocal n_done
            n_done += 1
            run.report("smallest visible losses", "tests simulated", n_done / len(items))

        found = each_in_workers(partial(log_bayes_factor, seed=seed), items, run, done)
        return np.split(np.array(found), np.cumsum([len(own) for own in losses])[:-1])

    first = np.array(VISIBILITY.first)
    rough = log_odds([first] * len(places), 0)
    floors = [float(each.min()) - 1.0 for each in rough]
    low, high = VISIBILITY.around
    further = [
        np.minimum(np.geomspace(low * at, high * at, VISIBILITY.n_simulated), 0.98)
        for at in (_passed(first, each, needed) for each in rough)
    ]
    found = zip(places, further, log_odds(further, len(first)), floors, strict=True)
    return {
        place: _where_most_are_above(losses, own, needed, floor)
        for place, losses, own, floor in found
    }


def _passed(losses: FloatArray, log_odds: FloatArray, needed: float) -> float:
    """About where the log odds pass what is needed."""
    above = np.flatnonzero(log_odds > needed)
    last = int(above[0]) if len(above) else len(losses) - 1
    return float(np.sqrt(losses[last] * losses[max(last - 1, 0)]))


def _where_most_are_above(
    losses: FloatArray, log_odds: FloatArray, needed: float, floor: float
) -> float | None:
    """The loss at which as many as wanted are above what is needed.

    Log odds rise with the square of a loss from a ``floor`` on, so that the root of what is above
    it follows a line, about which it scatters equally everywhere.
    """
    roots = np.sqrt(np.maximum(log_odds - floor, 0.0))
    slope, level = np.polyfit(losses, roots, 1)
    scatter = float((roots - slope * losses - level).std(ddof=2))
    if not slope > 0.0:
        return None
    wanted = math.sqrt(needed - floor) + float(ndtri(VISIBILITY.share)) * scatter
    found = float((wanted - level) / slope)
    return found if found <= VISIBILITY.largest else None


def log_bayes_factor(item: ToSimulate, seed: int) -> float:
    """Of the change against none in simulated tests, by Laplace's approximation, in nats."""
    rng = np.random.default_rng(seed_of(f"{item.changed.name} {item.number}", seed))
    unchanged, changed, z = item.unchanged, item.changed, item.z
    extended = np.zeros(len(changed.parameters))
    for i, parameter in enumerate(changed.parameters):
        known = parameter.name in unchanged.parameter_names
        extended[i] = (
            z[unchanged.parameter_names.index(parameter.name)]
            if known
            else parameter.prior.to_normal(item.loss)
        )
    tests = simulated_after(unchanged, changed, item.after, z, extended, rng)

    def log_evidence(model_class: ModelClass, start: FloatArray) -> float:
        configurations = [
            replace(test, data=tests[test.name].data, pairing=tests[test.name].pairing)
            for test in model_class.configurations
        ]
        target = class_target(replace(model_class, configurations=configurations))
        return find_maxima(target, start[None]).laplace_estimate.log_evidence

    with threadpool_limits(limits=1, user_api="blas"):
        return log_evidence(changed, extended) - log_evidence(unchanged, z)


class ErrorsOfMode(NamedTuple):
    """What a test shows of one mode: of its frequency first, then of its shape at the sensors."""

    model: FloatArray  # (1 + n,), the model's frequency in Hz and unit shape
    residuals: FloatArray  # (1 + n,), of the frequency as a share; NaN where not measured
    identification: FloatArray  # (1 + n,), variances of identification,
    prediction: FloatArray  # and of prediction


def simulated_after(
    unchanged: ModelClass,
    changed: ModelClass,
    after: Sequence[str],
    z: FloatArray,
    extended: FloatArray,
    rng: np.random.Generator,
) -> dict[str, Configuration]:
    """Name → test; those after the change with simulated modes, the others as they were.

    Args:
        z: parameters (d,) of the class without change, ``extended`` those of the one with it, both
            in standard-normal coordinates.
    """
    values = unchanged.values(z[None])
    known: dict[str, ErrorsOfMode] = {}
    for name, of_modes in _errors(unchanged, values).items():
        if name not in after:
            known = of_modes | known
    shared = as_product(unchanged.error.between_tests)
    rho = float(ProductTable((shared,), unchanged.parameters).evaluate(values)[0, 0])
    tests = {test.name: test for test in unchanged.configurations}
    for name, of_modes in _errors(changed, changed.values(extended[None])).items():
        if name in after:
            modes = [
                _simulated(mode, of_modes[mode.label], known.get(mode.label), rho, rng)
                if mode.label in of_modes
                else mode
                for mode in tests[name].data.modes
            ]
            tests[name] = _with_modes(tests[name], modes)
    return tests


def _errors(model_class: ModelClass, values: FloatArray) -> dict[str, dict[str, ErrorsOfMode]]:
    """Name of a test → label of a paired mode → its errors, at one row of ``values``."""
    found: dict[str, dict[str, ErrorsOfMode]] = {}
    for test, likelihood, own in model_class.parts(values):
        modes = likelihood.modes(own)
        shapes = likelihood.shapes_at_sensors(modes)[0]
        variances = likelihood.errors.prediction_var(own)[0]
        n = len(test.data.sensors)
        of_modes = found.setdefault(test.name, {})
        for label, number in dict(likelihood.pairing).items():
            mode = test.data.mode(label)
            hz, model = modes.frequencies_hz[0, number - 1], shapes[:, number - 1]
            unit = np.full(n, np.nan) if mode.unit_shape is None else mode.unit_shape
            measured = np.isfinite(unit)
            model = model / (np.linalg.norm(model[measured]) or 1.0)
            model = model * (np.sign(np.nansum(unit * model)) or 1.0)
            of_modes[label] = ErrorsOfMode(
                np.append(hz, model),
                np.append(mode.frequency_hz / hz - 1.0, unit - model),
                np.append((mode.frequency_cov or 0.0) ** 2, np.full(n, mode.shape_sd or 0.0) ** 2),
                np.append(variances[0], np.full(n, variances[-1])),
            )
    return found


def _simulated(
    mode: IdentifiedMode,
    after: ErrorsOfMode,
    before: ErrorsOfMode | None,
    shared: float,
    rng: np.random.Generator,
) -> IdentifiedMode:
    """A mode as a test after the change would identify it, given its errors in one before."""
    variance, mean, model = after.prediction, np.zeros(len(after.model)), after.model
    if before is not None and len(before.model) == len(model):
        # Where the test before did not measure, nothing is known.
        gain = shared * variance / (before.prediction + before.identification)
        gain = np.where(np.isfinite(before.residuals), gain, 0.0)
        mean = gain * np.nan_to_num(before.residuals)
        variance = variance * (1.0 - shared * gain)
        turned = np.sign(before.model[1:] @ model[1:]) or 1.0
        model = np.append(model[0], turned * model[1:])
    errors = mean + np.sqrt(variance + after.identification) * rng.standard_normal(len(mean))
    shape = None if mode.shape is None else model[1:] + errors[1:]
    if shape is not None:
        shape = np.where(np.isfinite(after.residuals[1:]), shape, np.nan)
    return replace(mode, frequency_hz=float(model[0] * math.exp(errors[0])), shape=shape)


def _with_modes(test: Configuration, modes: Sequence[IdentifiedMode]) -> Configuration:
    """The test with those of the modes that are in its band, by frequency."""
    low, high = test.data.band_hz
    inside = sorted(
        (mode for mode in modes if low <= mode.frequency_hz <= high),
        key=lambda mode: mode.frequency_hz,
    )
    data = replace(test.data.without_covariance(), modes=tuple(inside))
    pairing = {label: i for label, i in dict(test.pairing).items() if label in data.labels}
    return replace(test, data=data, pairing=pairing)
