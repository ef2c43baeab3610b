"""Diagnostics of chains and importance weights, and estimates of a log evidence."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp, ndtri

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.sampling.settings import CHECKS


def autocorrelation_times(chain: FloatArray) -> FloatArray:
    """Integrated autocorrelation times in steps of a chain (n_steps, n_walkers, k), (k,).

    The autocovariance is averaged over the walkers before it is normalised, and taken about the
    mean of all of them: a walker that does not move then lengthens the time, while emcee's
    estimate, normalised walker by walker, is not defined for it. Summed over the window of Sokal
    (1996), the first M that exceeds five times the estimate. One where all draws are the same.
    """
    n = len(chain)
    centred = chain - chain.mean(axis=(0, 1))
    transformed = np.fft.rfft(centred, n=2 * n, axis=0)
    covariance = np.fft.irfft(np.abs(transformed) ** 2, axis=0)[:n].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = 2.0 * np.cumsum(covariance / covariance[0], axis=0) - 1.0
    beyond = np.arange(n)[:, None] > 5.0 * times
    last = np.where(beyond.any(axis=0), beyond.argmax(axis=0), n - 1)
    at_window = times[last, np.arange(chain.shape[-1])]
    # Rounding may leave a covariance to draws that are all the same.
    differ = np.ptp(chain, axis=(0, 1)) > 0.0
    return np.where(differ & np.isfinite(at_window), np.maximum(at_window, 1.0), 1.0)


def r_hat(chains: Sequence[FloatArray]) -> FloatArray:
    """Rank-normalised split R-hat of each coordinate, (d,) (Vehtari et al. 2021), as in arviz.

    Every chain is split in halves, all draws are replaced by normal scores of their ranks, and the
    spread between the halves is compared with that within; the same for distances from the median.
    The larger of both is returned.

    A chain of n steps with autocorrelation time τ has a mean that scatters: even where all is well,
    R-hat exceeds 1 by about τ/n.

    Args:
        chains: one or more, (n_steps, d); of longer ones the middle is left out.
    """
    n = min(len(chain) for chain in chains) // 2
    halves = np.stack([half for chain in chains for half in (chain[:n], chain[-n:])])
    distances = np.abs(halves - np.median(halves, axis=(0, 1)))
    return np.maximum(_r_hat_of_ranks(halves), _r_hat_of_ranks(distances))


def _r_hat_of_ranks(parts: FloatArray) -> FloatArray:
    """R-hat of normal scores (Blom 1958) of the ranks of ``parts`` (n_parts, n, d); (d,)."""
    size, n = parts[..., 0].size, parts.shape[1]
    columns = parts.reshape(size, -1).T
    ranks = np.array([averaged_ranks(column) for column in columns]).T.reshape(parts.shape)
    scores = ndtri((ranks - 0.375) / (size + 0.25))
    within = scores.var(axis=1, ddof=1).mean(axis=0)
    between = scores.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt((n - 1) / n + between / within)
    moves, differ = np.ptp(parts, axis=1).any(axis=0), np.ptp(parts, axis=(0, 1)) > 0.0
    return np.where(moves, ratio, np.where(differ, np.inf, 1.0))


def averaged_ranks(values: FloatArray) -> FloatArray:
    """Ranks (n,) from 1, those of equal values averaged."""
    _, which, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1.0))[which]


class ParetoTail(NamedTuple):
    """A generalised Pareto distribution fitted to the largest weights."""

    k: float  # its shape; -inf where the tail is flat, NaN where there are too few weights
    scale: float
    threshold: float
    share: float

    def beyond_the_largest(self, n: float) -> float:
        """What weights larger than the largest of ``n`` add to their mean on average.

        The mean excess of the distribution over its (1 - 1/n) quantile; infinite for k >= 1.
        """
        if not -math.inf < self.k < 1.0:
            return 0.0 if self.k < 1.0 else math.inf
        excess = self.scale * math.expm1(self.k * math.log(self.share * n)) / self.k
        beyond = self.threshold + excess + (self.scale + self.k * excess) / (1.0 - self.k)
        return beyond / n


def pareto_tail(weights: FloatArray) -> ParetoTail:
    """The tail of positive weights (n,), by the fit of Zhang and Stephens (2009).

    The tail is the largest min(n/5, 3√n) weights, as for Pareto-smoothed importance sampling,
    whose weak prior, 10 draws at k = 1/2, steadies short tails.
    """
    n = len(weights)
    n_tail = int(min(0.2 * n, 3.0 * math.sqrt(n)))
    if n_tail < 5:
        return ParetoTail(math.nan, math.nan, math.nan, math.nan)
    largest = np.sort(weights)[-n_tail - 1 :]
    threshold, share = float(largest[0]), n_tail / n
    excess = largest[1:] - threshold
    if not excess[-1] > 1e-10 * largest[-1]:
        # Weights that are equal but for rounding.
        return ParetoTail(-math.inf, 0.0, threshold, share)
    n_trials = 30 + int(math.sqrt(n_tail))
    quartile = excess[int(n_tail / 4 + 0.5) - 1]
    if not quartile > 1e-290 * excess[-1]:
        # Too few weights matter for their tail to have a shape.
        return ParetoTail(math.inf, math.inf, threshold, share)
    trials = 1.0 - np.sqrt(n_trials / (np.arange(1, n_trials + 1) - 0.5))
    trials = 1.0 / excess[-1] + trials / (3.0 * quartile)
    shapes = np.log1p(-trials[:, None] * excess).mean(axis=1)
    log_profile = n_tail * (np.log(-trials / shapes) - shapes - 1.0)
    chances = np.exp(log_profile - logsumexp(log_profile))
    mean = float(chances @ trials)
    k = float(np.log1p(-mean * excess).mean())
    return ParetoTail((n_tail * k + 5.0) / (n_tail + 10.0), -k / mean, threshold, share)


@dataclass(frozen=True)
class Estimate:
    """A log evidence with its standard error, in nats."""

    log_evidence: float
    error: float

    def __str__(self) -> str:
        return f"{self.log_evidence:.3f} ± {self.error:.3f}"


@dataclass(frozen=True)
class EvidenceEstimate:
    """An estimate of the log evidence by one method, which checks the quoted one."""

    name: str
    log_evidence: float  # in nats
    # Its standard error; None where it is unknown and nothing is judged by the estimate.
    error: float | None = None
    # A smaller difference from the quoted value is no disagreement, whatever the errors.
    tolerance: float = 0.0

    def agrees_with(self, quoted: Estimate) -> bool:
        """Whether the difference from the quoted value is within the errors or the tolerance."""
        if self.error is None:
            return True
        allowed = max(CHECKS.standard_errors * math.hypot(self.error, quoted.error), self.tolerance)
        return abs(self.log_evidence - quoted.log_evidence) <= allowed

    def shifted(self, correction: float, error: float) -> "EvidenceEstimate":
        """This estimate plus a correction that has a standard error of its own."""
        return replace(
            self,
            log_evidence=self.log_evidence + correction,
            error=None if self.error is None else math.hypot(self.error, error),
        )

    def __str__(self) -> str:
        if self.error is None:
            return f"{self.log_evidence:.3f}"
        return str(Estimate(self.log_evidence, self.error))
