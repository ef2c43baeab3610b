"""Estimates of a log evidence, and whether they agree."""

import math
from dataclasses import dataclass, replace

# Estimates that differ by more than this many standard errors of their difference disagree: by
# chance once in 16,000 times.
STANDARD_ERRORS = 4.0


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

    def agrees_with(self, quoted: Estimate) -> bool:
        """Whether the difference from the quoted value is within the errors."""
        if self.error is None:
            return True
        allowed = STANDARD_ERRORS * math.hypot(self.error, quoted.error)
        return abs(self.log_evidence - quoted.log_evidence) <= allowed

    def shifted(self, correction: float, error: float) -> "EvidenceEstimate":
        """This estimate plus a correction that has a standard error of its own."""
        both = None if self.error is None else math.hypot(self.error, error)
        return replace(self, log_evidence=self.log_evidence + correction, error=both)

    def __str__(self) -> str:
        if self.error is None:
            return f"{self.log_evidence:.3f}"
        return str(Estimate(self.log_evidence, self.error))
