"""Mixtures fitted to posterior draws, and the two ensembles whose moves these propose.

The ensembles are the posterior's draws, or check importance draws that suffice.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.ensembles import Ensemble, Walkers, run_ensemble
from bayes_ssi.inference.sampling.importance import (
    ImportanceSample,
    ImportanceSampler,
    ScoredDraws,
)
from bayes_ssi.inference.sampling.mixture import Proposal, StudentMixture
from bayes_ssi.inference.sampling.mixture_fitting import choose_mixture
from bayes_ssi.inference.sampling.settings import (
    CHAINS,
    IMPORTANCE,
    ChainSettings,
    SamplingSettings,
    StepProgress,
    part,
)


@dataclass(frozen=True)
class ProposalFitting:
    """Fits mixtures, each of which is tried out on a batch of importance draws."""

    sampler: ImportanceSampler
    # Components around the maxima of the posterior. Every mixture has them, so that regions that
    # the draws lost are still proposed.
    around_maxima: StudentMixture
    wanted_error: float = SamplingSettings.log_evidence_error  # of the log evidence
    chains: ChainSettings = CHAINS

    def fitted(self, draws: FloatArray, held_out: FloatArray) -> ImportanceSample:
        """Importance draws from a mixture fitted to ``draws`` and judged by ``held_out``."""
        return self.sampler.sample(self._mixture(draws, self._thinned(held_out)))

    def refitted(self, ensembles: Sequence[Ensemble], trial: ImportanceSample) -> ImportanceSample:
        """A trial of a mixture fitted to two ensembles; ``trial`` if that suits their draws better.

        The efficiency of importance draws does not decide: unlike the draws of the ensembles,
        they do not show a region that their mixture lacks.
        """
        draws, held_out = (ensemble.draws for ensemble in ensembles)
        held_out = self._thinned(held_out)
        mixture = self._mixture(draws, held_out).with_prior_component(self.sampler.prior_share)
        if trial.mixture.log_pdf(held_out).mean() >= mixture.log_pdf(held_out).mean():
            return trial
        return self.sampler.sample(mixture)

    def proposal(self, trial: ImportanceSample) -> Proposal:
        """The mixture of ``trial`` as the ensembles' proposal.

        Draws that lost a region leave its component too little weight; the importance draws give
        every component its share.
        """
        mixture = trial.mixture.reweighted(trial.z, trial.weights).with_prior_component()
        # The better the mixture, the less is left for other moves to do.
        return Proposal(mixture, min(0.7 + trial.efficiency, 0.95))

    def serves(self, sample: ImportanceSample) -> bool:
        """Whether importance draws can take the place of long chains.

        A heavy tail of few weights is left to components that are added there.
        """
        return sample.efficiency >= self.chains.least_efficiency

    def is_worth_refitting(self, sample: ImportanceSample) -> bool:
        """Whether a refit may pay: importance draws are poor, or so many more are needed."""
        needed = len(sample.z) * (sample.estimate.error / self.wanted_error) ** 2
        enough = self.chains.most_batches * self.sampler.batch
        return not self.serves(sample) or needed - len(sample.z) > enough

    def _mixture(self, draws: FloatArray, held_out: FloatArray) -> StudentMixture:
        fitted = choose_mixture(self._thinned(draws), held_out, self.sampler.rng)
        mixture = fitted.mixed_with(self.around_maxima)
        if any(self.around_maxima.bends):
            # They may follow a ridge better than what draws are enough to fit.
            mixture = mixture.reweighted(held_out, np.ones(len(held_out)))
        return mixture.widened()

    def _thinned(self, draws: FloatArray) -> FloatArray:
        """As many of the draws as a batch of importance draws has, at random."""
        n = self.sampler.batch
        return draws if len(draws) <= n else self.sampler.rng.choice(draws, n, replace=False)


def run_ensembles(
    walkers: Sequence[Walkers],
    fitting: ProposalFitting,
    trial: ImportanceSample,
    max_steps: int,
    seeds: Sequence[np.random.SeedSequence],
    progress: StepProgress,
    particles: Sequence[ScoredDraws] = (),
) -> tuple[list[Ensemble], ImportanceSample]:
    """Independent ensembles, and importance draws from a mixture that suits the posterior.

    The mixture of ``trial`` proposes the ensembles' moves. Where its importance draws serve as
    posterior draws, and there was no doubt that called for ``particles`` of compressions, short
    chains check them. Otherwise chains become as long as they should, but walkers that mix slowly
    are stopped. Where chains or particles are where importance draws are not, chains continue from
    their positions with a mixture fitted to their draws.
    """
    chains, wanted_error = fitting.chains, fitting.wanted_error
    seeds_of_attempts = zip(*(seed.spawn(chains.most_refits + 1) for seed in seeds), strict=True)
    settled = False
    for attempt, attempt_seeds in enumerate(seeds_of_attempts):
        settled = settled or attempt == chains.most_refits
        proposal = fitting.proposal(trial)
        efficient = fitting.serves(trial)
        checked = efficient and not particles
        if checked:
            proposal = proposal._replace(share=chains.mixture_share_in_check)
        enough = chains.steps_of_check if checked else chains.few_steps if efficient else max_steps
        slowest = math.inf if settled or checked else chains.slow
        ensembles = [
            run_ensemble(
                fitting.sampler.target,
                start,
                proposal,
                min(max_steps, enough),
                seed,
                part(progress, "ensembles", i, 2),
                slowest,
            )
            for i, (start, seed) in enumerate(zip(walkers, attempt_seeds, strict=True))
        ]
        fast = all(ensemble.autocorrelation_times.max() <= slowest for ensemble in ensembles)
        if not fitting.is_worth_refitting(trial):
            # As many draws as the evidence needs, some of them where walkers went.
            most_draws = chains.most_batches * fitting.sampler.batch
            sampler = replace(fitting.sampler, max_draws=most_draws)
            trial = sampler.refined(trial, wanted_error, (*ensembles, *particles))
        missed = trial.share_beyond((*ensembles, *particles))
        agree = trial.pareto_k <= IMPORTANCE.pareto_k_limit and missed <= wanted_error
        if settled or (fast and agree):
            break
        walkers = [ensemble.walkers for ensemble in ensembles]
        before = trial.efficiency
        trial = fitting.refitted(ensembles, trial)
        # Mixtures hardly fit this posterior, but well enough for importance draws.
        settled = efficient and trial.efficiency < chains.least_improvement * before
    if fitting.is_worth_refitting(trial):
        trial = fitting.refitted(ensembles, trial)
    return ensembles, trial
