"""Approximate evidences of hypotheses: which of them matter, and which need no sampling?

The maxima of a hypothesis follow from ascents from draws of its prior, from least squares in the
residuals of plausible pairings, and from draws of a hypothesis with one feature less, next to which
the new feature's parameters, such as an appendage's mass and frequency, scan their priors evenly.
Laplace's approximation at the maxima, corrected by some hundred importance draws, gives the
evidence. Efforts are a ladder, from the cheapest:

========  =======================================  ==================  ========================
effort    what is computed                         error; evaluations  who goes on to the next
========  =======================================  ==================  ========================
look      the greatest likelihood, of hypotheses   only a bound; 2,200 the highest, until those
          that differ in places all together                           left have a thousandth
quick     Laplace's approximation at the maxima,   some tenths of a    those with 0.3 % of the
          and 300 importance draws about them;     nat, or 0.1; 1,000  probability of all
          up to 6,000 for those with 0.01 %        to 4,000
full      the same, by searches repeated until     0.1 nats; a tenth   those on which the answer
          they agree, with draws as it takes       of sampling         rests (``to_sample``)
sampling  a posterior, checked                     as it is wanted     none
========  =======================================  ==================  ========================

Up to 30 hypotheses with at most one feature begin with the full effort; those that can be
computed together with a look; others with the quick one.
"""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, count
from typing import TypeVar

import numpy as np
from scipy.special import ndtri
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray, systematic_indices
from bayes_ssi.inference.calibration.narrow_regions import class_target
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.sample import seed_of
from bayes_ssi.inference.sampling.importance import ImportanceSample, ImportanceSampler
from bayes_ssi.inference.sampling.maxima import Maxima, find_maxima
from bayes_ssi.inference.sampling.mixture import HEAVY_TAILS, StudentMixture
from bayes_ssi.inference.sampling.multistart import search_maxima, search_starts
from bayes_ssi.inference.sampling.regions import local_maxima
from bayes_ssi.inference.sampling.target import SuggestedStarts, Target
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.inference.workers.workers import Function, evaluate
from bayes_ssi.studies.search.common_likelihood import common_log_likelihoods, in_common
from bayes_ssi.studies.search.side_by_side import SideBySide

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Effort:
    """How much is computed of one hypothesis, before it is sampled or in its place."""

    n_draws: int  # draws that scan the prior of what the hypothesis adds
    n_ascents: int  # from the best of these, and of the prior's
    batch: int  # importance draws; none where the greatest likelihood is enough
    # Whether searches are repeated until they agree, with descents in residuals, and draws are
    # added until the error is the wanted one.
    is_full: bool = False


# Fewer ascents end a hundred nats below the greatest likelihood of some of the best places.
LOOK = Effort(500, 12, 0)
QUICK = Effort(250, 3, 300)  # a hundredth of the evaluations of sampling
# A region with half a hundredth of the prior is hit by five of 500 draws; an evidence to a few
# tenths of a nat, in a tenth of the evaluations of sampling.
FULL = Effort(500, 4, 600, is_full=True)
MOST_DRAWS = 6000  # of one hypothesis
MOST_FULL = 30  # hypotheses with at most one feature, so many take half a minute in full
SIDE_BY_SIDE = 8  # more hypotheses in common batches are no faster
WANTED_ERROR = 0.1  # decides whether a hypothesis has a hundredth or a thousandth of all


# Of importance draws; where the new feature explains nothing, the posterior is the simpler one's
# times the prior of the rest.
SHARE_OF_SIMPLER = 0.5


