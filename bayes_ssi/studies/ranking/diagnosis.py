"""Mistakes in the data or in the pairing without which a class would explain them: hints.

Mistakes are undone one at a time: two sensors exchanged, a sensor's sign, the unit of the
frequencies, the pairing. Each class that results is fitted in two steps. Its likelihood at points
where the model's modes are computed once, for all mistakes, selects the few that are fitted by an
ascent to the maximum of likelihood times prior. The gain is the rise of this maximum, in nats.

Where structures are approximate, they are fitted to, and fits that gain are solved exactly. The
errors of data with a joint covariance count as independent here: what is a mistake stands out from
them by far.

Inferred error sizes can absorb a mistake, which the p-values of the class then hardly show; the
gain does. The density of data without a mistake is a density of the data themselves. If the class
is right, its ratio to the class's own density is 1 on average, so that, of n mistakes, one gains
ln(100 n) with a probability of one in a hundred at most (Markov's inequality); maxima stand here
for densities averaged over the prior.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray, evenly_spaced_indices, joined
from bayes_ssi.inference.criticism.adequacy import Hint, adequacy
from bayes_ssi.inference.criticism.misfit import INADEQUATE
from bayes_ssi.inference.model_class.configuration import Configuration, joint_digest, label_in
from bayes_ssi.inference.model_class.model_class import ModelClass, Pairing
from bayes_ssi.inference.posterior.posterior import Posterior
from bayes_ssi.inference.posterior_sampling.refinement import (
    is_approximate,
    with_confirming_structures,
)
from bayes_ssi.inference.posterior_sampling.sample import emulated_again
from bayes_ssi.inference.sampling.ascents import ascend
from bayes_ssi.inference.sampling.target import Target, log_standard_normal
from bayes_ssi.inference.workers.workers import Workers
from bayes_ssi.measurements.modes.modal_data import ModalData
from bayes_ssi.structures.modal import Modes
from bayes_ssi.studies.ranking.class_sampling import is_cheap
from bayes_ssi.studies.ranking.comparison import Comparison

Change = Callable[[ModalData], ModalData]

MOST_DIAGNOSED = 3  # classes whose misfit is diagnosed, the most probable first
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


def repairs_of_shapes(model_class: ModelClass, in_one_mode: bool) -> list[Repair]:
    """Each two sensors exchanged and each sensor's sign turned, in one mode or in whole tests.

    Those that come to the same are one: of two sensors, either sign is as good as the other.
    """
    places: list[tuple[str, list[Configuration], str | None]]
    places = [(*place, None) for place in _tests(model_class)]
    if in_one_mode:
        places = [
            (f" in mode {label_in(test.name, mode.label)!r}", [test], mode.label)
            for test in model_class.configurations
            for mode in test.data.modes
            if mode.scored_shape is not None
        ]
    by_digest: dict[str, Repair] = {}
    for where, tests, label in places:
        for mistake, change in _changes([test.data for test in tests], label):
            configurations = _with_data(model_class, tests, change)
            digest = joint_digest({test.name: test.data for test in configurations})
            same = by_digest.get(digest)
            words = f"{same.mistake}, or {mistake}{where}" if same else mistake + where
            by_digest[digest] = Repair(words, model_class, configurations)
    by_digest.pop(model_class.data_digest, None)
    return list(by_digest.values())


def _changes(tests: Sequence[ModalData], label: str | None) -> Iterator[tuple[str, Change]]:
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


# Points at which all repairs are compared: of the posterior, which the mistake distorts, and of
# the prior, which it does not.
POSTERIOR_POINTS, PRIOR_POINTS = 16, 64
# The best of each kind of repair that are fitted.
FITTED = 3
# Nats; two ascents to one maximum, as where a repair changes nothing that is compared, differ by
# less.
NO_GAIN = 0.01


def diagnose(
    model_class: ModelClass, posterior: Posterior, workers: Workers | None = None
) -> tuple[Hint, ...]:
    """Hints at mistakes without which the class would explain the data, the largest gain first.

    The gain of a hint must be one that a right class gives less than one time in a hundred, the
    class without the mistake must be adequate, and no other hint may be a hundred times as
    probable.
    """
    if posterior.emulators:
        model_class, workers = emulated_again(model_class, posterior), None
    given, model_class = model_class, model_class.with_independent_errors()
    points = _points(model_class, posterior, workers)
    best = _log_maximum(model_class, posterior, climbs=model_class is not given)
    kinds = [
        repairs_of_shapes(model_class, in_one_mode=False),
        repairs_of_shapes(model_class, in_one_mode=True),
        repairs_of_frequencies(model_class),
        list(repair_of_pairing(model_class)),
    ]
    least_gain = math.log(sum(map(len, kinds)) / INADEQUATE)

    def convincing(repairs: Sequence[Repair]) -> list[Hint]:
        scored = [(each, _log_posteriors(each, points)) for each in repairs]
        scored.sort(key=lambda item: -float(item[1].max()))
        hints = [_fitted(repair, points, own, best, workers) for repair, own in scored[:FITTED]]
        return [hint for hint in hints if hint.gain > least_gain and not hint.misfit.is_small]

    hints = [hint for kind in kinds for hint in convincing(kind)]
    if not hints and posterior.adequacy and posterior.adequacy.overall.is_small:
        hints = convincing(list(common_factor(model_class)))
    hints.sort(key=lambda hint: -hint.gain)
    return tuple(hint for hint in hints if hint.gain > hints[0].gain + math.log(INADEQUATE))


def with_hints(
    model_classes: Sequence[ModelClass],
    posteriors: Sequence[Posterior],
    comparison: Comparison,
    workers: Workers | None,
) -> tuple[Posterior, ...]:
    """The posteriors, that of the best class with hints why it does not explain the data.

    Where no repair makes it explain them, the next classes are tried: a mistake may make a wrong
    class the best.
    """
    classes = {each.name: each for each in model_classes}
    by_name = {each.name: each for each in posteriors}
    hints: tuple[Hint, ...] = ()
    for row in comparison.classes[:MOST_DIAGNOSED]:
        candidate, posterior = classes[row.name], by_name[row.name]
        if posterior.adequacy is None:
            break
        hints = diagnose(candidate, posterior, None if is_cheap(candidate) else workers)
        if hints and row is not comparison.best:
            then = f"; {row.name!r} would then explain the data"
            hints = tuple(replace(hint, mistake=hint.mistake + then) for hint in hints)
        if hints or posterior.adequacy.is_adequate:
            break
    best = by_name[comparison.best.name]
    if not hints or best.adequacy is None:
        return tuple(posteriors)
    hinted = replace(best, adequacy=replace(best.adequacy, hints=hints))
    return tuple(hinted if each is best else each for each in posteriors)


@dataclass(frozen=True, eq=False)
class _Points:
    """Where repairs are compared: coordinates (n, d) of named parameters, and the modes there."""

    names: tuple[str, ...]
    z: FloatArray
    modes: list[Modes]
    # Configuration of the class → log density (n,) of its data.
    log_densities: Mapping[Configuration, FloatArray]

    def of(self, model_class: ModelClass) -> FloatArray:
        """The coordinates of another class's parameters; those that it alone has are zero."""
        known, none = dict(zip(self.names, self.z.T, strict=True)), np.zeros(len(self.z))
        return np.column_stack([known.get(name, none) for name in model_class.parameter_names])


