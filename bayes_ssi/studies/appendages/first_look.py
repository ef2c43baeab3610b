"""A first look at hundreds of hypotheses: how well can each explain the data at best?

No evidence exceeds the greatest likelihood. So a hypothesis whose greatest likelihood is far below
the evidence of another needs no more than that. It is climbed to from a scan of the appendage's
mass and frequency over their priors, the other parameters as in the posterior without it.

On one finite-element model, many places are looked at in common batches: a look takes a seventh of
the time of screening quickly.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import softmax
from threadpoolctl import threadpool_limits

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.model_class.configuration import Configuration
from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.posterior_sampling.to_posterior import seed_of
from bayes_ssi.inference.sampling.maxima import ascend
from bayes_ssi.inference.sampling.mixture import StudentMixture
from bayes_ssi.inference.sampling.regions import local_maxima
from bayes_ssi.inference.sampling.settings import MIXTURES
from bayes_ssi.inference.sampling.target import Target, log_standard_normal
from bayes_ssi.inference.workers.run import Run
from bayes_ssi.structures.finite_elements.projected_structure import (
    AlternativePlaces,
    ProjectedStructure,
)
from bayes_ssi.studies.appendages.sampling_choice import STANDARD_ERRORS
from bayes_ssi.studies.appendages.screening import Screened, ToScreen, scan_draws

# Frequencies in steps of some 2 %, from the two best of which ascents end within a few nats of the
# greatest likelihood, while evidences are eight and more below it.
N_DRAWS, N_ASCENTS = 120, 2
# Hypotheses that are looked at together: more are no faster.
TOGETHER = 32
# Rows whose matrices stay in the processor's cache.
ROWS = 256


class FirstLook(NamedTuple):
    """What a first look at a hypothesis shows.

    Attributes:
        z: (m, d), where ascents ended, in standard-normal coordinates, the highest first.
        log_likelihoods: (m,), there.
        n_evaluations: evaluations of the log-likelihood.
    """

    z: FloatArray
    log_likelihoods: FloatArray
    n_evaluations: int

    @property
    def greatest(self) -> float:
        """The greatest log-likelihood."""
        return float(self.log_likelihoods.max())

    def as_screened(self, parameter_names: Sequence[str], gap: float) -> Screened:
        """Screened by the first look alone.

        Args:
            gap: from a log evidence up to the greatest log-likelihood, as other hypotheses have it.
                The error is such that the evidence may be as great as the likelihood.
        """
        d = self.z.shape[1]
        log_posteriors = self.log_likelihoods + log_standard_normal(self.z)
        return Screened(
            parameter_names=tuple(parameter_names),
            log_evidence=self.greatest - gap,
            error=gap / STANDARD_ERRORS,
            laplace=math.nan,
            n_evaluations=self.n_evaluations,
            maxima=self.z,
            z=self.z,
            weights=softmax(log_posteriors),
            mixture=StudentMixture(
                np.ones(1), self.z[:1], np.eye(d)[None], np.array([MIXTURES.heavy_tails])
            ),
        )


def first_looks(hypotheses: Sequence[ToScreen], seed: int, run: Run) -> dict[int, FirstLook]:
    """Look at those hypotheses that can be computed together.

    Returns:
        By the number of the hypothesis. Others are not on finite-element models in a small basis,
        or the likelihood is zero wherever they were looked at.
    """
    groups: dict[Hashable, list[int]] = {}
    for i, hypothesis in enumerate(hypotheses):
        groups.setdefault(_in_common(hypothesis), []).append(i)
    groups.pop(None, None)
    parts = [
        group[start : start + TOGETHER]
        for group in groups.values()
        for start in range(0, len(group), TOGETHER)
    ]
    one = partial(look_together, seed=seed)
    wanted = [[hypotheses[i] for i in part] for part in parts]
    looks = {}
    if run.workers is not None:
        looks = run.workers.try_each(one, wanted, are_brief=True)
    for number, each in enumerate(wanted):
        if number not in looks:
            looks[number] = one(each)
    return {
        i: look
        for number, part in enumerate(parts)
        for i, look in zip(part, looks[number], strict=True)
        if look is not None
    }


def _in_common(hypothesis: ToScreen) -> Hashable:
    """What hypotheses that are computed together have in common; None if one cannot be."""
    model_class, simpler = hypothesis
    structures = _projected(model_class.configurations)
    if simpler is None or len(structures) < len(model_class.configurations):
        return None
    kinds = tuple(tuple(map(type, structure.elements)) for structure in structures)
    positions = tuple(model_class.parameter_names.index(name) for name in simpler.parameter_names)
    return id(simpler), kinds, positions


def _projected(tests: Sequence[Configuration]) -> list[ProjectedStructure]:
    """The structures of tests that can be computed together."""
    return [test.structure for test in tests if isinstance(test.structure, ProjectedStructure)]


def look_together(hypotheses: Sequence[ToScreen], seed: int) -> list[FirstLook | None]:
    """A first look at hypotheses that differ in nothing but places; None where it shows nothing."""
    classes = [hypothesis.model_class for hypothesis in hypotheses]
    target = _AllPlaces(_JointLikelihood.of(classes), len(classes[0].parameters) + 1)
    with threadpool_limits(limits=1, user_api="blas"):
        starts = np.concatenate([_starts(target, i, h, seed) for i, h in enumerate(hypotheses)])
        unit = np.tile(np.eye(target.n_dimensions), (len(starts), 1, 1))
        ends, log_posteriors = ascend(target, starts, unit)
    z, which = ends[:, :-1], _numbers(ends)
    log_likelihoods = log_posteriors - log_standard_normal(z)
    looks: list[FirstLook | None] = []
    for i in range(len(hypotheses)):
        own = np.flatnonzero(which == i)
        own = own[np.argsort(-log_posteriors[own], kind="stable")]
        n_evaluations = target.n_evaluations // len(hypotheses)
        looks.append(FirstLook(z[own], log_likelihoods[own], n_evaluations) if len(own) else None)
    return looks


def _starts(target: Target, number: int, hypothesis: ToScreen, seed: int) -> FloatArray:
    """Where ascents for one hypothesis begin (m, d + 1): at the best draws of a scan."""
    model_class, simpler = hypothesis
    assert simpler is not None
    rng = np.random.default_rng(seed_of(f"first look at {model_class.name}", seed))
    z = np.pad(scan_draws(model_class, simpler, N_DRAWS, rng), ((0, 0), (0, 1)))
    z[:, -1] = number
    log_likelihoods = target.log_likelihood(z)
    possible = np.isfinite(log_likelihoods)
    if not possible.any():
        return z[:0]
    return local_maxima(z[possible], log_likelihoods[possible])[:N_ASCENTS]


def _numbers(z: FloatArray) -> np.ndarray:
    """Numbers of hypotheses (B,): the last coordinate, but for the steps of differences."""
    return np.rint(z[:, -1]).astype(np.intp)


class _AllPlaces(Target):
    """Log-likelihoods of several hypotheses, whose number is the last coordinate.

    It has no slope, so that ascents for all hypotheses at once leave it.
    """

    def log_posterior(self, z: FloatArray) -> FloatArray:
        return self.log_likelihood(z) + log_standard_normal(z[:, :-1])


@dataclass(frozen=True, eq=False)
class _JointLikelihood:
    """Log-likelihoods of hypotheses that differ in nothing but places."""

    model_class: ModelClass
    places: tuple[AlternativePlaces, ...]

    @classmethod
    def of(cls, classes: Sequence[ModelClass]) -> _JointLikelihood:
        tests = zip(*(each.configurations for each in classes), strict=True)
        places = tuple(AlternativePlaces.of(_projected(of_test)) for of_test in tests)
        return cls(classes[0], places)

    def __call__(self, z: FloatArray) -> FloatArray:
        parts = [self._of_rows(z[start : start + ROWS]) for start in range(0, len(z), ROWS)]
        return np.concatenate(parts)

    def _of_rows(self, z: FloatArray) -> FloatArray:
        values, which = self.model_class.values(z[:, :-1]), _numbers(z)
        modes = [
            places.modes(own[:, : len(configuration.structure.parameters)], which)
            for places, (configuration, _, own) in zip(
                self.places, self.model_class.parts(values), strict=True
            )
        ]
        return self.model_class.log_density_of_modes(values, modes)