@dataclass(frozen=True, eq=False)
class Screened:
    parameter_names: tuple[str, ...]  # columns of ``z``
    log_evidence: float  # in nats, from importance draws
    error: float
    # Laplace's approximation of the log evidence, summed over the maxima; NaN of a look.
    laplace: float
    n_evaluations: int  # evaluations of the log-likelihood
    maxima: FloatArray  # (m, d), those that were climbed to, in standard-normal coordinates
    z: FloatArray  # (n, d), importance draws in standard-normal coordinates
    weights: FloatArray  # (n,), of the draws, which add up to one
    mixture: StudentMixture

    def draws(self, names: Sequence[str], n: int) -> FloatArray:
        """Draws (n, d) of some parameters, half from the posterior and half from the proposal."""
        rng = np.random.default_rng(0)
        of_posterior = self.z[systematic_indices(self.weights, n // 2, rng)]
        proposed = _drawn(self.mixture, n - n // 2, rng)
        return self._columns(np.concatenate([of_posterior, proposed]), names)

    def posterior_draws(self, names: Sequence[str], n: int) -> FloatArray:
        rng = np.random.default_rng(0)
        return self._columns(self.z[systematic_indices(self.weights, n, rng)], names)

    def wide_draws(self, names: Sequence[str], n: int) -> FloatArray:
        """Draws (n, d) of some parameters, nine tenths from a region twice as wide.

        Where a feature explains what the structure's parameters had to, these lie next to the
        posterior without it.
        """
        rng = np.random.default_rng(0)
        wide = replace(self.mixture, factors=2.0 * self.mixture.factors, prior_share=0.1)
        return self._columns(_drawn(wide, n, rng), names)

    def _columns(self, z: FloatArray, names: Sequence[str]) -> FloatArray:
        """The columns of some parameters, none beyond three."""
        return np.clip(z[:, [self.parameter_names.index(name) for name in names]], -3.0, 3.0)


# A hypothesis, and a screened one of the same baseline with one feature less, if any.
ToScreen = tuple[ModelClass, Screened | None]


def screen_all(
    hypotheses: Sequence[ToScreen], seed: int, run: Run, effort: Effort = FULL
) -> list[Screened]:
    """Their approximate evidences; ValueError where no maximum of one is found."""
    step = f"screening {len(hypotheses)}"
    return together(partial(_screened, seed=seed, effort=effort), hypotheses, run, step)


def screen(hypothesis: ToScreen, seed: int, effort: Effort = FULL) -> Screened:
    """The approximate evidence of one hypothesis; ValueError where no maximum is found."""
    return _side_by_side(partial(_screened, seed=seed, effort=effort), [hypothesis])[0]


def together(
    function: Callable[[ToScreen, Target], R], hypotheses: Sequence[ToScreen], run: Run, step: str
) -> list[R]:
    """A function of each hypothesis and its target, side by side where likelihoods allow it."""
    n_workers = run.workers.n_workers if run.workers else 1
    n = min(SIDE_BY_SIDE, math.ceil(len(hypotheses) / n_workers))
    groups: dict[Hashable, list[int]] = {}
    for i, (model_class, _) in enumerate(hypotheses):
        groups.setdefault(in_common(model_class), []).append(i)
    parts = [own[i : i + n] for own in groups.values() for i in range(0, len(own), n)]
    items = [[hypotheses[i] for i in part] for part in parts]
    answers = each_in_workers(
        partial(_side_by_side, function), items, run, ("all hypotheses", step)
    )
    by_number = dict(zip(chain.from_iterable(parts), chain.from_iterable(answers), strict=True))
    return [by_number[i] for i in range(len(hypotheses))]


def _side_by_side(
    function: Callable[[ToScreen, Target], R], hypotheses: Sequence[ToScreen]
) -> list[R]:
    """A function of each of several hypotheses and its target, in common batches."""
    classes = [model_class for model_class, _ in hypotheses]
    batches = SideBySide(common_log_likelihoods(classes))

    def of_one(i: int) -> R:
        target = class_target(classes[i])
        target.function = lambda z: batches.ask((i, z))
        return function(hypotheses[i], target)

    # The matrices are small: threads inside BLAS would only wait for one another.
    with threadpool_limits(limits=1, user_api="blas"):
        return batches.run([partial(of_one, i) for i in range(len(classes))])


def each_in_workers(
    function: Callable[[T], R], items: Sequence[T], run: Run, reported: tuple[str, str]
) -> list[R]:
    """A quick function of each item, side by side in workers; here where there are none, or died.

    ``reported`` are what is computed and the step of it that these items are.
    """
    numbers = count(1)

    def done(_: int) -> None:
        run.report(*reported, next(numbers) / len(items))

    results: dict[int, R] = {}
    if run.workers is not None:
        results = run.workers.try_each(function, items, done)
    for i, item in enumerate(items):
        if i not in results:
            results[i] = function(item)
            done(i)
    return [results[i] for i in range(len(items))]


def _screened(hypothesis: ToScreen, target: Target, seed: int, effort: Effort) -> Screened:
    model_class, simpler = hypothesis
    # Not the seed of its sampling, whose errors are to be independent.
    own_seed = seed_of(f"screening of {model_class.name}", seed)
    seed_of_starts, seed_of_searches, seed_of_draws = own_seed.spawn(3)
    try:
        maxima = _maxima(target, hypothesis, (seed_of_starts, seed_of_searches), effort)
    except ValueError as error:
        raise type(error)(f"model class {model_class.name!r}: {error}") from error
    mixture = maxima.as_mixture().widened()
    if simpler is not None:
        mixture = mixture.mixed_with(_extended(model_class, simpler), SHARE_OF_SIMPLER)
    sample = _importance_sample(target, mixture, np.random.default_rng(seed_of_draws), effort)
    estimate = sample.estimate
    return Screened(
        parameter_names=model_class.parameter_names,
        log_evidence=estimate.log_evidence,
        error=estimate.error,
        laplace=maxima.laplace_estimate.log_evidence,
        n_evaluations=target.n_evaluations,
        maxima=maxima.z,
        z=sample.z,
        weights=sample.weights,
        mixture=sample.mixture.reweighted(sample.z, sample.weights),
    )


def with_more_draws(screened: Sequence[ToScreen], seed: int, run: Run) -> list[Screened]:
    """Hypotheses with as many new draws from their mixtures as the wanted error takes."""
    step = f"drawing for {len(screened)}"
    return together(partial(_with_more_draws, seed=seed), screened, run, step)


def _with_more_draws(item: ToScreen, target: Target, seed: int) -> Screened:
    model_class, screened = item
    assert screened is not None
    rng = np.random.default_rng(seed_of(f"more draws of {model_class.name}", seed))
    sampler = ImportanceSampler(target, rng, FULL.batch, max_draws=MOST_DRAWS)
    sample = _to_wanted_error(sampler, sampler.sample(screened.mixture))
    return replace(
        screened,
        log_evidence=sample.estimate.log_evidence,
        error=sample.estimate.error,
        n_evaluations=screened.n_evaluations + target.n_evaluations,
        z=sample.z,
        weights=sample.weights,
        mixture=sample.mixture.reweighted(sample.z, sample.weights),
    )


def _maxima(
    target: Target,
    hypothesis: ToScreen,
    seeds: tuple[np.random.SeedSequence, np.random.SeedSequence],
    effort: Effort,
) -> Maxima:
    """The maxima of a hypothesis; ``seeds`` are those of starts in residuals and of searches."""
    model_class, simpler = hypothesis
    narrow = np.empty((0, target.n_dimensions))
    if simpler is not None:
        if effort.is_full:
            # They take as many evaluations as all else: once is enough.
            narrow = target.suggested(np.random.default_rng(seeds[0]))
        target.suggest_starts = _scan(target.function, model_class, simpler, effort)
    if not effort.is_full:
        rng = np.random.default_rng(seeds[1])
        highest, suggested = search_starts(target, effort.n_draws, rng)
        return find_maxima(target, np.concatenate([highest[: effort.n_ascents], suggested]))
    search = search_maxima(target, 1, seeds[1], n_draws=effort.n_draws, n_ascents=effort.n_ascents)
    return find_maxima(target, narrow, search.maxima) if len(narrow) else search.maxima


def _importance_sample(
    target: Target, mixture: StudentMixture, rng: np.random.Generator, effort: Effort
) -> ImportanceSample:
    batch = effort.batch
    sampler = ImportanceSampler(
        target, rng, batch, prior_share=0.05, least_efficiency=0.05, max_draws=MOST_DRAWS
    )
    trial = sampler.sample(mixture)
    if not effort.is_full:
        return trial
    trial = sampler.refined(trial, math.inf)
    # Components were added at the heaviest draws, which now weigh too little: new draws only.
    sample = sampler.sample(trial.mixture.reweighted(trial.z, trial.weights))
    return _to_wanted_error(sampler, sample)


def _to_wanted_error(sampler: ImportanceSampler, sample: ImportanceSample) -> ImportanceSample:
    while sample.estimate.error > WANTED_ERROR and len(sample.z) < sampler.max_draws:
        sample = sampler.extended(sample, (sample.estimate.error / WANTED_ERROR) ** 2)
    return sample


def _scan(
    log_likelihood: Function, model_class: ModelClass, simpler: Screened, effort: Effort
) -> Callable[[np.random.Generator], SuggestedStarts]:
    """Starts from the simpler hypothesis's posterior, the other parameters all over their priors.

    Evenly, so that no part of the band is left out.
    """

    def starts(rng: np.random.Generator) -> SuggestedStarts:
        z = scan_draws(model_class, simpler, effort.n_draws, rng)
        log_likelihoods = evaluate(log_likelihood, z).values
        possible = np.isfinite(log_likelihoods)
        scanned = local_maxima(z[possible], log_likelihoods[possible])[: effort.n_ascents]
        return SuggestedStarts(scanned, effort.n_draws)

    return starts


def scan_draws(
    model_class: ModelClass, simpler: Screened, n: int, rng: np.random.Generator
) -> FloatArray:
    """Draws (n, d) of the simpler hypothesis's posterior, and of the other parameters' priors.

    In these, each coordinate has one draw in every n-th of its prior.
    """
    strata = rng.permuted(np.tile(np.arange(n)[:, None], (1, len(model_class.parameters))), axis=0)
    z = ndtri((strata + rng.random(strata.shape)) / n)
    rows = rng.permutation(systematic_indices(simpler.weights, n, rng))
    z[:, _columns(model_class, simpler)] = simpler.z[rows]
    return z


def _extended(model_class: ModelClass, simpler: Screened) -> StudentMixture:
    """The simpler hypothesis's mixture times the prior of the other parameters."""
    columns, own = _columns(model_class, simpler), simpler.mixture
    k, d = own.n_components, len(model_class.parameters)
    means, factors = np.zeros((k, d)), np.tile(np.eye(d), (k, 1, 1))
    means[:, columns] = own.means
    factors[np.ix_(range(k), columns, columns)] = own.factors
    weights, tails = own.weights / own.weights.sum(), np.full(k, HEAVY_TAILS)
    return StudentMixture(weights, means, factors, tails, bends=own.bends)


def _columns(model_class: ModelClass, simpler: Screened) -> list[int]:
    return [model_class.parameter_names.index(name) for name in simpler.parameter_names]


def _drawn(mixture: StudentMixture, n: int, rng: np.random.Generator) -> FloatArray:
    return mixture.draw(rng.multinomial(n, mixture.all_weights / mixture.all_weights.sum()), rng)
