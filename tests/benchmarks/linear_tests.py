"""Tests of a structure with linear models and normal errors, whose evidence is known."""

import math

import numpy as np
from scipy.special import logsumexp, ndtri

from bayes_ssi.results.hierarchy.likelihood_fit import fit_likelihood


def linear_tests(y, variances, nuisance=0.3, n_draws=1000, seed=0):
    """One datum y_i ~ N(a_i + nuisance·b_i, variance_i) in each test, a and b with priors N(0, 1).

    Fitted to exact draws and log-likelihoods; the evidence has an error like that of sampling.
    """
    rng = np.random.default_rng(seed)
    fits = []
    for i, (datum, variance) in enumerate(zip(y, variances, strict=True)):
        row = np.array([1.0, nuisance])
        precision = np.outer(row, row) / variance + np.eye(2)
        mean = np.linalg.solve(precision, row * datum / variance)
        spread = np.linalg.cholesky(np.linalg.inv(precision))
        z = mean + rng.standard_normal((n_draws, 2)) @ spread.T
        log_likelihoods = log_normal(datum - z @ row, variance)
        evidence = log_normal(datum, variance + 1.0 + nuisance**2) + rng.normal(0.0, 0.005)
        fits.append(fit_likelihood(z, log_likelihoods, evidence, np.random.default_rng([0, i])))
    return fits


def log_normal(residual, variance):
    return -0.5 * residual**2 / variance - 0.5 * np.log(2.0 * math.pi * variance)


def exact_log_evidence(y, variances, x, *, varies, follows, spread_prior, slope_sd):
    """Quadrature over the standard deviation; the mean and the slope are integrated exactly.

    ``variances`` (n,) are those of the data about a_i.
    """
    middles = (np.arange(4000) + 0.5) / 4000
    spreads = spread_prior.from_normal(ndtri(middles)) if varies else np.zeros(1)
    total = variances + spreads[:, None] ** 2
    design = np.column_stack([np.ones(len(y)), slope_sd * x * follows])
    precision = np.eye(2) + np.einsum("ta,st,tb->sab", design, 1.0 / total, design)
    right = np.einsum("ta,st->sa", design, y / total)
    gained = np.einsum("sa,sa->s", right, np.linalg.solve(precision, right[..., None])[..., 0])
    log_parts = log_normal(y, total).sum(axis=1) + 0.5 * gained
    log_parts -= 0.5 * np.linalg.slogdet(precision)[1]
    return float(logsumexp(log_parts)) - math.log(len(spreads))