def _points(model_class: ModelClass, posterior: Posterior, workers: Workers | None) -> _Points:
    """The maximum of the posterior, some of its draws, the prior median and some prior draws."""
    chosen = evenly_spaced_indices(len(posterior.values), POSTERIOR_POINTS)
    of_posterior = np.concatenate([posterior.maxima[:1], posterior.values[chosen]])
    n = len(model_class.parameters)
    of_prior = np.random.default_rng(0).standard_normal((PRIOR_POINTS, n))
    z = np.concatenate([model_class.coordinates(of_posterior), np.zeros((1, n)), of_prior])
    values = model_class.values(z)
    if workers is None:
        modes = model_class.modes_or_nan(values)
    else:
        shares = np.array_split(np.arange(len(z)), min(workers.n_parts, len(z)))
        known = workers.try_each(model_class.modes_or_nan, [values[share] for share in shares])
        z = z[np.concatenate([shares[i] for i in sorted(known)])]
        of_tests = zip(*(known[i] for i in sorted(known)), strict=True)
        modes = [joined(of_test) for of_test in of_tests]
    parts = zip(model_class.parts(model_class.values(z)), modes, strict=True)
    densities = {
        test: likelihood.log_density(own, likelihood.compared_modes(own, of_test))
        for (test, likelihood, own), of_test in parts
    }
    return _Points(model_class.parameter_names, z, modes, densities)


