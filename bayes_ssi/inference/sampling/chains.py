"""Two independent ensembles: the posterior's draws, or a check of importance draws that suffice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayes_ssi.inference.sampling.diagnostics import LENGTH_IN_AUTOCORRELATION_TIMES, PARETO_K_LIMIT
from bayes_ssi.inference.sampling.ensembles import Ensemble, Walkers, run_ensemble
from bayes_ssi.inference.sampling.importance import ImportanceSample, ScoredDraws
from bayes_ssi.inference.sampling.proposals import ProposalFitting
from bayes_ssi.inference.sampling.settings import SamplingSettings, StepProgress, part
from bayes_ssi.inference.sampling.target import Target

# An ensemble that needs more steps than this mixes slowly, and starts again with a better mixture.
FEW_STEPS = 1000
SLOW = FEW_STEPS / LENGTH_IN_AUTOCORRELATION_TIMES
# Steps of a chain that only checks importance draws. Half of them are local moves, which go where
# the mixture does not: as many as in 500 steps of which the mixture proposes nine tenths.
STEPS_OF_A_CHECK, SHARE_IN_A_CHECK = 100, 0.5
# Most refits of the mixture; they end earlier where a refit raises the efficiency of importance
# draws by less than this factor.
MAX_REFITS, WORTH_REFITTING = 4, 1.2
# Below this efficiency importance draws are poor: chains are run to their full length, and the
# mixture is finally fitted to their draws.
LEAST_EFFICIENCY = 0.1
# A fit of a mixture takes as long as some ten thousand evaluations of a small structure: it pays
# only where more batches of importance draws than this would be needed without it.
MOST_BATCHES = 8


def serves(sample: ImportanceSample) -> bool:
    """Whether importance draws can take the place of long chains.

    A heavy tail of few weights is left to components that are added there.
    """
    return sample.efficiency >= LEAST_EFFICIENCY


def is_worth_refitting(
    sample: ImportanceSample, settings: SamplingSettings, fitting: ProposalFitting
) -> bool:
    """Whether importance draws are poor, or need so many more that a trial of others may pay."""
    needed = len(sample.z) * (sample.estimate.error / settings.log_evidence_error) ** 2
    return not serves(sample) or needed - len(sample.z) > MOST_BATCHES * fitting.sampler.batch


def run_ensembles(
    target: Target,
    walkers: Sequence[Walkers],
    fitting: ProposalFitting,
    trial: ImportanceSample,
    settings: SamplingSettings,
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
    seeds_of_attempts = zip(*(seed.spawn(MAX_REFITS + 1) for seed in seeds), strict=True)
    settled = False
    for attempt, attempt_seeds in enumerate(seeds_of_attempts):
        settled = settled or attempt == MAX_REFITS
        proposal = fitting.proposal(trial)
        efficient = serves(trial)
        checked = efficient and not particles
        if checked:
            proposal = proposal._replace(share=SHARE_IN_A_CHECK)
        enough = STEPS_OF_A_CHECK if checked else FEW_STEPS if efficient else settings.max_steps
        longest = min(settings.max_steps, enough)
        slowest = math.inf if settled or checked else SLOW
        ensembles = [
            run_ensemble(
                target, start, proposal, longest, seed, part(progress, "ensembles", i, 2), slowest
            )
            for i, (start, seed) in enumerate(zip(walkers, attempt_seeds, strict=True))
        ]
        fast = all(each.autocorrelation_times.max() <= slowest for each in ensembles)
        if not is_worth_refitting(trial, settings, fitting):
            # As many draws as the evidence needs, some of them where walkers went.
            sampler = replace(fitting.sampler, max_draws=MOST_BATCHES * fitting.sampler.batch)
            trial = sampler.refined(trial, settings.log_evidence_error, (*ensembles, *particles))
        missed = trial.share_beyond((*ensembles, *particles))
        agree = trial.pareto_k <= PARETO_K_LIMIT and missed <= settings.log_evidence_error
        if settled or (fast and agree):
            break
        walkers = [each.walkers for each in ensembles]
        before = trial.efficiency
        trial = fitting.refitted(ensembles, trial)
        # Mixtures hardly fit this posterior, but well enough for importance draws.
        settled = efficient and trial.efficiency < WORTH_REFITTING * before
    if is_worth_refitting(trial, settings, fitting):
        trial = fitting.refitted(ensembles, trial)
    return ensembles, trial


def are_cut_short(ensembles: Sequence[Ensemble], settings: SamplingSettings) -> bool:
    """Whether longer chains than these were allowed, and needed."""
    return settings.max_steps > STEPS_OF_A_CHECK and not all(e.is_long_enough for e in ensembles)
