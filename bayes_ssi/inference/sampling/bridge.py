"""Bridge sampling: the evidence from posterior draws and proposal draws together."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from bayes_ssi.inference.sampling.diagnostics import autocorrelation_times
from bayes_ssi.inference.sampling.ensembles import Ensemble
from bayes_ssi.inference.sampling.estimates import EvidenceEstimate
from bayes_ssi.inference.sampling.importance import ImportanceSample


def bridge_sampling(ensemble: Ensemble, sample: ImportanceSample) -> EvidenceEstimate:
    """Bridge sampling between the posterior draws of an ensemble and those from a mixture.

    The optimal bridge of Meng and Wong (1996); error after Frühwirth-Schnatter (2004), with the
    chain's autocorrelation.

    Args:
        sample: draws from a mixture fitted without ``ensemble``.
    """
    log_proposals = sample.mixture.log_pdf(ensemble.draws)
    posterior = ensemble.log_posteriors - log_proposals.reshape(ensemble.log_posteriors.shape)
    proposal = sample.log_weights
    n_posterior = posterior.size / float(ensemble.autocorrelation_times.max())
    log_s1 = math.log(n_posterior / (n_posterior + proposal.size))
    log_s2 = math.log(proposal.size / (n_posterior + proposal.size))
    log_evidence = sample.estimate.log_evidence
    for _ in range(200):
        from_proposal = proposal - np.logaddexp(log_s1 + proposal, log_s2 + log_evidence)
        from_posterior = -np.logaddexp(log_s1 + posterior, log_s2 + log_evidence)
        updated = float(
            logsumexp(from_proposal)
            - math.log(proposal.size)
            - logsumexp(from_posterior)
            + math.log(posterior.size)
        )
        settled = abs(updated - log_evidence) < 1e-9
        log_evidence = updated
        if settled:
            break
    f1, f2 = (np.exp(terms - terms.max()) for terms in (from_proposal, from_posterior))
    time = float(autocorrelation_times(f2[..., None])[0])
    relative_variance = f1.var() / (f1.mean() ** 2 * f1.size) + time * f2.var() / (
        f2.mean() ** 2 * f2.size
    )
    return EvidenceEstimate("bridge sampling", log_evidence, float(np.sqrt(relative_variance)))
