"""Autocorrelation times of chains, and estimates of a log evidence."""

import math
from dataclasses import dataclass, replace

import numpy as np

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
