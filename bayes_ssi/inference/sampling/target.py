"""What is sampled: a log-likelihood over standard-normal coordinates, evaluated in batches."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.inference.workers.cache import Cache
from bayes_ssi.inference.workers.workers import Evaluated, Function, Workers, evaluate

# Points at which a model is asked twice whether it is noisy; by which share they are moved, as what
# a model remembers would show no noise; and how many nats count as rounding then.
POINTS_TO_CHECK, NUDGE, ROUNDING = 3, 1e-13, 1e-5
# Coordinates end here: farther out the prior's density, and the probability that the mapping to
# parameters begins with, vanish in double precision. Proposals with heavy tails go there.
FARTHEST = 38.0
# Positions (n, d) → log density and log-likelihood, (n,) each.
LogDensity = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def log_standard_normal(z: FloatArray) -> FloatArray:
    """log N(z; 0, I), (B,), for ``z`` (B, d)."""
    return -0.5 * np.einsum("bd,bd->b", z, z) - 0.5 * z.shape[1] * np.log(2.0 * np.pi)


class SuggestedStarts(NamedTuple):
    """Where a target that knows its problem expects maxima."""

    z: FloatArray  # (m, d), coordinates near them with a positive likelihood; m may be zero
    n_evaluations: int


@dataclass
class Target:
    """A log-likelihood over coordinates whose prior is N(0, I); counts its evaluations."""

    function: Function  # (B, d) coordinates → (B,) log-likelihoods; row i depends on row i alone
    n_dimensions: int
    workers: Workers | None = None  # where it is evaluated; in this process if None
    cache: Cache | None = None  # what it evaluated in an earlier run
    # Where a search should climb from besides its own draws, which each search calls with its own
    # generator; None where all that is known is the log-likelihood.
    suggest_starts: Callable[[np.random.Generator], SuggestedStarts] | None = None
    # (m, d), near maxima that an earlier search found, which counts as one of the independent
    # searches; None if there was none.
    known_starts: FloatArray | None = None
    # Coordinates (B, d) → parameter values (B, d), of which chains are judged; the coordinates
    # themselves if None.
    parameter_values: Callable[[FloatArray], FloatArray] | None = None
    # Whether hardly any parameter has an influence on it, which is then no reason for doubt.
    is_flat: bool = False
    _number: int = field(default=0, init=False)  # of this model in the cache
    noise: float = field(default=0.0, init=False)  # in nats, where it was measured
    n_evaluations: int = field(default=0, init=False)
    # Points of likelihood zero, as the function raised, returned NaN or lost its worker there.
    n_failed: int = field(default=0, init=False)
    # The point (d,) at which it failed first, and why.
    first_failure: tuple[FloatArray, str] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if self.cache is not None:
            self._number = self.cache.new_model()

    def log_likelihood(self, z: FloatArray) -> FloatArray:
        """The log-likelihood (B,) at ``z`` (B, d); -inf where the function failed.

        It counts as -inf, and is not evaluated, where a coordinate is beyond ``±FARTHEST``.
        """
        beyond = (np.abs(z) > FARTHEST).any(axis=1)
        if beyond.any():
            values = np.full(len(z), -np.inf)
            values[~beyond] = self.log_likelihood(z[~beyond])
            return values
        if not len(z):
            return np.empty(0)
        values, reasons = self._evaluated(z)
        self.n_evaluations += len(z)
        failed = np.isnan(values)
        if failed.any():
            self.n_failed += int(failed.sum())
            if self.first_failure is None:
                row = int(np.argmax(failed))
                # NaN in a batch: evaluated alone, the point may give a reason.
                alone = {} if row in reasons else self._evaluate(z[[row]]).failures
                reason = reasons.get(row) or alone.get(0, "the answer is NaN")
                self.first_failure = (z[row].copy(), reason)
            values = np.where(failed, -np.inf, values)
        if np.isposinf(values).any():
            where = np.array2string(z[np.isposinf(values)][0], precision=3)
            raise ValueError(
                f"the log-likelihood is +inf at coordinates {where}: did an error size go to zero "
                "where the data are fitted exactly? Give it a prior that keeps away from zero, "
                "such as LogNormal"
            )
        return values

    def log_posterior(self, z: FloatArray) -> FloatArray:
        """log-likelihood + log prior density, (B,): the posterior up to the evidence."""
        return self.log_density(z)[0]

    def log_density(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The log posterior and the log-likelihood, (B,) each."""
        values = self.log_likelihood(z)
        return values + log_standard_normal(z), values

    def is_noisy_at(self, z: FloatArray) -> bool:
        """Whether answers differ at the first of ``z`` (n, d) moved in the last digits; kept."""
        z = z[:POINTS_TO_CHECK]
        once, again = self.log_likelihood(np.concatenate([z, z * (1.0 + NUDGE)])).reshape(2, -1)
        with np.errstate(invalid="ignore"):
            noise = float(np.abs(again - once).max())
        self.noise = noise if ROUNDING < noise < np.inf else 0.0
        return self.noise > 0.0

    def suggested(self, rng: np.random.Generator) -> FloatArray:
        """Suggested starts (m, d) of one search; none where nothing suggests any."""
        if self.suggest_starts is None:
            return np.empty((0, self.n_dimensions))
        # A child: what follows is the same whether they are recalled or not.
        (child,) = rng.spawn(1)
        # Of a batch, the points are its key.
        key = child.bit_generator.seed_seq.generate_state(4)
        kept = self.cache.recalled(self._number, key) if self.cache else None
        if kept is None:
            z, n_evaluations = self.suggest_starts(child)
            kept = Evaluated(np.append(z, n_evaluations), {})
            if self.cache:
                self.cache.keep(self._number, key, kept)
        self.n_evaluations += int(kept.values[-1])
        return kept.values[:-1].reshape(-1, self.n_dimensions)

    def _evaluated(self, z: FloatArray) -> Evaluated:
        if self.cache is None:
            return self._evaluate(z)
        return self.cache.evaluated(self._number, z, self._evaluate)

    def _evaluate(self, z: FloatArray) -> Evaluated:
        return (self.workers.evaluate if self.workers else evaluate)(self.function, z)
