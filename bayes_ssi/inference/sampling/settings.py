"""How to sample: what users choose."""

import math
from collections.abc import Callable
from dataclasses import dataclass

# Called with the name of a step and the completed share of it.
StepProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class SamplingSettings:
    """How precisely to sample.

    Attributes:
        log_evidence_error: wanted standard error of the log evidence, in nats.
        particles: number in each compression of the prior; None chooses it by the number of
            parameters.
        searches: least number of independent searches for maxima.
        effective_sample_size: that chains should have, of the bulk and of the tails of every
            parameter, as arviz computes it.
        r_hat: the largest rank-normalised split R-hat that chains should have; where it is larger,
            a check fails (Vehtari et al. 2021 ask for 1.01).
        max_steps: longest chain, in steps, burn-in included.
        economical: with emulators of slow structures in their place, which need some hundred
            solutions; structures with small matrices are sampled as they are.

    Raises:
        ValueError: a setting is not positive, R-hat is not above 1, or there are fewer than 8
            particles per parameter.
    """

    log_evidence_error: float = 0.01
    particles: int | None = None
    searches: int = 4
    effective_sample_size: int = 2000
    r_hat: float = 1.01
    max_steps: int = 10_000
    economical: bool = False

    def __post_init__(self) -> None:
        for name in (
            "log_evidence_error", "particles", "searches", "effective_sample_size", "max_steps",
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(
                    f"SamplingSettings: {name} must be positive and finite, got {value!r}"
                )
        if not 1.0 < self.r_hat < math.inf:
            raise ValueError(
                f"SamplingSettings: r_hat must be above 1 and finite, got {self.r_hat!r}"
            )

    def n_particles(self, n_dimensions: int) -> int:
        """The number of particles; ValueError where fewer were requested than these need."""
        if self.particles is None:
            # Of fewer, those at the ends of a thin ridge are lost by chance, level after level: of
            # half as many, so much that errors are twice those claimed.
            return max(1000, 50 * n_dimensions)
        # A quarter of the particles survives a level; to half of those, as many as there are
        # dimensions, the proposals of the others are fitted.
        least = 8 * n_dimensions
        if self.particles < least:
            raise ValueError(
                f"SamplingSettings: particles must be at least {least} for "
                f"{n_dimensions} parameters, got {self.particles!r}"
            )
        return self.particles
