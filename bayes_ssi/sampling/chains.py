"""Two independent ensembles, with proposals that are refitted while walkers mix slowly."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bayes_ssi.sampling.diagnostics import LENGTH_IN_AUTOCORRELATION_TIMES
from bayes_ssi.sampling.ensembles import Ensemble, Walkers, run_ensemble
from bayes_ssi.sampling.importance import ImportanceSample
from bayes_ssi.sampling.proposals import ProposalFitting
from bayes_ssi.sampling.settings import SamplingSettings, StepProgress, part
from bayes_ssi.sampling.target import Target

# Longer chains are not worth their cost where importance draws serve as well. An ensemble that
# needs more steps mixes slowly, and starts again with a better mixture.
FEW_STEPS = 1000
SLOW = FEW_STEPS / LENGTH_IN_AUTOCORRELATION_TIMES
# Most refits of the mixture; they end earlier where importance draws are good enough and a refit
# raises their efficiency by less than this factor.
MAX_REFITS, WORTH_REFITTING = 4, 1.2
# Below this efficiency importance draws are poor: chains are run to their full length, and the
# mixture is finally fitted to their draws.
LEAST_EFFICIENCY = 0.1


def run_ensembles(
    target: Target,
    walkers: Sequence[Walkers],
    fitting: ProposalFitting,
    trial: ImportanceSample,
    settings: SamplingSettings,
    seeds: Sequence[np.random.SeedSequence],
    progress: StepProgress,
) -> tuple[list[Ensemble], ImportanceSample]:
    """Independent ensembles, and importance draws from a mixture that suits the posterior.

    The mixture of ``trial`` proposes the ensembles' moves. Walkers that mix slowly with it are
    stopped, and continue from their positions with a mixture fitted to their draws; so do walkers
    that went where importance draws from the mixture do not.
    """
    seeds_of_attempts = zip(*(seed.spawn(MAX_REFITS + 1) for seed in seeds), strict=True)
    settled = False
    for attempt, attempt_seeds in enumerate(seeds_of_attempts):
        settled = settled or attempt == MAX_REFITS
        slowest = math.inf if settled else SLOW
        efficient = trial.efficiency >= LEAST_EFFICIENCY
        longest = min(settings.max_steps, FEW_STEPS) if efficient else settings.max_steps
        proposal = fitting.proposal(trial)
        ensembles = [
            run_ensemble(
                target, start, proposal, longest, seed, part(progress, "ensembles", i, 2), slowest
            )
            for i, (start, seed) in enumerate(zip(walkers, attempt_seeds, strict=True))
        ]
        fast = all(each.autocorrelation_times.max() <= slowest for each in ensembles)
        if settled or (fast and trial.share_beyond(ensembles) <= settings.log_evidence_error):
            break
        walkers = [each.walkers for each in ensembles]
        before = trial.efficiency
        trial = fitting.refitted(ensembles, trial)
        # Mixtures hardly fit this posterior, but well enough for importance draws.
        settled = efficient and trial.efficiency < WORTH_REFITTING * before
    if _is_worth_refitting(trial, settings, fitting):
        trial = fitting.refitted(ensembles, trial)
    return ensembles, trial


def _is_worth_refitting(
    trial: ImportanceSample, settings: SamplingSettings, fitting: ProposalFitting
) -> bool:
    """Whether importance draws are poor, or so many are needed that a trial of others may pay."""
    needed = len(trial.z) * (trial.estimate.error / settings.log_evidence_error) ** 2
    return trial.efficiency < LEAST_EFFICIENCY or needed > 2 * fitting.sampler.batch


def are_cut_short(ensembles: Sequence[Ensemble], settings: SamplingSettings) -> bool:
    """Whether longer chains than these were allowed, and needed."""
    return settings.max_steps > FEW_STEPS and not all(each.is_long_enough for each in ensembles)
