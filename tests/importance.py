"""Log evidence by adaptive importance sampling with Student's t: one method, and no chains."""

import math

import numpy as np


def coordinates(candidate, values):
    """Standard-normal coordinates (n, d) of parameter values (n, d)."""
    columns = zip(candidate.parameters, np.transpose(values), strict=True)
    return np.column_stack([parameter.prior.to_normal(column) for parameter, column in columns])


def log_evidence(candidate, posterior):
    """Log evidence in nats and its standard error.

    Args:
        candidate: a model class with one region of posterior.
        posterior: name of a parameter → approximate mean and standard deviation.
    """
    rng = np.random.default_rng(1)
    means, sds = np.array([posterior[name] for name in candidate.parameter_names]).T
    d, freedom = len(means), 6.0
    centre = coordinates(candidate, means[None])[0]
    root = np.diag(np.abs(coordinates(candidate, (means + 0.3 * sds)[None])[0] - centre) / 0.3)
    for n in (3000, 3000, 3000, 8000):
        t = rng.standard_normal((n, d)) * np.sqrt(freedom / rng.chisquare(freedom, (n, 1)))
        z = centre + t @ root.T
        log_t = math.lgamma((freedom + d) / 2) - math.lgamma(freedom / 2)
        log_t -= 0.5 * d * math.log(freedom * math.pi) + np.log(np.diag(root)).sum()
        log_t = log_t - 0.5 * (freedom + d) * np.log1p((t**2).sum(1) / freedom)
        log_prior = -0.5 * ((z**2).sum(1) + d * math.log(2.0 * math.pi))
        log_weights = candidate.log_likelihood_at(z) + log_prior - log_t
        weights = np.exp(log_weights - np.nanmax(log_weights))
        mean_weight = weights.mean()
        error = weights.std() / mean_weight / math.sqrt(n)
        estimate = math.log(mean_weight) + np.nanmax(log_weights)
        weights /= weights.sum()
        centre = weights @ z
        root = np.linalg.cholesky((weights * (z - centre).T) @ (z - centre))
    return estimate, error
