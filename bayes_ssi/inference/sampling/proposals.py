"""Mixtures fitted to posterior draws, which propose ensembles' moves and importance draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.ensembles import Ensemble
from bayes_ssi.inference.sampling.importance import ImportanceSample, ImportanceSampler
from bayes_ssi.inference.sampling.maxima import Maxima
from bayes_ssi.inference.sampling.mixture import Proposal, StudentMixture
from bayes_ssi.inference.sampling.mixture_fitting import choose_mixture


@dataclass(frozen=True)
class ProposalFitting:
    """Fits mixtures, each of which is tried out on a batch of importance draws.

    Attributes:
        maxima: maxima of the posterior. Every mixture has components around them, so that regions
            that the draws lost are still proposed.
    """

    sampler: ImportanceSampler
    maxima: Maxima

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

    def _mixture(self, draws: FloatArray, held_out: FloatArray) -> StudentMixture:
        fitted = choose_mixture(self._thinned(draws), held_out, self.sampler.rng)
        return fitted.mixed_with(self.maxima.as_mixture()).widened()

    def _thinned(self, draws: FloatArray) -> FloatArray:
        """As many of the draws as a batch of importance draws has, at random."""
        n = self.sampler.batch
        return draws if len(draws) <= n else self.sampler.rng.choice(draws, n, replace=False)
