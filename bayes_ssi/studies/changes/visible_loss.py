"""The smallest loss at each place that two tests would have shown.

Both tests are simulated with a loss, from the posterior of "nothing changed", and with errors of
its sizes, of which the tests share a part. Laplace's approximation then says how much more probable
a change there is than none. That rises with the loss, and scatters from simulation to simulation: a
line through its root says where nine in ten are above the odds that count as shown.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray, systematic_indices
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.sample import seed_of
from bayes_ssi.inference.sampling.maxima import find_maxima
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.parameters.parameters import ProductTable, as_product
from bayes_ssi.studies.changes.changes_family import Changes
from bayes_ssi.studies.changes.kinds_of_change import ChangePlace, KindOfChange
from bayes_ssi.studies.search.approximate_evidence import each_in_workers
from bayes_ssi.studies.search.family import Hypothesis

# When a loss counts as shown, and how many tests are simulated.
SHOWN = 0.9  # probability from which on a change counts as shown
ODDS_SHOWN = 9.0  # the same of one place, against none
SHARE_OF_TESTS = 0.9  # of the tests that show it
# Losses of the first simulations, which find where odds pass the wanted ones, and the range of
# those that follow, relative to it.
FIRST_LOSSES = (0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
LOSSES_AROUND = (0.7, 1.6)
# In each of two rounds: over seeds the loss scatters by 2 to 7 %; by 16 % with one round.
N_SIMULATED = 18
SECOND_ROUND = (0.8, 1.25)  # of the second round, relative to the first answer
MOST_LOST = 0.98  # in simulations; what is left still stands
LARGEST_LOSS = 0.95  # losses beyond are no answer


def smallest_loss(
    losses: FloatArray, log_odds: FloatArray, needed: float, floor: float
) -> float | None:
    """The smallest loss that would be shown as surely as wanted; None if none would.

    Log odds of a change rise with the square of its loss, so that the root of what is above a floor
    is a line in the loss, about which it scatters equally everywhere.

    Args:
        losses: (n,), of simulations, and ``log_odds`` (n,) in them.
        needed: log odds from which on a change counts as shown.
    """
    roots = np.sqrt(np.maximum(log_odds - floor, 0.0))
    slope, level = np.polyfit(losses, roots, 1)
    if slope <= 0.0:
        return None
    scatter = float((roots - slope * losses - level).std(ddof=2))
    wanted = math.sqrt(needed - floor) + float(ndtri(SHARE_OF_TESTS)) * scatter
    smallest = float((wanted - level) / slope)
    return smallest if smallest <= LARGEST_LOSS else None


def smallest_losses(
    family: Changes, nothing: Hypothesis[KindOfChange], seed: int, run: Run
) -> dict[KindOfChange, float | None]:
    """Place → the smallest loss of all its parameters that would be shown; None if none would.

    Args:
        nothing: the hypothesis that nothing changed.
    """
    baseline, unchanged, screened = nothing.key.baseline, nothing.model_class, nothing.screened
    n = len(FIRST_LOSSES) + 2 * N_SIMULATED
    rng = np.random.default_rng(seed_of("posterior of nothing changed", seed))
    z = rng.permutation(screened.z[systematic_indices(screened.weights, n, rng)])
    considered = family.features[baseline]
    places = [e for e in considered if isinstance(e, ChangePlace) and not e.is_common]
    classes = [family.hypothesis(unchanged, (place,), place.name) for place in places]
    one, none = (family.prior_weight(baseline, number, 0) for number in (1, 0))
    needed = math.log(ODDS_SHOWN * none / one)
    of_place = partial(_smallest_loss, unchanged=unchanged, z=z, needed=needed, seed=seed)
    what = f"{n * len(places)} tests simulated"
    run.report("smallest visible losses", what, 0.0)
    smallest = each_in_workers(of_place, classes, run, ("smallest visible losses", what))
    return dict(zip(places, smallest, strict=True))


def _smallest_loss(
    changed: ModelClass, unchanged: ModelClass, z: FloatArray, needed: float, seed: int
) -> float | None:
    """From losses of all sizes, then about where log odds pass what is needed, then the answer."""
    covariances: dict[str, FloatArray] = {}

    def log_odds(losses: FloatArray, begin: int) -> FloatArray:
        odds = []
        for i, loss in enumerate(losses.tolist(), begin):
            rng = np.random.default_rng(seed_of(f"{changed.name} {i}", seed))
            odds.append(log_bayes_factor(changed, unchanged, z[i], loss, rng, covariances))
        return np.array(odds)

    first = np.array(FIRST_LOSSES)
    rough = log_odds(first, 0)
    above = np.flatnonzero(rough > needed)
    last = int(above[0]) if len(above) else len(first) - 1
    passed = math.sqrt(first[last] * first[max(last - 1, 0)])
    floor = min(float(rough.min()), 0.0) - 1.0  # without a loss, none is more probable
    low, high = LOSSES_AROUND
    losses, odds = np.empty(0), np.empty(0)
    for _ in range(2):
        near = np.geomspace(low * passed, high * passed, N_SIMULATED)
        near = np.minimum(near, MOST_LOST)
        odds = np.append(odds, log_odds(near, len(first) + len(losses)))
        losses = np.append(losses, near)
        smallest = smallest_loss(losses, odds, needed, floor)
        (low, high), passed = SECOND_ROUND, smallest or LARGEST_LOSS
    return smallest


def log_bayes_factor(
    changed: ModelClass,
    unchanged: ModelClass,
    z: FloatArray,
    loss: float,
    rng: np.random.Generator,
    covariances: dict[str, FloatArray],
) -> float:
    """Of a change against none in tests simulated with a loss, by Laplace, in nats.

    Args:
        z: (d,), a draw of "nothing changed", in standard-normal coordinates.
        covariances: name of a class → that of its parameters (1, d, d) in another such test, from
            which searches gain; it is replaced by that in this one.
    """
    own = dict(zip(unchanged.parameter_names, z, strict=True))
    lost = np.array(
        [own[p.name] if p.name in own else p.prior.to_normal(loss) for p in changed.parameters]
    )
    tests = simulated_tests(changed, lost, rng)

    def log_evidence(model_class: ModelClass, start: FloatArray) -> float:
        pairs = zip(tests, model_class.configurations, strict=True)
        own = tuple(replace(test, structure=each.structure) for test, each in pairs)
        target = class_target(replace(model_class, configurations=own))
        known = covariances.get(model_class.name)
        maxima = find_maxima(target, start[None], covariances=known)
        covariances[model_class.name] = maxima.covariances[:1]
        return maxima.laplace_estimate.log_evidence

    with threadpool_limits(limits=1, user_api="blas"):
        return log_evidence(changed, lost) - log_evidence(unchanged, z)


def simulated_tests(
    model_class: ModelClass, z: FloatArray, rng: np.random.Generator
) -> list[Configuration]:
    """The tests of a class at one row ``z`` (d,), with simulated errors of its paired modes.

    Identified are the modes that were, as far as they are in the band then.
    """
    values = model_class.values(z[None])
    shared = as_product(model_class.error.between_tests)
    (rho,) = ProductTable((shared,), model_class.parameters).evaluate(values)[0]
    in_common: dict[tuple[str, int], tuple[FloatArray, FloatArray]] = {}
    tests = []
    for test, likelihood, own in model_class.parts(values):
        modes, variances = likelihood.modes(own), likelihood.prediction_var(own)[0]
        shapes, n = likelihood.shapes_at_sensors(modes)[0], len(test.data.sensors)
        sizes = np.sqrt(np.append(variances[0], np.full(n, variances[-1])))
        low, high = test.data.band_hz
        made = []
        for mode in test.data.modes:
            if mode.label in likelihood.pairing:
                number = likelihood.pairing[mode.label] - 1
                common, alone, identification = rng.standard_normal((3, 1 + n))
                measured = np.ones(n, bool) if mode.shape is None else np.isfinite(mode.shape)
                unit = shapes[:, number] / (np.linalg.norm(shapes[measured, number]) or 1.0)
                common, first = in_common.setdefault((mode.label, n), (common, unit))
                identification[0] *= mode.frequency_cov or 0.0
                identification[1:] *= mode.shape_sd or 0.0
                together = math.sqrt(rho) * common + math.sqrt(1.0 - rho) * alone
                error = sizes * together + identification
                # As a shape in another test, whose error it shares.
                turned = (np.sign(first @ unit) or 1.0) * unit + error[1:]
                hz = float(modes.frequencies_hz[0, number]) * math.exp(error[0])
                shape = None if mode.shape is None else np.where(measured, turned, np.nan)
                mode = replace(mode, frequency_hz=hz, shape=shape)
            if low <= mode.frequency_hz <= high:
                made.append(mode)
        made.sort(key=lambda mode: mode.frequency_hz)
        data = replace(test.data.without_covariance(), modes=tuple(made))
        pairing = {a: i for a, i in likelihood.pairing.items() if a in data.labels}
        tests.append(replace(test, data=data, pairing=pairing if likelihood.pairing else "any"))
    return tests