def _log_maximum(model_class: ModelClass, posterior: Posterior, climbs: bool) -> float:
    """The maximum of likelihood times prior; ``climbs`` where it is not that of the posterior."""
    z = model_class.coordinates(posterior.maxima[:1])
    if climbs:
        target = Target(model_class.log_likelihood_at, z.shape[1])
        return float(ascend(target, z, np.eye(z.shape[1])[None])[1][0])
    return float((model_class.log_likelihood_at(z) + log_standard_normal(z))[0])


def _log_posteriors(repair: Repair, points: _Points) -> FloatArray:
    """Likelihood times prior (n,) at the points."""
    # Changed data leave the parameters as they are; another pairing may have other errors.
    of_class = repair.model_class if repair.given_pairings else repair.original
    z = points.of(of_class)
    total = log_standard_normal(z) + repair.log_scale
    parts = of_class.parts(of_class.values(z))
    for test, (_, _, own), modes in zip(repair.configurations, parts, points.modes, strict=True):
        if test in points.log_densities:
            total += points.log_densities[test]
        else:
            likelihood = test.likelihood(of_class.error, of_class.identification)
            total += likelihood.log_density(own, likelihood.compared_modes(own, modes))
    return np.where(np.isnan(total), -np.inf, total)


def _fitted(
    repair: Repair, points: _Points, at_points: FloatArray, best: float, workers: Workers | None
) -> Hint:
    """The hint that a repair gives, its class fitted from the best point and from the prior's."""
    # Errors that a mistake made large have a maximum of their own.
    changed, of_prior = repair.model_class, at_points[-PRIOR_POINTS:]
    starts = [int(at_points.argmax()), int(of_prior.argmax()) - len(of_prior)]
    z = points.of(changed)[starts]
    target = Target(changed.log_likelihood_at, z.shape[1], workers)
    z, ends = ascend(target, z, np.array([np.eye(z.shape[1])] * len(starts)))
    z, log_posteriors = z[[ends.argmax()]], ends.max(keepdims=True)
    values = changed.values(z)
    gain = float(log_posteriors[0]) + repair.log_scale - best
    # The approximation may be coarse there; without any gain it is no hint in either case.
    if gain > NO_GAIN and is_approximate(changed):
        changed = with_confirming_structures(changed, values)
        exact = changed.log_likelihood(values) + log_standard_normal(z)
        gain += float((exact - log_posteriors)[0])
    modes = [likelihood.compared_modes(own) for _, likelihood, own in changed.parts(values)]
    misfit = adequacy(changed, values, modes, np.random.default_rng(0)).overall
    return Hint(repair.mistake or _other_pairing(repair, values), gain, misfit)


def _other_pairing(repair: Repair, values: FloatArray) -> str:
    """How the best pairing at ``values`` (1, d) differs from the given ones, in words."""

    def model_mode(number: int | None) -> str:
        return "spurious" if number is None else f"model mode {number}"

    differences = []
    parts = repair.model_class.parts(values)
    for (test, likelihood, own), given in zip(parts, repair.given_pairings, strict=True):
        inferred = likelihood.inferred_pairing(own)
        if inferred is not None and given != "any":
            best = inferred.best
            differences += [
                f"mode {label_in(test.name, label)!r} seems to be "
                f"{model_mode(best.get(label))}, not {model_mode(given.get(label))}"
                for label in test.data.labels
                if best.get(label) != given.get(label)
            ]
    return "; ".join(differences)
